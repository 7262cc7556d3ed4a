"""Experiments: the config of a study, its cells and random streams, and the computation of one unit of work."""

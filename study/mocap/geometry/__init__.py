"""Rigid motion, rotations and the statistics of series: arrays only."""

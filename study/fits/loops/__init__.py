"""Loops in, the same loops compiled out: what every kernel stands on, with small matrices and random numbers."""

"""Figures 2 to 7 of the paper."""

"""Runs: work is cut into units, computed by workers and stored in a folder."""

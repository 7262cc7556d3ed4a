"""Posteriors of single trials by ensemble samplers, and their calibration."""

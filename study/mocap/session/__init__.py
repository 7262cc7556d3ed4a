"""Recordings of one session: several trials merged into one calibration, and its shapes fitted to another recording."""

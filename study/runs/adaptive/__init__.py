"""Adaptive runs: trials are added to a cell until a measure is precise enough."""

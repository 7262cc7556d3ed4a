"""Runs that add trials to a cell until a measure is precise enough."""

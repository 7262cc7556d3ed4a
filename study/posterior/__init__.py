"""Posteriors of single trials by emcee, computed on the same draws as the fits."""

"""Estimators of one's own: registering a function, loading a file or an installed package, and checking properties."""

"""`Samples` in, `Estimates` out: a file for each family of estimators."""

"""Answers of estimators: the arrays that they fill, and the `Fit` and `JointFit` that a user receives."""

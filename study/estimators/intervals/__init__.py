"""Confidence intervals of a sphere's radius and centre that cover where standard errors do not."""

from study.estimators.intervals.interval import Intervals, intervals

__all__ = ["Intervals", "intervals"]

"""The status that a user sees: one rule for every estimator, beside what the estimator says itself."""

import numpy as np

from study.estimators.estimates import Estimates
from study.estimators.intervals import Intervals
from study.estimators.status import Status
from study.sphere.types import Ints


def settled_status(estimates: Estimates, ends: Intervals) -> Ints:
    """Status of each fit (b,), given the intervals of its points at 95 %.

    A rule that admits only fits far from the noise selects those whose curvature came out too large, and intervals of
    such fits do not cover. Intervals of the fits that are bounded do (theory 10.5). So this rule replaces the
    estimator's "ok" and "insignificant"; only an estimate outside its own interval stays insignificant. Failures stay,
    and so does "hinge", whose centre is of another kind.
    """
    own, radius = estimates.status.reshape(-1), estimates.radius.reshape(-1)
    inside = (ends.radius[:, 0] <= radius) & (radius <= ends.radius[:, 1])
    ruled = (own == Status.OK) | (own == Status.INSIGNIFICANT)
    accepted = np.where((own == Status.OK) | inside, Status.OK, own)
    return np.asarray(np.where(ruled, np.where(ends.identified, accepted, Status.WEAKLY_IDENTIFIED), own))

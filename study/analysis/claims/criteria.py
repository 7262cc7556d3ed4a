"""Rules that several claims share: from numbers with their errors to yes, no, or a verdict."""

import math

from study.analysis.claims.claim import Number, Verdict


def within(number: Number, target: float, distance: float) -> bool:
    """True if a number and two standard errors on either side lie within a distance of a target.

    A number without an error, such as a time, is taken as exact.
    """
    error = 0.0 if math.isnan(number.error) else number.error
    return abs(number.value - target) + 2.0 * error <= distance


def is_one(number: Number) -> bool:
    """True if a number is 1 within .1 or three standard errors."""
    return abs(number.value - 1.0) <= max(0.1, 3.0 * number.error)


def on_par(most: Number, least_noise: Number) -> Verdict:
    """Verdict on a ratio that should be 1 everywhere.

    Args:
        most: the greatest ratio; the claim is reproduced if it is at most 1.1, three standard errors allowed.
        least_noise: the ratio at the smallest noise; the claim is partly reproduced if it is 1.
    """
    if most.value - 3.0 * most.error <= 1.1:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if is_one(least_noise) else Verdict.NOT_REPRODUCED

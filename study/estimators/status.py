"""Status of a fit: a number that tables store, with the text that a user reads."""

from enum import IntEnum
from typing import Self


class Worded(IntEnum):
    """Numbers as tables store them, each with a ``text`` for the user."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:  # without a text a member is looked up by its value
        member = int.__new__(cls, value)
        member._value_ = value
        member.text = text
        return member


class Status(Worded):
    """Status of a fit.

    A fit that is not ``OK`` may still hold a number: the status says how far to trust it. Statuses compare equal to
    the integers in `Fit.status`, and `text` explains them: ``Status(2).text``.
    """

    OK = 0, "ok"
    NOT_POSITIVE_DEFINITE = 1, "covariance minus noise is not positive definite: the noise hides the sphere's extent"
    SINGULAR = 2, "the points lie in a plane or a line (or are one point): they leave the centre undetermined"
    NOT_CONVERGED = 3, "the iteration did not converge within its limit of steps"
    AT_BOUND = 4, "the best sphere is a plane: the centre runs away from the points and was stopped at the bound"
    TOO_FEW_POINTS = 5, "fewer than d + 1 points"
    NOT_FINITE = 6, "a coordinate is not finite, or the points are too large or too small to compute with"
    INSIGNIFICANT = 7, "along some direction the points' extent is within the noise: the centre is unreliable"
    HINGE = 8, "the points lie on an arc or in a plane, within the noise: the centre was taken in their plane"
    FAILED = 9, "the estimator raised an exception, or the worker that ran it died"


def explain(status: int) -> str:
    """Text of a status number."""
    return next(member.text for member in Status if member == status)

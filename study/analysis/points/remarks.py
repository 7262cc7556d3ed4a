"""Remarks on fitted points in words: the intervals of radius and centre, outliers, copies."""

import math
from collections.abc import Iterator

from study.estimators import Fit
from study.sphere.types import Floats

LEVEL = 0.95
"""Coverage of the intervals."""
_NAMED = 5
"""Rows of outliers that are named."""


def doubts(fit: Fit) -> Iterator[str]:
    """Lines about points that a fit should not be trusted with: outliers, and rows that repeat earlier ones.

    Rows are counted from 1 and include those with missing coordinates.
    """
    rows, samples = (fit.outliers.nonzero()[0] + 1).tolist(), int(fit.count)
    if rows:
        named = ", ".join(str(row) for row in rows[:_NAMED]) + (" …" if len(rows) > _NAMED else "")
        one = len(rows) == 1
        points = (
            f"1 of {samples} points is an outlier (row"
            if one
            else f"{len(rows)} of {samples} points are outliers (rows"
        )
        it = "it" if one else "them"
        use = f"leaves {it} out" if fit.without_outliers else f"uses {it}; -e robust leaves {it} out"
        yield f"{points} {named}): the fit {use}"
    copies = int(fit.copies)
    if copies:
        repeat = "repeats an earlier one" if copies == 1 else "repeat earlier ones"
        yield f"{copies} of {samples} rows {repeat}: every ± is too small; the intervals count copies once"


def intervals_in_words(fit: Fit, names: list[str]) -> Iterator[str]:
    """Lines with the 95 % intervals of the radius and the centre, which depend on the points alone."""
    low, high = (float(end) for end in fit.interval("radius", LEVEL))
    title = f"{LEVEL:.0%} intervals".replace("%", " %")
    if not math.isfinite(high):
        told = f"radius at least {_digits(low, low)}" if low > 0.0 else "the radius may be anything"
        yield f"{title}: {told}; the points do not bound it, nor the centre"
        return
    parts = [f"radius {_between(low, high)}"]
    parts += [f"{name} {_between(*ends)}" for name, ends in zip(names, fit.interval("center", LEVEL), strict=True)]
    yield f"{title}: {', '.join(parts)}"


def _between(low: float, high: float) -> str:
    low, high = float(low), float(high)
    return f"{_digits(low, high - low)} to {_digits(high, high - low)}"


def _digits(value: float, width: float) -> str:
    """A value to the third digit of a width."""
    if not (math.isfinite(value) and width > 0.0):
        return f"{value:.6g}"
    digits = 2 - math.floor(math.log10(width))
    return f"{value:.{digits}f}" if 0 <= digits <= 12 else f"{value:.6g}"


def interval_numbers(fit: Fit, names: list[str]) -> dict[str, float]:
    """Ends of the intervals by the names of columns, such as radius_low and center_x_high."""
    ends: dict[str, Floats] = {"radius": fit.interval("radius", LEVEL)}
    ends |= {f"center_{name}": pair for name, pair in zip(names, fit.interval("center", LEVEL), strict=True)}
    return {f"{name}_{side}": float(pair[i]) for name, pair in ends.items() for i, side in enumerate(("low", "high"))}

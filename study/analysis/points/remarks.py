"""Remarks on fitted points in words: the intervals of radius and centre, outliers, copies."""

import math
from collections.abc import Iterator

import numpy as np

from study.estimators import Fit
from study.sphere.types import Floats

LEVEL = 0.95
"""Coverage of the intervals."""
_NAMED = 5
"""Rows of outliers that are named."""
_SPARE = 6
"""Points more than d + 1 from which on intervals were measured to cover in ok fits (docs/coverage.md)."""
_ACROSS = 0.3
"""Standard error across a belt, in rms distances of its points from its plane, beyond which intervals are too short."""
_NEAR = 0.3
"""Distance of that plane from the centre, in radii, up to which points are a belt and not a cap."""


def doubts(fit: Fit) -> Iterator[str]:
    """Lines about points that a fit should not be trusted with: outliers, rows that repeat earlier ones, few points.

    Rows are counted from 1 and include those with missing coordinates.
    """
    rows, samples, planned = (fit.outliers.nonzero()[0] + 1).tolist(), int(fit.count), fit.residuals.shape[0]
    infinite = [] if fit.samples is None else np.isinf(fit.samples.points[0]).any(axis=1).nonzero()[0] + 1
    if len(infinite):
        yield f"not finite in {len(infinite)} of {planned} rows, the first of which is row {infinite[0]}"
    if samples < planned:
        yield f"{planned - samples} of {planned} rows lack a coordinate and are left out"
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
        repeat, they = ("repeats an earlier one", "it is") if copies == 1 else ("repeat earlier ones", "they are")
        yield f"{copies} of {samples} rows {repeat}; if {they} no new measurement, every ± is too small"
        yield "for the intervals, rows that repeat an earlier one count once"
    spare = samples - copies - fit.center.shape[0] - 1
    if fit.ok and spare < _SPARE:
        more = "1 point" if spare == 1 else f"{spare} points"
        yield f"only {more} more than a sphere needs, so that the noise can look small by chance: ok may be luck"
    if fit.ok and _is_belt(fit):
        yield "the points lie close to a plane through the centre: its interval across that plane is too short"


def uses_outliers(fit: Fit) -> bool:
    """True if some points are outliers and the fit does not leave them out."""
    return not fit.without_outliers and bool(fit.outliers.any())


def _is_belt(fit: Fit) -> bool:
    """True if the centre is least certain across a plane through it, as far as the points are from that plane."""
    d = fit.center.shape[0]
    covariance = fit.covariance[:d, :d]
    if fit.samples is None or not np.isfinite(covariance).all():
        return False
    values, vectors = np.linalg.eigh(covariance)
    heights = (fit.samples.points[0] - fit.center) @ vectors[:, -1]
    about = abs(np.nanmean(heights)) < _NEAR * fit.radius
    return bool(about and math.sqrt(values[-1]) > _ACROSS * np.nanstd(heights))


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

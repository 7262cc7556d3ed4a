"""Properties that an estimator should have, each a function that says in words how a data set violates it.

They are those that `tests/estimators/test_properties.py` asks of the shipped estimators, with wider tolerances: an
iteration may stop at 1e-8.
"""

from collections.abc import Callable

import numpy as np

from study.estimators.answer.fit import Fit
from study.estimators.own.check_cases import NOISE, CheckCase
from study.estimators.status import Status, explain
from study.sphere.types import Floats

FitPoints = Callable[[Floats, float], Fit]
"""Fits points (…, n, d) with a noise."""
Property = Callable[[FitPoints, CheckCase], str]
"""Says how a data set violates a property; empty if it does not."""
TOLERANCE = 1e-6


def answers(fit: FitPoints, case: CheckCase) -> str:
    """Sound points have the status ok, finite numbers, and a noise variance that is one."""
    found = fit(case.points, NOISE)
    if found.own_status != Status.OK:
        return f"no answer on sound points: {explain(int(found.own_status))}"
    if not (np.all(np.isfinite(found.center)) and np.isfinite(found.radius)):
        return "no answer on sound points: the status is ok, but centre or radius is not finite"
    if not found.noise_variance >= 0.0:
        return f"the noise variance is {float(found.noise_variance):.3g}, and should not be negative"
    return ""


def exact(fit: FitPoints, case: CheckCase) -> str:
    """Points exactly on a sphere give that sphere."""
    found = fit(case.exact, 1e-12)
    return _differs("not exact without noise", found, case.center, 1.0)


def shift(fit: FitPoints, case: CheckCase) -> str:
    """Shifted points have a shifted sphere."""
    by = 100.0 * case.rng.standard_normal(case.dimension)
    one, two = fit(case.points, NOISE), fit(case.points + by, NOISE)
    words = f"does not move with the points: shifted by {np.linalg.norm(by):.3g}"
    return _differs(words, two, one.center + by, float(one.radius), size=100.0)


def rotation(fit: FitPoints, case: CheckCase) -> str:
    """Rotated or mirrored points have a rotated or mirrored sphere."""
    q = np.linalg.qr(case.rng.standard_normal((case.dimension, case.dimension)))[0]
    one, two = fit(case.points, NOISE), fit(case.points @ q.T, NOISE)
    return _differs("does not rotate with the points: rotated", two, one.center @ q.T, float(one.radius))


def scale(fit: FitPoints, case: CheckCase) -> str:
    """Another unit of length gives the same sphere in that unit."""
    one = fit(case.points, NOISE)
    for unit in (1e-3, 1e3):
        two = fit(unit * case.points, unit * NOISE)
        words = f"depends on the unit of length: all lengths times {unit:g}"
        if fault := _differs(words, two, unit * one.center, unit * float(one.radius), size=unit):
            return fault
    return ""


def permutation(fit: FitPoints, case: CheckCase) -> str:
    """The order of the samples does not matter."""
    one, two = fit(case.points, NOISE), fit(case.rng.permutation(case.points), NOISE)
    return _differs("depends on the order of the samples: in another order", two, one.center, float(one.radius))


def batch(fit: FitPoints, case: CheckCase) -> str:
    """A set has the same answer alone and beside others, and its points are left as they are."""
    sets = case.points + 1e-3 * case.rng.standard_normal((3, *case.points.shape))
    before = sets.copy()
    together = fit(sets, NOISE)
    if not np.array_equal(sets, before):
        return "changes the points that it is given"
    for t in range(3):
        alone, place = fit(before[t], NOISE), (together.center[t], float(together.radius[t]))
        if fault := _differs("differs in a batch: fitted alone and beside other sets", alone, *place):
            return fault
    return ""


def repeatable(fit: FitPoints, case: CheckCase) -> str:
    """The same points have the same answer twice, to the last bit."""
    one, two = fit(case.points, NOISE), fit(case.points, NOISE)
    same = np.array_equal(one.center, two.center, equal_nan=True) and np.array_equal(one.radius, two.radius, True)
    return "" if same else "another answer for the same points: use no random numbers but those of a fixed seed"


PROPERTIES: dict[str, Property] = {
    "answers": answers,
    "exact": exact,
    "shift": shift,
    "rotation": rotation,
    "scale": scale,
    "permutation": permutation,
    "batch": batch,
    "repeatable": repeatable,
}
"""The properties of sound data sets, in the order in which they are checked."""


def degenerate(fit: FitPoints, words: str, points: Floats) -> str:
    """Points that determine no sphere raise nothing, and have a status where numbers are not finite."""
    try:
        with np.errstate(all="ignore"):
            found = fit(points, NOISE)
    except Exception as error:
        line = str(error).split("\n")[0]
        return f"raises on {words}: {type(error).__name__}: {line}"
    if found.own_status == Status.OK and not (np.all(np.isfinite(found.center)) and np.isfinite(found.radius)):
        return f"says ok on {words}, and the centre or the radius is not finite: give such fits a status"
    return ""


def _differs(words: str, found: Fit, center: Floats, radius: float, size: float = 1.0) -> str:
    """Words for a sphere that is not the expected one; empty if it is, within the tolerance times the size."""
    limit = TOLERANCE * max(size, abs(radius))
    away = float(np.linalg.norm(found.center - center))
    if not abs(float(found.radius) - radius) <= limit:
        value, expected = float(found.radius), radius
        return f"{words}: the radius is {_number(value, expected)} instead of {_number(expected, value)}"
    if not away <= limit:
        return f"{words}: the centre is {away:.3g} from where it should be, at radius {abs(radius):.3g}"
    return ""


def _number(value: float, beside: float) -> str:
    """A number with as many digits as tell it from another."""
    digits = next((k for k in range(3, 17) if f"{value:.{k}g}" != f"{beside:.{k}g}"), 17)
    return f"{value:.{digits}g}"

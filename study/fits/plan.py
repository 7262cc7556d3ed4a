"""Plan a measurement: how many points on how large a cap an error of centre or radius needs.

The errors are the attainable bound of `errors/attainable.py`. A simulation of the planned points says how often their
fit is ok: a flat cap with the planned error may still look like a plane. A circle in space is planned in its plane.
"""

import math
import operator
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import scipy

from study.fits.errors.attainable import attainable_bound, bound_dimension, one_number
from study.fits.errors.intervals import NOISY
from study.fits.evidence.goodness import fewest_points
from study.fits.evidence.judge import LARGEST_UNSEEN
from study.fits.loops.random import stream
from study.fits.points.cap import sample_cap
from study.fits.registry import fit
from study.fits.space_circle import fit_circle
from study.text import columns, with_error


class FitPlan(NamedTuple):
    """A measurement of a sphere, and the least standard errors that an estimator can have from it.

    Attributes:
        points: number of points N.
        angle: half-angle of the cap, in degrees.
        center_error: standard error of the centre along the cap's axis, in the unit of the noise.
        across_error: of the centre across the axis.
        radius_error: of the radius.
    """

    points: int
    angle: float
    center_error: float
    across_error: float
    radius_error: float


_ROUND = 1e9
"""Radius over noise beyond which errors, in units of the noise, do not change."""
_LARGEST_PLAN = 1e15
"""Number of points beyond which no plan is made."""


def plan_fit(
    noise: float,
    radius: float,
    error: float | None = None,
    *,
    angle: float | None = None,
    points: int | None = None,
    of: str = "center",
    dimension: int = 3,
) -> FitPlan:
    """Plan a measurement: points needed on a cap, the cap needed for so many points, or the error of both.

    Of the error, the angle and the number of points two are given. The errors are those of `study.attainable_bound`
    divided by the number of points: with few points, those of a fit are a little larger. So many points are planned at
    least that their shape is tested: 12 of a circle, 15 of a sphere, 19 in four dimensions.

    Args:
        noise: standard deviation of each coordinate.
        radius: radius of the sphere, in the unit of the noise.
        error: standard error that is wanted, in the unit of the noise; None to compute it.
        angle: half-angle of the cap that is measured, in degrees; None for the smallest that will do.
        points: number of points; None for the smallest that will do.
        of: "center", of which the error is that along the cap's axis, the largest; or "radius".
        dimension: d ≥ 2.

    Raises:
        ValueError: if not two of three are given, a value is out of range, or no cap will do.
        TypeError: if a value is not one number.

    Examples:
        >>> import study
        >>> plan = study.plan_fit(noise=0.1, radius=50, error=0.02, angle=60)
        >>> plan.points, round(plan.radius_error, 3)
        (1201, 0.015)
        >>> round(study.plan_fit(noise=0.1, radius=50, error=0.02, points=400).angle)
        82
    """
    if [error, angle, points].count(None) != 1:
        raise ValueError("a plan needs two of error, angle and points; it finds the third")
    given = {"noise": noise, "radius": radius, "error": error}
    sigma, r, wanted = (_positive(name, value) for name, value in given.items())
    r = min(r, _ROUND * sigma)
    if of not in ("center", "radius"):
        raise ValueError(f"of = {of!r}: plan the error of the 'center' or of the 'radius'")
    fewest, place = fewest_points(bound_dimension(dimension), LARGEST_UNSEEN), 0 if of == "center" else -1
    if points is not None and not fewest <= operator.index(points) < _LARGEST_PLAN:
        words = f"plan with at least {fewest}, from which on their shape is tested, and below {_LARGEST_PLAN:g}"
        raise ValueError(f"points = {points!s:.40}: {words}")

    def variance(half_angle: float) -> float:
        """Variance for one point, in units of the noise."""
        return float(np.diag(attainable_bound(half_angle, sigma / r, dimension))[place]) * (r / sigma) ** 2

    if points is None:
        ratio = sigma / wanted
        needed = variance(angle) * ratio * ratio  # type: ignore[arg-type]
        if not needed < _LARGEST_PLAN:
            raise ValueError(f"error = {wanted:g}: needs {needed:.0e} points; give a larger error or angle")
        points = max(math.ceil(needed * (1.0 - 1e-9)), fewest)
    elif angle is None:
        angle = _least_angle(variance, points * (wanted / sigma) * (wanted / sigma))
    bound = np.sqrt(np.diag(attainable_bound(angle, sigma / r, dimension)) / points) * r  # type: ignore[arg-type]
    return FitPlan(points, float(angle), float(bound[0]), float(bound[1]), float(bound[-1]))  # type: ignore[arg-type]


def _positive(name: str, value: float | None) -> float:
    """Check that an argument that is given is one positive number; NaN for one that is not."""
    if value is not None and not 0.0 < one_number(name, value) < math.inf:
        raise ValueError(f"{name} = {value!r}: must be positive and finite")
    return math.nan if value is None else float(value)


def _least_angle(variance: Callable[[float], float], most: float) -> float:
    """The smallest cap, in degrees, on which the variance for one point is at most this."""
    if not variance(180.0) <= most:
        share = math.sqrt(variance(180.0) / most) if most > 0.0 else math.inf
        remedy = "give more points, or a larger error"
        raise ValueError(f"points: even a whole sphere has an error {share:.3g} times that; {remedy}")

    def excess(logarithm: float) -> float:
        try:
            return math.log(variance(math.exp(logarithm)) / most)
        except ValueError:  # noise hides so small a cap
            return 100.0

    low = math.log(180.0)
    while excess(low) <= 0.0:
        low -= 0.5
    if low == math.log(180.0):
        return 180.0
    return math.exp(scipy.optimize.brentq(excess, low, low + 0.5, xtol=1e-6))


_SETS, _ALL_POINTS, _MOST = 400, 2_000_000, 100_000
"""Sets that are simulated, points of all of them, and points of one beyond which none is."""


def axis_error(plan: FitPlan, noise: float, radius: float) -> float:
    """Least standard error of the axis of a circle in space, in radians, from uniform points on ± ``plan.angle``.

    The plane is a regression of heights on the points in it, whose smaller variance is that along the chord or across.
    """
    a = math.radians(plan.angle)
    across, mean = 0.5 - math.sin(2.0 * a) / (4.0 * a), math.sin(a) / a
    return noise / (radius * math.sqrt(plan.points * min(across, 1.0 - across - mean * mean)))


def ok_share(
    plan: FitPlan, noise: float, radius: float, dimension: int = 3, circle: bool = False
) -> tuple[float, float]:
    """Share of measurements by a plan whose fit is ok, and its Monte-Carlo error.

    Points are uniform on the cap, and their noise is normal. The same plan has the same share in each call. NaN for
    more than 100,000 points.

    Args:
        plan: the measurement.
        noise: standard deviation of each coordinate.
        radius: radius of the sphere, in the unit of the noise.
        dimension: d ≥ 2.
        circle: the points are on an arc in space, and fitted by `study.fit_circle`.
    """
    if plan.points > _MOST:
        return math.nan, math.nan
    sets, rng = min(_SETS, _ALL_POINTS // plan.points), stream(0, "plan")
    directions = sample_cap(rng, sets * plan.points, math.radians(plan.angle), 2 if circle else dimension)
    if circle:
        directions = np.column_stack([directions, np.zeros(len(directions))])
    points = radius * directions + noise * rng.standard_normal(directions.shape)
    share = float(np.mean((fit_circle if circle else fit)(points.reshape(sets, plan.points, -1)).ok))
    held = min(max(share, 1.0 / sets), 1.0 - 1.0 / sets)
    return share, math.sqrt(held * (1.0 - held) / sets)


_LARGE = 1.0 / 3.0
"""Planned error over the radius beyond which a plan is warned of."""
_CAPS = (15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0)
"""Half-angles for which a printed plan gives the number of points."""


def plan_in_words(
    plan: FitPlan, noise: float, radius: float, error: float | None, of: str = "center", circle: bool = False
) -> Iterator[str]:
    """Lines about a plan, and the number of points that other caps, or arcs, need for the same error."""
    center, across, size = (f"{value:.2g}" for value in plan[2:])
    errors = f"centre ± {center} along its axis and ± {across} across it, radius ± {size}"
    cap = "arc" if circle else "cap"
    errors += f", axis ± {axis_error(plan, noise, radius):.2g} rad" if circle else ""
    yield f"{plan.points:,} points on {'an arc of ±' if circle else 'a cap of'} {plan.angle:.3g}°: {errors}"
    yield "± is the least standard error that an estimator can have on so many points (the attainable bound)"
    share, deviation = ok_share(plan, noise, radius, circle=circle)
    if share == share:
        yield f"status ok in {with_error(100.0 * share, 100.0 * deviation)} % of such measurements, by simulation"
    if (largest := max(plan.center_error, plan.radius_error)) > _LARGE * radius:
        yield f"an error of {largest:.2g} is more than a third of the radius: take more points, or a larger {cap}"
    if noise > NOISY * radius:
        yield f"the noise is above {NOISY:g} radii: every fit will be weakly identified, however many points there are"
    if error is None:
        return
    yield ""
    cells = []
    for angle in _CAPS:
        try:
            other = plan_fit(noise, radius, error, angle=angle, of=of, dimension=2 if circle else 3)
            numbers = [f"{other.points:,}", f"{other.center_error:.2g}, {other.radius_error:.2g}"]
        except ValueError:  # the noise hides so small a cap, or too many points are needed
            numbers = ["-", "-"]
        cells.append([f"{'±' * circle}{angle:g}°", *numbers])
    yield from columns(cells, [cap, "points", "errors of centre and radius"])

"""Plan a measurement: how many points on how large a cap an error of centre or radius needs.

The errors are the attainable bound of `errors/attainable.py`. A simulation of the planned points says how often their
fit is ok: a flat cap with the planned error may still look like a plane. A circle in space is planned in its plane.
"""

import math
import operator
from collections.abc import Callable, Iterator
from functools import cache
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


class SimulatedPlan(NamedTuple):
    """Fits of simulated measurements by a plan: NaN for plans of more than 100,000 points.

    Attributes:
        ok_share: share of the measurements whose fit is ok.
        ok_error: its Monte-Carlo error.
        center_error: error of the centre along the cap's axis that 68.3 % of the fits do not exceed, as of ± one
            standard error, in the unit of the noise. Fits that fail count as infinitely far.
        across_error: the same of the centre across the axis.
        radius_error: the same of the radius.
    """

    ok_share: float
    ok_error: float
    center_error: float
    across_error: float
    radius_error: float


class FitPlan(NamedTuple):
    """A measurement of a sphere, and the least standard errors that an estimator can have from it.

    Attributes:
        points: number of points N.
        angle: half-angle of the cap, in degrees.
        center_error: standard error of the centre along the cap's axis, in the unit of the noise.
        across_error: of the centre across the axis.
        radius_error: of the radius.
        noise: standard deviation of each coordinate, as it was given.
        radius: radius of the sphere, as it was given, in the unit of the noise.
        dimension: d of the sphere; 2 for a circle.
        in_space: the points are on an arc in space, which `study.fit_circle` fits.
    """

    points: int
    angle: float
    center_error: float
    across_error: float
    radius_error: float
    noise: float
    radius: float
    dimension: int = 3
    in_space: bool = False

    @property
    def axis_error(self) -> float:
        """Least standard error of the axis of a circle in space, in radians, from uniform points on ± ``angle``.

        The plane is a regression of heights on the points in it, whose smaller variance is along the chord or across.
        """
        a = math.radians(self.angle)
        across, mean = 0.5 - math.sin(2.0 * a) / (4.0 * a), math.sin(a) / a
        return self.noise / (self.radius * math.sqrt(self.points * min(across, 1.0 - across - mean * mean)))

    def simulated(self) -> SimulatedPlan:
        """Fit 400 simulated measurements: how often a fit is ok, and how far it is from the truth.

        Points are uniform on the cap, and their noise is normal. With few points errors are larger than the bound, and
        on a cap whose curvature the noise hides they are smaller. The same plan has the same answer in each call.
        """
        return _simulated(self)


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
        >>> study.plan_fit(noise=0.1, radius=50, angle=60, points=400).simulated().ok_share > 0.95
        True
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
    errors = float(bound[0]), float(bound[1]), float(bound[-1])
    return FitPlan(points, float(angle), *errors, sigma, float(radius), dimension)  # type: ignore[arg-type]


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


_ONE_ERROR = 0.6827
"""Share of normal errors within one standard deviation."""


@cache
def _simulated(plan: FitPlan) -> SimulatedPlan:
    """The answer of `FitPlan.simulated`."""
    if plan.points > _MOST:
        return SimulatedPlan(*[math.nan] * 5)
    sets, rng, radius = min(_SETS, _ALL_POINTS // plan.points), stream(0, "plan"), min(plan.radius, _ROUND * plan.noise)
    directions = sample_cap(rng, sets * plan.points, math.radians(plan.angle), plan.dimension)
    if plan.in_space:
        directions = np.column_stack([directions, np.zeros(len(directions))])
    points = radius * directions + plan.noise * rng.standard_normal(directions.shape)
    found = (fit_circle if plan.in_space else fit)(points.reshape(sets, plan.points, -1))
    share = float(np.mean(found.ok))
    held = min(max(share, 1.0 / sets), 1.0 - 1.0 / sets)
    errors = (found.center[:, 0], found.center[:, 1 : plan.dimension], found.radius - radius)
    sizes = (np.quantile(np.nan_to_num(np.abs(error), nan=np.inf), _ONE_ERROR) for error in errors)
    return SimulatedPlan(share, math.sqrt(held * (1.0 - held) / sets), *map(float, sizes))


_LARGE = 1.0 / 3.0
"""Planned error over the radius beyond which a plan is warned of."""
_CAPS = (15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0)
"""Half-angles for which a printed plan gives the number of points."""


_APART = 1.15
"""Factor between simulated and planned errors from which on both are printed: three Monte-Carlo errors of 400 sets.
Fits of few points err more than the bound says, and fits of caps whose curvature the noise hides err less."""


def plan_in_words(plan: FitPlan, error: float | None, of: str = "center") -> Iterator[str]:
    """Lines about a plan, and the number of points that other caps, or arcs, need for the same error."""
    center, across, size = (f"{value:.2g}" for value in plan[2:5])
    errors, noise, radius = "centre ± {} along its axis and ± {} across it, radius ± {}", plan.noise, plan.radius
    planned = errors.format(center, across, size) + (f", axis ± {plan.axis_error:.2g} rad" if plan.in_space else "")
    cap = "arc" if plan.in_space else "cap"
    yield f"{plan.points:,} points on {'an arc of ±' if plan.in_space else 'a cap of'} {plan.angle:.3g}°: {planned}"
    yield "± is the least standard error that an estimator can have on so many points (the attainable bound)"
    share, deviation, *found = plan.simulated()
    if share == share:
        yield f"status ok in {with_error(100.0 * share, 100.0 * deviation)} % of such measurements, by simulation"
    if any(
        not 1.0 / _APART <= one / least <= _APART for one, least in zip(found, plan[2:5], strict=True) if one == one
    ):
        yield "68 % of these fits are within " + errors.format(*(f"{value:.2g}" for value in found))
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
            other = plan_fit(noise, radius, error, angle=angle, of=of, dimension=plan.dimension)
            numbers = [f"{other.points:,}", f"{other.center_error:.2g}, {other.radius_error:.2g}"]
        except ValueError:  # the noise hides so small a cap, or too many points are needed
            numbers = ["-", "-"]
        cells.append([f"{'±' * plan.in_space}{angle:g}°", *numbers])
    yield from columns(cells, [cap, "points", "errors of centre and radius"])

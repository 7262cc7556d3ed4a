"""Check of one's own estimators: every property on every data set, sound or degenerate, and a report in words.

A property is a function that says in words how a data set violates it. They are those that the tests ask of the shipped
estimators, with wider tolerances: an iteration may stop at 1e-8.
"""

import contextlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

from study.arrays import Floats
from study.fits.answers.answer import Fit
from study.fits.points.samples import Status
from study.fits.registry import LIMIT, OvertimeError, faults_of, fit, in_time, load, one_line, sound_samples

NOISE = 0.01
_SETS = 6


class CheckCase(NamedTuple):
    """One sound data set about a sphere of radius 1.

    Attributes:
        dimension: d.
        number: of samples, N.
        seed: of its random numbers.
        points: with noise `NOISE` (n, d).
        exact: the same without noise (n, d).
        center: of the sphere (d,).
    """

    dimension: int
    number: int
    seed: int
    points: Floats
    exact: Floats
    center: Floats

    @property
    def rng(self) -> np.random.Generator:
        """A generator for further numbers."""
        return np.random.default_rng(1000 + self.seed)

    def __str__(self) -> str:
        return f"d = {self.dimension}, N = {self.number}, seed {self.seed}"


def sound_cases(dimension: int) -> Iterator[CheckCase]:
    """Sound data sets, small ones first: directions spread over the sphere, ten times as far as the noise at least."""
    for seed in range(_SETS):
        rng = np.random.default_rng(seed)
        n = dimension + 5 + 9 * seed
        while True:
            u = rng.standard_normal((n, dimension))
            u /= np.linalg.norm(u, axis=1, keepdims=True)
            if np.linalg.svd(u - u.mean(axis=0), compute_uv=False)[-1] > 0.3 * np.sqrt(n):
                break
        center = rng.standard_normal(dimension)
        exact = center + u
        yield CheckCase(dimension, n, seed, exact + NOISE * rng.standard_normal(u.shape), exact, center)


def degenerate_sets(dimension: int) -> Iterator[tuple[str, Floats]]:
    """Point sets that determine no sphere, or hardly, each with words for it."""
    rng = np.random.default_rng(5)
    plane = rng.standard_normal((12, dimension))
    plane[:, -1] = 0.0
    lines = np.outer(np.arange(12.0), np.ones(dimension))
    yield "12 equal points", np.ones((12, dimension))
    yield "two points, each six times", np.repeat(np.eye(2, dimension), 6, axis=0)
    yield "points on a line", lines
    yield "points in a plane" if dimension == 3 else "points on an axis", plane
    yield f"d + 1 = {dimension + 1} points", rng.standard_normal((dimension + 1, dimension))
    yield "a point at infinity", np.where(lines == 3.0, np.inf, plane)
    yield "coordinates of 1e200", 1e200 * rng.standard_normal((12, dimension))
    yield "coordinates of 1e-200", 1e-200 * rng.standard_normal((12, dimension))


FitPoints = Callable[[Floats, float], Fit]
"""Fits points (…, n, d) with a noise."""
Property = Callable[[FitPoints, CheckCase], str]
"""Says how a data set violates a property; empty if it does not."""
TOLERANCE = 1e-6


def answers(fit: FitPoints, case: CheckCase) -> str:
    """Sound points have the status ok, finite numbers, and a noise variance that is one."""
    answer = fit(case.points, NOISE)
    if answer.estimates.status != Status.OK:
        return f"no answer on sound points: {Status(int(answer.estimates.status)).text}"
    if not (np.all(np.isfinite(answer.center)) and np.isfinite(answer.radius)):
        return "no answer on sound points: the status is ok, but centre or radius is not finite"
    if not answer.estimates.noise_variance >= 0.0:
        return f"the noise variance is {float(answer.estimates.noise_variance):.3g}, and should not be negative"
    return ""


def exact(fit: FitPoints, case: CheckCase) -> str:
    """Points exactly on a sphere give that sphere."""
    answer = fit(case.exact, 1e-12)
    return _differs("not exact without noise", answer, case.center, 1.0)


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


PROPERTIES: tuple[Property, ...] = (answers, exact, shift, rotation, scale, permutation, batch, repeatable)
"""The properties of sound data sets, in the order in which they are checked."""


def degenerate(fit: FitPoints, words: str, points: Floats) -> str:
    """Points that determine no sphere raise nothing, and have a status where numbers are not finite."""
    try:
        with np.errstate(all="ignore"):
            answer = fit(points, NOISE)
    except Exception as error:
        return f"raises on {words}: {one_line(error)}"
    if answer.estimates.status == Status.OK and not (np.all(np.isfinite(answer.center)) and np.isfinite(answer.radius)):
        return f"says ok on {words}, and the centre or the radius is not finite: give such fits a status"
    return ""


def _differs(words: str, answer: Fit, center: Floats, radius: float, size: float = 1.0) -> str:
    """Words for a sphere that is not the expected one; empty if it is, within the tolerance times the size."""
    limit = TOLERANCE * max(size, abs(radius))
    away, value = float(np.linalg.norm(answer.center - center)), float(answer.radius)
    if not abs(value - radius) <= limit:
        return f"{words}: the radius is {_number(value, radius)} instead of {_number(radius, value)}"
    if not away <= limit:
        return f"{words}: the centre is {away:.3g} from where it should be, at radius {abs(radius):.3g}"
    return ""


def _number(value: float, other: float) -> str:
    """A number with as many digits as tell it from another."""
    digits = next((k for k in range(3, 17) if f"{value:.{k}g}" != f"{other:.{k}g}"), 17)
    return f"{value:.{digits}g}"


BUDGET = 20.0
"""Seconds after which no new data set is taken, of all estimators of a file."""


@dataclass(frozen=True)
class CheckReport:
    """Result of a check.

    Attributes:
        estimator: its name.
        violations: a sentence for each violated property, of the first data set that violates it.
        sets: number of sound data sets that were used.
        remarks: what was left out, in words.
    """

    estimator: str
    violations: tuple[str, ...]
    sets: int
    remarks: tuple[str, ...]


def check_file(path: Path, budget: float = BUDGET, limit: float = LIMIT) -> list[CheckReport]:
    """Check the estimators that a file registers.

    Args:
        path: the file.
        budget: seconds after which no new data set is taken; each estimator has its share of them.
        limit: seconds in which a single fit should be done.

    Raises:
        PluginError: if the file cannot be used.
    """
    names = load(path)
    fit(sound_samples(2).points, noise=NOISE)  # compiled code is loaded now, which is not the estimators' time
    with contextlib.redirect_stdout(sys.stderr):
        return [check_estimator(name, budget / len(names), limit) for name in names]


def check_estimator(name: str, budget: float = BUDGET, limit: float = LIMIT) -> CheckReport:
    """Check a registered estimator; see `check_file`."""
    broken = dict[Callable[..., object], str]()
    sets, remarks, place = 0, [], ""
    unable = faults_of(name)
    end = perf_counter() + budget

    def fitted(points: Floats, noise: float) -> Fit:
        try:
            with in_time(limit):
                return fit(points, name, noise, copy=False)  # so that changed points show
        except SystemExit as end:
            raise RuntimeError(one_line(end)) from None

    try:
        for d in (2, 3):
            if d in unable:
                remarks.append(f"d = {d} is left out: {unable[d]}")
                continue
            for case in sound_cases(d):
                if perf_counter() > end:
                    remarks.append(f"stopped after {budget:.3g} s at {case}: the estimator is slow")
                    break
                sets, place = sets + 1, str(case)
                for holds in PROPERTIES:
                    if holds in broken:
                        continue
                    try:
                        words = holds(fitted, case)
                    except Exception as error:
                        words = f"raises on sound points: {one_line(error)}"
                    if words:
                        broken[holds] = f"{words} ({place})"
            for kind, points in degenerate_sets(d):
                if perf_counter() > end:
                    break
                place = f"{kind}, d = {d}"
                if degenerate not in broken and (words := degenerate(fitted, kind, points)):
                    broken[degenerate] = f"{words} (d = {d})"
    except OvertimeError as error:  # every further data set might cost as much
        broken[in_time] = f"{error} ({place}); the check ends here"
    return CheckReport(name, tuple(broken.values()), sets, tuple(remarks))


def printed(reports: list[CheckReport]) -> Iterator[str]:
    """The reports for a terminal: a line per violation, or one that says that there is none."""
    for report in reports:
        for words in report.violations:
            yield f"{report.estimator}: {words}"
        if not report.violations:
            yield f"{report.estimator}: all {len(PROPERTIES) + 1} properties hold on {report.sets} data sets"
        for words in report.remarks:
            yield f"{report.estimator}: {words}"

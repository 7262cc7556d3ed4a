"""Curvatures at which the score was evaluated, with the spheres found there, and the evaluation itself.

A curvature is k = ±1/r₀: positive where the centre lies on the side of the first estimate, negative on the other.
T sign k is nearly linear in k, through the plane at k = 0, while it is far from linear in r₀.
"""

import math
from typing import NamedTuple

from study.estimators.intervals.profile import Cloud, ProfileRoom, Sphere, profile, set_height
from study.estimators.intervals.score import Beside, score
from study.sphere.jit import compiled
from study.sphere.types import Floats

GOOD, WEAK, FAILED = 0, 1, 2
"""A profile was found; the centre is not identified given the radius; there is no profile."""
MOST = 100
"""Largest number of evaluations for one set."""
_IDENTIFIED = 0.2
"""Largest standard error of the centre given the radius, in radii: beyond, plug-in nuisances do not serve."""
_LINEAR = 2.5
"""Ratio of radii up to which the centre is extrapolated along its derivative."""
_TINY = 1e-280
K, T, SLOPE, VARIANCE = 0, 1, 2, 3
"""Columns of `Trail.numbers`: curvature, T sign k, its derivative by k, noise variance."""


class Trail(NamedTuple):
    """Evaluations of one set, in their order.

    Attributes:
        numbers: the columns `K`, `T`, `SLOPE` and `VARIANCE` (MOST, 4).
        vectors: centre, b, standard errors of the centre and their correlations with T (MOST, 4, d).
    """

    numbers: Floats
    vectors: Floats


class Task(NamedTuple):
    """One set and working memory.

    Attributes:
        cloud: the points.
        sphere: the sphere at which the last evaluation ended.
        room: working memory of the profile.
        beside: working memory of the score.
        start: centre of the first estimate (d,), then an empty place for another centre (2, d).
        least: noise variance that counts as none.
    """

    cloud: Cloud
    sphere: Sphere
    room: ProfileRoom
    beside: Beside
    start: Floats
    least: float


@compiled
def _predict(task: Task, trail: Trail, count: int, k: float) -> None:
    """Centre and noise variance at a curvature from those at the nearest curvature before, or the start."""
    center, numbers, vectors = task.start[1], trail.numbers, trail.vectors
    d, r = center.size, 1.0 / abs(k)
    task.sphere.numbers[0] = r
    if count == 0:
        for i in range(d):
            center[i] = task.start[0, i]
        return
    near = 0
    for m in range(count):
        if abs(numbers[m, K] - k) < abs(numbers[near, K] - k):
            near = m
    before, length, bend = 1.0 / abs(numbers[near, K]), 0.0, vectors[near, 1]
    for i in range(d):
        length += bend[i] * bend[i]
    length = max(math.sqrt(length), _TINY)
    ratio = r / before if numbers[near, K] * k > 0.0 else 0.0
    for i in range(d):
        if 1.0 / _LINEAR < ratio < _LINEAR:
            center[i] = vectors[near, 0, i] + bend[i] * (before - r)
        elif ratio > 0.0:
            center[i] = vectors[near, 0, i] + bend[i] / max(length, 1.0) * (before - r)
        else:
            center[i] = bend[i] / length * r
    task.sphere.numbers[2] = numbers[near, VARIANCE]


@compiled
def evaluate(task: Task, trail: Trail, count: int, k: float) -> int:
    """Write the profile and the score at a curvature to place ``count`` of the trail, unless there is no profile.

    Returns:
        `GOOD`, `WEAK` or `FAILED`.
    """
    cloud, sphere, room, beside, start, least = task
    numbers, vectors = trail
    d = start.shape[1]
    _predict(task, trail, count, k)
    set_height(sphere, start[1])
    found, means = profile(cloud, sphere, room, least)
    side = 0.0
    for i in range(d):
        side += sphere.toward[i] * vectors[0, 1, i] if count > 0 else 0.0
    if not found or (k < 0.0 and not side > 0.0):  # it fell back to the side of the estimate
        return FAILED
    at = score(cloud, sphere, room, means, beside)
    if not (abs(at.value) < math.inf and at.slope == at.slope):
        return FAILED
    sign, r = math.copysign(1.0, k), sphere.numbers[0]
    numbers[count, K], numbers[count, T] = k, sign * at.value
    numbers[count, SLOPE], numbers[count, VARIANCE] = -r * r * at.slope, sphere.numbers[2]
    for i in range(d):
        vectors[count, 0, i] = r * sphere.toward[i]
        vectors[count, 1, i] = room.pull[i]
        vectors[count, 2, i], vectors[count, 3, i] = beside.error[i], beside.correlation[i]
    return GOOD if at.spread <= _IDENTIFIED * r else WEAK

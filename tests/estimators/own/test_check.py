"""`study check`: estimators that violate one property each, and the sentence about it."""

import numpy as np
import pytest

import study
from study.estimators.estimates import blank
from study.estimators.own.check import check_estimator, printed


def sound(points):
    """Coope's fit, which has all properties."""
    matrix = np.column_stack([2.0 * points, np.ones(len(points))])
    *center, k = np.linalg.lstsq(matrix, (points**2).sum(axis=1), rcond=None)[0]
    return np.array(center), np.sqrt(k + np.dot(center, center))


def larger(points):
    """A radius that is 2 % too large."""
    center, radius = sound(points)
    return center, 1.02 * radius


def pulled(points):
    """Pulled to the origin."""
    center, radius = sound(points)
    away = np.linalg.norm(center)
    return (center * (1.0 - 0.1 * np.exp(-away)) if away < 1e9 else center), radius


def axes(points):
    """Noisy along the axes: the largest residual's sign along the first one."""
    center, radius = sound(points)
    residual = np.linalg.norm(points - center, axis=1) - radius
    return center + np.ptp(residual) * np.eye(len(center))[0], radius


def metric(points):
    """A limit of the radius in metres."""
    center, radius = sound(points)
    return center, min(radius, 100.0)


def first(points):
    """The first sample counts twice."""
    return sound(np.vstack([points[:1], points]))


def drunk(points):
    """Random numbers."""
    center, radius = sound(points)
    return center, radius * (1.0 + 1e-9 * np.random.default_rng().random())


def negative(samples):
    """A noise variance below 0."""
    result = simple(samples)
    result.noise_variance[:] = -1.0
    return result


def simple(samples):
    """Coope's fit of a batch, without any care."""
    result = blank(samples.shape[0], samples.shape[1])
    for t, x in enumerate(samples.points):
        result.center[t], result.radius[t] = sound(x) if np.all(np.abs(x) < 1e50) else (np.nan, np.nan)
    result.noise_variance[:] = 0.0
    return result


def neighbour(samples):
    """Depends on the number of sets."""
    result = simple(samples)
    result.radius[:] *= 1.0 + 0.001 * (len(result.radius) - 1)
    return result


def touching(samples):
    """Changes the points."""
    result = simple(samples)
    samples.x[:, 0, 0] += 1.0
    return result


def raising(samples):
    """Raises where points are not finite."""
    if not np.all(np.isfinite(samples.points)):
        raise FloatingPointError("infinite")
    return simple(samples)


VIOLATIONS = {
    larger: "not exact without noise: the radius is 1.02 instead of 1 (d = 2, N = 7, seed 0)",
    metric: "depends on the unit of length: all lengths times 1000: the radius is 100 instead of ",
    drunk: "another answer for the same points: use no random numbers but those of a fixed seed (d = 2, N = 7, seed 0)",
    first: "depends on the order of the samples: in another order: the ",
    pulled: "does not move with the points: shifted by ",
    axes: "does not rotate with the points: rotated: the centre is ",
    negative: "the noise variance is -1, and should not be negative (d = 2, N = 7, seed 0)",
    neighbour: "differs in a batch: fitted alone and beside other sets: the radius is ",
    touching: "changes the points that it is given (d = 2, N = 7, seed 0)",
    raising: "raises on a point at infinity: FloatingPointError: infinite (d = 2)",
}
BATCHED = (negative, neighbour, touching, raising)


@pytest.fixture
def reported():
    """The report on a function."""

    def report(function):
        study.register("mine", function, batched=function in BATCHED)
        return check_estimator("mine", budget=1e9)

    return report


def test_a_sound_estimator(reported):
    """Without violations there is one line, with the numbers of properties and data sets."""
    assert list(printed([reported(sound)])) == ["mine: all 9 properties hold on 12 data sets"]


@pytest.mark.parametrize("function", list(VIOLATIONS), ids=lambda f: f.__name__)
def test_a_violation_in_words(reported, function):
    """The property that is violated is said in words, with the first data set that violates it."""
    lines = list(printed([reported(function)]))
    assert any(line.startswith(f"mine: {VIOLATIONS[function]}") for line in lines), lines


def test_circles_alone(reported):
    """An estimator of circles is checked in the plane; the rest is left out, with the reason."""

    def circle(points):
        if points.shape[1] != 2:
            raise ValueError("circles only")
        return sound(points)

    assert list(printed([reported(circle)])) == [
        "mine: all 9 properties hold on 6 data sets",
        "mine: d = 3 is left out: ValueError: circles only",
    ]


def test_a_slow_estimator_has_fewer_data_sets(reported):
    """With no time at all, no data set is taken, and that is said."""
    study.register("mine", sound)
    report = check_estimator("mine", budget=0.0)
    assert report.sets == 0
    assert "the estimator is slow" in report.remarks[0]


def test_shipped_estimators_pass():
    """The checks ask nothing that the shipped closed forms do not have."""
    for name in ("als", "gdke", "taubin"):
        assert check_estimator(name, budget=1e9).violations == ()

"""Properties that every registered estimator must have, on sound data sets.

Sound: caps of 60 to 180 degrees, noise 0.01 r, and directions whose scatter is at least 0.1 r in every direction,
which is ten times the noise. There a relative rounding error ε of the points moves a centre by some ε/0.1² = 100 ε;
the tolerances allow sums of n ≤ 60 samples on top, 10⁴ ε = 2e-12, times the largest coordinate.

Points of extreme size: fitted in a unit of their own, exactly, or refused by a status.

Agreement with other people's software on 200 data sets: scikit-spatial.
"""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from skspatial.objects import Sphere

import study
from study import Status

RELATIVE = 1e4 * np.finfo(float).eps

COARSE = {"lls_single": 1e4 * np.finfo(np.float32).eps}
"""The same for an estimator that computes in single precision."""

DECADES = {"lls_nr": 0.5, "lls_nr_raw": 0.5}
"""Decades by which the unit may change; 6, but for reproductions of a flaw that depends on the unit."""

MORE = {"ugdk_cov": 60}
"""Samples added for an estimator that estimates more than d + 2 numbers."""

EVEN = {"mle_mirror": 0.3}
"""Largest distance of the centroid from the centre, over the radius, with which the start is inside the sphere."""

CASES = st.tuples(st.integers(2, 3), st.integers(0, 56), st.floats(60.0, 180.0), st.integers(0, 2**32 - 1))


def properties(test):
    """Run a test on 15 sound data sets, the same ones each time."""
    return settings(derandomize=True, max_examples=15, deadline=None, database=None)(given(case=CASES)(test))


@pytest.fixture(scope="session", params=[None, pytest.param(4, marks=pytest.mark.slow)], ids=["", "4"])
def sound(on_cap, estimator, request):
    """Make of a case a sound data set on a sphere of radius 1, and a generator for further numbers."""

    def make(case, noise=0.01):
        d, more, angle, seed = case
        d = request.param or d
        rng = np.random.default_rng(seed)
        n = d + 2 + more + MORE.get(estimator, 0)
        points, directions = on_cap(rng, n, angle, d, noise, center=rng.standard_normal(d))
        scatter = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points))
        assume(scatter > 0.1)
        assume(np.linalg.norm(directions.mean(axis=0)) < EVEN.get(estimator, 1.0))
        return points, rng

    return make


def fit(points, estimator, noise=0.01):
    """Fit, and assert that the status is OK."""
    answer = study.fit(points, estimator, noise)
    assert np.all(answer.estimates.status == Status.OK)
    return answer


@pytest.fixture(scope="session")
def assert_same(estimator):
    """Assert that a fit is this one, for a sphere of radius ``scale`` within ``size`` of the origin."""
    relative = COARSE.get(estimator, RELATIVE)

    def check(got, center, radius, variance, scale=1.0, size=10.0):
        np.testing.assert_allclose(got.center, center, rtol=0, atol=relative * size)
        np.testing.assert_allclose(got.radius, radius, rtol=0, atol=relative * size)
        np.testing.assert_allclose(got.estimates.noise_variance, variance, rtol=0, atol=relative * size * scale)

    return check


@properties
def test_shift(sound, assert_same, estimator, case):
    """Shifted points have a shifted sphere."""
    points, rng = sound(case)
    shift = 100.0 * rng.standard_normal(points.shape[1])
    one, two = fit(points, estimator), fit(points + shift, estimator)
    assert_same(two, one.center + shift, one.radius, one.estimates.noise_variance, size=np.abs(shift).max() + 10.0)


@properties
def test_rotation_and_reflection(sound, assert_same, random_rotation, estimator, case):
    """Rotated or mirrored points have a rotated or mirrored sphere."""
    points, rng = sound(case)
    q = random_rotation(rng, points.shape[1])
    one, two = fit(points, estimator), fit(points @ q.T, estimator)
    assert_same(two, one.center @ q.T, one.radius, one.estimates.noise_variance)
    own, same = one.estimates.condition, two.estimates.condition
    np.testing.assert_allclose(same, own, rtol=100 * RELATIVE, atol=100 * RELATIVE)


@properties
def test_scale(sound, assert_same, estimator, case):
    """Another unit of length gives the same sphere in that unit."""
    points, rng = sound(case)
    scale = 10.0 ** (DECADES.get(estimator, 6.0) * rng.uniform(-1, 1))
    one, two = fit(points, estimator), fit(scale * points, estimator, 0.01 * scale)
    expected = scale * one.center, scale * one.radius, scale**2 * one.estimates.noise_variance
    assert_same(two, *expected, scale=scale, size=10.0 * scale)
    own, same = one.estimates.condition, two.estimates.condition
    np.testing.assert_allclose(same, own, rtol=100 * RELATIVE, atol=100 * RELATIVE)


@properties
def test_exact_without_noise(sound, assert_same, estimator, case):
    """Points exactly on a sphere give that sphere."""
    points, _ = sound(case, noise=0.0)
    center = np.random.default_rng(case[3]).standard_normal(points.shape[1])
    answer = fit(points, estimator, 1e-12)
    assert_same(answer, center, 1.0, 0.0)
    assert np.all(answer.estimates.noise_variance >= 0.0)


@properties
def test_permutation(sound, assert_same, estimator, case):
    """The order of the samples does not matter; the noise variance is one, below the sphere's size."""
    points, rng = sound(case)
    one, two = fit(points, estimator), fit(rng.permutation(points), estimator)
    assert 0.0 <= one.estimates.noise_variance < 0.1
    assert_same(two, one.center, one.radius, one.estimates.noise_variance)


@pytest.fixture
def points(rng, on_cap):
    """Points on a cap of a sphere of radius 1."""
    return on_cap(rng, 40, 100.0, noise=0.01, center=0.5)[0]


@pytest.mark.parametrize("name", ["als", "mle", "ugdk"])
@pytest.mark.parametrize("power", [-400, -300, 300, 400])
def test_a_power_of_two_is_exact(points, name, power):
    """Points times 2^k have the sphere times 2^k, to the last bit, because the unit is a power of two itself.

    The points' own unit is one, which changes no bit: their extent lies between 1 and 2.
    """
    points = points / np.abs(points - points[0]).max() * 1.5
    noise = 0.01 if name == "ugdk" else None
    own = study.fit(np.ldexp(points, -1), name, noise and np.ldexp(noise, -1))
    far = study.fit(np.ldexp(points, power), name, noise and np.ldexp(noise, power))
    assert own.ok
    assert far.ok
    np.testing.assert_array_equal(far.center, np.ldexp(own.center, power + 1))
    np.testing.assert_array_equal(far.radius, np.ldexp(own.radius, power + 1))
    np.testing.assert_array_equal(far.estimates.noise_variance, np.ldexp(own.estimates.noise_variance, 2 * power + 2))


def test_a_batch_of_all_sizes(points):
    """Each set of a batch is fitted in its own unit, with missing samples too; ordinary ones keep their bits."""
    scales = np.array([1e-140, 1e-120, 1e-50, 1.0, 1e50, 1e120, 1e140])
    sets = scales[:, None, None] * points
    sets[[1, 3], 5:9, 0] = np.nan
    fit = study.fit(sets)
    assert [Status(int(s)).name for s in fit.status] == ["NOT_FINITE", *["OK"] * 5, "NOT_FINITE"]
    alone = study.fit(points)
    np.testing.assert_allclose(fit.radius[[2, 4, 5]] / scales[[2, 4, 5]], alone.radius, rtol=1e-12)
    np.testing.assert_array_equal(fit.center[3], study.fit(np.delete(points, range(5, 9), axis=0)).center)
    assert np.isnan(fit.radius[[0, -1]]).all()


@pytest.mark.parametrize("scale", [1e-120, 1e120])
def test_given_noise(points, scale):
    """A given Σ is taken in the same unit."""
    noise = np.diag([1e-4, 2e-4, 3e-4])
    one, fit = study.fit(points, "ugdk", noise), study.fit(scale * points, "ugdk", scale**2 * noise)
    assert fit.ok
    np.testing.assert_allclose(fit.center / scale, one.center, rtol=1e-11)
    assert fit.estimates.condition == pytest.approx(float(one.estimates.condition), rel=1e-9)
    np.testing.assert_allclose(fit.standard_errors / scale, one.standard_errors, rtol=1e-9)


def test_noise_of_another_world(points):
    """A noise that is larger or smaller than the points by any factor raises nothing and warns of nothing."""
    assert study.fit(1e-120 * points, "ugdk", 1e120).status == Status.NOT_POSITIVE_DEFINITE
    assert study.fit(1e120 * points, "ugdk", 1e-120).ok


@pytest.mark.parametrize("scale", [1e-120, 1e-60, 1e60])
def test_growing_fits_refuse(points, scale):
    """Moments cannot be scaled afterwards: the status says so, and no number is given."""
    growing = study.Incremental(3)
    growing.update(scale * points)
    fit = growing.fit(study.ESTIMATORS["als"])
    assert fit.status == Status.NOT_FINITE
    assert np.isnan(fit.radius)


@pytest.mark.parametrize("estimator", ["gdke", "lls"])
def test_algebraic_peers(on_cap, estimator):
    """scikit-spatial's best fit agrees to 1e-9 r, on 200 sets: n 5..500, caps 40..180°, noise 0.001..0.05 r."""
    rng = np.random.default_rng(137)
    for _ in range(200):
        n, angle = int(np.exp(rng.uniform(np.log(5), np.log(501)))), rng.uniform(40.0, 180.0)
        radius, noise = rng.uniform(0.5, 37.0), 10 ** rng.uniform(-3, np.log10(0.05))
        center, axis = rng.uniform(-2, 2, 3), rng.standard_normal(3)
        points, _ = on_cap(rng, n, angle, 3, noise * radius, radius, center, axis=axis)
        fit, peer = study.fit(points, estimator), Sphere.best_fit(points)
        np.testing.assert_allclose([*fit.center, fit.radius], [*peer.point, peer.radius], rtol=0, atol=1e-9 * radius)

"""Properties that every registered estimator must have, on sound data sets.

Sound: caps of 60 to 180 degrees, noise 0.01 r, and directions whose scatter is at least 0.1 r in every direction,
which is ten times the noise. There a relative rounding error ε of the points moves a centre by some ε/0.1² = 100 ε;
the tolerances allow sums of n ≤ 60 samples on top, 10⁴ ε = 2e-12, times the largest coordinate.
"""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

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

CASES = st.tuples(st.integers(2, 4), st.integers(0, 56), st.floats(60.0, 180.0), st.integers(0, 2**32 - 1))


def properties(test):
    """Run a test on 15 sound data sets, the same ones each time."""
    return settings(derandomize=True, max_examples=15, deadline=None, database=None)(given(case=CASES)(test))


@pytest.fixture(scope="session")
def sound(on_cap, estimator):
    """Make of a case a sound data set on a sphere of radius 1, and a generator for further numbers."""

    def make(case, noise=0.01):
        d, more, angle, seed = case
        rng = np.random.default_rng(seed)
        points, directions = on_cap(
            rng, d + 2 + more + MORE.get(estimator, 0), angle, d, noise, center=rng.standard_normal(d)
        )
        scatter = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points))
        assume(scatter > 0.1)
        assume(np.linalg.norm(directions.mean(axis=0)) < EVEN.get(estimator, 1.0))
        return points, rng

    return make


def fit(points, estimator, noise=0.01):
    """Fit, and assert that the status is OK."""
    answer = study.fit(points, estimator, noise)
    assert np.all(answer.own_status == Status.OK)
    return answer


@pytest.fixture(scope="session")
def assert_same(estimator):
    """Assert that a fit is this one, for a sphere of radius ``scale`` within ``size`` of the origin."""
    relative = COARSE.get(estimator, RELATIVE)

    def check(got, center, radius, variance, scale=1.0, size=10.0):
        np.testing.assert_allclose(got.center, center, rtol=0, atol=relative * size)
        np.testing.assert_allclose(got.radius, radius, rtol=0, atol=relative * size)
        np.testing.assert_allclose(got.noise_variance, variance, rtol=0, atol=relative * size * scale)

    return check


@properties
def test_shift(sound, assert_same, estimator, case):
    """Shifted points have a shifted sphere."""
    points, rng = sound(case)
    shift = 100.0 * rng.standard_normal(points.shape[1])
    one, two = fit(points, estimator), fit(points + shift, estimator)
    assert_same(two, one.center + shift, one.radius, one.noise_variance, size=np.abs(shift).max() + 10.0)


@properties
def test_rotation_and_reflection(sound, assert_same, random_rotation, estimator, case):
    """Rotated or mirrored points have a rotated or mirrored sphere."""
    points, rng = sound(case)
    q = random_rotation(rng, points.shape[1])
    one, two = fit(points, estimator), fit(points @ q.T, estimator)
    assert_same(two, one.center @ q.T, one.radius, one.noise_variance)
    np.testing.assert_allclose(two.condition, one.condition, rtol=100 * RELATIVE, atol=100 * RELATIVE)


@properties
def test_scale(sound, assert_same, estimator, case):
    """Another unit of length gives the same sphere in that unit."""
    points, rng = sound(case)
    scale = 10.0 ** (DECADES.get(estimator, 6.0) * rng.uniform(-1, 1))
    one, two = fit(points, estimator), fit(scale * points, estimator, 0.01 * scale)
    assert_same(
        two, scale * one.center, scale * one.radius, scale**2 * one.noise_variance, scale=scale, size=10.0 * scale
    )
    np.testing.assert_allclose(two.condition, one.condition, rtol=100 * RELATIVE, atol=100 * RELATIVE)


@properties
def test_exact_without_noise(sound, assert_same, estimator, case):
    """Points exactly on a sphere give that sphere."""
    points, _ = sound(case, noise=0.0)
    center = np.random.default_rng(case[3]).standard_normal(points.shape[1])
    answer = fit(points, estimator, 1e-12)
    assert_same(answer, center, 1.0, 0.0)
    assert np.all(answer.noise_variance >= 0.0)


@properties
def test_permutation(sound, assert_same, estimator, case):
    """The order of the samples does not matter."""
    points, rng = sound(case)
    one, two = fit(points, estimator), fit(rng.permutation(points), estimator)
    assert_same(two, one.center, one.radius, one.noise_variance)


@properties
def test_swapped_coordinates(sound, assert_same, estimator, case):
    """The order of the coordinates does not matter."""
    points, rng = sound(case)
    order = rng.permutation(points.shape[1])
    one, two = fit(points, estimator), fit(points[:, order], estimator)
    assert_same(two, one.center[order], one.radius, one.noise_variance)


@properties
def test_batched_equals_looped(sound, estimator, case):
    """A set's answer is, to the last bit, the same alone and beside other sets."""
    points, rng = sound(case)
    batch = points + 1e-3 * rng.standard_normal((3, *points.shape))
    together = study.fit(batch, estimator, 0.01)
    for t in range(3):
        alone = study.fit(batch[t], estimator, 0.01)
        for name, one, whole in zip(study.Estimates._fields, alone.estimates, together.estimates, strict=True):
            np.testing.assert_array_equal(one, whole[t], err_msg=name)


@properties
def test_noise_variance_is_a_variance(sound, estimator, case):
    """The noise variance is finite, not negative and below the sphere's size."""
    points, _ = sound(case)
    assert 0.0 <= fit(points, estimator).noise_variance < 0.1

"""Points of extreme size: fitted in a unit of their own, exactly, or refused by a status."""

import numpy as np
import pytest

import study
from study import Status


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
    np.testing.assert_array_equal(far.noise_variance, np.ldexp(own.noise_variance, 2 * power + 2))


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


@pytest.mark.parametrize("shape", [0.02, np.diag([1e-4, 2e-4, 3e-4])])
@pytest.mark.parametrize("scale", [1e-120, 1e120])
def test_given_noise(points, scale, shape):
    """A given σ or Σ is taken in the same unit."""
    noise = scale * shape if np.ndim(shape) == 0 else scale**2 * shape
    one, fit = study.fit(points, "ugdk", shape), study.fit(scale * points, "ugdk", noise)
    assert fit.ok
    np.testing.assert_allclose(fit.center / scale, one.center, rtol=1e-11)
    assert fit.condition == pytest.approx(float(one.condition), rel=1e-9)
    np.testing.assert_allclose(fit.standard_errors / scale, one.standard_errors, rtol=1e-9)


def test_noise_of_another_world(points):
    """A noise that is larger or smaller than the points by any factor raises nothing and warns of nothing."""
    assert study.fit(1e-120 * points, "ugdk", 1e120).status == Status.NOT_POSITIVE_DEFINITE
    assert study.fit(1e120 * points, "ugdk", 1e-120).ok


@pytest.mark.parametrize("scale", [1e-120, 1e120])
def test_several_markers(rng, on_cap, scale):
    """`mgdk` scales all markers together."""
    markers = [on_cap(rng, 30, 100.0, noise=0.01, radius=r)[0] for r in (0.5, 2.0)]
    for noise in (None, 0.01):
        one = study.mgdk(markers, noise)
        fit = study.mgdk([scale * marker for marker in markers], None if noise is None else scale * noise)
        assert fit.ok
        np.testing.assert_allclose(fit.center / scale, one.center, rtol=0, atol=1e-11)
        np.testing.assert_allclose(fit.radii / scale, one.radii, rtol=1e-11)
        np.testing.assert_allclose(fit.standard_errors / scale, one.standard_errors, rtol=1e-8)
    assert study.mgdk([1e-150 * marker for marker in markers]).status == Status.NOT_FINITE


@pytest.mark.parametrize("scale", [1e-120, 1e-60, 1e60])
def test_growing_fits_refuse(points, scale):
    """Moments cannot be scaled afterwards: the status says so, and no number is given."""
    growing = study.Incremental(3)
    growing.update(scale * points)
    fit = growing.fit(study.ESTIMATORS["als"])
    assert fit.status == Status.NOT_FINITE
    assert np.isnan(fit.radius)

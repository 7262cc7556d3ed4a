"""Data that determine no sphere: a status and NaN, no exception, no warning, and no effect on other sets."""

import numpy as np
import pytest

import study
from study import Status

FLAWED = ("lls_nr", "lls_nr_raw", "lls_single")


@pytest.fixture(scope="module", params=[name for name in study.ESTIMATORS if name not in FLAWED])
def careful(request):
    """Each estimator but those that reproduce a flaw: a cut gives the least norm, single precision has little range."""
    return request.param


def assert_lost(fit, status, names):
    """Assert that the fit has this status and no numbers that could be taken for an answer."""
    assert names == [status.name] * len(names)
    assert np.isnan(fit.center).all()
    assert np.isnan(fit.radius).all()


def assert_plane(fit, estimator, names):
    """Assert that a plane is recognised; `hinge` alone then has an answer, in the plane."""
    if estimator == "hinge":
        assert names == ["HINGE"] * len(names)
        assert np.isfinite(fit.center).all()
    else:
        assert_lost(fit, Status.SINGULAR, names)


def assert_others(fit, clean, bad):
    """Assert that all but the bad sets have the answers of the clean batch."""
    for name in ("center", "radius", "noise_variance", "status"):
        one, two = (np.delete(getattr(f, name), bad, axis=0) for f in (fit, clean))
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("value", [np.inf, -np.inf])
@pytest.mark.parametrize("n", [6, 30, 700])
def test_not_finite(rng, on_cap, estimator, status_of, value, n):
    """One infinite coordinate, wherever it stands, loses its own set and no other."""
    points = on_cap(rng, n, noise=0.01, sets=9)[0]
    clean = study.fit(points, estimator, noise=0.01)
    places = [(0, 0, 0), (2, n // 2, 1), (5, n - 1, 2), (7, n - 1, 0)]
    for place in places:
        points[place] = value
    fit = study.fit(points, estimator, noise=0.01)
    bad = [place[0] for place in places]
    assert [status_of(fit)[t] for t in bad] == ["NOT_FINITE"] * 4
    assert np.isnan(fit.center[bad]).all()
    assert np.isnan(fit.radius[bad]).all()
    assert_others(fit, clean, bad)


@pytest.mark.parametrize("n", [12, 700])
def test_missing_samples(rng, on_cap, estimator, n):
    """A row with a NaN is a missing sample: the fit is that of the rest, and other sets are not affected."""
    points = on_cap(rng, n, noise=0.01, sets=6)[0]
    clean = study.fit(points, estimator, noise=0.01)
    points[1, 3, 0] = points[1, n - 1, 2] = points[4, 0, 1] = np.nan
    fit = study.fit(points, estimator, noise=0.01)
    np.testing.assert_array_equal(fit.count, [n, n - 2, n, n, n - 1, n])
    for t in (1, 4):
        rest = study.fit(points[t][~np.isnan(points[t]).any(axis=1)], estimator, noise=0.01)
        np.testing.assert_allclose(fit.center[t], rest.center, rtol=0, atol=1e-12)
        assert fit.radius[t] == pytest.approx(float(rest.radius), abs=1e-12)
        assert fit.status[t] == rest.status
    assert_others(fit, clean, [1, 4])


def test_too_few_left(rng, on_cap, estimator, status_of):
    """With fewer than d + 1 samples left the status is TOO_FEW_POINTS."""
    points = on_cap(rng, 6, noise=0.01, sets=3)[0]
    points[0, :3, 1] = np.nan
    points[2] = np.nan
    fit = study.fit(points, estimator, noise=0.01)
    assert [status_of(fit)[t] for t in (0, 2)] == ["TOO_FEW_POINTS"] * 2
    assert np.isnan(fit.center[[0, 2]]).all()


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e150, 1e200, 1e300])
def test_too_large_or_small(rng, on_cap, estimator, status_of, scale):
    """Coordinates whose squares come near the ends of float64 are refused by the status of infinite ones."""
    fit = study.fit(scale * on_cap(rng, 20, noise=0.01)[0], estimator, noise=0.01)
    assert_lost(fit, Status.NOT_FINITE, status_of(fit))


@pytest.mark.parametrize("scale", [1e-125, 1e-60, 1e-30, 1e30, 1e60, 1e125])
def test_units_are_free(rng, on_cap, careful, status_of, scale):
    """Any unit gives the same sphere, and the same standard errors."""
    points = on_cap(rng, 100, noise=0.01)[0]
    one = study.fit(points, careful, noise=0.01)
    fit = study.fit(scale * points, careful, noise=0.01 * scale)
    assert status_of(fit) == ["OK"]
    np.testing.assert_allclose(fit.center / scale, one.center, rtol=0, atol=1e-12)
    assert fit.radius / scale == pytest.approx(float(one.radius), rel=1e-12)
    assert fit.noise_variance / scale**2 == pytest.approx(float(one.noise_variance), rel=1e-9)
    np.testing.assert_allclose(fit.standard_errors / scale, one.standard_errors, rtol=1e-9)
    np.testing.assert_allclose(fit.residuals / scale, one.residuals, rtol=0, atol=1e-11)


@pytest.mark.parametrize("point", [0.0, 1.0, 0.1, -123.456])
def test_identical_points(careful, status_of, point):
    """Points that are all the same determine nothing."""
    fit = study.fit(np.full((3, 8, 3), point), careful, noise=0.01)
    assert_lost(fit, Status.SINGULAR, status_of(fit))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_coordinate_plane(rng, on_cap, careful, status_of, axis):
    """Points with one coordinate in common lie in a plane."""
    points = on_cap(rng, 12, noise=0.1, sets=5)[0]
    points[:, :, axis] = 0.7
    fit = study.fit(points, careful, noise=0.01)
    assert_plane(fit, careful, status_of(fit))


@pytest.mark.parametrize("n", [4, 20, 1000])
@pytest.mark.parametrize("offset", [0.0, 10.0])
def test_any_plane(rng, random_rotation, careful, status_of, offset, n):
    """Points of a plane are recognised in any orientation and place, in spite of rounding."""
    sets = []
    for _ in range(100):
        angle = rng.uniform(0, 2 * np.pi, n)
        flat = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
        sets.append(flat @ random_rotation(rng, 3) + offset * rng.standard_normal(3))
    fit = study.fit(np.array(sets), careful, noise=1e-3)
    assert_plane(fit, careful, status_of(fit))


@pytest.mark.parametrize("d", [2, 3])
def test_line(careful, status_of, d):
    """Points of a line determine nothing, not even a circle in a plane."""
    fit = study.fit(np.outer(np.arange(9.0), np.arange(1, d + 1)) + 0.3, careful, noise=0.01)
    assert_lost(fit, Status.SINGULAR, status_of(fit))


def test_lost_sets_have_no_noise_and_no_condition(rng, random_rotation, careful):
    """A set without a sphere has no noise estimate and no condition below 1."""
    points = np.zeros((40, 9, 3))
    for t in range(2, 40):
        points[t] = rng.standard_normal((9, 3)) * [1, 1, 0] @ random_rotation(rng, 3)
    points[1, 4, 1] = np.inf
    fit = study.fit(points, careful, noise=0.01)
    lost = np.isin(fit.status, [Status.SINGULAR, Status.NOT_FINITE])
    assert np.all(lost) or careful == "hinge"
    assert careful == "ugdk" or np.isnan(fit.noise_variance[lost]).all()
    assert not np.any(fit.condition[lost] < 1.0)

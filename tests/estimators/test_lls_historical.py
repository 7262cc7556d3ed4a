"""Least squares of the paper's time: small singular values cut, and single precision, with these flaws alone."""

import numpy as np
import pytest

import study
from study import Status

CENTERS = [0.0, 1.0, 5.0]
EPS = float(np.finfo(np.float32).eps)
LARGEST = float(np.finfo(np.float32).max)


@pytest.mark.parametrize("x", CENTERS)
@pytest.mark.parametrize("angle", [0.05, 0.01])
def test_centred_cut_puts_the_answer_on_the_sphere(rng, on_cap, angle, x):
    """On a tiny cap the centred design loses the axis: the centre is the centroid, one radius off (theory §4)."""
    points = on_cap(rng, 40, angle, center=[x, 0.0, 0.0])[0]
    fit = study.fit(points, "lls_nr")
    np.testing.assert_allclose(fit.center, points.mean(axis=0), rtol=0, atol=1e-3)
    assert np.linalg.norm(study.fit(points, "lls").center - [x, 0.0, 0.0]) < 1e-5


@pytest.mark.parametrize("x", CENTERS)
@pytest.mark.parametrize("angle", [0.05, 0.01])
def test_uncentred_cut_takes_the_least_norm(rng, on_cap, angle, x):
    """All points nearly at p: of all solutions of β·p + β₀ = |p|² the shortest has the centre β/2 = ½p|p|²/(|p|² + 1).

    Half way to the sphere (theory §4) where |p| is large against the unit of length, and not otherwise.
    """
    p = x + 1.0
    fit = study.fit(on_cap(rng, 40, angle, center=[x, 0.0, 0.0])[0], "lls_nr_raw")
    np.testing.assert_allclose(fit.center, [0.5 * p**3 / (p**2 + 1), 0.0, 0.0], rtol=0, atol=1e-3)


@pytest.mark.parametrize("name", ["lls_nr", "lls_nr_raw"])
@pytest.mark.parametrize("noise", [1e-9, 0.05])
def test_sound_sets_are_not_cut(rng, on_cap, noise, name):
    """On caps of 60° and more nothing is cut and the answer is that of `lls`."""
    points = on_cap(rng, 30, 60.0, noise=noise, center=1.0, sets=50)[0]
    np.testing.assert_allclose(study.fit(points, name).center, study.fit(points, "lls").center, rtol=0, atol=1e-11)


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("noise", [1e-3, 0.1])
def test_same_fit_as_lls(rng, on_cap, d, noise):
    """On sound sets the answers are those of `lls` to some hundred single-precision roundings, and not to fewer.

    Normal equations square the condition of the design, which is below 10 here.
    """
    points = on_cap(rng, 50, 120.0, d, noise, radius=5.0, center=3.0, sets=100)[0]
    one, two = study.fit(points, "lls"), study.fit(points, "lls_single")
    assert np.all(two.own_status == Status.OK)
    np.testing.assert_allclose(two.center, one.center, rtol=0, atol=5.0 * 1000 * EPS)
    np.testing.assert_allclose(two.radius, one.radius, rtol=1000 * EPS)
    assert np.abs(two.center - one.center).max() > EPS


@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_floor(rng, on_cap, offset):
    """Without noise the error is that of single precision, for any origin: above 1e-8 r, below 1e-5 r."""
    center = np.full(3, offset)
    points = on_cap(rng, 50, 90.0, center=center, sets=100)[0]
    error = np.linalg.norm(study.fit(points, "lls_single").center - center, axis=1)
    assert 1e-8 < np.median(error) < 1e-5


def test_range(rng):
    """The status is not finite where, and nearly only where, a sum of third powers leaves the range.

    Sums of signed terms overflow between the largest term and the sum of sizes; sets in between are left out.
    """
    points = rng.standard_normal((400, 20, 3)) * np.geomspace(1e10, 1e15, 400)[:, None, None]
    y = points - points.mean(axis=1, keepdims=True)
    terms = np.abs(y) * np.sum(y**2, axis=2, keepdims=True)
    lost = terms.max(axis=(1, 2)) > LARGEST
    safe = terms.sum(axis=1).max(axis=1) < LARGEST
    fit = study.fit(points, "lls_single")
    assert min(lost.sum(), safe.sum()) > 100
    assert np.all(fit.own_status[lost] == Status.NOT_FINITE)
    assert np.isnan(fit.center[lost]).all()
    assert np.isnan(fit.radius[lost]).all()
    assert np.all(fit.own_status[safe] == Status.OK)
    assert np.isfinite(fit.center[safe]).all()
    assert np.all(study.fit(points, "lls").own_status == Status.OK)


def test_no_bare_nan(rng, on_cap):
    """A set without an answer in single precision has a status that says so, and the others keep theirs."""
    points = on_cap(rng, 30, noise=0.01, sets=5)[0]
    clean = study.fit(points, "lls_single")
    points[1] *= 1e25
    points[2] = points[2, 0]
    points[3] *= 1e-30
    fit = study.fit(points, "lls_single")
    assert list(fit.own_status) == [Status.OK, Status.NOT_FINITE, Status.SINGULAR, Status.SINGULAR, Status.OK]
    assert list(np.isnan(fit.center).all(axis=1)) == [False, True, True, True, False]
    np.testing.assert_array_equal(fit.center[[0, 4]], clean.center[[0, 4]])


@pytest.mark.parametrize(("angle", "status"), [(0.01, Status.SINGULAR), (1.0, Status.OK)])
def test_tiny_caps_are_planes(rng, on_cap, angle, status):
    """A cap whose smallest variance is below single rounding of the largest, φ²/12 < 3ε at .1°, is a plane."""
    fit = study.fit(on_cap(rng, 50, angle, sets=20)[0], "lls_single")
    assert np.all(fit.own_status == status)


def test_memory_order_does_not_matter(rng, on_cap):
    """The answer is, to the last bit, the same for points in either order in memory."""
    points = on_cap(rng, 333, 100.0, noise=0.05, sets=7)[0]
    one, two = study.fit(points, "lls_single"), study.fit(np.asfortranarray(points), "lls_single")
    np.testing.assert_array_equal(one.center, two.center)

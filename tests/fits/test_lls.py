"""Linear least squares: Kåsa's fit by orthogonal factorisation.

Least squares of the paper's time: small singular values cut, and single precision, with these flaws alone.

The cut of the textbook's least squares: at its tolerance, against LAPACK with the same one.
"""

import numpy as np
import pytest

import study
from study import Status

EPS = np.finfo(float).eps


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("n", [6, 511, 512, 513, 1024, 1025, 3000])
def test_against_lapack(rng, on_cap, n, d):
    """The chunked triangle gives what NumPy's SVD gives on the whole system, on both sides of a chunk's end."""
    points = on_cap(rng, n, 120.0, d, noise=0.05, radius=3.0, center=1.0)[0]
    design = np.column_stack([np.ones(n), points])
    beta = np.linalg.lstsq(design, np.sum(points**2, axis=1), rcond=None)[0]
    fit = study.fit(points, "lls")
    np.testing.assert_allclose(fit.center, beta[1:] / 2, rtol=0, atol=1e-12)
    assert fit.radius == pytest.approx(np.sqrt(beta[0] + np.sum(beta[1:] ** 2) / 4), rel=1e-12)


@pytest.mark.parametrize("estimator", ["lls", "gdke"])
@pytest.mark.parametrize("angle", [20.0, 1.0, 0.2])
@pytest.mark.parametrize("n", [50, 2000])
def test_rounding_on_small_caps(rng, on_cap, estimator, angle, n):
    """Without noise the error stays below 10 ε(|c| + r)/φ²: the power two of an orthogonal or twice-centred fit.

    Normal equations of raw coordinates lose ε/φ⁴: 4e-7 at 1° where this allows 2e-11 (theory §7).
    """
    center = np.array([2.0, 0.0, 0.0])
    points = on_cap(rng, n, angle, center=center, sets=30)[0]
    error = np.linalg.norm(study.fit(points, estimator).center - center, axis=1)
    assert np.median(error) < 10 * EPS * 3 / np.radians(angle) ** 2


def test_far_origin(rng, on_cap):
    """A distant origin costs no more than the data's own rounding, ε|c|, amplified by the fit."""
    points = on_cap(rng, 900, 60.0, sets=20)[0]
    far = np.array([1e6, -2e6, 5e5])
    fit = study.fit(points + far, "lls")
    assert np.abs(fit.center - far).max() < 100 * EPS * 2e6


SINGLE = float(np.finfo(np.float32).eps)

LARGEST = float(np.finfo(np.float32).max)


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("noise", [1e-3, 0.1])
def test_same_fit_as_lls(rng, on_cap, d, noise):
    """On sound sets the answers are those of `lls` to some hundred single-precision roundings, and not to fewer.

    Normal equations square the condition of the design, which is below 10 here.
    """
    points = on_cap(rng, 50, 120.0, d, noise, radius=5.0, center=3.0, sets=100)[0]
    one, two = study.fit(points, "lls"), study.fit(points, "lls_single")
    assert np.all(two.estimates.status == Status.OK)
    np.testing.assert_allclose(two.center, one.center, rtol=0, atol=5.0 * 1000 * SINGLE)
    np.testing.assert_allclose(two.radius, one.radius, rtol=1000 * SINGLE)
    assert np.abs(two.center - one.center).max() > SINGLE


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
    assert np.all(fit.estimates.status[lost] == Status.NOT_FINITE)
    assert np.isnan(fit.center[lost]).all()
    assert np.isnan(fit.radius[lost]).all()
    assert np.all(fit.estimates.status[safe] == Status.OK)
    assert np.isfinite(fit.center[safe]).all()
    assert np.all(study.fit(points, "lls").estimates.status == Status.OK)


def test_no_bare_nan(rng, on_cap):
    """A set without an answer in single precision has a status that says so, and the others keep theirs."""
    points = on_cap(rng, 30, noise=0.01, sets=5)[0]
    clean = study.fit(points, "lls_single")
    points[1] *= 1e25
    points[2] = points[2, 0]
    points[3] *= 1e-30
    fit = study.fit(points, "lls_single")
    assert list(fit.estimates.status) == [Status.OK, Status.NOT_FINITE, Status.SINGULAR, Status.SINGULAR, Status.OK]
    assert list(np.isnan(fit.center).all(axis=1)) == [False, True, True, True, False]
    np.testing.assert_array_equal(fit.center[[0, 4]], clean.center[[0, 4]])


@pytest.mark.parametrize(("angle", "status"), [(0.01, Status.SINGULAR), (1.0, Status.OK)])
def test_tiny_caps_are_planes(rng, on_cap, angle, status):
    """A cap whose smallest variance is below single rounding of the largest, φ²/12 < 3ε at .1°, is a plane."""
    fit = study.fit(on_cap(rng, 50, angle, sets=20)[0], "lls_single")
    assert np.all(fit.estimates.status == status)


TOLERANCE = {"lls_nr": 1e-5, "lls_nr_raw": 1e-6}


def designs(points, name):
    """The columns (x, 1) of each set, centred for `lls_nr`, and their origin."""
    origin = points.mean(axis=1, keepdims=True) if name == "lls_nr" else np.zeros_like(points[:, :1])
    x = points - origin
    return np.concatenate([x, np.ones((*points.shape[:2], 1))], axis=2), origin[:, 0]


@pytest.mark.parametrize("name", TOLERANCE)
def test_cut_at_the_tolerance(on_cap, name):
    """On both sides of the edge the answer is LAPACK's least-norm one with that tolerance, and not the other's.

    LAPACK (gelsd) cuts by the same rule, rcond times the largest; sets within 1e-3 of the edge are left out. 400 sets
    without noise lie on caps of 1e-3 to 60 degrees of random position.
    """
    rng, sets = np.random.default_rng(22), []
    radii = 10 ** rng.uniform(-0.3, 1.57, 400)
    for angle, radius in zip(np.geomspace(1e-3, 60.0, 400), radii, strict=True):
        center, axis = rng.standard_normal((2, 3))
        sets.append(on_cap(rng, 30, angle, 3, 0.0, radius, center, axis=axis)[0])
    points = np.array(sets)
    matrix, origin = designs(points, name)
    values = np.linalg.svd(matrix, compute_uv=False)
    share = values[:, -1] / values[:, 0] / TOLERANCE[name]
    sides = [share < 0.999, share > 1.001]
    assert min(side.sum() for side in sides) > 50
    assert min(np.abs(np.log(share[side])).min() for side in sides) < 0.1  # some sets lie within 10 % of the edge
    fit = study.fit(points, name)
    for t in np.flatnonzero(sides[0] | sides[1]):
        square = np.sum(matrix[t, :, :3] ** 2, axis=1)
        beta, _, rank, _ = np.linalg.lstsq(matrix[t], square, rcond=TOLERANCE[name])
        uncut = np.linalg.lstsq(matrix[t], square, rcond=1e-30)[0]
        assert (rank < 4) == sides[0][t]
        error = np.linalg.norm(fit.center[t] - origin[t] - beta[:3] / 2) / radii[t]
        assert error < 1e-6
        if rank < 4:
            assert np.linalg.norm(fit.center[t] - origin[t] - uncut[:3] / 2) / radii[t] > 1e-3

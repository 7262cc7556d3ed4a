"""The cut of the textbook's least squares: at its tolerance, against LAPACK with the same one; and the error it makes.

`test_lls_historical.py` has the two answers on tiny caps without noise; here are the edge of the cut, and noise.
"""

import numpy as np
import pytest

import study

TOLERANCE = {"lls_nr": 1e-5, "lls_nr_raw": 1e-6}


def designs(points, name):
    """The columns (x, 1) of each set, centred for `lls_nr`, and their origin."""
    origin = points.mean(axis=1, keepdims=True) if name == "lls_nr" else np.zeros_like(points[:, :1])
    x = points - origin
    return np.concatenate([x, np.ones((*points.shape[:2], 1))], axis=2), origin[:, 0]


def smallest_shares(points, name):
    """Smallest singular value of each set's design over the largest."""
    values = np.linalg.svd(designs(points, name)[0], compute_uv=False)
    return values[:, -1] / values[:, 0]


@pytest.fixture(scope="module")
def caps(on_cap):
    """400 sets on caps of 1e-3 to 60 degrees of random position, their centres and radii, no noise."""
    rng, sets, centers, radii = np.random.default_rng(22), [], [], []
    for angle in np.geomspace(1e-3, 60.0, 400):
        radius, center = 10 ** rng.uniform(-0.3, 1.57), rng.standard_normal(3)
        sets.append(on_cap(rng, 30, angle, 3, 0.0, radius, center, axis=rng.standard_normal(3))[0])
        centers.append(center)
        radii.append(radius)
    return np.array(sets), np.array(centers), np.array(radii)


@pytest.mark.parametrize("name", TOLERANCE)
def test_cut_at_the_tolerance(caps, name):
    """On both sides of the edge the answer is LAPACK's least-norm one with that tolerance, and not the other's.

    LAPACK (gelsd) cuts by the same rule, rcond times the largest; sets within 1e-3 of the edge are left out.
    """
    points, _, radii = caps
    share = smallest_shares(points, name) / TOLERANCE[name]
    matrix, origin = designs(points, name)
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


@pytest.mark.parametrize("name", TOLERANCE)
def test_not_cut_is_lls(caps, name):
    """Without a cut the centre is that of `lls`: to 1e-9 r, and on the smallest caps to 1e-12 r/share².

    Forming Uᵀ|x|² loses a few ε, which the division by the smallest singular value magnifies, in raw coordinates twice.
    """
    points, _, radii = caps
    share = smallest_shares(points, name)
    whole = share > 1.001 * TOLERANCE[name]
    one, two = study.fit(points[whole], name), study.fit(points[whole], "lls")
    error = np.linalg.norm(one.center - two.center, axis=1) / radii[whole]
    wide = share[whole] > 1e-3
    assert wide.sum() > 50
    assert error[wide].max() < 1e-9
    assert np.all(error < 1e-12 / share[whole] ** 2)


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize("d", [2, 3])
def test_centred_answer_lies_on_the_sphere(rng, on_cap, d, noise):
    """On caps of 0.05° the centred version is off by 1.0 r within 1 %, wherever the sphere lies (theory §4)."""
    for radius in (0.5, 3.0, 37.0):
        center = 2 * rng.standard_normal(d)
        points = on_cap(rng, 30, 0.05, d, noise * radius, radius, center, sets=100)[0]
        error = np.linalg.norm(study.fit(points, "lls_nr").center - center, axis=1) / radius
        np.testing.assert_allclose(error, 1.0, rtol=0.01)


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize("d", [2, 3])
def test_uncentred_answer_lies_half_way(rng, on_cap, d, noise):
    """On caps of 0.01° the uncentred version is off by 0.5 r within 1 %, for a large sphere at the origin (theory §4).

    In general ĉ = ½p|p|²/(|p|² + 1): the column of ones has unit size, so half way needs |p| ≫ 1 (20² here).
    """
    for radius in (20.0, 37.0):
        points = on_cap(rng, 30, 0.01, d, noise * radius, radius, sets=100)[0]
        error = np.linalg.norm(study.fit(points, "lls_nr_raw").center, axis=1) / radius
        np.testing.assert_allclose(error, 0.5, rtol=0.01)

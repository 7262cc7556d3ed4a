"""The Cramér-Rao bound against the full Fisher information and the closed forms for caps."""

import mpmath
import numpy as np
import pytest

import study
from study.sphere.bounds import weighted_scatter
from study.sphere.cap import heights, sample_cap
from study.sphere.jit import CHUNK


def full_bound(directions, covariance, radius):
    """Bound on (c, r) from the whole (nd) × (d + 1 + n(d - 1)) Jacobian: the directions are parameters too."""
    n, d = directions.shape
    jacobian = np.zeros((n * d, d + 1 + n * (d - 1)))
    for i, u in enumerate(directions):
        rows = slice(i * d, (i + 1) * d)
        tangent = np.linalg.svd(u[None])[2][1:].T
        jacobian[rows, :d] = np.eye(d)
        jacobian[rows, d] = u
        jacobian[rows, d + 1 + i * (d - 1) : d + 1 + (i + 1) * (d - 1)] = radius * tangent
    information = jacobian.T @ np.kron(np.eye(n), np.linalg.inv(covariance)) @ jacobian
    return np.linalg.inv(information)[: d + 1, : d + 1]


def even(n, angle, d):
    """Directions spread evenly by area over a cap: no sampling error to allow for."""
    phi, k = np.radians(angle), np.arange(n)
    if d == 2:
        theta = phi * (2 * (k + 0.5) / n - 1)
        return np.stack([np.cos(theta), np.sin(theta)], axis=1)
    t = heights((k + 0.5) / n, phi, 3)
    across, azimuth = np.sqrt(t * (2 - t)), np.pi * (3 - np.sqrt(5)) * k
    return np.stack([1 - t, across * np.cos(azimuth), across * np.sin(azimuth)], axis=1)


@pytest.mark.parametrize("d", [2, 3, 4])
@pytest.mark.parametrize("radius", [0.3, 20.0])
def test_eliminated_directions(rng, d, radius):
    """J⁻¹ is the (c, r) block of the inverse of the full information, Σ anisotropic, whatever the radius (3.1)."""
    u = sample_cap(rng, 7, 1.5, d)
    a = rng.standard_normal((d, d))
    covariance = a @ a.T + 0.1 * np.eye(d)
    expected = full_bound(u, covariance, radius)
    assert np.abs(study.crlb(u, covariance) - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("n", [4, CHUNK - 1, CHUNK, CHUNK + 1, 1000])
def test_equal_weights_need_no_row_of_their_own(rng, n):
    """Weights of one chunk stand for those of all, to the bit."""
    u, ones = sample_cap(rng, 2 * n, 1.0).T.reshape(3, 2, n).swapaxes(0, 1), np.ones((1, n))
    for few, many in zip(weighted_scatter(u, ones[:, :CHUNK]), weighted_scatter(u, ones), strict=True):
        np.testing.assert_array_equal(few, many)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("angle", [5, 20, 45, 90, 180])
def test_large_samples_on_a_cap(cap_moments, angle, d):
    """Many samples on a cap reach σ²/(N K) across and along the axis, and σ² m₂/(N Kₐ) in the radius (3.2)-(3.3)."""
    n, sigma = 20_000, 0.3
    mean, k = cap_moments(angle, d)
    variance = np.diag(study.crlb(even(n, angle, d), sigma)) * n / sigma**2
    np.testing.assert_allclose(variance[:d], 1 / np.diag(k), rtol=0.01)
    assert variance[d] == pytest.approx((k[0, 0] + mean[0] ** 2) / k[0, 0], rel=0.01)


def test_paper_limit():
    """On the whole sphere √(N tr)/σ of the centre is 3, the "3σ/√N" of the WSCG abstract; on the circle it is 2."""
    for d in (2, 3):
        bound = study.crlb(even(50_000, 180, d), 1.0)[:d, :d]
        assert np.sqrt(50_000 * np.trace(bound)) == pytest.approx(d, rel=0.01)


@pytest.mark.parametrize("phi", [0.1, 1e-3, 1e-5])
def test_tiny_caps(rng, phi):
    """On a tiny cap the bound keeps the digits that inverting J would lose: 1e-13/φ² against 60 digits."""
    u = sample_cap(rng, 30, phi, 3)
    with mpmath.workdps(60):
        w = mpmath.matrix([[*map(float, row), 1.0] for row in u])
        for i in range(30):
            square = mpmath.fsum(w[i, j] ** 2 for j in range(3))  # rounded directions are not quite unit vectors
            for j in range(4):
                w[i, j] /= mpmath.sqrt(square)
        exact = np.array((mpmath.matrix(w.T * w) ** -1).tolist(), dtype=float)
    assert np.abs(study.crlb(u, 1.0) / exact - 1)[np.diag_indices(4)].max() < 1e-13 / phi**2


@pytest.mark.parametrize("n", [2, 3, 5, 100, 3000])
def test_circles_leave_the_centre_open(rng, random_rotation, n):
    """Directions on a circle, great or small, or too few of them give an infinite bound, in any orientation."""
    for height in (0.0, 0.8):
        for _ in range(20):
            a = rng.uniform(-np.pi, np.pi, n)
            across = np.sqrt(1 - height**2)
            u = np.stack([across * np.cos(a), across * np.sin(a), np.full(n, height)], axis=1) @ random_rotation(rng, 3)
            assert np.all(np.isposinf(study.crlb(u, 0.1)))


def test_batches(rng):
    """Leading axes are a batch, and an undetermined set leaves the others alone."""
    u = sample_cap(rng, 6 * 8, 2.0, 3).reshape(2, 3, 8, 3)
    u[1, 2, :, 2] = 0.0
    u[1, 2] /= np.linalg.norm(u[1, 2], axis=1, keepdims=True)
    bound = study.crlb(u, 0.2)
    assert bound.shape == (2, 3, 4, 4)
    assert np.all(np.isposinf(bound[1, 2]))
    for i, j in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]:
        np.testing.assert_allclose(bound[i, j], study.crlb(u[i, j], 0.2), rtol=1e-12)
    np.testing.assert_allclose(study.crlb(u[0], 0.2 * 0.2 * np.eye(3)), bound[0], rtol=1e-12)
    assert np.all(np.isposinf(study.crlb(np.empty((0, 3)), 0.2)))
    assert study.crlb(np.empty((0, 8, 3)), 0.2).shape == (0, 4, 4)


@pytest.mark.parametrize("shape", [(3,), (5, 1), ()])
def test_bad_shape(shape):
    """Directions of another shape than (…, n, d) raise an error that names the shape."""
    with pytest.raises(ValueError, match="shape"):
        study.crlb(np.ones(shape), 0.1)


@pytest.mark.parametrize(
    "noise",
    [
        *(0.0, -1.0, np.nan, np.inf),
        *([0.1, 0.1, 0.1], np.eye(2), [[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        *(np.diag([1.0, 1.0, last]) for last in (-1.0, 0.0, np.nan)),
    ],
)
def test_bad_noise(rng, noise):
    """A noise that is neither a standard deviation nor a covariance raises an error that names it."""
    with pytest.raises(ValueError, match="noise"):
        study.crlb(sample_cap(rng, 8, 2.0, 3), noise)

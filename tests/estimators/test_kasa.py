"""The Delogne-Kåsa family against the paper's equations in plain NumPy, and against an older iteration."""

import numpy as np
import pytest

import study
from study import Status

COVARIANCE = 1e-3 * np.array([[2.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 0.5]])


def by_the_book(points, sigma):
    """Paper eqs 4-6 and 17, 21 (2, 3 where Σ̂ = 0) for one point set."""
    n = len(points)
    y = points - points.mean(axis=0)
    c = np.cov(points.T) - sigma
    s = (y * np.sum(y**2, axis=1)[:, None]).sum(axis=0) / (n - 1)
    offset = 0.5 * np.linalg.solve(c, s)
    return points.mean(axis=0) + offset, np.sqrt((n - 1) / n * np.trace(c) + offset @ offset)


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("n", [7, 40, 800])
def test_gdke_is_equations_2_to_6(rng, on_cap, n, d):
    """GDKE's centre and radius are the paper's; the radius is the root mean square distance (eq. 3)."""
    for points in on_cap(rng, n, 120.0, d, noise=0.05, radius=3.0, center=2.0, sets=5)[0]:
        fit = study.fit(points, "gdke")
        center, radius = by_the_book(points, np.zeros((d, d)))
        np.testing.assert_allclose(fit.center, center, rtol=0, atol=1e-11)
        assert fit.radius == pytest.approx(radius, abs=1e-11)
        distance = np.linalg.norm(points - fit.center, axis=1)
        assert fit.radius == pytest.approx(np.sqrt(np.mean(distance**2)), rel=1e-12)
        assert np.isnan(fit.condition)


@pytest.mark.parametrize("noise", [0.03, COVARIANCE])
def test_ugdk_is_equations_15_to_21(rng, on_cap, noise):
    """UGDK subtracts σ² or the whole Σ, and returns the given noise as its noise variance."""
    sigma = noise**2 * np.eye(3) if np.ndim(noise) == 0 else noise
    points = on_cap(rng, 60, 90.0, noise=noise, radius=2.0, center=-1.0, sets=8)[0]
    fit = study.fit(points, "ugdk", noise)
    for t, sample in enumerate(points):
        center, radius = by_the_book(sample, sigma)
        np.testing.assert_allclose(fit.center[t], center, rtol=0, atol=1e-12)
        assert fit.radius[t] == pytest.approx(radius, abs=1e-12)
    np.testing.assert_allclose(fit.noise_variance, np.trace(sigma) / 3, rtol=1e-14)


def test_scalar_noise_is_an_isotropic_covariance(rng, on_cap):
    """σ and σ²I are the same noise, which is not known where there is no sphere."""
    points = on_cap(rng, 25, 70.0, noise=0.05, sets=10)[0]
    points[3, :, 2] = 0.0
    one, two = study.fit(points, "ugdk", 0.05), study.fit(points, "ugdk", 0.05**2 * np.eye(3))
    for name in ("center", "radius", "noise_variance", "own_status", "condition"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=1e-11, atol=1e-12)
    assert np.isnan(one.noise_variance[3])


def test_ugdk_is_the_limit_of_bias_compensation(rng, on_cap):
    """Iterating c ← x̄ + C⁻¹(½S + Σ(c - x̄)) (Halvorsen 2003) converges to UGDK."""
    for points in on_cap(rng, 50, 80.0, noise=COVARIANCE, sets=10)[0]:
        y = points - points.mean(axis=0)
        c, s = np.cov(points.T), (y * np.sum(y**2, axis=1)[:, None]).sum(axis=0) / 49
        offset = np.zeros(3)
        for _ in range(200):
            offset = np.linalg.solve(c, 0.5 * s + COVARIANCE @ offset)
        fit = study.fit(points, "ugdk", COVARIANCE)
        np.testing.assert_allclose(fit.center, points.mean(axis=0) + offset, rtol=0, atol=1e-12)


def test_covariance_rotates_with_the_points(rng, on_cap, random_rotation):
    """Points and Σ that are rotated together have the rotated answer."""
    points = on_cap(rng, 40, 90.0, noise=COVARIANCE)[0]
    q = random_rotation(rng, 3)
    fit = study.fit(points, "ugdk", COVARIANCE)
    rotated = q @ COVARIANCE @ q.T
    other = study.fit(points @ q.T, "ugdk", 0.5 * (rotated + rotated.T))
    np.testing.assert_allclose(other.center, q @ fit.center, rtol=0, atol=1e-12)
    assert other.condition == pytest.approx(float(fit.condition), rel=1e-10)


@pytest.mark.parametrize("noise", [0.15, 60 * COVARIANCE])
def test_status_is_the_leontief_condition(rng, on_cap, noise):
    """ρ is the spectral radius of Σ̂C⁻¹: NOT_POSITIVE_DEFINITE exactly where it reaches 1, with finite numbers."""
    sigma = noise**2 * np.eye(3) if np.ndim(noise) == 0 else noise
    points = on_cap(rng, 12, 60.0, noise=noise, sets=400)[0]
    fit = study.fit(points, "ugdk", noise)
    rho = np.array([np.abs(np.linalg.eigvals(sigma @ np.linalg.inv(np.cov(p.T)))).max() for p in points])
    np.testing.assert_allclose(fit.condition, rho, rtol=1e-9)
    np.testing.assert_array_equal(fit.own_status == Status.NOT_POSITIVE_DEFINITE, rho >= 1)
    assert set(np.unique(fit.own_status)) == {Status.OK, Status.NOT_POSITIVE_DEFINITE}  # both cases occur
    assert np.isfinite(fit.center).all()
    assert np.isfinite(fit.radius[fit.own_status == Status.OK]).all()


@pytest.mark.parametrize("estimator", ["gdke", "lls"])
def test_noise_from_residuals(rng, on_cap, estimator):
    """σ² solves Var f = 4r²σ² + 2dσ⁴ with r² = mean|x - c|² - dσ² (theory §5.2), times n/(n - d - 1)."""
    for d, n in [(2, 9), (3, 30), (3, 700)]:
        points = on_cap(rng, n, 120.0, d, noise=0.2, radius=2.0, center=5.0)[0]
        fit = study.fit(points, estimator)
        square = np.sum((points - fit.center) ** 2, axis=1)
        low, high = 0.0, square.mean() / (2 * d)  # the left side grows up to σ² = mean|x - c|²/d
        for _ in range(60):
            guess = (low + high) / 2
            small = 4 * (square.mean() - d * guess) * guess + 2 * d * guess**2 < square.var()
            low, high = (guess, high) if small else (low, guess)
        assert fit.noise_variance == pytest.approx(low * n / (n - d - 1), rel=1e-9)


def test_no_residual_no_noise(rng, on_cap, estimator):
    """A sphere interpolates d + 1 points: an estimator that does not use the given noise has no estimate of it."""
    points = on_cap(rng, 4, 90.0, sets=5)[0]
    fit = study.fit(points, estimator, noise=1e-9)
    if estimator not in ("ugdk", "hinge"):
        assert np.isnan(fit.noise_variance).all()
    if estimator != "mle_mirror":  # which may find a plane from its start
        atol = 1e-4 if estimator == "lls_single" else 1e-9
        np.testing.assert_allclose(np.linalg.norm(points - fit.center[:, None], axis=2), 1.0, atol=atol)

"""Standard errors and ellipsoids of a fit: their definition, and their coverage of the truth."""

import numpy as np
import pytest
from scipy import stats

import study
from study import Status
from study.sphere.cap import sample_cap

SIGMA = 1e-4 * np.array([[2.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 0.5]])
TRIALS = 4000


def half_spheres(seed, n, noise=0.01, d=3):
    """Points (4000, n, d) on half spheres about the origin."""
    rng = np.random.default_rng(seed)
    u = sample_cap(rng, TRIALS * n, np.pi / 2, d).reshape(TRIALS, n, d).swapaxes(1, 2)
    z = rng.standard_normal((TRIALS, d, n))
    return (u + noise * z).swapaxes(1, 2)


def covered(fit, level):
    """Share of fits whose ellipsoid covers the true centre, 0: its semi-axes are columns, so |axes⁻¹ĉ| < 1."""
    axes = fit.ellipsoid(level)
    inside = np.linalg.norm(np.linalg.solve(axes, fit.center[:, :, None])[:, :, 0], axis=1) < 1.0
    return inside.mean()


def slack(level):
    """4 binomial standard errors of a share of 4000: exceeded by chance in 6 of 10⁵ cases."""
    return 4 * np.sqrt(level * (1 - level) / TRIALS)


def by_hand(points, center, noise):
    """[Σ wwᵀ/(uᵀΣu)]⁻¹ with w = (u, 1) and u the directions from a centre (theory 3.1), for one set."""
    sigma = noise**2 * np.eye(len(center)) if np.ndim(noise) == 0 else noise
    u = (points - center) / np.linalg.norm(points - center, axis=1, keepdims=True)
    w = np.column_stack([u, np.ones(len(u))])
    return np.linalg.inv((w / np.einsum("ni,ij,nj->n", u, sigma, u)[:, None]).T @ w)


@pytest.mark.parametrize("level", [0.68, 0.95])
@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize(("d", "n"), [(3, 100), (3, 10), (2, 10)])
def test_nominal_coverage(d, n, known, level):
    """At σ = .01 r on half spheres the 68 % and 95 % ellipsoids cover the centre that often, at N = 10 too.

    4000 trials, to 4 binomial standard errors. With the noise not given the F distribution allows for its estimate.
    """
    points = half_spheres(1000 * d + n, n, d=d)
    for name in ("als", "mle", "ugdk") if known else ("als", "mle"):
        fit = study.fit(points, name, 0.01 if known else None)
        assert covered(fit, level) == pytest.approx(level, abs=slack(level))


def test_corrected_does_not_take_a_given_noise():
    """Its ellipsoid is the same with the noise given, since it estimates the noise: 95 % cover the centre at N = 10."""
    points = half_spheres(7, 10)
    given, own = study.fit(points, "corrected", 0.01), study.fit(points, "corrected")
    assert not given.noise_is_known
    np.testing.assert_array_equal(given.ellipsoid(0.95), own.ellipsoid(0.95))
    assert covered(given, 0.95) > 0.92  # by χ², as if the noise were known, it would be .82


def test_robust_ellipsoid_counts_the_points_that_are_left():
    """With three of ten points left out its ellipsoid is that of `mle` of the seven."""
    points = half_spheres(8, 13)[:300]
    points[:, 10:] *= 3.0
    fit = study.fit(points, "robust")
    all_three = (fit.outliers == (np.arange(13) > 9)).all(axis=1)
    assert all_three.sum() > 200
    alone = study.fit(points[all_three, :10], "mle")
    np.testing.assert_allclose(fit[all_three].covariance, alone.covariance, rtol=1e-9)
    axes = [np.abs(each.ellipsoid(0.95)) for each in (fit[all_three], alone)]  # their signs are free
    np.testing.assert_allclose(axes[0], axes[1], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(("n", "rounded"), [(6, 0.71), (10, 0.85)])
def test_chi_squared_would_not_do(n, rounded):
    """With σ estimated an ellipsoid by χ² would cover 85 % instead of 95 % at N = 10, and 71 % at N = 6.

    These are values of the distribution of d F(d, N - d - 1) at the quantile of χ², and the fits agree.
    """
    quantile = stats.chi2.ppf(0.95, 3)
    expected = stats.f.cdf(quantile / 3, 3, n - 4)
    assert round(expected, 2) == rounded
    fit = study.fit(half_spheres(77, n), "als")
    precision = np.linalg.inv(fit.covariance[:, :3, :3])
    share = np.mean(np.einsum("bi,bij,bj->b", fit.center, precision, fit.center) < quantile)
    assert share == pytest.approx(expected, abs=slack(expected))
    assert covered(fit, 0.95) == pytest.approx(0.95, abs=slack(0.95))


@pytest.mark.parametrize("known", [False, True])
def test_standard_errors_are_the_scatter(known):
    """Errors over standard errors have unit variance, for each coordinate and the radius, as χ² and Student's t have.

    The variance of t with ν = 96 degrees of freedom is ν/(ν - 2); a variance of 4000 has a standard error of 2.2 %.
    """
    points = half_spheres(5, 100)
    for name in ("als", "mle", "ugdk") if known else ("als", "mle"):
        fit = study.fit(points, name, 0.01 if known else None)
        pulls = np.column_stack([fit.center, fit.radius - 1.0]) / fit.standard_errors
        expected = 1.0 if known else 96 / 94
        np.testing.assert_allclose(np.mean(pulls**2, axis=0), expected, rtol=4.5 * np.sqrt(2 / TRIALS))


@pytest.mark.parametrize(
    ("name", "noise"),
    [
        (name, noise)
        for name, entry in study.ESTIMATORS.items()
        for noise in (None, 0.03, SIGMA)
        if entry.covariance is None
        if not (name == "ugdk" and noise is None) and not (name == "hinge" and np.ndim(noise) == 2)
    ],
)
def test_covariance_is_the_bound_with_estimates(rng, on_cap, name, noise):
    """It is [Σ wwᵀ/(uᵀΣu)]⁻¹ of the directions from ĉ, with the noise as given, σ or Σ, else with σ̂²."""
    points = on_cap(rng, 30, 100.0, noise=0.03, radius=2.0, center=1.0, sets=5)[0]
    fit = study.fit(points, name, noise)
    for t in range(5):
        used = np.sqrt(fit.noise_variance[t]) if noise is None else noise
        expected = by_hand(points[t], fit.center[t], used)
        np.testing.assert_allclose(fit.covariance[t], expected, rtol=1e-8, atol=1e-12 * np.trace(expected))
        np.testing.assert_allclose(fit.standard_errors[t], np.sqrt(np.diag(expected)), rtol=1e-8)
        directions = points[t] - fit.center[t]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        np.testing.assert_allclose(fit.covariance[t], study.crlb(directions, used), rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("lead", [(), (6,), (2, 3)])
def test_shapes_and_values(rng, on_cap, lead):
    """Residuals, counts, errors and ellipsoids have the leading axes of the points, and values by definition."""
    points = on_cap(rng, 25, 100.0, noise=0.05, sets=max(int(np.prod(lead)), 1))[0].reshape(*lead, 25, 3)
    fit = study.fit(points, "mle")
    distance = np.linalg.norm(points - fit.center[..., None, :], axis=-1)
    expected = np.sqrt(np.mean((distance - fit.radius[..., None]) ** 2, axis=-1))
    np.testing.assert_allclose(fit.residual_rms, expected, rtol=1e-12)
    assert fit.residual_rms.shape == fit.count.shape == lead
    np.testing.assert_array_equal(fit.count, 25)
    assert fit.covariance.shape == (*lead, 4, 4)
    assert fit.standard_errors.shape == (*lead, 4)
    axes = fit.ellipsoid(0.9)
    assert axes.shape == (*lead, 3, 3)
    product = axes @ np.swapaxes(axes, -1, -2)
    np.testing.assert_allclose(
        product, 3 * stats.f.ppf(0.9, 3, 21) * fit.covariance[..., :3, :3], rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("noise", [None, 0.05, SIGMA])
def test_errors_of_lost_fits(rng, on_cap, noise):
    """Without an answer, or without a noise estimate, errors are NaN or infinite, and nothing warns."""
    sound = on_cap(rng, 12, 120.0, noise=0.05)[0]
    row = np.arange(12)[:, None]
    four, infinite = np.where(row > 3, np.nan, sound), np.where(row == 3, np.inf, sound)
    lost = [np.ones((12, 3)), np.full((12, 3), np.nan), sound * [1, 1, 0], infinite]
    fit = study.fit(np.array([sound, four, *lost]), "als", noise)
    np.testing.assert_array_equal(fit.count, [12, 4, 12, 0, 12, 12])
    assert fit.own_status[1] == Status.OK
    for errors in (fit.standard_errors, fit.ellipsoid().reshape(6, 9)):
        assert np.isfinite(errors[0]).all()
        assert np.isfinite(errors[1]).all() == (noise is not None)
        assert not np.isfinite(errors[2:]).all(axis=1).any()
    assert np.isfinite(fit.residual_rms[:2]).all()
    assert np.isnan(fit.residual_rms[2:]).all()

"""The estimators' errors in Monte-Carlo runs of fixed seed, against theory.

Means are compared to 4.5 of their standard errors, which a component passes by chance in 7 of 10⁶ seeds.
"""

import numpy as np
import pytest

import study
from study import Status
from study.sphere.moments import Moments

TILTED = np.array([[1.0, 0.4, -0.3], [0.4, 0.6, 0.1], [-0.3, 0.1, 0.3]])


def large(on_cap, rng, covariance, estimators, angle=60.0, trials=400, n=20_000):
    """Errors (trials, 3) of each estimator on the same large samples, drawn twenty sets at a time."""
    sets = (on_cap(rng, n, angle, noise=covariance, sets=20)[0] for _ in range(trials // 20))
    errors = [[study.fit(points, name, covariance).center for name in estimators] for points in sets]
    return np.concatenate(errors, axis=1)


@pytest.mark.parametrize("covariance", [0.1**2 * np.eye(3), 0.1**2 * TILTED])
def test_gdke_bias(rng, on_cap, cap_moments, assert_mean, covariance):
    """GDKE's large-sample bias is -(C₀ + Σ)⁻¹Σ(c₀ - μ̄), anisotropic Σ included (eq. 14, theory 0.3); UGDK has none.

    400 trials of 20 000 samples at 60°: a standard error near 1e-4 against a bias of 0.2 and a remainder of O(1/N).
    """
    mean, k = cap_moments(60.0, 3)
    bias = np.linalg.solve(k + covariance, covariance @ mean)  # c₀ = 0 and μ̄ = m, so -(c₀ - μ̄) = m
    assert np.linalg.norm(bias) > 0.1
    gdke, ugdk = large(on_cap, rng, covariance, ["gdke", "ugdk"])
    assert_mean(gdke, bias)
    assert_mean(ugdk, 0.0)


def test_moments_are_unbiased_at_any_size(rng, assert_mean):
    """E(C) = C₀ + Σ and E(S) = S₀ exactly, at n = 5 and with anisotropic Σ (eqs 10, 12): 300 000 trials, 12 means."""
    fixed = rng.standard_normal((5, 3))
    exact = Moments.of(fixed.T[None])
    noise = rng.standard_normal((300_000, 5, 3)) @ np.linalg.cholesky(0.3 * TILTED).T
    moments = Moments.of((fixed + noise).swapaxes(1, 2))
    assert_mean(moments.covariance, exact.covariance[0] + 0.3 * TILTED)
    assert_mean(moments.third_central, exact.third_central[0])


def test_efficient_at_small_noise(rng, on_cap):
    """At σ = 0.01 r on a half sphere, N = 1000, the RMSE is within 3 % of the bound.

    6000 trials: the axial variance holds two thirds of the trace, so the MSE has a relative standard error of
    √(2·(12² + 3² + 3²)/18²/6000) = 1.3 % and the RMSE 0.65 %; 3 % are 4.6 of those (false alarms 4e-6).
    """
    squares, bounds = {"mle": [], "ugdk": []}, []
    for _ in range(12):
        points, directions = on_cap(rng, 1000, 90.0, noise=0.01, sets=500)
        for name, found in squares.items():
            found.append(np.sum(study.fit(points, name, 0.01).center ** 2, axis=1))
        bounds.append(np.trace(study.crlb(directions, 0.01)[:, :3, :3], axis1=1, axis2=2))
    for name, found in squares.items():
        assert abs(np.sqrt(np.mean(found) / np.mean(bounds)) - 1) < 0.03, name


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("estimator", ["gdke", "lls", "mle"])
def test_noise_variance_is_unbiased(rng, on_cap, assert_mean, estimator, d):
    """Estimates of σ² at σ = 0.01 r have mean σ²: 5000 trials of 30 samples, a standard error of 0.4 %."""
    for angle in (60.0, 180.0):
        fit = study.fit(on_cap(rng, 30, angle, d, noise=0.01, sets=5000)[0], estimator)
        assert np.all(fit.own_status == Status.OK)
        assert_mean(fit.noise_variance / 0.01**2, 1.0)


@pytest.mark.parametrize(
    ("d", "limit"), [(2, 1 - (2 - np.sqrt(2)) / 4), (3, 1 - (np.pi - 2 * np.sqrt(2)) / (4 * np.pi))]
)
def test_pure_noise_is_not_positive_definite(rng, d, limit):
    """On pure noise UGDK fails with the probability of the GOE limit, 0.854 in two and 0.975 in three dimensions.

    The limits are in theory 0.5. 4000 trials of 4000 samples: a binomial standard error below 0.6 %, of which 4.5 are
    allowed; the finite sample adds some 0.1 % (0.7 % at N = 100, falling as 1/√N).
    """
    failures = sum(
        np.sum(study.fit(rng.standard_normal((200, 4000, d)), "ugdk", 1.0).own_status == Status.NOT_POSITIVE_DEFINITE)
        for _ in range(20)
    )
    assert abs(failures / 4000 - limit) < 4.5 * np.sqrt(limit * (1 - limit) / 4000)


def test_ugdk_radius_is_unbiased_where_gdke_is_not(rng, on_cap, assert_mean):
    """On the whole sphere GDKE's radius is 3σ²/2r too long and MLE's σ²/r (theory §3), UGDK's is right.

    200 trials of 20 000 samples at σ = 0.1 r: standard errors near 5e-5; terms of σ⁴ are allowed 2 σ⁴ = 2e-4.
    """
    points = np.concatenate([on_cap(rng, 20_000, noise=0.1, sets=20)[0] for _ in range(10)])
    for estimator, excess in [("gdke", 0.015), ("mle", 0.01), ("ugdk", 0.0)]:
        radius = study.fit(points, estimator, 0.1).radius
        slack = 4.5 * radius.std(ddof=1) / np.sqrt(200) + 2e-4
        assert abs(radius.mean() - 1 - excess) < slack

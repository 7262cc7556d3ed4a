"""Linear least squares: Kåsa's fit by orthogonal factorisation."""

import numpy as np
import pytest

import study

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


@pytest.mark.parametrize("n", [5, 60, 1500])
@pytest.mark.parametrize("angle", [40.0, 90.0, 180.0])
def test_same_fit_as_gdke(rng, on_cap, angle, n):
    """LLS and GDKE are one fit (theory 0.1): centre, radius and noise agree to 1e-12 r on sound sets.

    Sound: the bound at σ = 1 is below 30/√n, so that rounding is amplified some hundred times at most.
    """
    points, directions = on_cap(rng, n, angle, noise=0.02, radius=7.0, center=1.0, sets=100)
    bound = np.sqrt(np.trace(study.crlb(directions, 1.0)[:, :3, :3], axis1=1, axis2=2))
    sound = points[bound < 30 / np.sqrt(n)]
    assert len(sound) > 20
    one, two = study.fit(sound, "lls"), study.fit(sound, "gdke")
    np.testing.assert_allclose(one.center, two.center, rtol=0, atol=1e-12 * 7)
    np.testing.assert_allclose(one.radius, two.radius, rtol=0, atol=1e-12 * 7)
    np.testing.assert_allclose(one.noise_variance, two.noise_variance, rtol=1e-9, atol=100 * EPS * 7**2)


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

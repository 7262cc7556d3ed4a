"""Estimators that find the noise in the points, against the generalised eigenproblems of their publications."""

import numpy as np
import pytest
from scipy.linalg import eig

import study


def published(points, name):
    """Centre by the matrix pencil M θ = η N θ of the publications, θ = (A, B, C) of A|x|² + Bᵀx + C = 0 (theory §5.1).

    Taubin constrains the mean squared gradient, Pratt |B|² - 4AC, Hyper 2 Taubin - Pratt's kin to unbiasedness.
    """
    n, d = points.shape
    origin = points.mean(axis=0)
    x = points - origin
    square = np.sum(x**2, axis=1)
    z = np.column_stack([square, x, np.ones(n)])
    mean = z.mean(axis=0)
    taubin = np.zeros((d + 2, d + 2))
    taubin[0, 0] = 4 * mean[0]
    taubin[0, 1 : d + 1] = taubin[1 : d + 1, 0] = 2 * mean[1 : d + 1]
    taubin[1 : d + 1, 1 : d + 1] = np.eye(d)
    constraint = taubin.copy()
    if name == "pratt":
        constraint[0, : d + 1] = constraint[: d + 1, 0] = 0.0
        constraint[0, -1] = constraint[-1, 0] = -2.0
    elif name == "hyper":
        unit = np.eye(d + 2)[0]
        constraint += d * (np.outer(mean, unit) + np.outer(unit, mean))
    values, vectors = eig(z.T @ z / n, constraint)
    usable = np.isfinite(values) & (np.abs(values.imag) < 1e-9) & (values.real > -1e-12)
    theta = vectors[:, usable][:, np.argmin(values[usable].real)].real
    return origin - theta[1 : d + 1] / (2 * theta[0])


@pytest.mark.parametrize("name", ["taubin", "pratt", "hyper"])
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("noise", [0.01, 0.2])
def test_published_eigenproblems(rng, on_cap, noise, d, name):
    """One equation with one constant gives the centre of each publication's eigenproblem (theory 5.1)."""
    for points in on_cap(rng, 40, 100.0, d, noise, radius=2.0, center=1.0, sets=20)[0]:
        np.testing.assert_allclose(study.fit(points, name).center, published(points, name), rtol=0, atol=1e-10)


def test_pratt_is_hyper_on_the_circle(rng, on_cap):
    """In two dimensions Pratt and Hyper have the same constant, -4, and so the same centre; in three they differ."""
    flat, solid = (on_cap(rng, 30, 100.0, d, noise=0.1, sets=10)[0] for d in (2, 3))
    np.testing.assert_allclose(study.fit(flat, "pratt").center, study.fit(flat, "hyper").center, rtol=0, atol=1e-13)
    assert np.abs(study.fit(solid, "pratt").center - study.fit(solid, "hyper").center).max() > 1e-5


@pytest.mark.parametrize("noise", [0.01, 0.3])
def test_als_explains_its_residuals(rng, on_cap, noise):
    """`als` is `ugdk` with the noise that explains the residuals: Var f = 4r²η + 2dη² (theory §5.2)."""
    for points in on_cap(rng, 50, 110.0, noise=noise, sets=10)[0]:
        fit = study.fit(points, "als")
        eta = fit.noise_variance * (50 - 4) / 50
        square = np.sum((points - fit.center) ** 2, axis=1)
        assert np.var(square) == pytest.approx(4 * fit.radius**2 * eta + 6 * eta**2, rel=1e-9)
        ugdk = study.fit(points, "ugdk", np.sqrt(eta * 50 / 49))  # η is of weight 1/n, C of 1/(n - 1)
        np.testing.assert_allclose(ugdk.center, fit.center, rtol=0, atol=1e-10)


def test_als_variance_is_unbiased(rng, on_cap, assert_mean):
    """The mean of σ̂² is σ² at n = 8, 20 and 100 (theory §5.2): 20 000 trials each, to 4.5 standard errors."""
    for n in (8, 20, 100):
        fit = study.fit(on_cap(rng, n, noise=0.01, sets=20_000)[0], "als")
        assert_mean(fit.noise_variance / 0.01**2, 1.0)


@pytest.mark.parametrize("name", ["taubin", "pratt", "hyper", "als"])
def test_always_positive_definite(rng, name):
    """The root lies below the least eigenvalue of C, so the Leontief condition never fails, not even on pure noise."""
    fit = study.fit(rng.standard_normal((2000, 12, 3)), name)
    assert np.all(fit.condition < 1.0)
    assert np.isfinite(fit.center).all()

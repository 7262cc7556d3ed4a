"""Small dense linear algebra against LAPACK and, where LAPACK loses digits, against mpmath.

Means of a noisy radius against confluent hypergeometric functions of 60 digits.
"""

import mpmath
import numpy as np
import pytest
from scipy import special

from study.fits.estimators.corrected import RadialMeans, angle_means, radial_means
from study.fits.loops.linalg import cholesky_solve, eigenbasis

EPS = np.finfo(float).eps


def symmetric(rng, d):
    """A random symmetric matrix."""
    a = rng.standard_normal((d, d))
    return a + a.T


@pytest.mark.parametrize("d", [1, 2, 3, 4, 6, 8])
def test_against_lapack(rng, d):
    """Eigenvalues agree with eigh, the basis is orthonormal and diagonalises the matrix."""
    matrices = np.array([symmetric(rng, d) for _ in range(50)])
    before = matrices.copy()
    values, vectors = eigenbasis(matrices)
    np.testing.assert_array_equal(matrices, before)
    scale = np.abs(values).max()
    np.testing.assert_allclose(values, np.linalg.eigh(matrices)[0], rtol=0, atol=50 * EPS * scale)
    np.testing.assert_allclose(vectors.swapaxes(1, 2) @ vectors, np.broadcast_to(np.eye(d), (50, d, d)), atol=50 * EPS)
    rebuilt = (vectors * values[:, None, :]) @ vectors.swapaxes(1, 2)
    np.testing.assert_allclose(rebuilt, matrices, rtol=0, atol=50 * EPS * scale)


@pytest.mark.parametrize("grades", [[1.0, 1e-4], [1e-6, 1.0, 1e-3], [1.0, 1e-5, 1e-10], [1e-9, 1e3, 1e-3, 1e-12, 1.0]])
def test_small_eigenvalues_keep_their_digits(rng, grades):
    """A graded positive definite matrix gives every eigenvalue to 1e-13, where a bound in the norm would give none.

    Demmel & Veselić 1992: relative errors of about d ε κ(A), A the matrix scaled to unit diagonal; here κ(A) < 20.
    """
    d = len(grades)
    for _ in range(10):
        a = np.eye(d) + 0.3 * symmetric(rng, d) / d
        matrix = a * np.outer(grades, grades)
        unit = matrix / np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
        if np.linalg.cond(unit) > 20:
            continue
        with mpmath.workdps(60):
            exact = sorted(float(v) for v in mpmath.eigsy(mpmath.matrix(matrix.tolist()), eigvals_only=True))
        np.testing.assert_allclose(eigenbasis(matrix[None])[0][0], exact, rtol=1e-13, atol=0)


@pytest.mark.parametrize("d", [1, 2, 3, 5, 7])
def test_cholesky_solves(rng, d):
    """A positive definite system is solved like LAPACK does."""
    for _ in range(20):
        a = rng.standard_normal((d, d))
        matrix, right = a @ a.T + np.eye(d), rng.standard_normal(d)
        expected, solution = np.linalg.solve(matrix, right), right.copy()
        assert cholesky_solve(matrix.copy(), solution)
        np.testing.assert_allclose(solution, expected, rtol=0, atol=1e3 * EPS * np.abs(expected).max())


@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 2.0], [2.0, 1.0]],
        [[1.0, 1.0], [1.0, 1.0]],
        [[-1.0, 0.0], [0.0, 1.0]],
        [[0.0, 0.0], [0.0, 0.0]],
        [[np.nan, 0.0], [0.0, 1.0]],
        [[1.0, np.nan], [np.nan, 1.0]],
    ],
)
def test_cholesky_refuses(matrix):
    """A matrix that is indefinite, singular or NaN is reported as not positive definite."""
    assert not cholesky_solve(np.array(matrix), np.ones(2))


RADIUS = 1.7


def mean_power(k, r, s, d):
    """E Rᵏ by its closed form."""
    half = mpmath.mpf(d) / 2
    scale = (2 * s) ** (mpmath.mpf(k) / 2) * mpmath.gamma(half + mpmath.mpf(k) / 2) / mpmath.gamma(half)
    return scale * mpmath.hyp1f1(-mpmath.mpf(k) / 2, half, -r * r / (2 * s))


def mean_direction(r, s, d):
    """E e·u = ∂E R/∂r, by its closed form."""
    half = mpmath.mpf(d) / 2
    scale = r / mpmath.sqrt(2 * s) * mpmath.gamma(half + mpmath.mpf(1) / 2) / mpmath.gamma(half + 1)
    return scale * mpmath.hyp1f1(mpmath.mpf(1) / 2, half + 1, -r * r / (2 * s))


def exact(r, s, d):
    """All fields of `RadialMeans`, with derivatives by differences of 25 digits."""
    r, s = mpmath.mpf(r), mpmath.mpf(s)
    mean = lambda r, s: mean_power(1, r, s, d)  # noqa: E731
    direction = lambda r, s: mean_direction(r, s, d)  # noqa: E731
    variance = lambda r, s: r * r + d * s - mean(r, s) ** 2  # noqa: E731
    first = lambda r, s: r / direction(r, s)  # noqa: E731
    second = lambda r, s: (r * mean(r, s) + s * direction(r, s)) / r  # noqa: E731
    by_r = lambda f: mpmath.diff(lambda q: f(q, s), r, h=r * mpmath.mpf(10) ** -25)  # noqa: E731
    by_s = lambda f: mpmath.diff(lambda q: f(r, q), s, h=s * mpmath.mpf(10) ** -25)  # noqa: E731
    return RadialMeans(
        mean(r, s) - r,
        direction(r, s) - 1,
        variance(r, s),
        first(r, s) - r,
        second(r, s) - r,
        by_s(mean),
        by_r(variance),
        by_s(variance),
        by_r(first) - 1,
        by_s(first),
        by_r(second) - 1,
        by_s(second),
    )


@pytest.mark.parametrize("dimension", [2, 3, 4, 20])
@pytest.mark.parametrize("noise", [1e-6, 1e-3, 0.05, 0.111, 0.113, 0.5, 1.0, 30.0])
def test_against_closed_forms(dimension, noise):
    """All means and derivatives have 11 digits, from σ far below r to far above it."""
    with mpmath.workdps(60):
        wanted = exact(RADIUS, (RADIUS * noise) ** 2, dimension)
    found = radial_means(RADIUS, (RADIUS * noise) ** 2, dimension)
    for name, value, truth in zip(RadialMeans._fields, found, wanted, strict=True):
        floor = 1e-15 * noise if name == "variance_by_r" else 0.0  # of order σ²/r, from terms of order σ
        np.testing.assert_allclose(value, float(truth), rtol=1e-11, atol=floor, err_msg=name)


@pytest.mark.parametrize("d", [2, 3, 4, 9])
def test_angle_given_the_radius(d):
    """The Bessel functions of the angle's law are those of SciPy; at large κ, beyond its range, the series' limit."""
    kappa = np.array([np.logspace(-8, 8, 200)])
    density, cosine = np.empty_like(kappa), np.empty_like(kappa)
    angle_means(kappa, d, density, cosine)
    order = 0.5 * d - 1.0
    np.testing.assert_allclose(density, np.sqrt(kappa) * special.ive(order, kappa), rtol=1e-12)
    np.testing.assert_allclose(cosine, special.ive(order + 1.0, kappa) / special.ive(order, kappa), rtol=1e-12)
    angle_means(np.full((1, 200), 1e20), d, density, cosine)
    np.testing.assert_allclose(density, 1.0 / np.sqrt(2.0 * np.pi), rtol=1e-15)
    np.testing.assert_allclose(cosine, 1.0, rtol=1e-15)

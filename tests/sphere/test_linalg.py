"""Small dense linear algebra against LAPACK and, where LAPACK loses digits, against mpmath."""

import mpmath
import numpy as np
import pytest

from study.sphere.linalg import cholesky_solve, eigenbasis

EPS = np.finfo(float).eps


def symmetric(rng, d):
    """A random symmetric matrix."""
    a = rng.standard_normal((d, d))
    return a + a.T


@pytest.mark.parametrize("d", [1, 2, 3, 4, 6, 8])
def test_against_lapack(rng, d):
    """Eigenvalues agree with eigh, the basis is orthonormal and diagonalises the matrix."""
    matrices = np.array([symmetric(rng, d) for _ in range(50)])
    kept = matrices.copy()
    values, vectors = eigenbasis(matrices)
    np.testing.assert_array_equal(matrices, kept)
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


@pytest.mark.parametrize("values", [[1, 2, 2], [3, 3, 3], [0, 1, 1], [0, 0, 0], [-1, -1, 4]])
def test_repeated_eigenvalues(rng, random_rotation, values):
    """Repeated and zero eigenvalues are found, with an orthonormal basis."""
    q = random_rotation(rng, 3)
    got, vectors = eigenbasis(((q * values) @ q.T)[None])
    np.testing.assert_allclose(got[0], values, rtol=0, atol=50 * EPS)
    np.testing.assert_allclose(vectors[0].T @ vectors[0], np.eye(3), atol=50 * EPS)


def test_diagonal_matrix_is_sorted_exactly():
    """A diagonal matrix is decomposed without rounding: its entries in ascending order, unit vectors as columns."""
    values, vectors = eigenbasis(np.diag([3.0, -1.0, 1e-30, 2.0])[None])
    np.testing.assert_array_equal(values[0], [-1.0, 1e-30, 2.0, 3.0])
    np.testing.assert_array_equal(vectors[0], np.eye(4)[:, [1, 2, 3, 0]])


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

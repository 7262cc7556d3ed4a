import numpy as np
import pytest
from scipy.linalg import eigh

from study.mocap.geometry.generalised_eigen import diagonalise_pair, smallest_generalised_eigenvalue


@pytest.mark.parametrize("d", [2, 3])
def test_agrees_with_scipy(rng, d):
    """Eigenvalues are scipy's for random pairs, and the vectors diagonalise both matrices."""
    for _ in range(20):
        a, b = rng.standard_normal((2, d, d + 3))
        c, f = a @ a.T, b @ b.T
        values, vectors = np.empty(d), np.empty((d, d))
        diagonalise_pair(c, f, np.empty((2, d, d)), values, vectors)
        np.testing.assert_allclose(values, eigh(c, f, eigvals_only=True), rtol=1e-9)
        np.testing.assert_allclose(vectors.T @ f @ vectors, np.eye(d), atol=1e-10)
        np.testing.assert_allclose(vectors.T @ c @ vectors, np.diag(values), atol=1e-9 * values[-1])
        assert smallest_generalised_eigenvalue(c, f) == values[0]

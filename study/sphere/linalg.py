"""Linear algebra of d × d matrices inside compiled loops, where a LAPACK call costs more than the work itself."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from study.sphere.compiled import compiled

_MAX_SWEEPS = 40
_EPS = 2.0**-52


@compiled
def diagonalise(matrix: Any, vectors: Any) -> None:
    """Cyclic Jacobi: overwrite a symmetric matrix by its eigenvalues on the diagonal, ascending.

    Jacobi and not QR, because it keeps small eigenvalues of a positive definite matrix to high relative
    accuracy (Demmel & Veselić 1992), and on a small cap the smallest one carries the answer.

    ``vectors`` receives the eigenvectors as columns.
    """
    d = matrix.shape[0]
    for i in range(d):
        for j in range(d):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_MAX_SWEEPS):
        rotated = False
        for p in range(d - 1):
            for q in range(p + 1, d):
                off = matrix[p, q]
                if not abs(off) > 0.25 * _EPS * math.sqrt(abs(matrix[p, p] * matrix[q, q])):
                    continue
                rotated = True
                theta = 0.5 * (matrix[q, q] - matrix[p, p]) / off
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                matrix[p, p] -= t * off
                matrix[q, q] += t * off
                matrix[p, q] = matrix[q, p] = 0.0
                for k in range(d):
                    if k != p and k != q:
                        kp, kq = matrix[k, p], matrix[k, q]
                        matrix[k, p] = matrix[p, k] = c * kp - s * kq
                        matrix[k, q] = matrix[q, k] = s * kp + c * kq
                    vp, vq = vectors[k, p], vectors[k, q]
                    vectors[k, p] = c * vp - s * vq
                    vectors[k, q] = s * vp + c * vq
        if not rotated:
            break
    for i in range(d - 1):  # ascending order, by selection
        low = i
        for j in range(i + 1, d):
            if matrix[j, j] < matrix[low, low]:
                low = j
        if low != i:
            matrix[i, i], matrix[low, low] = matrix[low, low], matrix[i, i]
            for k in range(d):
                vectors[k, i], vectors[k, low] = vectors[k, low], vectors[k, i]


@compiled
def cholesky_solve(matrix: Any, right: Any) -> bool:
    """Solve a positive definite system in place; False, and garbage, if the matrix is not positive definite.

    The lower triangle of ``matrix`` is overwritten by the factor, ``right`` by the solution.
    """
    d = matrix.shape[0]
    for j in range(d):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not pivot > 0.0:
            return False
        root = math.sqrt(pivot)
        matrix[j, j] = root
        for i in range(j + 1, d):
            entry = matrix[i, j]
            for k in range(j):
                entry -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = entry / root
    for i in range(d):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(d - 1, -1, -1):
        for k in range(i + 1, d):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]
    return True


@compiled
def _diagonalise_all(matrices: Any, values: Any, vectors: Any) -> None:
    for t in range(matrices.shape[0]):
        diagonalise(matrices[t], vectors[t])
        for i in range(values.shape[1]):
            values[t, i] = matrices[t, i, i]


def eigenbasis(matrices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues (b, d), ascending, and eigenvectors (b, d, d), as columns, of symmetric matrices (b, d, d)."""
    values, vectors = np.empty(matrices.shape[:2]), np.empty(matrices.shape)
    _diagonalise_all(matrices.copy(), values, vectors)
    return values, vectors


@compiled
def _components_all(basis: Any, vectors: Any, result: Any) -> None:
    b, d = vectors.shape
    for t in range(b):
        for k in range(d):
            along = 0.0
            for i in range(d):
                along += basis[t, i, k] * vectors[t, i]
            result[t, k] = along


def components(basis: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Components (b, d) of vectors (b, d) along the columns of bases (b, d, d)."""
    result = np.empty(vectors.shape)
    _components_all(basis, vectors, result)
    return result

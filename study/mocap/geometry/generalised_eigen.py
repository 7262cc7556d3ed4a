"""Generalised eigenvalues of two small symmetric matrices: the extent of points in units of their noise."""

import math

import numpy as np

from study.sphere.jit import compiled
from study.sphere.linalg import diagonalise
from study.sphere.types import Floats


@compiled
def diagonalise_pair(c: Floats, f: Floats, scratch: Floats, values: Floats, vectors: Floats) -> None:
    """Find V with VᵀFV = I and VᵀCV diagonal, for C (d, d) and a positive definite F (d, d).

    ``values`` (d,) receives the diagonal, ascending and not below 0; ``vectors`` (d, d) receives V, one direction a
    column; ``scratch`` is (2, d, d).
    """
    d = len(values)
    inverse, inner = scratch[0], scratch[1]
    # Cholesky's factor L of F, and its inverse row by row
    for i in range(d):
        for j in range(i + 1):
            entry = f[i, j]
            for k in range(j):
                entry -= inner[i, k] * inner[j, k]
            inner[i, j] = math.sqrt(entry) if i == j else entry / inner[j, j]
    for i in range(d):
        for j in range(d):
            entry = 1.0 if i == j else 0.0
            for k in range(j, i):
                entry -= inner[i, k] * inverse[k, j]
            inverse[i, j] = entry / inner[i, i] if j <= i else 0.0
    for i in range(d):
        for j in range(i + 1):
            entry = 0.0
            for k in range(i + 1):
                for m in range(j + 1):
                    entry += inverse[i, k] * c[k, m] * inverse[j, m]
            inner[i, j] = entry
            inner[j, i] = entry
    diagonalise(inner, vectors)
    for k in range(d):
        values[k] = max(inner[k, k], 0.0)
    for k in range(d):
        for i in range(d):
            entry = 0.0
            for m in range(i, d):
                entry += inverse[m, i] * vectors[m, k]
            vectors[i, k] = entry  # row i is not needed again: L⁻ᵀ is triangular


def smallest_generalised_eigenvalue(c: Floats, f: Floats) -> float:
    """Least λ with det(C - λF) = 0, not below 0, for C (d, d) and a positive definite F (d, d)."""
    d = len(c)
    values = np.empty(d)
    diagonalise_pair(c, f, np.empty((2, d, d)), values, np.empty((d, d)))
    return float(values[0])

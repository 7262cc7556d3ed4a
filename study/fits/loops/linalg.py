"""Linear algebra of d × d matrices in compiled loops, where a call of LAPACK costs more than the work itself."""

import math

import numpy as np

from study.arrays import Floats
from study.fits.loops.jit import compiled, fill

_MAX_SWEEPS = 40
_LANES = 16
"""Number of matrices that are diagonalised side by side."""
Lanes = tuple[int, ...]
_ONE, _SEVERAL = (0,), (0,) * _LANES
"""Tuples as long as the number of matrices, which the compiler knows so."""
_TINY = 1e-280
_EPS = 2.0**-52


@compiled
def _choose(pp: Floats, qq: Floats, pq: Floats, cosine: Floats, sine: Floats, lanes: Lanes) -> bool:
    """Choose the rotations that take the p-q entries of some matrices to zero, and apply them to those entries.

    Returns False if every one of the entries is too small to change the eigenvalues of its plane.
    """
    rotated = 0.0
    for k in range(len(lanes)):
        significant = abs(pq[k]) > 0.25 * _EPS * math.sqrt(abs(pp[k] * qq[k]))
        off = pq[k] if significant else 1.0
        theta = 0.5 * (qq[k] - pp[k]) / off
        t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
        t = -t if theta < 0.0 else t  # the smaller of both angles
        t, off = (t, off) if significant else (0.0, 0.0)
        cosine[k] = 1.0 / math.sqrt(t * t + 1.0)
        sine[k] = t * cosine[k]
        pp[k] -= t * off
        qq[k] += t * off
        pq[k] = 0.0 if significant else pq[k]
        rotated += 1.0 if significant else 0.0
    return rotated > 0.0


@compiled
def _rotate(first: Floats, second: Floats, cosine: Floats, sine: Floats, lanes: Lanes) -> None:
    """Rotate pairs of entries."""
    for k in range(len(lanes)):
        a, b = first[k], second[k]
        first[k] = cosine[k] * a - sine[k] * b
        second[k] = sine[k] * a + cosine[k] * b


@compiled
def _jacobi(matrix: Floats, vectors: Floats, angles: Floats, lanes: Lanes) -> None:
    """Diagonalise symmetric matrices side by side (d, d, k) in place, by cyclic Jacobi, on the upper triangle alone.

    Jacobi and not QR, because it keeps small eigenvalues of a positive definite matrix to high relative
    accuracy (Demmel & Veselić 1992), and on a small cap the smallest one carries the answer. A matrix that is done is
    rotated by angles of zero while others go on, so its numbers do not depend on its neighbours.

    ``vectors`` (d, d, k) receives the eigenvectors as columns; ``angles`` (2, k) is working memory.
    """
    d, cosine, sine = matrix.shape[0], angles[0], angles[1]
    for i in range(d):
        for j in range(d):
            fill(vectors[i, j], 1.0 if i == j else 0.0)
    for _ in range(_MAX_SWEEPS):
        rotated = False
        for p in range(d - 1):
            for q in range(p + 1, d):
                if not _choose(matrix[p, p], matrix[q, q], matrix[p, q], cosine, sine, lanes):
                    continue
                rotated = True
                for k in range(d):
                    if k != p and k != q:
                        _rotate(matrix[min(k, p), max(k, p)], matrix[min(k, q), max(k, q)], cosine, sine, lanes)
                    _rotate(vectors[k, p], vectors[k, q], cosine, sine, lanes)
        if not rotated:
            break


@compiled
def diagonalise(matrix: Floats, vectors: Floats) -> None:
    """Diagonalise a symmetric matrix (d, d): eigenvalues on its diagonal, ascending, and eigenvectors as columns."""
    d = matrix.shape[0]
    _jacobi(matrix.reshape(d, d, 1), vectors.reshape(d, d, 1), np.empty((2, 1)), _ONE)
    for i in range(d - 1):
        low = i
        for j in range(i + 1, d):
            if matrix[j, j] < matrix[low, low]:
                low = j
        if low != i:
            matrix[i, i], matrix[low, low] = matrix[low, low], matrix[i, i]
            for k in range(d):
                vectors[k, i], vectors[k, low] = vectors[k, low], vectors[k, i]


@compiled
def diagonalise_all(matrices: Floats, values: Floats, basis: Floats) -> None:
    """Diagonalise matrices (b, d, d), which stay as they are, several side by side in vector registers.

    ``values`` (b, d), ascending, and ``basis`` (b, d, d) receive the result.
    """
    b, d, _ = matrices.shape
    matrix, vectors, angles = np.empty((d, d, _LANES)), np.empty((d, d, _LANES)), np.empty((2, _LANES))
    for start in range(0, b, _LANES):
        count = min(_LANES, b - start)
        for i in range(d):
            for j in range(d):
                for k in range(_LANES):
                    matrix[i, j, k] = matrices[start + k, i, j] if k < count else (1.0 if i == j else 0.0)
        _jacobi(matrix, vectors, angles, _SEVERAL)
        for k in range(count):
            for j in range(d):  # ascending: the place of each is the number of those before it
                place = 0
                for i in range(d):
                    if matrix[i, i, k] < matrix[j, j, k] or (i < j and not matrix[i, i, k] > matrix[j, j, k]):
                        place += 1
                values[start + k, place] = matrix[j, j, k]
                for i in range(d):
                    basis[start + k, i, place] = vectors[i, j, k]


@compiled
def eliminate(matrix: Floats, columns: int) -> bool:
    """Solve d equations with so many right sides, which stand beside the matrix, in place; False if singular."""
    d = matrix.shape[0]
    wide = d + columns
    for j in range(d):
        best = j
        for i in range(j + 1, d):
            if abs(matrix[i, j]) > abs(matrix[best, j]):
                best = i
        if not abs(matrix[best, j]) > _TINY:
            return False
        for k in range(wide):
            matrix[j, k], matrix[best, k] = matrix[best, k], matrix[j, k]
        over = 1.0 / matrix[j, j]
        for k in range(wide):
            matrix[j, k] *= over
        for i in range(d):
            if i != j:
                factor = matrix[i, j]
                for k in range(wide):
                    matrix[i, k] -= factor * matrix[j, k]
    return True


@compiled
def cholesky_solve(matrix: Floats, right: Floats) -> bool:
    """Solve a positive definite system in place.

    The lower triangle of ``matrix`` is overwritten by the factor, ``right`` by the solution. Returns False, and leaves
    both undefined, if the matrix is not positive definite.
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


def eigenbasis(matrices: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues (b, d), ascending, and eigenvectors (b, d, d), as columns, of symmetric matrices (b, d, d)."""
    values, vectors = np.empty(matrices.shape[:2]), np.empty(matrices.shape)
    diagonalise_all(matrices, values, vectors)
    return values, vectors


@compiled
def components_all(basis: Floats, vectors: Floats, result: Floats) -> None:
    """Components (b, d) of vectors (b, d) along the columns of bases (b, d, d)."""
    b, d = vectors.shape
    for t in range(b):
        for k in range(d):
            along = 0.0
            for i in range(d):
                along += basis[t, i, k] * vectors[t, i]
            result[t, k] = along

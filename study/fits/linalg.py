"""Linear algebra of d × d matrices in compiled loops, where a call of LAPACK costs more than the work itself."""

import math

import numpy as np

from study.arrays import Floats
from study.fits.jit import compiled

_MAX_SWEEPS = 40
_LANES = 16
"""Number of matrices that are diagonalised side by side."""
_EPS = 2.0**-52


@compiled
def _significant(pp: float, qq: float, off: float) -> bool:
    """True if an entry off the diagonal is large enough to change the eigenvalues of its plane."""
    return abs(off) > 0.25 * _EPS * math.sqrt(abs(pp * qq))


@compiled
def _tangent(pp: float, qq: float, off: float) -> float:
    """Tangent of the smaller angle whose rotation takes an entry off the diagonal to zero."""
    theta = 0.5 * (qq - pp) / off
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    return -t if theta < 0.0 else t


@compiled
def diagonalise(matrix: Floats, vectors: Floats) -> None:
    """Diagonalise a symmetric matrix in place, by cyclic Jacobi: eigenvalues on the diagonal, ascending.

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
                if not _significant(matrix[p, p], matrix[q, q], off):
                    continue
                rotated = True
                t = _tangent(matrix[p, p], matrix[q, q], off)
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
def _eliminate(pp: Floats, qq: Floats, pq: Floats, cosine: Floats, sine: Floats) -> bool:
    """Choose the rotations that take the p-q entries of some matrices to zero, and apply them to those entries.

    Returns False if every one of the entries is negligible.
    """
    rotated = 0.0
    for k in range(_LANES):
        significant = _significant(pp[k], qq[k], pq[k])
        off = pq[k] if significant else 0.0
        t = _tangent(pp[k], qq[k], pq[k] if significant else 1.0) if significant else 0.0
        c = 1.0 / math.sqrt(t * t + 1.0)
        cosine[k] = c
        sine[k] = t * c
        pp[k] -= t * off
        qq[k] += t * off
        pq[k] = 0.0 if significant else pq[k]
        rotated += 1.0 if significant else 0.0
    return rotated > 0.0


@compiled
def _rotate(first: Floats, second: Floats, cosine: Floats, sine: Floats) -> None:
    """Rotate pairs of entries."""
    for k in range(_LANES):
        a, b = first[k], second[k]
        first[k] = cosine[k] * a - sine[k] * b
        second[k] = sine[k] * a + cosine[k] * b


@compiled
def _sweep(matrix: Floats, vectors: Floats, cosine: Floats, sine: Floats) -> bool:
    """Rotate in every plane once, on the upper triangle alone. Returns False if nothing was left to rotate."""
    d = matrix.shape[0]
    rotated = False
    for p in range(d - 1):
        for q in range(p + 1, d):
            if not _eliminate(matrix[p, p], matrix[q, q], matrix[p, q], cosine, sine):
                continue
            rotated = True
            for k in range(d):
                if k != p and k != q:
                    _rotate(matrix[min(k, p), max(k, p)], matrix[min(k, q), max(k, q)], cosine, sine)
                _rotate(vectors[k, p], vectors[k, q], cosine, sine)
    return rotated


@compiled
def diagonalise_all(matrices: Floats, values: Floats, basis: Floats) -> None:
    """Diagonalise matrices (b, d, d) by the same method, several at a time side by side in vector registers.

    A matrix that is done is rotated by angles of zero while others go on, so its numbers do not depend on its
    neighbours. ``values`` (b, d) and ``basis`` (b, d, d) receive the result; the matrices stay as they are.
    """
    b, d, _ = matrices.shape
    matrix, vectors = np.empty((d, d, _LANES)), np.empty((d, d, _LANES))
    cosine, sine = np.empty(_LANES), np.empty(_LANES)
    for start in range(0, b, _LANES):
        count = min(_LANES, b - start)
        for i in range(d):
            for j in range(d):
                for k in range(_LANES):
                    unit = 1.0 if i == j else 0.0
                    vectors[i, j, k] = unit
                    matrix[i, j, k] = matrices[start + k, i, j] if k < count else unit
        for _ in range(_MAX_SWEEPS):
            if not _sweep(matrix, vectors, cosine, sine):
                break
        for k in range(count):
            t = start + k
            for j in range(d):  # ascending: the place of each is the number of those before it
                place = 0
                for i in range(d):
                    if matrix[i, i, k] < matrix[j, j, k] or (i < j and not matrix[i, i, k] > matrix[j, j, k]):
                        place += 1
                values[t, place] = matrix[j, j, k]
                for i in range(d):
                    basis[t, i, place] = vectors[i, j, k]


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

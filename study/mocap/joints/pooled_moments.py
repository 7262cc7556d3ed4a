"""Several markers' moments put together: the equations of one centre, and of how large the noise is.

    ĉ = A⁻¹ b,  A = Σ w_p (C_p - η F̄_p),  b = Σ w_p [(C_p - η F̄_p) x̄_p + ½ (s_p - η (2 mean F z + mean Tr F z)_p)]

is MGDK (paper eq. 22, corrected) with noise of covariance ηF, known but for its size; η is where the variance of the
residuals is what such noise gives (theory §5.5). All of it can be done in a plane, as for a hinge, for each marker in
its own.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from study.mocap.joints.marker_moments import Seen, squared_noise
from study.sphere.jit import compiled, dot
from study.sphere.linalg import diagonalise
from study.sphere.types import Floats

TINY = 1e-13
"""Share of the markers' extent below which rounding is all that is left of it."""
_ROUNDS = 4
_HALVINGS = 45
"""Of the interval in which the noise's size lies: to 3·10⁻¹⁴ of it."""
_SHAPE = 0.1
"""Share of the noise's variance to which its shape is known."""


class Pool:
    """The markers' moments, stacked, with weights; everything in the subspace that the columns of a basis span."""

    def __init__(self, moments: Sequence[Seen], present: list[int]) -> None:
        self.present = present
        self.n = np.array([m.count for m in moments])
        self.mean = np.array([m.mean for m in moments])
        self.c = np.array([m.second for m in moments])
        self.s = np.array([m.third for m in moments])
        self.f = np.array([m.noise for m in moments])
        self.pulled = np.array([m.pulled for m in moments])
        self.traced = np.array([m.traced for m in moments])
        self.along = np.array([m.along for m in moments])
        self.shift, self.tilt = np.array([m.shift for m in moments]), np.array([m.tilt for m in moments])
        self.pivot = np.array([m.pivot for m in moments])
        self.moments = moments
        m2 = np.trace(self.c, axis1=1, axis2=2)
        self.variance = np.array([m.fourth for m in moments]) - m2**2
        self.w = self.n.copy()

    def spread(self) -> Floats:
        """Eigenvalues of Σ n C, ascending."""
        return np.asarray(np.linalg.eigvalsh(np.einsum("p,pij->ij", self.n, self.c)))

    def matrix(self, size: float, basis: Floats) -> Floats:
        """A, in the basis."""
        return np.asarray(basis.T @ np.einsum("p,pij->ij", self.w, self.c - size * self.f) @ basis)

    def top(self, basis: Floats) -> float:
        """The size of noise that would explain all of the extent along some direction."""
        total = basis.T @ np.einsum("p,pij->ij", self.w, self.c) @ basis
        noise = basis.T @ np.einsum("p,pij->ij", self.w, self.f) @ basis
        return _top(total, noise)

    def offsets(self, center: Floats, basis: Floats) -> Floats:
        """The offset o = c - x̄ of each marker (M, 3), within the basis."""
        return np.asarray((center - self.mean) @ basis @ basis.T)

    def squared(self, center: Floats) -> Floats:
        """Tr F² of each marker (M,), as far as it shows in residuals about a centre."""
        result = np.empty(len(self.n))
        squared_noise(center, self.mean, self.pivot, self.shift, self.tilt, result)
        return result

    def strain(self, o: Floats) -> Floats:
        """Mean vᵀFv of each marker (M,), v = z - o."""
        quadratic = np.einsum("pi,pij,pj->p", o, self.f, o)
        return np.asarray(self.along - 2.0 * np.einsum("pi,pi->p", o, self.pulled) + quadratic)

    def square_radii(self, center: Floats, size: float, basis: Floats) -> Floats:
        """r̂² (M,) (paper eq. 23)."""
        o = self.offsets(center, basis)
        inside = basis.T @ (self.c - size * self.f) @ basis
        return np.asarray(np.trace(inside, axis1=1, axis2=2) + np.einsum("pi,pi->p", o, o))

    def weigh(self, center: Floats, basis: Floats) -> None:
        """Weights n/r̂², of radii that the noise is not taken off: those are never too small."""
        self.w = self.n / np.maximum(self.square_radii(center, 0.0, basis), 1e-300)

    def solve(self, basis: Floats, given: float | None = None) -> tuple[float, Floats]:
        """Size η of the noise, unless given, and centre (3,); the weights stay as they were used.

        Where no size below that at which the noise explains all of the extent is enough, it is that one: the centre is
        then of no use.
        """
        middle = np.empty(3)
        size = _solve(
            self.n, self.mean, self.c, self.s, self.f, self.pulled, self.traced, self.along, self.variance,
            self.shift, self.tilt, self.pivot, basis, math.nan if given is None else given, self.w, middle,
        )  # fmt: skip
        return size, middle

    def noise(self, size: float, center: Floats, basis: Floats) -> float:
        """Standard deviation of the noise along the radius."""
        o = self.offsets(center, basis)
        square = np.trace(self.c, axis1=1, axis2=2) + np.einsum("pi,pi->p", o, o)
        return float(np.sqrt(max(size * (self.w @ self.strain(o)) / (self.w @ square), 0.0)))

    def flat(self, size: float, worth: float, basis: Floats) -> float:
        """Standard errors by which the least extent exceeds noise, each of which is η√(2/n) and a share of η."""
        return float((self.top(basis) - size) / max(size * (np.sqrt(2.0 / max(worth, 1.0)) + _SHAPE), 1e-300))

    def least(self, size: float) -> tuple[Floats, Floats]:
        """Direction of least extent (3,), and the two across it as columns (3, 2)."""
        vectors = np.linalg.eigh(self.matrix(size, np.eye(3)))[1]
        return vectors[:, 0], vectors[:, 1:]

    def rounded(self) -> bool:
        """Whether rounding is all that is left of the least extent, and of that alone."""
        values = self.spread()
        return bool(values[0] <= TINY * values[2] < values[1])

    def swing(self, size: float) -> Floats:
        """Root mean square angles about the centre along the principal directions (3,), ascending."""
        values = np.linalg.eigvalsh(self.matrix(size, np.eye(3))) / self.n.sum()
        return np.asarray(np.sqrt(np.maximum(values, 0.0)))

    def slopes(self, size: float, center: Floats, basis: Floats) -> Floats:
        """Jacobian of the estimating functions of (c, η)."""
        o = self.offsets(center, basis)
        fo = np.einsum("pij,pj->pi", self.f, o)
        d = basis.shape[1]
        slopes = np.empty((d + 1, d + 1))
        slopes[:d, :d] = -self.matrix(size, basis)
        slopes[:d, d] = basis.T @ (self.w @ (fo - self.pulled - 0.5 * self.traced))
        residual = self.s - 2.0 * np.einsum("pij,pj->pi", self.c, o)
        slopes[d, :d] = basis.T @ (self.w @ (-4.0 * residual + 8.0 * size * (self.pulled - fo)))
        slopes[d, d] = self.w @ (-4.0 * self.strain(o) + 4.0 * size * self.squared(center))
        return slopes


@compiled
def _pencil(c: Any, f: Any, work: Any, values: Any, vectors: Any) -> None:
    """Extents (d,) in units of the noise, ascending, and directions (d, d), with VᵀFV = I and VᵀCV diagonal.

    ``work`` (2, d, d) is room to work in.
    """
    d = len(values)
    inverse, inner = work[0], work[1]
    # Cholesky's factor of F, and its inverse row by row
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
            vectors[i, k] = entry  # row i is needed no more: L⁻ᵀ is triangular


@compiled
def _excess(parts: Any, variance: float, strain: float, squared: float, size: float) -> float:
    """Variance of the residuals less what noise of this size gives (theory §5.5), summed over markers."""
    for k in range(parts.shape[0]):
        extent, right, noise, pull = parts[k, 0], parts[k, 1], parts[k, 2], parts[k, 3]
        a = (right - size * noise) / (extent - size)
        variance += 4.0 * a * (extent * a - 2.0 * right)
        strain += a * (a - 2.0 * pull)
    return variance - 4.0 * size * strain + 2.0 * size * size * squared


@compiled
def _weigh(n: Any, mean: Any, c: Any, within: Any, middle: Any, w: Any) -> float:
    """Put n/r̂² into ``w``, of radii that the noise is not taken off; the largest change, as a share, is returned."""
    change, most = 0.0, 0.0
    for p in range(len(n)):
        square = 0.0
        for i in range(3):
            offset = 0.0
            for j in range(3):
                square += within[i, j] * c[p, i, j]
                offset += within[i, j] * (middle[j] - mean[p, j])
            square += offset * offset
        before = w[p]
        w[p] = n[p] / max(square, 1e-300)
        change, most = max(change, abs(w[p] - before)), max(most, w[p])
    return change / most


@compiled
def _sum(
    w: Any, mean: Any, c: Any, s: Any, f: Any, pulled: Any, traced: Any, along: Any, variance: Any,
    within: Any, origin: Any, total: Any, noise: Any, sums: Any,
) -> tuple[float, float]:  # fmt: skip
    """Weighted sums over markers about the mean of their centroids, that goes into ``origin``, within a subspace.

    ``total`` and ``noise`` (3, 3) receive Σ w C and Σ w F, ``sums`` (3, 3) the right-hand side, what one unit of noise
    takes off it, and the part of that which shows in the strain; returned are the residuals' variance and strain.
    """
    m, cm, fm = np.empty(3), np.empty(3), np.empty(3)
    weight, spread, strain = 0.0, 0.0, 0.0
    for i in range(3):
        origin[i] = 0.0
        for j in range(3):
            sums[i, j], total[i, j], noise[i, j] = 0.0, 0.0, 0.0
    for p in range(len(w)):
        weight += w[p]
        for i in range(3):
            origin[i] += w[p] * mean[p, i]
    for i in range(3):
        origin[i] /= weight
    for p in range(len(w)):
        for i in range(3):
            m[i] = 0.0
            for j in range(3):
                m[i] += within[i, j] * (mean[p, j] - origin[j])
        spread += w[p] * variance[p]
        strain += w[p] * along[p]
        for i in range(3):
            cm[i] = c[p, i, 0] * m[0] + c[p, i, 1] * m[1] + c[p, i, 2] * m[2]
            fm[i] = f[p, i, 0] * m[0] + f[p, i, 1] * m[1] + f[p, i, 2] * m[2]
            spread += w[p] * m[i] * (4.0 * s[p, i] + 4.0 * cm[i])
            strain += w[p] * m[i] * (2.0 * pulled[p, i] + fm[i])
            sums[0, i] += w[p] * (cm[i] + 0.5 * s[p, i])
            sums[1, i] += w[p] * (fm[i] + pulled[p, i] + 0.5 * traced[p, i])
            sums[2, i] += w[p] * (fm[i] + pulled[p, i])
            for j in range(3):
                total[i, j] += w[p] * c[p, i, j]
                noise[i, j] += w[p] * f[p, i, j]
    return spread, strain


@compiled
def _root(parts: Any, variance: float, strain: float, squared: float, high: float) -> float:
    """The size at which `_excess` is none, by halving; 0 if the residuals are too small, ``high`` if too large."""
    if not (high > 0.0 and _excess(parts, variance, strain, squared, 0.0) > 0.0):
        return 0.0
    if _excess(parts, variance, strain, squared, high) >= 0.0:
        return high
    low = 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _excess(parts, variance, strain, squared, middle) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@compiled
def _solve(
    n: Any, mean: Any, c: Any, s: Any, f: Any, pulled: Any, traced: Any, along: Any, variance: Any,
    shift: Any, tilt: Any, pivot: Any, basis: Any, given: float, w: Any, center: Any,
) -> float:  # fmt: skip
    """`Pool.solve`: the size is returned, found if ``given`` is NaN; ``w`` and ``center`` are written."""
    d = basis.shape[1]
    within, total, noise, sums, origin = (
        np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3),
    )  # fmt: skip
    of_c, of_f, work, extent, vectors = (
        np.empty((d, d)), np.empty((d, d)), np.empty((2, d, d)), np.empty(d), np.empty((d, d)),
    )  # fmt: skip
    parts, square = np.empty((d, 4)), np.empty(len(n))
    for i in range(3):
        for j in range(3):
            within[i, j] = 0.0
            for k in range(d):
                within[i, j] += basis[i, k] * basis[j, k]
    size = 0.0
    for trial in range(_ROUNDS + 1):  # the first is a start, without noise
        change = _weigh(n, mean, c, within, center, w) if trial > 0 else 1.0
        spread, strain = _sum(
            w, mean, c, s, f, pulled, traced, along, variance, within, origin, total, noise, sums
        )  # fmt: skip
        for k in range(d):
            for q in range(d):
                of_c[k, q], of_f[k, q] = 0.0, 0.0
                for i in range(3):
                    for j in range(3):
                        of_c[k, q] += basis[i, k] * total[i, j] * basis[j, q]
                        of_f[k, q] += basis[i, k] * noise[i, j] * basis[j, q]
        # where F is I and C diagonal, everything is a sum of d fractions of the size
        _pencil(of_c, of_f, work, extent, vectors)
        for k in range(d):
            parts[k, 0] = extent[k]
            for r in range(3):
                parts[k, 1 + r] = 0.0
                for q in range(d):
                    for i in range(3):
                        parts[k, 1 + r] += vectors[q, k] * basis[i, q] * sums[r, i]
        first = 0  # along the directions before it there is nothing but rounding
        while first < d and not extent[first] > TINY * extent[d - 1]:
            first += 1
        limit = extent[0] * (1.0 - 1e-9)
        if trial > 0 and math.isnan(given):
            squared_noise(center, mean, pivot, shift, tilt, square)
            size = _root(parts[first:], spread, strain, dot(w, square), limit)
        elif trial > 0:
            size = given
        for i in range(3):
            center[i] = origin[i]
        for k in range(first, d):
            along_k = (parts[k, 1] - size * parts[k, 2]) / (parts[k, 0] - size)
            for q in range(d):
                for i in range(3):
                    center[i] += along_k * vectors[q, k] * basis[i, q]
        if change < 1e-6 or (math.isnan(given) and size > 0.0 and size == limit):
            break  # at the limit it is not positive definite; where that leads is of no use
    return size


def _top(c: Floats, f: Floats) -> float:
    """Least extent in units of the noise."""
    d = len(c)
    values = np.empty(d)
    _pencil(c, f, np.empty((2, d, d)), values, np.empty((d, d)))
    return float(values[0])

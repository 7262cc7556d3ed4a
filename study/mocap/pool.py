"""Several markers' moments put together: the equations of one centre, and of how large the noise is.

    ĉ = A⁻¹ b,  A = Σ w_p (C_p - η F̄_p),  b = Σ w_p [(C_p - η F̄_p) x̄_p + ½ (s_p - η (2 mean F z + mean Tr F z)_p)]

is MGDK (paper eq. 22, corrected) with noise of covariance ηF, known but for its size; η is where the variance of the
residuals is what such noise gives (theory §5.5). All of it can be done in a plane, as for a hinge, for each marker in
its own.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from study.mocap.seen import Seen, squared_noise

Floats = NDArray[np.float64]

TINY = 1e-13
"""Share of the markers' extent below which rounding is all that is left of it."""
_ROUNDS = 4
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
        return float(_pencil(total, noise)[0][0])

    def offsets(self, center: Floats, basis: Floats) -> Floats:
        """The offset o = c - x̄ of each marker (M, 3), within the basis."""
        return np.asarray((center - self.mean) @ basis @ basis.T)

    def squared(self, center: Floats) -> Floats:
        """Tr F² of each marker (M,), as far as it shows in residuals about a centre."""
        return squared_noise(center - self.pivot, self.mean - self.pivot, self.shift, self.tilt)

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
        """Size η of the noise, unless given, and centre (3,); the weights stay as they were used."""
        size = 0.0
        middle = _Sums(self, basis, self.mean[0]).center(0.0)
        for _ in range(_ROUNDS):
            before = self.w
            self.weigh(middle, basis)
            sums = _Sums(self, basis, middle)
            high = float(sums.top[0]) * (1.0 - 1e-9)
            if given is not None:
                size = given
            elif not (high > 0.0 and sums.excess(0.0) > 0.0):
                size = 0.0
            elif sums.excess(high) >= 0.0:
                return high, sums.center(high)  # not positive definite; where that leads is of no use
            else:
                size = float(brentq(sums.excess, 0.0, high, xtol=1e-12 * high, rtol=1e-10))
            middle = sums.center(size)
            if np.abs(self.w - before).max() < 1e-6 * self.w.max():
                break
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


class _Sums:
    """What the centre and the size follow from, summed over markers, in the basis and about the centroids' mean."""

    def __init__(self, pool: Pool, basis: Floats, near: Floats) -> None:
        w, self.basis = pool.w, basis
        self.origin = w @ pool.mean / w.sum()
        mean = (pool.mean - self.origin) @ basis
        c, f = basis.T @ pool.c @ basis, basis.T @ pool.f @ basis
        s, pulled, traced = pool.s @ basis, pool.pulled @ basis, pool.traced @ basis
        cm, fm = np.einsum("pij,pj->pi", c, mean), np.einsum("pij,pj->pi", f, mean)
        self.c, self.f = np.einsum("p,pij->ij", w, c), np.einsum("p,pij->ij", w, f)
        self.right, self.pull = w @ (cm + 0.5 * s), w @ (fm + pulled)
        self.right_noise = self.pull + 0.5 * (w @ traced)
        self.variance = w @ (pool.variance + np.einsum("pi,pi->p", mean, 4.0 * s + 4.0 * cm))
        self.strain = w @ (pool.along + np.einsum("pi,pi->p", mean, 2.0 * pulled + fm))
        self.squared = w @ pool.squared(near)

        # in the basis in which F is I and C diagonal, everything is a sum of d fractions of the size
        self.top, self.vectors = _pencil(self.c, self.f)
        columns = [self.top, *(v @ self.vectors for v in (self.right, self.right_noise, self.pull))]
        shown = self.top > TINY * self.top[-1]  # along the others there is nothing but rounding
        self.parts = [tuple(map(float, part)) for part in np.stack(columns, axis=1)[shown]]
        self.vectors = self.vectors[:, shown]

    def center(self, size: float) -> Floats:
        """ĉ (3,); across the basis, the mean of the centroids."""
        along = [(right - size * noise) / (extent - size) for extent, right, noise, _ in self.parts]
        return np.asarray(self.origin + self.basis @ self.vectors @ np.array(along))

    def excess(self, size: float) -> float:
        """Variance of the residuals less what noise of this size gives (theory §5.5), summed over markers."""
        variance, strain = self.variance, self.strain
        for extent, right, noise, pull in self.parts:
            a = (right - size * noise) / (extent - size)
            variance += 4.0 * a * (extent * a - 2.0 * right)
            strain += a * (a - 2.0 * pull)
        return float(variance - 4.0 * size * strain + 2.0 * size**2 * self.squared)


def _pencil(c: Floats, f: Floats) -> tuple[Floats, Floats]:
    """Extents in units of the noise, ascending, and directions (d, d) as columns, with VᵀFV = I and VᵀCV diagonal."""
    root = np.linalg.cholesky(f)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ c @ inverse.T)
    return np.maximum(values, 0.0), inverse.T @ vectors

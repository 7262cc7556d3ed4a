"""Pooled moments of several markers: the fit of their common centre, and statistics of that fit.

Symbols are those of `solve_center`, which solves the equations; o = c - x̄ is the offset of a centre from a marker's
mean, and v = z - o is a sample as seen from the centre.
"""

import math
from collections.abc import Sequence

import numpy as np

from study.mocap.geometry.generalised_eigen import smallest_generalised_eigenvalue
from study.mocap.joints.marker_moments import MarkerMoments, lagged_products, squared_noise
from study.mocap.joints.solve_center import TINY, StackedMoments, solve_center
from study.sphere.types import Floats

SHAPE_ERROR = 0.1
"""Relative uncertainty of the noise's variance in one direction: the shape of its covariance is known to this."""


class PooledMoments:
    """Moments of the markers of one joint, with weights, in the subspace that the columns of a basis (3, d) span.

    Attributes:
        markers: moments of each marker.
        present: places of these in the list that they were taken from.
        stacked: their arrays.
        w: weights (M,).
    """

    def __init__(self, markers: Sequence[MarkerMoments], present: list[int]) -> None:
        self.markers, self.present = markers, present
        second = np.array([m.second for m in markers])
        self.stacked = StackedMoments(
            n=np.array([m.count for m in markers]),
            mean=np.array([m.mean for m in markers]),
            c=second,
            s=np.array([m.third for m in markers]),
            f=np.array([m.noise for m in markers]),
            fz=np.array([m.noise_z for m in markers]),
            trace_z=np.array([m.trace_z for m in markers]),
            zfz=np.array([m.z_noise_z for m in markers]),
            variance=np.array([m.fourth for m in markers]) - np.trace(second, axis1=1, axis2=2) ** 2,
            shift=np.array([m.shift for m in markers]),
            tilt=np.array([m.tilt for m in markers]),
            pivot=np.array([m.pivot for m in markers]),
        )
        self.w = self.stacked.n.copy()

    def solve(self, basis: Floats, given: float | None = None) -> tuple[float, Floats]:
        """Solve for the size η of the noise, unless given, and the centre (3,); sets the weights that belong to it."""
        center = np.empty(3)
        size = solve_center(self.stacked, basis, math.nan if given is None else given, self.w, center)
        return size, center

    def reweight(self, center: Floats, basis: Floats) -> None:
        """Set the weights n/r̂², of radii without noise taken off: those are never too small."""
        self.w = self.stacked.n / np.maximum(self.square_radii(center, 0.0, basis), 1e-300)

    def extents(self) -> Floats:
        """Eigenvalues of Σ n C (3,), ascending."""
        return np.asarray(np.linalg.eigvalsh(np.einsum("p,pij->ij", self.stacked.n, self.stacked.c)))

    def matrix(self, size: float, basis: Floats) -> Floats:
        """A = Σ w (C - ηF), in the basis (d, d)."""
        m = self.stacked
        return np.asarray(basis.T @ np.einsum("p,pij->ij", self.w, m.c - size * m.f) @ basis)

    def largest_size(self, basis: Floats) -> float:
        """Smallest generalised eigenvalue of (Σ w C, Σ w F) in the basis: η must be below it for a centre to exist."""
        total = basis.T @ np.einsum("p,pij->ij", self.w, self.stacked.c) @ basis
        noise = basis.T @ np.einsum("p,pij->ij", self.w, self.stacked.f) @ basis
        return smallest_generalised_eigenvalue(total, noise)

    def square_radii(self, center: Floats, size: float, basis: Floats) -> Floats:
        """r̂² of each marker (M,) (paper eq. 23)."""
        m, o = self.stacked, self._offsets(center, basis)
        inside = basis.T @ (m.c - size * m.f) @ basis
        return np.asarray(np.trace(inside, axis1=1, axis2=2) + np.einsum("pi,pi->p", o, o))

    def radial_noise(self, size: float, center: Floats, basis: Floats) -> float:
        """Standard deviation of the noise along the radius, metres."""
        o = self._offsets(center, basis)
        square = np.trace(self.stacked.c, axis1=1, axis2=2) + np.einsum("pi,pi->p", o, o)
        return float(np.sqrt(max(size * (self.w @ self._mean_vfv(o)) / (self.w @ square), 0.0)))

    def significance(self, size: float, effective: float, basis: Floats, shape_error: float = 0.0) -> float:
        """Significance of the smallest eigenvalue: standard errors by which it exceeds the noise.

        Its standard error is η√(2/n), n the effective number of independent frames, and a share of η.
        """
        error = size * (np.sqrt(2.0 / max(effective, 1.0)) + shape_error)
        return float((self.largest_size(basis) - size) / max(error, 1e-300))

    def slow_share(self, center: Floats) -> float:
        """Share of the residuals' variance that a frame has in common with the next one.

        Soft tissue is slow, and noise of markers and poses is new in each frame.
        """
        common, total = 0.0, 0.0
        for marker, weight in zip(self.markers, self.w / self.stacked.n, strict=True):
            used = marker.used & (marker.by_pattern.pattern >= 0)
            one, two = lagged_products(marker.z, used, center - marker.mean)
            common, total = common + weight * one, total + weight * two
        return min(max(common / total, 0.0), 1.0) if 0.0 < total < math.inf else 1.0

    def shape_covariance(self, size: float, center: Floats, basis: Floats, error: float) -> Floats:
        """Covariance of the centre (3, 3), m², as the shape of the noise's covariance is known to `SHAPE_ERROR`.

        The noise along each principal direction e of the motion is off by that share, independently of the others: F
        changes by a share of eᵀFe eeᵀ. The estimating functions (see `add_scores`) change with it, and (c, η) by the
        inverse of their Jacobian. Where the noise shows along e itself, as the residual of one marker's sphere, η
        takes it up.
        """
        m, o = self.stacked, self._offsets(center, basis)
        directions = basis @ np.linalg.eigh(self.matrix(size, basis))[1]
        along = np.einsum("ik,pij,jk->kp", directions, m.f, directions)
        offset, extent = directions.T @ o.T, np.einsum("ik,pij,jk->kp", directions, m.c, directions)
        weighted = error * size * self.w * along
        scores = np.empty((basis.shape[1] + 1, directions.shape[1]))
        scores[:-1] = basis.T @ directions * (weighted * offset).sum(axis=1)
        scores[-1] = (4.0 * weighted * (size * along - extent - offset**2)).sum(axis=1)
        shifts = basis @ np.linalg.pinv(self.jacobian(size, center, basis))[:-1] @ scores
        return np.asarray(shifts @ shifts.T)

    def least_direction(self, size: float) -> tuple[Floats, Floats]:
        """Direction of least extent (3,), and the two across it as columns (3, 2)."""
        vectors = np.linalg.eigh(self.matrix(size, np.eye(3)))[1]
        return vectors[:, 0], vectors[:, 1:]

    def exactly_planar(self) -> bool:
        """True if the smallest extent, and that alone, is rounding."""
        values = self.extents()
        return bool(values[0] <= TINY * values[2] < values[1])

    def rms_angles(self, size: float) -> Floats:
        """Root mean square angles of motion about the centre, along the principal directions (3,), ascending."""
        values = np.linalg.eigvalsh(self.matrix(size, np.eye(3))) / self.stacked.n.sum()
        return np.asarray(np.sqrt(np.maximum(values, 0.0)))

    def jacobian(self, size: float, center: Floats, basis: Floats) -> Floats:
        """Jacobian of the estimating functions of (c, η), see `add_scores`, in the basis (d + 1, d + 1)."""
        m, o = self.stacked, self._offsets(center, basis)
        fo = np.einsum("pij,pj->pi", m.f, o)
        d = basis.shape[1]
        slopes = np.empty((d + 1, d + 1))
        slopes[:d, :d] = -self.matrix(size, basis)
        slopes[:d, d] = basis.T @ (self.w @ (fo - m.fz - 0.5 * m.trace_z))
        residual = m.s - 2.0 * np.einsum("pij,pj->pi", m.c, o)
        slopes[d, :d] = basis.T @ (self.w @ (-4.0 * residual + 8.0 * size * (m.fz - fo)))
        slopes[d, d] = self.w @ (-4.0 * self._mean_vfv(o) + 4.0 * size * self._squared_noise(center))
        return slopes

    def _offsets(self, center: Floats, basis: Floats) -> Floats:
        """O of each marker (M, 3), within the basis."""
        return np.asarray((center - self.stacked.mean) @ basis @ basis.T)

    def _squared_noise(self, center: Floats) -> Floats:
        """`squared_noise` of each marker (M,)."""
        m, result = self.stacked, np.empty(len(self.stacked.n))
        squared_noise(center, m.mean, m.pivot, m.shift, m.tilt, result)
        return result

    def _mean_vfv(self, o: Floats) -> Floats:
        """Mean vᵀFv of each marker (M,)."""
        quadratic = np.einsum("pi,pij,pj->p", o, self.stacked.f, o)
        return np.asarray(self.stacked.zfz - 2.0 * np.einsum("pi,pi->p", o, self.stacked.fz) + quadratic)

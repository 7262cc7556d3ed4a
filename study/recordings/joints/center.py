"""One centre from several markers in a segment's axes: MGDK with the noise that the segment's pose really has.

With noise of covariance I it is `study.mgdk` (paper eq. 22, corrected), the size of the noise found as `als` does and
weights 1/r̂². Here each sample has a covariance of its own (`PoseNoise`). Where markers move in planes, as about a
hinge, the direction across the planes is dropped.

The covariance is the sandwich of the estimating functions of (c, η), frame by frame, in its long-run form
(`long_run_covariance`). It holds for any residuals, be they correlated in time and between markers or of unequal
variance, as long as there are many times more frames than their autocorrelation time.

Samples far off a marker's sphere, such as those of swapped markers, are rejected before. Least squares is not robust:
one marker that is half a metre away in one frame of fifty moves the sphere there. So small random sets of samples, many
of which hold no outlier, propose centres. If the median sample is several times nearer to its sphere about one of these
than about the centre of all samples, there are outliers. Samples far from the spheres about that centre are rejected,
then those far from GDKE's, until none is.

Moments. UGDK subtracts the covariance of the noise from the moments of a marker (paper eqs 10-17). Here each sample has
a covariance F of its own, (*) of `PoseNoise`:

    second moment  Σzzᵀ - ΣF,        third moment  Σ|z|²z - Σ(2F + Tr F) z.

The mean of both is exact for any symmetric noise. The centre of several markers is

    ĉ = A⁻¹ b,  A = Σ w_p (C_p - η F̄_p),  b = Σ w_p [(C_p - η F̄_p) x̄_p + ½ (s_p - η (2 mean F z + mean Tr(F) z)_p)]

which is MGDK (paper eq. 22, corrected) with noise of covariance ηF, known but for its size η. The size is where the
variance of the residuals is what such noise gives (theory §5.5). For a hinge all of it is done in a plane, for each
marker in its own. o = c - x̄ is the offset of a centre from a marker's mean, and v = z - o a sample as seen from there.

Scores are the contribution of each frame to the equations that define the centre and its noise. The centre's covariance
follows from them, for any correlation in time (`long_run_covariance`).

Source: Rousseeuw 1984 (least median of squares).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dsygv
from scipy.optimize import brentq

from study.arrays import Bools, Floats
from study.fits import fit
from study.fits.loops.random import stream
from study.recordings.joints.poses import PoseNoise, long_run_covariance
from study.recordings.rigid import skew


@dataclass(frozen=True)
class LocalMarker:
    """A marker in a segment's axes.

    Attributes:
        y: its place (3, frames), metres.
        used: samples to use (frames,).
        own: variance of its own noise, m².
    """

    y: Floats
    used: Bools
    own: float

    def in_frames(self, frames: slice) -> "LocalMarker":
        """The marker in some of the frames."""
        return LocalMarker(np.ascontiguousarray(self.y[:, frames]), self.used[frames], self.own)

    def near_sphere(self, center: Floats, axis: Floats | None = None, tolerance: float = 0.0) -> "LocalMarker":
        """The marker without the samples that are far off its sphere.

        Args:
            center: of the sphere (3,), metres.
            axis: of a hinge (3,), to reject samples off the marker's circle about it instead.
            tolerance: share of the radius that is never far.
        """
        away = self.y - center[:, None]
        if axis is not None:
            away = away - np.outer(axis, axis @ away)
        distance = np.sqrt((away**2).sum(axis=0))
        inside = distance[self.used]
        if not len(inside):
            return self
        middle = np.median(inside)
        limit = max(_FAR * 1.4826 * float(np.median(np.abs(inside - middle))), tolerance * middle, _ROUNDING)
        return replace(self, used=self.used & (np.abs(distance - middle) <= limit))


TINY = 1e-13
"""Share of the markers' extent below which an extent is rounding."""
_REPEATS = 4
SHAPE_ERROR = 0.1
"""Relative uncertainty of the noise's variance in one direction: the shape of its covariance is known to this."""


class PooledMoments:
    """Moments of the markers of one joint in a segment's axes, and what noise of size 1 adds to them (weights 1/n).

    They have weights, and are used in the subspace that the columns of a basis (3, d) span.

    Args:
        markers: of the joint.
        present: numbers of those with two samples or more in frames whose pose is known, M of them; others are left
            out.
        pose: noise of the segment's pose.
        size: variance of the noise in units of what ``pose`` and the markers say, to correct for its mean effects.

    Attributes:
        used: frames of each marker with a sample that counts (frames,), n of them.
        z: samples of each (3, n), corrected for the mean effects of the noise, less their mean.
        covariances: F of each sample of each (3, 3, n).
        n, mean, c, s: numbers of samples (M,), x̄ (M, 3), mean zzᵀ C (M, 3, 3), mean |z|²z (M, 3).
        f, fz, trace_z, zfz: means of F (M, 3, 3), F z (M, 3), Tr(F) z (M, 3) and zᵀFz (M,).
        variance: variances of |z|² (M,).
        shift, tilt: mean covariances (M, 3, 3) of the noise's translation, the marker's own noise included, m², and of
            its rotation, rad².
        pivot: mean point about which it rotates (M, 3), metres.
        w: weights (M,).
    """

    def __init__(self, markers: Sequence[LocalMarker], present: list[int], pose: PoseNoise, size: float) -> None:
        self.present, chosen = present, [markers[k] for k in present]
        self.used = [marker.used & (pose.pattern >= 0) for marker in chosen]
        x = [pose.corrected(m.y.compress(used, axis=1), used, size) for m, used in zip(chosen, self.used, strict=True)]
        own = [marker.own for marker in chosen]
        self.covariances = [pose.covariances(*sample) for sample in zip(x, self.used, own, strict=True)]
        self.n = np.array([float(points.shape[1]) for points in x])
        share = (1.0 / self.n).tolist()
        self.mean = np.array([part * points.sum(axis=1) for part, points in zip(share, x, strict=True)])
        self.z = [points - mean[:, None] for points, mean in zip(x, self.mean, strict=True)]
        samples = list(zip(share, self.z, self.covariances, strict=True))
        squares = [(z**2).sum(axis=0) for z in self.z]
        self.c = np.array([part * z @ z.T for part, z, _ in samples])
        self.s = np.array([part * z @ square for (part, z, _), square in zip(samples, squares, strict=True)])
        fourth = np.array([part * float(square @ square) for part, square in zip(share, squares, strict=True)])
        self.variance = fourth - np.einsum("pii->p", self.c) ** 2
        # means of F and of F_ij z_k (3, 3, 4)
        of_f = [
            part * (f.reshape(9, -1) @ np.vstack([np.ones_like(z[0]), z]).T).reshape(3, 3, 4) for part, z, f in samples
        ]
        self.f = np.array([moment[:, :, 0] for moment in of_f])
        self.fz = np.array([np.einsum("ijj->i", moment[:, :, 1:]) for moment in of_f])
        self.trace_z = np.array([np.einsum("iik->k", moment[:, :, 1:]) for moment in of_f])
        self.zfz = np.array([part * float(np.vdot(f, z[:, None] * z)) for part, z, f in samples])
        numbers = (np.bincount(pose.pattern[used], minlength=len(pose.centroid)) for used in self.used)
        patterns = [part * count for part, count in zip(share, numbers, strict=True)]
        shifts = (np.einsum("k,kij->ij", part, pose.shift) for part in patterns)
        self.shift = np.array([noise * np.eye(3) + shift for noise, shift in zip(own, shifts, strict=True)])
        self.tilt = np.array([np.einsum("k,kij->ij", part, pose.tilt) for part in patterns])
        self.pivot = np.array([part @ pose.centroid for part in patterns])
        self.w = self.n.copy()

    def solve(self, basis: Floats, given: float | None = None) -> tuple[float, Floats]:
        """Solve for the size η of the noise, unless given, and the centre; sets the weights that belong to it.

        Where no size below the smallest generalised eigenvalue of (Σ w C, Σ w F) is enough, η is just below that, and
        the centre is of no use.

        Returns:
            η, and ĉ (3,).
        """
        size, center, change = 0.0, np.zeros(3), 1.0
        for step in range(_REPEATS + 1):  # the first is a start, without noise
            if step > 0:
                change = self.reweight(center, basis)
            w, origin = self.w, self.w @ self.mean / self.w.sum()
            m = -self._offsets(origin, basis)
            cm, fm = (self.c @ m[:, :, None])[:, :, 0], (self.f @ m[:, :, None])[:, :, 0]
            right = np.array([cm + 0.5 * self.s, fm + self.fz + 0.5 * self.trace_z, fm + self.fz])
            # in directions in which F is I and C diagonal, everything is a sum of d fractions of the size
            extent, vectors = self._extents(basis)
            directions = basis @ vectors
            terms = np.vstack([extent, (w @ right) @ directions])
            known = extent > TINY * extent[-1]  # along the others there is nothing but rounding
            limit = float(extent[0]) * (1.0 - 1e-9)
            if step > 0 and given is None:
                variance = float(w @ (self.variance + 4.0 * ((self.s + cm) * m).sum(axis=1)))
                vfv = float(w @ (self.zfz + ((2.0 * self.fz + fm) * m).sum(axis=1)))
                size = _noise_size(terms[:, known], variance, vfv, float(w @ self.squared_noise(center)), limit)
            elif step > 0 and given is not None:
                size = given
            extent, b, b_noise, _ = terms[:, known]
            center = origin + directions[:, known] @ ((b - size * b_noise) / (extent - size))
            if change < 1e-6 or (given is None and 0.0 < size == limit):
                break  # at the limit the matrix is singular, and further rounds are of no use
        return size, center

    def squared_noise(self, center: Floats) -> Floats:
        """Compute half the variance of |noise|² in the residuals about a centre (M,); for noise by (*) that is Tr F².

        A rotation about the pivot does not change the distance from the pivot. So it counts at second order only as far
        as the centre is from the pivot. With d and v the centre and the marker's mean from there, S the shift's and T
        the tilt's covariance, the result is Tr S (S + 2 [d] T [d]ᵀ) + Tr Q², Q = (½ (d vᵀ + v dᵀ) - d·v) T.
        """
        d, v = center - self.pivot, self.mean - self.pivot
        dv, cross = d[:, :, None] * v[:, None], skew(d)
        along = (d * v).sum(axis=1)[:, None, None]
        q = 0.5 * (dv + dv.swapaxes(1, 2)) @ self.tilt - along * self.tilt
        rotated = cross @ self.tilt @ cross.swapaxes(1, 2)
        return np.asarray(np.einsum("pii->p", self.shift @ (self.shift + 2.0 * rotated) + q @ q))

    def scores(self, size: float, center: Floats, basis: Floats) -> Floats:
        """Estimating functions of (c, η), frame by frame (4, frames).

        Summed over markers with their weights, they are ½ z f + η (F (o - z) - ½ Tr F z) for the centre, and
        f² - 4η vᵀFv + 2η² Tr F² (as in `squared_noise`) for the size, with f = |v|² less its mean. Both sum to zero at
        the solution.
        """
        scores = np.zeros((4, len(self.used[0])))
        about = self._offsets(center, basis), self.squared_noise(center), self.w / self.n
        for z, f, used, o, square, weight in zip(self.z, self.covariances, self.used, *about, strict=True):
            v = z - o[:, None]
            residual = (v**2).sum(axis=0)
            residual -= residual.mean()
            fv = f[:, 0] * v[0] + f[:, 1] * v[1] + f[:, 2] * v[2]
            trace = f[0, 0] + f[1, 1] + f[2, 2]
            scores[:3, used] += weight * (0.5 * z * residual - size * (fv + 0.5 * trace * z))
            along = (fv * v).sum(axis=0)
            scores[3, used] += weight * (residual**2 - 4.0 * size * along + 2.0 * size**2 * square)
        return scores

    def reweight(self, center: Floats, basis: Floats) -> float:
        """Set the weights n/r̂², of radii without noise taken off: those are never too small.

        Returns the largest change, relative to the largest weight.
        """
        before, self.w = self.w, self.n / np.maximum(self.square_radii(center, 0.0, basis), 1e-300)
        return float(np.abs(self.w - before).max() / self.w.max())

    def extents(self) -> Floats:
        """Eigenvalues of Σ n C (3,), ascending."""
        return np.linalg.eigvalsh(np.einsum("p,pij->ij", self.n, self.c))

    def matrix(self, size: float, basis: Floats) -> Floats:
        """A = Σ w (C - ηF), in the basis (d, d)."""
        return np.asarray(basis.T @ np.einsum("p,pij->ij", self.w, self.c - size * self.f) @ basis)

    def largest_size(self, basis: Floats) -> float:
        """Smallest generalised eigenvalue of (Σ w C, Σ w F) in the basis: η must be below it for a centre to exist."""
        return float(self._extents(basis)[0][0])

    def square_radii(self, center: Floats, size: float, basis: Floats) -> Floats:
        """r̂² of each marker (M,) (paper eq. 23)."""
        o = self._offsets(center, basis)
        inside = (self.c - size * self.f).reshape(-1, 9) @ (basis @ basis.T).ravel()
        return np.asarray(inside + (o**2).sum(axis=1))

    def radial_noise(self, size: float, center: Floats, basis: Floats) -> float:
        """Standard deviation of the noise along the radius, metres."""
        o = self._offsets(center, basis)
        square = np.einsum("pii->p", self.c) + np.einsum("pi,pi->p", o, o)
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
        for z, used, mean, n, w in zip(self.z, self.used, self.mean, self.n, self.w, strict=True):
            squares, weight = ((z - (center - mean)[:, None]) ** 2).sum(axis=0), w / n
            residual = np.zeros(len(used))
            residual[used] = squares - squares.mean()
            pairs = (used[1:] & used[:-1]).sum()
            common += weight * float(residual[1:] @ residual[:-1]) * n / max(pairs, 1)
            total += weight * float(residual @ residual)
        return min(max(common / total, 0.0), 1.0) if 0.0 < total < math.inf else 1.0

    def shape_covariance(self, size: float, center: Floats, basis: Floats, error: float) -> Floats:
        """Covariance of the centre (3, 3), m², as the shape of the noise's covariance is known to `SHAPE_ERROR`.

        The noise along each principal direction e of the motion is off by that share, independently of the others: F
        changes by a share of eᵀFe eeᵀ. The estimating functions (see `scores`) change with it, and (c, η) by the
        inverse of their Jacobian. Where the noise shows along e itself, as the residual of one marker's sphere, η
        takes it up.
        """
        o = self._offsets(center, basis)
        directions = basis @ np.linalg.eigh(self.matrix(size, basis))[1]
        along = np.einsum("ik,pij,jk->kp", directions, self.f, directions)
        offset, extent = directions.T @ o.T, np.einsum("ik,pij,jk->kp", directions, self.c, directions)
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

    def jacobian(self, size: float, center: Floats, basis: Floats) -> Floats:
        """Jacobian of the estimating functions of (c, η), see `scores`, in the basis (d + 1, d + 1)."""
        o = self._offsets(center, basis)
        fo = np.einsum("pij,pj->pi", self.f, o)
        d = basis.shape[1]
        slopes = np.empty((d + 1, d + 1))
        slopes[:d, :d] = -self.matrix(size, basis)
        slopes[:d, d] = basis.T @ (self.w @ (fo - self.fz - 0.5 * self.trace_z))
        residual = self.s - 2.0 * np.einsum("pij,pj->pi", self.c, o)
        slopes[d, :d] = basis.T @ (self.w @ (-4.0 * residual + 8.0 * size * (self.fz - fo)))
        slopes[d, d] = self.w @ (-4.0 * self._mean_vfv(o) + 4.0 * size * self.squared_noise(center))
        return slopes

    def _offsets(self, center: Floats, basis: Floats) -> Floats:
        """Offset o of each marker (M, 3), projected on the subspace that the basis spans."""
        return np.asarray((center - self.mean) @ basis @ basis.T)

    def _extents(self, basis: Floats) -> tuple[Floats, Floats]:
        """Eigenvalues of Σ w C relative to Σ w F (d,), ascending and not below 0, and its vectors (d, d)."""
        total, noise = (basis.T @ (self.w @ part.reshape(-1, 9)).reshape(3, 3) @ basis for part in (self.c, self.f))
        values, vectors, failed = dsygv(total, noise)  # eigh(driver="gv") calls the same, and takes five times as long
        if failed:
            raise np.linalg.LinAlgError("the extents relative to the noise of the poses cannot be computed")
        return np.maximum(values, 0.0), vectors

    def _mean_vfv(self, o: Floats) -> Floats:
        """Mean vᵀFv of each marker (M,)."""
        quadratic = np.einsum("pi,pij,pj->p", o, self.f, o)
        return np.asarray(self.zfz - 2.0 * np.einsum("pi,pi->p", o, self.fz) + quadratic)


def _noise_size(terms: Floats, variance: float, vfv: float, squared: float, limit: float) -> float:
    """Size at which the variance of the residuals is what noise gives (theory §5.5): from 0 to ``limit``.

    Args:
        terms: in directions in which F is I and C diagonal, the extents, b, what noise of size 1 takes off it, and
            Σ w (F m + mean F z) (4, d).
        variance: weighted sum over markers of the variance of the residuals about the origin.
        vfv: weighted sum of vᵀFv about the origin.
        squared: weighted sum of `PooledMoments.squared_noise`.
        limit: size to return where none is enough.
    """
    directions = terms.T.tolist()  # for so few numbers faster than an array

    def excess(size: float) -> float:
        of_residuals, along = variance, vfv
        for extent, b, b_noise, fz in directions:
            a = (b - size * b_noise) / (extent - size)
            of_residuals += 4.0 * a * (extent * a - 2.0 * b)
            along += a * (a - 2.0 * fz)
        return of_residuals - 4.0 * size * along + 2.0 * size**2 * squared

    if not (limit > 0.0 and excess(0.0) > 0.0):
        return 0.0
    return limit if excess(limit) >= 0.0 else float(brentq(excess, 0.0, limit, xtol=1e-15 * limit, rtol=1e-14))


_FRAMES = 600
"""Frames from which a first value of the noise's size is found."""
_SIGNIFICANT = 3.0
"""Standard errors within which a direction's extent, or what it explains, is noise."""
_RADIUS = 5.0
"""Least radius, in standard deviations of the noise, that shows a sphere and not a cloud of noise."""
_WORSE = 1.5
"""Growth of the noise's size, from what it was or should be, above which no direction may be dropped."""
_LINE = 2.0 / math.sqrt(5.0)
"""Relative standard deviation of the variance along a random direction, for soft tissue that slides along one line."""
SIGNIFICANT = 2.0
"""Standard errors by which the smallest extent must exceed the noise, as for `als`."""
CONDITION_LIMIT = 0.999
"""A condition ρ above this counts as 1: at the limit of `PooledMoments.solve`."""


@dataclass(frozen=True)
class CenterFit:
    """A centre in a segment's axes.

    Attributes:
        center: ĉ (3,), metres. Along a dropped axis it is at the mean of the markers' centroids.
        radii: r̂ of each marker (M,), metres, across the axis if one is dropped; NaN where none is real.
        noise: standard deviation of the noise along the radius, metres, the pose's noise included.
        size: η, the variance of the noise in units of what was expected.
        condition: ρ, the share of the smallest extent that is noise; below 1 for a centre to exist.
        covariance: of ĉ (3, 3), m²; 0 along a dropped axis.
        shape: part of the error that comes from the noise's shape, which is not in ``covariance`` (3, 3), m².
        frames: number of frames used.
        effective_frames: effective number of independent frames.
        axis: dropped direction (3,), or None.
        least: direction of least extent (3,), dropped or not.
        significance: standard errors by which the least extent that was not dropped exceeds the noise.
        clear: True if the extent along ``least`` exceeds the noise even if that has another shape than expected.
        rms_angles: root mean square angles of the markers' motion about the centre, along their principal directions
            (3,), ascending, radians; noise taken off.
        normal: matrix of the normal equations A = Σ w (C - ηF) (3, 3), see above.
        weights: w of each marker (M,); 0 for one with too few samples.
    """

    center: Floats
    radii: Floats
    noise: float
    size: float
    condition: float
    covariance: Floats
    shape: Floats
    frames: int
    effective_frames: float
    axis: Floats | None
    least: Floats
    significance: float
    clear: bool
    rms_angles: Floats
    normal: Floats
    weights: Floats

    @property
    def significant(self) -> bool:
        """True if a centre exists, and the least extent exceeds the noise, as that has the expected shape."""
        return self.condition < CONDITION_LIMIT and self.significance > SIGNIFICANT

    @property
    def exceeds_noise(self) -> bool:
        """True if any radius is several times the noise, so that the sphere is not just a cloud of noise."""
        return bool(np.nanmax(self.radii, initial=0.0) > _RADIUS * self.noise)


def fit_center(
    markers: Sequence[LocalMarker], pose: PoseNoise, hinge: bool | None = None, size: float | None = None
) -> CenterFit | None:
    """Fit one centre with its covariance.

    The direction of least extent is dropped, as for a hinge, if its extent is within the noise, if it explains nothing
    of the residuals of the fit without it (`hinge` of `study.fits` asks the same two), and if that fit is no
    worse.

    Args:
        markers: at least one.
        pose: noise of the pose of the segment in whose axes they are.
        hinge: True to drop a direction, False to keep all, None to decide by the data.
        size: η, if it is known; 0 gives GDKE's centre, which is biased towards the markers.

    Returns:
        The fit; None if the samples are too few, or lie on a line.
    """
    given, everything = size, np.eye(3)
    pooled = _pooled_moments(markers, pose, given)
    if pooled is None:
        return None
    size, center = pooled.solve(everything, given)
    scores, basis, axis = pooled.scores(size, center, everything), everything, None
    covariance, share = _covariance(scores, pooled, size, center, everything)
    frames = int((scores != 0.0).any(axis=0).sum())
    effective = share * frames
    tissue = _LINE * pooled.slow_share(center) / math.sqrt(len(pooled.n))
    significance = pooled.significance(size, effective, everything, tissue)
    clear = pooled.significance(size, effective, everything, SHAPE_ERROR) > _SIGNIFICANT
    values = pooled.extents()
    if hinge is None and values[0] <= TINY * values[2] < values[1]:  # exactly planar
        hinge = True
    least, across = pooled.least_direction(size)
    if hinge or (not clear and hinge is None):
        planar_size, planar_center = pooled.solve(across, given)
        planar_scores = pooled.scores(planar_size, planar_center, across)
        along = least @ planar_scores[:3]
        # sizes, not residuals: moving the centre to where the pose itself rotates least makes any residual smaller
        before = size if size < CONDITION_LIMIT * pooled.largest_size(everything) else 0.0
        planar_significance = pooled.significance(planar_size, effective, across, max(SHAPE_ERROR, tissue))
        no_worse = planar_size < _WORSE * max(before, 1.0) and planar_significance > _SIGNIFICANT
        if hinge or (no_worse and along.sum() ** 2 < _SIGNIFICANT**2 * long_run_covariance(along[None])[0][0, 0]):
            size, center, basis, axis, significance = planar_size, planar_center, across, least, planar_significance
            covariance, share = _covariance(planar_scores, pooled, size, center, basis)
        else:
            pooled.reweight(center, everything)
    shape = pooled.shape_covariance(size, center, basis, math.hypot(SHAPE_ERROR, tissue))
    radii, weights = np.full(len(markers), np.nan), np.zeros(len(markers))
    weights[pooled.present] = pooled.w
    squares = pooled.square_radii(center, size, basis)
    radii[pooled.present] = np.sqrt(np.where(squares > 0.0, squares, np.nan))
    noise, condition = pooled.radial_noise(size, center, basis), size / max(pooled.largest_size(basis), 1e-300)
    normal = pooled.matrix(size, everything)
    motion = np.sqrt(np.maximum(np.linalg.eigvalsh(normal) / pooled.n.sum(), 0.0))
    accuracy = noise, size, condition, covariance, shape, frames, share * frames
    return CenterFit(center, radii, *accuracy, axis, least, significance, clear, motion, normal, weights)


def center_only(
    markers: Sequence[LocalMarker], pose: PoseNoise, hinge: bool = False, size: float | None = None
) -> Floats | None:
    """The centre (3,) of `fit_center` without its covariance, for a joint that is known to be a hinge or not."""
    pooled = _pooled_moments(markers, pose, size)
    if pooled is None:
        return None
    eta, center = pooled.solve(np.eye(3), size)
    return pooled.solve(pooled.least_direction(eta)[1], size)[1] if hinge else center


def _pooled_moments(markers: Sequence[LocalMarker], pose: PoseNoise, given: float | None) -> PooledMoments | None:
    """Moments corrected for the mean effects of noise of the given size, or of a size found in some of the frames.

    They are of the markers with two samples or more; None if these are too few, or lie on a line.
    """
    size = 1.0 if given is None else given
    step = max(len(pose.pattern) // _FRAMES, 1)
    for part in (slice(None, None, step), slice(None)) if given is None else (slice(None),):
        chosen, noise = [marker.in_frames(part) for marker in markers], pose.in_frames(part)
        counts = [int((marker.used & (noise.pattern >= 0)).sum()) for marker in chosen]
        present, pooled = [k for k, count in enumerate(counts) if count >= 2], None
        if sum(counts[k] for k in present) >= 3 + len(present):
            moments = PooledMoments(chosen, present, noise, size)
            values = moments.extents()
            pooled = moments if values[1] > TINY * values[2] else None
        if given is None and pooled is not None and part.step is not None:
            size = pooled.solve(np.eye(3))[0]  # the mean effects depend on the size; a first value of it will do
    return pooled


def _covariance(
    scores: Floats, pooled: PooledMoments, size: float, center: Floats, basis: Floats
) -> tuple[Floats, float]:
    """Covariance of ĉ (3, 3), and the effective number of independent frames as a share of the frames."""
    d = basis.shape[1]
    inflated, independent = long_run_covariance(np.concatenate([basis.T @ scores[:3], scores[3:]]))
    inverse = np.linalg.pinv(pooled.jacobian(size, center, basis))[:d]
    covariance = basis @ inverse @ inflated @ inverse.T @ basis.T
    plain = basis @ inverse @ independent @ inverse.T @ basis.T
    total = float(np.trace(covariance))
    return covariance, min(float(np.trace(plain)) / total, 1.0) if total > 0.0 else 1.0


_FAR = 6.0
"""Robust standard deviations from its sphere beyond which a sample is rejected."""
_ROUNDING = 1e-9
"""Metres: deviations below this are rounding."""
_SETS, _SAMPLES = 20, 10
"""Random sets per marker, and samples of each: with a tenth of all samples wrong, a third of the sets are clean."""
_OUTLIER_FRAMES = 600
"""Frames, spread over the recording, from which the centre of all samples comes."""
_COMPARED = 200
"""Samples of each marker on which centres are compared."""
_BETTER = 3.0
"""Factor by which a proposed centre must be better; one that fits a cluster of like poses is better by less."""
_COARSE = 0.3
"""Share of the radius by which a sample may miss a sphere about a centre as rough as that of a random set."""
_ROUNDS = 3


def reject_outliers(markers: Sequence[LocalMarker]) -> list[LocalMarker]:
    """Reject the samples of markers about one joint that are far off their spheres."""
    accepted = list(markers)
    clean = _robust_center(markers, _center_of_all(accepted))
    if clean is not None:
        accepted = [marker.near_sphere(clean, tolerance=_COARSE) for marker in markers]
    for _ in range(_ROUNDS):
        center = _center_of_all(accepted)
        if center is None:
            break
        before, accepted = accepted, [marker.near_sphere(center) for marker in accepted]
        if all(a.used.sum() == b.used.sum() for a, b in zip(accepted, before, strict=True)):
            break
    return accepted


def _center_of_all(markers: Sequence[LocalMarker]) -> Floats | None:
    """GDKE's centre (3,), on frames spread over the recording."""
    spread = slice(None, None, max(markers[0].y.shape[1] // _OUTLIER_FRAMES, 1))
    part = [marker.in_frames(spread) for marker in markers]
    none = np.zeros((1, 3, 3))
    exact = PoseNoise(np.zeros(part[0].y.shape[1], dtype=np.int64), np.zeros((1, 3)), none, none, none)
    return center_only(part, exact, size=0.0)


def _robust_center(markers: Sequence[LocalMarker], usual: Floats | None) -> Floats | None:
    """A centre (3,) from few samples that fits most samples much better than the usual one; None if there is none."""
    samples = [m.y[:, m.used].T for m in markers if m.used.sum() >= _SAMPLES]
    if not samples or usual is None:
        return None
    candidates = [usual[None]]
    for number, points in enumerate(samples):
        chosen = stream(0, "sift", number, len(points)).integers(0, len(points), (_SETS, _SAMPLES))
        candidates.append(fit(points[chosen], "gdke").center)
    centers = np.concatenate(candidates)
    centers = centers[np.isfinite(centers).all(axis=1)]
    misfit = np.zeros(len(centers))
    for points in samples:
        part = points[:: max(len(points) // _COMPARED, 1)]
        distance = np.sqrt(((part - centers[:, None]) ** 2).sum(axis=2))
        middle = np.median(distance, axis=1, keepdims=True)
        misfit += np.median(np.abs(distance - middle), axis=1)
    best = int(misfit.argmin())
    return centers[best] if misfit[best] * _BETTER < misfit[0] else None

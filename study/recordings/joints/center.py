"""One centre from several markers in a segment's axes: MGDK with the noise that the segment's pose really has.

With noise of covariance I it is `study.mgdk` (paper eq. 22, corrected), the size of the noise found as `als` does and
weights 1/r̂². Here each sample has a covariance of its own (`pose_noise`). Where markers move in planes, as about a
hinge, the direction across the planes is dropped.

The covariance is the sandwich of the estimating functions of (c, η), frame by frame, in its long-run form
(`long_run_covariance`). It holds for any residuals, be they correlated in time and between markers or of unequal
variance, as long as there are many times more frames than their autocorrelation time.

Samples far off a marker's sphere, such as those of swapped markers, are rejected before. Least squares is not robust:
one marker that is half a metre away in one frame of fifty moves the sphere there. So small random sets of samples, many
of which hold no outlier, propose centres. If the median sample is several times nearer to its sphere about one of these
than about the centre of all samples, there are outliers. Samples far from the spheres about that centre are rejected,
then those far from GDKE's, until none is.

Source: Rousseeuw 1984 (least median of squares).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.arrays import Bools, Floats
from study.fits import fit
from study.fits.random import stream
from study.recordings.joints.moments import SHAPE_ERROR, TINY, PooledMoments, marker_moments
from study.recordings.pose_noise import PoseNoise, long_run_covariance

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
CONDITION_LIMIT = 0.999
"""A condition ρ above this counts as 1: at the limit of `PooledMoments.solve`."""


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
        normal: matrix of the normal equations A = Σ w (C - ηF) (3, 3), see `moments`.
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
    tissue = _LINE * pooled.slow_share(center) / math.sqrt(len(pooled.markers))
    significance = pooled.significance(size, effective, everything, tissue)
    clear = pooled.significance(size, effective, everything, SHAPE_ERROR) > _SIGNIFICANT
    if hinge is None and pooled.exactly_planar():
        hinge = True
    least, across = pooled.least_direction(size)
    if hinge or (not clear and hinge is None):
        planar_size, planar_center = pooled.solve(across, given)
        planar_scores = pooled.scores(planar_size, planar_center, across)
        # sizes, not residuals: moving the centre to where the pose itself rotates least makes any residual smaller
        before = size if size < CONDITION_LIMIT * pooled.largest_size(everything) else 0.0
        if hinge or (
            planar_size < _WORSE * max(before, 1.0)
            and pooled.significance(planar_size, effective, across, max(SHAPE_ERROR, tissue)) > _SIGNIFICANT
            and _sum_is_noise(least @ planar_scores[:3])
        ):
            size, center, basis, axis = planar_size, planar_center, across, least
            significance = pooled.significance(size, effective, basis, max(SHAPE_ERROR, tissue))
            covariance, share = _covariance(planar_scores, pooled, size, center, basis)
        else:
            pooled.reweight(center, everything)
    shape = pooled.shape_covariance(size, center, basis, math.hypot(SHAPE_ERROR, tissue))
    radii, weights = np.full(len(markers), np.nan), np.zeros(len(markers))
    weights[pooled.present] = pooled.w
    squares = pooled.square_radii(center, size, basis)
    radii[pooled.present] = np.sqrt(np.where(squares > 0.0, squares, np.nan))
    return CenterFit(
        center=center,
        radii=radii,
        noise=pooled.radial_noise(size, center, basis),
        size=size,
        condition=size / max(pooled.largest_size(basis), 1e-300),
        covariance=covariance,
        shape=shape,
        frames=frames,
        effective_frames=share * frames,
        axis=axis,
        least=least,
        significance=significance,
        clear=clear,
        rms_angles=pooled.rms_angles(size),
        normal=pooled.matrix(size, everything),
        weights=weights,
    )


def center_only(
    markers: Sequence[LocalMarker], pose: PoseNoise, hinge: bool = False, size: float | None = None
) -> Floats | None:
    """The centre (3,) of `fit_center` without its covariance, for a joint that is known to be a hinge or not."""
    pooled = _pooled_moments(markers, pose, size)
    if pooled is None:
        return None
    found, center = pooled.solve(np.eye(3), size)
    return pooled.solve(pooled.least_direction(found)[1], size)[1] if hinge else center


def _pooled_moments(markers: Sequence[LocalMarker], pose: PoseNoise, given: float | None) -> PooledMoments | None:
    """Moments corrected for the mean effects of noise of the given size, or of a size found in some of the frames."""
    size = 1.0 if given is None else given
    if given is None:  # the mean effects depend on the size; a first value of it will do
        some = slice(None, None, max(len(pose.pattern) // _FRAMES, 1))
        pooled = _moments_of_size([marker.in_frames(some) for marker in markers], pose.in_frames(some), size)
        size = pooled.solve(np.eye(3))[0] if pooled is not None else size
    return _moments_of_size(markers, pose, size)


def _moments_of_size(markers: Sequence[LocalMarker], pose: PoseNoise, size: float) -> PooledMoments | None:
    """Moments of the markers with two samples or more; None if these are too few, or lie on a line."""
    moments = [marker_moments(m.y, m.used & (pose.pattern >= 0), pose, m.own, size) for m in markers]
    present = [k for k, each in enumerate(moments) if each.count >= 2]
    if sum(moments[k].count for k in present) < 3 + len(present):
        return None
    pooled = PooledMoments([moments[k] for k in present], present)
    return pooled if pooled.extents()[1] > TINY * pooled.extents()[2] else None


def _sum_is_noise(score: Floats) -> bool:
    """True if scores (frames,) add up to no more than their standard errors explain."""
    return bool(score.sum() ** 2 < _SIGNIFICANT**2 * long_run_covariance(score[None])[0][0, 0])


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
    kept = list(markers)
    clean = _robust_center(markers, _center_of_all(kept))
    if clean is not None:
        kept = [reject_off_sphere(marker, clean, tolerance=_COARSE) for marker in markers]
    for _ in range(_ROUNDS):
        center = _center_of_all(kept)
        if center is None:
            break
        before, kept = kept, [reject_off_sphere(marker, center) for marker in kept]
        if all(a.used.sum() == b.used.sum() for a, b in zip(kept, before, strict=True)):
            break
    return kept


def reject_off_sphere(
    marker: LocalMarker, center: Floats, axis: Floats | None = None, tolerance: float = 0.0
) -> LocalMarker:
    """Reject the samples of a marker that are far off its sphere.

    Args:
        marker: in a segment's axes.
        center: of the sphere (3,), metres.
        axis: of a hinge (3,), to reject samples off the marker's circle about it instead.
        tolerance: share of the radius that is never far.
    """
    away = marker.y - center[:, None]
    if axis is not None:
        away = away - np.outer(axis, axis @ away)
    distance = np.sqrt((away**2).sum(axis=0))
    inside = distance[marker.used]
    if not len(inside):
        return marker
    middle = np.median(inside)
    limit = max(_FAR * 1.4826 * float(np.median(np.abs(inside - middle))), tolerance * middle, _ROUNDING)
    return replace(marker, used=marker.used & (np.abs(distance - middle) <= limit))


def _center_of_all(markers: Sequence[LocalMarker]) -> Floats | None:
    """GDKE's centre (3,), on frames spread over the recording."""
    some = slice(None, None, max(markers[0].y.shape[1] // _OUTLIER_FRAMES, 1))
    part = [marker.in_frames(some) for marker in markers]
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

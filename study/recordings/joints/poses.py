"""Poses of each segment over time, from a rigid template of its markers, and the noise of markers and poses.

Three markers fix a pose. A segment with two gets its third point from a joint that is known already, as a thigh does
from its hip: the joint is fixed in both of its segments. The distances of markers from the rigid template show the
markers' noise, soft-tissue artefact included. A displacement that all markers of a segment share does not show.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.recordings.markersets import MarkerSet, Segment
from study.recordings.pose_noise import PoseNoise, rigid_residual_operator
from study.recordings.recording import Recording
from study.recordings.rigid import fit_rigid_motion, fit_template, to_local, to_world

_LEAST_SIGMA = 1e-9
"""Metres: least noise, so that the shape of its covariance is defined where there is none."""
_LOOSE = 0.35
"""Radians (20°): a pose whose rotation about some axis has a larger standard deviation is not used."""


@dataclass(frozen=True)
class PosePoint:
    """A point that a segment's pose is fitted to.

    Attributes:
        name: of a marker or a joint.
        x: its place in the world (3, frames), metres; NaN where missing.
        noise: covariance of its noise in the world's axes, one for each frame (3, 3, frames), m²; None for a marker,
            whose noise is found from the segment's residuals.
    """

    name: str
    x: Floats
    noise: Floats | None = None


@dataclass(frozen=True)
class SegmentPoses:
    """Poses of one segment over time, and their noise.

    Attributes:
        segment: name of the segment.
        points: names of the points that the poses are fitted to: markers, and joints where markers are too few.
        template: their places in the segment's axes (m, 3), metres.
        rotation: R (3, 3, frames), NaN where unknown.
        origin: o (3, frames), metres, with x = R a + o; NaN where unknown.
        known: frames in which the pose is known (frames,).
        good: samples that the poses are fitted to (m, frames).
        outliers: samples that contradict the others, as after a swap of markers (m, frames).
        scatter: root mean square distance of each point from its place in the template (m,), metres.
        sigma: standard deviation of one coordinate of a marker's own noise, metres.
        noise: noise of the poses.
    """

    segment: str
    points: tuple[str, ...]
    template: Floats
    rotation: Floats
    origin: Floats
    known: Bools
    good: Bools
    outliers: Bools
    scatter: Floats
    sigma: float
    noise: PoseNoise

    def to_local(self, x: Floats) -> Floats:
        """Express points of the world (…, 3, frames) in the segment's axes, metres."""
        return to_local(self.rotation, self.origin, x)

    def to_world(self, point: Floats) -> Floats:
        """Express a point fixed in the segment's axes (3,) in the world (3, frames), metres."""
        return to_world(self.rotation, self.origin, point)

    def mean_place(self, x: Floats) -> Floats:
        """Mean place in the segment's axes (3,), metres, of a point of the world (3, frames) fixed in the segment.

        It is corrected for the mean effects of the poses' noise; NaN for a point that is always missing.
        """
        y = self.to_local(x)
        used = self.known & ~np.isnan(y[0])
        if not used.any():
            return np.full(3, np.nan)
        return np.asarray(self.noise.corrected(y.compress(used, axis=1), used, 1.0).mean(axis=1))

    def in_frames(self, frames: Ints) -> "SegmentPoses":
        """The same segment in some of the frames."""
        return replace(
            self,
            rotation=self.rotation[:, :, frames],
            origin=self.origin[:, frames],
            known=self.known[frames],
            good=self.good[:, frames],
            outliers=self.outliers[:, frames],
            noise=self.noise.in_frames(frames),
        )

    def world_covariance(self, point: Floats, own: Floats | float = 0.0) -> Floats:
        """Covariance in the world of a point fixed in the segment.

        Args:
            point: in the segment's axes (3,), metres.
            own: covariance of its place there (3, 3), m².

        Returns:
            One for each frame (3, 3, frames), m², the poses' noise included.
        """
        fixed = self.noise.covariance_at(point) + own
        return np.asarray(np.einsum("ijt,jk,lkt->ilt", self.rotation, fixed, self.rotation, optimize=True))


def fit_poses(segment: str, points: Sequence[PosePoint], reference: int = 0) -> SegmentPoses | str:
    """Fit the poses of a segment to three points or more.

    Args:
        segment: its name.
        points: markers and joints that are fixed in it.
        reference: number of the frame in which the segment's axes are the world's, or the nearest one with a pose.

    Returns:
        The poses; or the reason why there are none, for a user.
    """
    names = ", ".join(point.name for point in points) or "none"
    if len(points) < 3:
        return f"{segment} has {len(points)} point{'s' * (len(points) != 1)} ({names}); its pose needs 3"
    x = np.ascontiguousarray(np.stack([point.x for point in points]))
    shape = fit_template(x)
    if np.isnan(shape.points).any():
        apart = [p.name for p, row in zip(points, shape.points, strict=True) if np.isnan(row).any()]
        return f"{segment}: {', '.join(apart)} never seen together with the others"
    rotation, origin, known = fit_rigid_motion(shape.points, x, shape.good)
    if known.sum() < 2:
        return f"{segment}: its points ({names}) lie on a line, or three are never seen at once"
    start = np.flatnonzero(known)[np.abs(np.flatnonzero(known) - reference).argmin()]
    first = rotation[:, :, start].copy()
    rotation, shape = np.einsum("ijt,kj->ikt", rotation, first), replace(shape, points=shape.points @ first.T)
    residual = to_local(rotation, origin, x) - shape.points[:, :, None]
    counted = shape.good & known
    square = np.where(counted, (residual**2).sum(axis=1), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        scatter = np.sqrt(square.sum(axis=1) / counted.sum(axis=1))
    given = [None if point.noise is None else _mean_local(rotation, point.noise, known) for point in points]
    sigma = _marker_sigma(shape.points, square, counted, given)
    covariance = np.stack([sigma**2 * np.eye(3) if each is None else each for each in given])
    noise = PoseNoise.of(shape.points, covariance, shape.good, known)
    loose = noise.patterns_beyond(_LOOSE)
    if loose[noise.pattern[known]].all():
        angle = np.degrees(noise.worst_angle)
        return (
            f"{segment}: its points ({names}) lie nearly on a line: the rotation about it is known to {angle:.0f}° only"
        )
    known = known & ~np.where(known, loose[noise.pattern], False)
    return SegmentPoses(
        segment=segment,
        points=tuple(point.name for point in points),
        template=shape.points,
        rotation=np.where(known, rotation, np.nan),
        origin=np.where(known, origin, np.nan),
        known=known,
        good=shape.good & known,
        outliers=shape.outliers,
        scatter=scatter,
        sigma=sigma,
        noise=noise.without(~known),
    )


def poses_from_markers(markerset: MarkerSet, recording: Recording, reference: int = 0) -> dict[str, SegmentPoses | str]:
    """Fit each segment's poses to its own markers alone; for a segment without any, the reason why."""
    return {
        segment.name: fit_poses(segment.name, marker_points(segment, recording), reference)
        for segment in markerset.segments
    }


def marker_points(segment: Segment, recording: Recording) -> list[PosePoint]:
    """Markers of a segment as points of its pose."""
    return [PosePoint(marker, recording.of(marker)) for marker in segment.markers]


def reference_frame(recording: Recording) -> int:
    """Number of the first frame with the most markers: the segments' axes are the world's there."""
    return int(recording.seen().sum(axis=0).argmax())


def _mean_local(rotation: Floats, noise: Floats, known: Bools) -> Floats:
    """Mean (3, 3), in the segment's axes, of covariances in the world's axes (3, 3, frames)."""
    both = known & ~np.isnan(noise[0, 0])
    if not both.any():
        return np.zeros((3, 3))
    r, w = rotation[:, :, both], noise[:, :, both]
    return np.asarray(np.einsum("jit,jkt,klt->il", r, w, r, optimize=True) / both.sum())


def _marker_sigma(points: Floats, square: Floats, counted: Bools, given: Sequence[Floats | None]) -> float:
    """Standard deviation of a marker's coordinate that explains the residuals of the rigid fits.

    Args:
        points: template (m, 3).
        square: squared residuals (m, frames), m².
        counted: samples of the fits (m, frames).
        given: noise of each point, as far as it is known (3, 3), m².
    """
    whole = counted.all(axis=0)
    if not whole.any():  # never all at once: each frame has six fewer residuals than coordinates
        spare = (3 * counted.sum(axis=0) - 6)[counted.sum(axis=0) >= 3].sum()
        return max(float(np.sqrt(square.sum() / max(spare, 1))), _LEAST_SIGMA)
    left = rigid_residual_operator(points)
    of_markers = np.kron(np.diag([each is None for each in given]).astype(float), np.eye(3))
    of_joints = np.zeros_like(left)
    for k, each in enumerate(given):
        if each is not None:
            of_joints[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = each
    expected, known = np.trace(left @ of_markers), np.trace(left @ of_joints)
    found = float(square[:, whole].sum(axis=0).mean())
    # where the joint's noise alone explains all residuals, it is the best guess at the markers' noise
    least = 0.1 * found / np.trace(left)
    return max(float(np.sqrt(max((found - known) / expected, least))), _LEAST_SIGMA)

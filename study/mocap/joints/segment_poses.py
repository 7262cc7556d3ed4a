"""Each segment's moving frame: where its rigid template lies in every frame, and how rigid its markers really are.

Three markers make a frame. A segment with two gets the third point from a joint that has been found already, such as
a thigh from its hip: the joint is fixed in both of its segments. How far markers stray from a rigid body says how
noisy they are, skin and soft tissue included; what moves all of them alike cannot be seen in them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.mocap.geometry.kabsch import into, motion, out_of
from study.mocap.geometry.rigid_template import template
from study.mocap.io.recording import Recording
from study.mocap.joints.marker_moments import seen
from study.mocap.joints.pose_noise import CarriedNoise, unexplained
from study.mocap.markersets.marker_set import MarkerSet, Segment
from study.sphere.types import Bools, Floats, Ints

_NOISELESS = 1e-9
"""Metres: what noise is taken to be at least, so that its shape is defined where there is none."""
_LOOSE = 0.35
"""Radians: a frame whose turn about some axis is not known better than this (20°) is not used."""


@dataclass(frozen=True)
class Point:
    """A point that helps to fix a segment's frame.

    Attributes:
        name: of a marker or a joint.
        x: where it was seen (3, frames), metres; NaN where not.
        noise: covariance of its noise in the world's axes, one for each frame (3, 3, frames), m²; None for a marker,
            whose noise is found from the segment's scatter.
    """

    name: str
    x: Floats
    noise: Floats | None = None


@dataclass(frozen=True)
class Frames:
    """A segment's frame over time.

    Attributes:
        segment: its name.
        points: what it is fixed by: markers, and joints where markers are too few.
        template: where they are in its axes (m, 3), metres.
        rotation: (3, 3, frames) and ``origin`` (3, frames), metres: x = R a + o; NaN where unknown.
        known: where the frame is known (frames,).
        good: samples that it was fitted to (m, frames).
        outliers: samples that were seen and do not fit the others, as after a swap (m, frames).
        scatter: root mean square distance of each point from where the rigid body has it (m,), metres.
        spread: standard deviation of one coordinate of a marker's own noise, metres.
        carried: noise of the frame.
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
    spread: float
    carried: CarriedNoise

    def see(self, x: Floats) -> Floats:
        """Points of the world (…, 3, frames) in the frame's axes, metres."""
        return into(self.rotation, self.origin, x)

    def place(self, x: Floats) -> Floats:
        """Where a point of the world (3, frames) that is fixed in the segment lies in its axes (3,), metres.

        The mean, freed from what the frame's own noise does to it; NaN if it was never seen.
        """
        y = self.see(x)
        used = self.known & ~np.isnan(y[0])
        return seen(y, used, self.carried, 0.0, 1.0).mean if used.any() else np.full(3, np.nan)

    def show(self, point: Floats) -> Floats:
        """A point fixed in the frame's axes (3,) in the world (3, frames)."""
        return out_of(self.rotation, self.origin, point)

    def at(self, part: Ints) -> "Frames":
        """The same in some of the frames."""
        return replace(
            self, rotation=self.rotation[:, :, part], origin=self.origin[:, part], known=self.known[part],
            good=self.good[:, part], outliers=self.outliers[:, part], carried=self.carried.at_frames(part),
        )  # fmt: skip

    def carry(self, point: Floats, known: Floats | None = None) -> Floats:
        """Covariance with which a point fixed in the frame moves, in the world's axes (3, 3, frames), m².

        Args:
            point: in the frame's axes (3,), metres.
            known: covariance with which its place is known there (3, 3), m².
        """
        fixed = self.carried.at(point) + (0.0 if known is None else known)
        return np.asarray(np.einsum("ijt,jk,lkt->ilt", self.rotation, fixed, self.rotation, optimize=True))


def fixed_by(segment: str, points: Sequence[Point], reference: int = 0) -> Frames | str:
    """The frame of a segment, from three points or more.

    Args:
        segment: its name.
        points: markers and joints that are fixed in it.
        reference: number of the frame in which the segment's axes are the world's; the next in which it is known.

    Returns:
        The frame; or, in words, why there is none.
    """
    names = ", ".join(point.name for point in points) or "none"
    if len(points) < 3:
        return f"{segment} has {len(points)} points ({names}); its frame needs 3"
    x = np.ascontiguousarray(np.stack([point.x for point in points]))
    shape = template(x)
    if np.isnan(shape.points).any():
        never = [p.name for p, row in zip(points, shape.points, strict=True) if np.isnan(row).any()]
        return f"{segment}: {', '.join(never)} never seen together with the others"
    rotation, origin, known = motion(shape.points, x, shape.good)
    if known.sum() < 2:
        return f"{segment}: its points ({names}) lie on a line, or three are never seen at once"
    start = np.flatnonzero(known)[np.abs(np.flatnonzero(known) - reference).argmin()]
    turn = rotation[:, :, start].copy()
    rotation, shape = np.einsum("ijt,kj->ikt", rotation, turn), replace(shape, points=shape.points @ turn.T)
    residual = into(rotation, origin, x) - shape.points[:, :, None]
    counted = shape.good & known
    square = np.where(counted, (residual**2).sum(axis=1), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        scatter = np.sqrt(square.sum(axis=1) / counted.sum(axis=1))
    noise = [None if point.noise is None else _turned(rotation, point.noise, known) for point in points]
    spread = _spread(shape.points, square, counted, noise)
    covariance = np.stack([spread**2 * np.eye(3) if each is None else each for each in noise])
    carried = CarriedNoise.of(shape.points, covariance, shape.good, known)
    loose = carried.loose(_LOOSE)
    if loose[carried.pattern[known]].all():
        angle = np.degrees(carried.tilt_angle)
        return (
            f"{segment}: its points ({names}) lie nearly on a line: its turn about that is known to {angle:.0f}° only"
        )
    known = known & ~np.where(known, loose[carried.pattern], False)
    return Frames(
        segment, tuple(point.name for point in points), shape.points, np.where(known, rotation, np.nan),
        np.where(known, origin, np.nan), known, shape.good & known, shape.outliers, scatter, spread,
        carried.without(~known),
    )  # fmt: skip


def own_frames(markerset: MarkerSet, recording: Recording, reference: int = 0) -> dict[str, Frames | str]:
    """The frame of each segment, from its own markers alone; or why there is none."""
    return {
        segment.name: fixed_by(segment.name, own_points(segment, recording), reference)
        for segment in markerset.segments
    }


def own_points(segment: Segment, recording: Recording) -> list[Point]:
    """A segment's markers."""
    return [Point(marker, recording.of(marker)) for marker in segment.markers]


def reference_frame(recording: Recording) -> int:
    """The first of the frames in which the most markers are seen: its pose is where rotations are counted from."""
    return int(recording.seen().sum(axis=0).argmax())


def _turned(rotation: Floats, noise: Floats, known: Bools) -> Floats:
    """Mean of covariances in the world's axes (3, 3, frames), as seen from the moving axes (3, 3)."""
    both = known & ~np.isnan(noise[0, 0])
    if not both.any():
        return np.zeros((3, 3))
    r, w = rotation[:, :, both], noise[:, :, both]
    return np.asarray(np.einsum("jit,jkt,klt->il", r, w, r, optimize=True) / both.sum())


def _spread(points: Floats, square: Floats, counted: Bools, noise: Sequence[Floats | None]) -> float:
    """Standard deviation of a marker's coordinate for which rigid fits leave the residuals that they do."""
    whole = counted.all(axis=0)
    if not whole.any():  # never all at once: each frame has six fewer residuals than coordinates
        spare = (3 * counted.sum(axis=0) - 6)[counted.sum(axis=0) >= 3].sum()
        return max(float(np.sqrt(square.sum() / max(spare, 1))), _NOISELESS)
    left = unexplained(points)
    of_markers = np.kron(np.diag([each is None for each in noise]).astype(float), np.eye(3))
    of_joints = np.zeros_like(left)
    for k, each in enumerate(noise):
        if each is not None:
            of_joints[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = each
    expected, known = np.trace(left @ of_markers), np.trace(left @ of_joints)
    found = float(square[:, whole].sum(axis=0).mean())
    # where the joint alone would explain them all, its own noise is the best guess at the markers'
    least = 0.1 * found / np.trace(left)
    return max(float(np.sqrt(max((found - known) / expected, least))), _NOISELESS)

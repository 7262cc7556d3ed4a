"""The gate between poses and numbers: what no body's legs can do is missing, with the reason.

A pose may fit its markers and be wrong: labels are exchanged, or the joint that it was fitted about is elsewhere. No
stated error covers that. So the legs of a skeleton pass a table of rules, `RULES`, before any angle, curve, picture or
file is made of them. A rule bars a joint, or a segment with its joints, in the frames in which it fails.

The limits are those of bodies, not of samples: a leg that passes may still be wrong by tens of degrees.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from study.arrays import Floats
from study.recordings.joints.find import JointPlace, SegmentShape
from study.recordings.markersets import landmarks, match
from study.recordings.recording import Recording
from study.recordings.rigid import fit_rigid_motion, relative_rotation, to_world, zxy_angles
from study.recordings.skeleton.anatomy import legs
from study.recordings.skeleton.draw import LARGEST_ERROR, Barred, Flag, Skeleton
from study.recordings.skeleton.scene import up_of

_BENDS = {"thigh": (-50.0, 160.0), "shank": (-20.0, 160.0), "foot": (-90.0, 45.0)}
"""Degrees: least and greatest mean flexion of the joint above a part. In children, whose joints move most, hips bend to
141° and overextend by 28°, knees to 153° and by 5°, and ankles to 25° (means of Soucie et al. 2011, Haemophilia
17:500-507)."""
_TURNS = 90.0
"""Degrees: greatest mean rotation of a joint about its long axis, either way; beyond, the lateral side is medial, or a
foot points back. Hips rotate by 30° inwards and 39° outwards (Kouyoumdjian et al. 2012, Orthop Traumatol Surg Res
98:17-23)."""
_FLIPPED = np.radians(90.0)
"""Angle by which a pose must be nearer to the mean one with two labels exchanged. An exchange turns a plane cluster by
180°, a joint by less than `_TURNS`."""
_AS_WELL = 0.01
"""Metres: misfit of a cluster with two labels exchanged up to which skin may hide the exchange: it moves markers by a
centimetre against each other in a session (see `study.recordings.skeleton.calibrate`)."""
_KEEPS = 0.009
"""Metres by which the distance of two markers of a thigh or a shank is off its median, in the median over the frames:
half of the 18 mm by which skin slides (see `RULES`). In recorded walks and jumps it is 3 mm at most."""
_PROPORTION = 1.5
"""Greatest ratio of a thigh to its shank, either way. On average they are 0.245 and 0.246 of the height (Drillis &
Contini 1966, in Winter 2009, Biomechanics and Motor Control of Human Movement, figure 4.1)."""
_UPRIGHT = float(np.cos(np.radians(45.0)))
"""Cosine of the greatest angle between up and the line from the heels to the pelvis of who stands or walks."""


@dataclass(frozen=True, eq=False)
class Body:
    """Pelvis and legs of a skeleton, as the rules see them.

    Attributes:
        skeleton: as it was drawn.
        recording: the whole recording, with the file's labels.
    """

    skeleton: Skeleton
    recording: Recording

    @cached_property
    def segments(self) -> dict[str, str]:
        """Names of the segments by what they are, as "left thigh" (see `legs`)."""
        return legs(self.skeleton.calibration.markerset)

    @cached_property
    def above(self) -> dict[str, JointPlace]:
        """The joint above each segment."""
        return {place.joint.child: place for place in self.skeleton.calibration.joints}

    def axes(self, part: str) -> Floats | None:
        """Anatomical axes of a part in the world (3, 3, frames); None if they are not known."""
        if part not in self.segments:
            return None
        anatomy = self.skeleton.calibration.shape(self.segments[part]).anatomy
        turned = np.einsum("ijt,jk->ikt", self.skeleton.rotation(self.segments[part]), anatomy)
        return None if np.isnan(turned).all() else turned

    def always(self, name: str, reason: str) -> Barred:
        """The finding that bars a joint or a segment in all frames."""
        return Barred(name, np.ones(self.skeleton.frames, dtype=np.bool_), reason)

    def joint_above(self, part: str) -> str:
        """Name of the joint above a part."""
        return self.above[self.segments[part]].joint.name


def _apart(body: Body) -> Iterator[Barred]:
    """Joints that their segments put more than 5 cm apart, in the median."""
    skeleton = body.skeleton
    for place in skeleton.calibration.joints:
        both = [skeleton.segments.index(name) for name in (place.joint.parent, place.joint.child)]
        seen = (skeleton.segment_flags[both] == Flag.SEEN).all(axis=0)
        if not (place.known and seen.any()):
            continue
        poses = [(skeleton.rotations[k][:, :, seen], skeleton.origins[k][:, seen]) for k in both]
        one, other = (to_world(*pose, at) for pose, at in zip(poses, (place.in_parent, place.in_child), strict=True))
        if (far := np.median(np.linalg.norm(one - other, axis=0))) > LARGEST_ERROR:
            yield body.always(place.joint.name, f"its two segments put it {1000 * far:.0f} mm apart")


def _unseen(body: Body) -> Iterator[Barred]:
    """Segments of legs that no frame shows, for their neighbours alone place them, and what has its zero from them."""
    skeleton = body.skeleton
    for part, name in body.segments.items():
        flags = skeleton.segment_flags[skeleton.segments.index(name)]
        if (flags != Flag.SEEN).all() and (flags != Flag.UNKNOWN).any():
            place = body.above.get(name)
            own = f": {place.joint.name}: {place.reason}" if place is not None and not place.known else ""
            yield body.always(name, f"no frame shows its pose{own}")
            foot = part.split(" ")[0] + " foot"
            if part.endswith("thigh") and foot in body.segments and body.axes(foot.replace("foot", "shank")) is None:
                yield body.always(body.joint_above(foot), f"its zero follows from {name}, which no frame shows")


def _bent(body: Body) -> Iterator[Barred]:
    """Joints of legs that bend or turn as none does, in the mean; and the pelvis, if both hips do."""
    hips = 0
    for (part, (low, high)), one in itertools.product(_BENDS.items(), ("left", "right")):
        above = {"thigh": "pelvis", "shank": f"{one} thigh", "foot": f"{one} shank"}[part]
        parent, child = body.axes(above), body.axes(f"{one} {part}")
        if parent is None or child is None:
            continue
        turn = relative_rotation(parent, child)
        angles = zxy_angles(turn[:, :, ~np.isnan(turn[0, 0])])
        if not angles.size:
            continue
        flexion, _, rotation = np.degrees(np.angle(np.exp(1j * angles).mean(axis=1)))
        flexion = -flexion if part == "shank" else flexion
        words = f"its mean flexion is {flexion:.0f}°, of bodies {low:.0f}° to {high:.0f}°" * (
            not low <= flexion <= high
        )
        if abs(rotation) > _TURNS:
            words = f"its segments are turned by {abs(rotation):.0f}° about its long axis: labels are exchanged"
        if words:
            hips += part == "thigh"
            yield body.always(body.joint_above(f"{one} {part}"), words)
    if hips == len(("left", "right")):
        yield body.always(body.segments["pelvis"], "both hips are as no body's: labels are exchanged")


def _exchanged(body: Body) -> Iterator[Barred]:
    """Segments of legs whose pose is far from the mean one, and near to it with two labels exchanged."""
    skeleton = body.skeleton
    for name in body.segments.values():
        shape, place = skeleton.calibration.shape(name), body.above.get(name)
        if place is None or not shape.has_own_pose:
            continue
        turn = relative_rotation(skeleton.rotation(place.joint.parent), skeleton.rotation(name))
        known = np.flatnonzero(~np.isnan(turn[0, 0]))
        own = np.moveaxis(turn[:, :, known], 2, 0)
        for i, j, exchange in exchanges(shape):
            given, better = (_angle(r @ place.mean_rotation.T) for r in (own, own @ exchange))
            frames = np.zeros(skeleton.frames, dtype=np.bool_)
            frames[known[given - better > _FLIPPED]] = True
            if frames.any():
                reason = f"{shape.markers[i]} and {shape.markers[j]} are exchanged: its cluster fits as well so"
                yield Barred(name, frames, reason)


def exchanges(shape: SegmentShape) -> Iterator[tuple[int, int, Floats]]:
    """Pairs of markers whose exchange a cluster does not show, with the rotation (3, 3) that undoes it."""
    for i, j in itertools.combinations(range(len(shape.markers)), 2):
        order = [*range(len(shape.markers))]
        order[i], order[j] = j, i
        rotation, origin, known = fit_rigid_motion(shape.places, np.ascontiguousarray(shape.places[order][:, :, None]))
        if known[0]:
            away = shape.places @ rotation[:, :, 0].T + origin[:, 0] - shape.places[order]
            if np.sqrt((away**2).sum(axis=1).mean()) < _AS_WELL:
                yield i, j, rotation[:, :, 0]


def _angle(rotations: Floats) -> Floats:
    """Angles of rotations (n, 3, 3), radians."""
    return np.asarray(Rotation.from_matrix(rotations).magnitude())


def _stretched(body: Body) -> Iterator[Barred]:
    """Thighs and shanks two of whose markers do not keep their distance, so that one is on another segment.

    In single frames, by 5 cm, only those of two markers: the fit of a cluster leaves such a marker out.
    """
    markers = match(body.skeleton.calibration.markerset, body.recording).recording
    for part, name in body.segments.items():
        shape = body.skeleton.calibration.shape(name)
        own = [marker for marker in shape.markers if marker in markers.markers]
        for one, other in itertools.combinations(own, 2) if part.endswith(("thigh", "shank")) else ():
            far = np.linalg.norm(markers.of(one) - markers.of(other), axis=0)
            if np.isnan(far).all():
                continue
            off = np.abs(far - np.nanmedian(far))
            always = np.full(len(off), np.nanmedian(off) > _KEEPS)
            frames = always if always.any() or shape.has_own_pose else off > LARGEST_ERROR
            if frames.any():
                most = 1000 * np.nanmedian(off[frames])
                yield Barred(name, frames, f"{one} and {other} are {most:.0f} mm off their usual distance")
                break


def _unlike(body: Body) -> Iterator[Barred]:
    """Thighs and shanks of one leg whose lengths no leg has: a marker of one is elsewhere on the leg."""
    for one in ("left", "right"):
        parts = [f"{one} {part}" for part in ("thigh", "shank", "foot")]
        if not {*parts} <= body.segments.keys():
            continue
        hip, knee, ankle = (body.above[body.segments[part]] for part in parts)
        thigh, shank = math.dist(hip.in_child, knee.in_parent), math.dist(knee.in_child, ankle.in_parent)
        if max(thigh, shank) > _PROPORTION * min(thigh, shank):
            reason = (
                f"the {one} thigh is {1000 * thigh:.0f} mm and the shank {1000 * shank:.0f} mm: labels are exchanged"
            )
            yield from (body.always(body.segments[part], reason) for part in parts[:2])


def _following(body: Body) -> Iterator[Barred]:
    """Segments without a pose of their own about a joint that is unknown or missing, or in a missing segment."""
    barred = {found.name: found.frames for found in body.skeleton.barred}
    for place in body.skeleton.calibration.joints:
        joint, error = place.joint, place.standard_error
        own = joint.child not in body.segments.values() or body.skeleton.calibration.shape(joint.child).has_own_pose
        if own or joint.child in barred:
            continue
        if error > LARGEST_ERROR:
            found = body.always(
                joint.child, f"its pose follows from {joint.name}, which is known to {1000 * error:.0f} mm"
            )
        elif (cause := next((name for name in (joint.name, joint.parent) if name in barred), "")) != "":
            found = Barred(joint.child, barred[cause], f"its pose follows from {cause}")
        else:
            continue
        barred[joint.child] = found.frames
        yield found


def _lying(body: Body) -> Iterator[Barred]:
    """Up, if the heels are not below the pelvis: who lies down shows none, or labels are wrong."""
    points, name = landmarks(body.recording.markers), body.segments.get("pelvis")
    heels = [body.recording.of(label) for point, label in points.items() if point.endswith("heel")]
    if name is None or not heels:
        return
    line = body.skeleton.origins[body.skeleton.segments.index(name)] - np.array(heels)
    line = up_of(body.recording)[0] @ line / np.linalg.norm(line, axis=1, keepdims=True)
    upwards = line[:, 2][~np.isnan(line[:, 2])]
    if upwards.size and np.median(upwards) < _UPRIGHT:
        angle = np.degrees(np.arccos(np.median(upwards)))
        yield body.always("up", f"the pelvis is {angle:.0f}° from above the heels, so that up is not known")


RULES: dict[str, Callable[[Body], Iterator[Barred]]] = {
    # a thigh's skin slides by 18 mm in fluoroscopy (PMC8631460)
    "the two segments of a joint put it at most 5 cm apart": _apart,
    "markers show each segment of a leg in some frame; its neighbours alone do not place it": _unseen,
    # Soucie et al. 2011 and Kouyoumdjian et al. 2012, as above
    "the mean flexion of hips, knees and ankles is one of bodies, and they are turned by at most 90°": _bent,
    "no cluster fits as well with two labels exchanged, and is nearer to its mean pose so": _exchanged,
    # PMC8631460, as above
    "two markers of a thigh or a shank are within 9 mm of their usual distance, in the median": _stretched,
    # Drillis & Contini 1966, as above
    "a thigh is at most 1.5 times as long as its shank, and the other way round": _unlike,
    "a segment of two markers follows a joint known to 5 cm; neither this nor the segment above is missing": _following,
    "the pelvis is above the heels, within 45°; else angles to the floor, and gait, are missing": _lying,
}
"""What every leg must be, in the order in which it is asked; `study.recordings.gait` asks that feet strike in turn."""


def gated(skeleton: Skeleton, recording: Recording) -> Skeleton:
    """Bar what no body's legs can do.

    Args:
        skeleton: as it was drawn.
        recording: the whole recording, with the file's labels.

    Returns:
        The skeleton, with what is ``barred``. A barred segment, and the centre of a barred joint and of one that is
        fixed in a barred segment, are unknown in these frames.
    """
    for rule in RULES.values():
        for finding in rule(Body(skeleton, recording)):
            skeleton = _without(skeleton, finding)
    return skeleton


def _without(skeleton: Skeleton, finding: Barred) -> Skeleton:
    """The skeleton without a joint or a segment in some frames."""
    names = "rotations", "origins", "turning", "segment_flags", "centers", "flags"
    rotations, origins, turning, segment_flags, centers, flags = (getattr(skeleton, name).copy() for name in names)
    for k, place in enumerate(skeleton.calibration.joints):
        if finding.name in (place.joint.name, place.joint.parent):
            centers[k][:, finding.frames], flags[k][finding.frames] = np.nan, Flag.UNKNOWN
    if finding.name in skeleton.segments:
        k = skeleton.segments.index(finding.name)
        rotations[k][:, :, finding.frames], origins[k][:, finding.frames] = np.nan, np.nan
        segment_flags[k][finding.frames], turning[k][finding.frames] = Flag.UNKNOWN, np.nan
    changed = dict(zip(names, (rotations, origins, turning, segment_flags, centers, flags), strict=True))
    return replace(skeleton, barred=(*skeleton.barred, finding), **changed)

"""Points of the body on a skeleton: anatomical axes of the segments, and joints that motion does not show.

Points are known by their labels (`landmarks`): spines of the pelvis, epicondyles, malleoli, heel and metatarsals. Each
is a place in its segment's axes, the median over the frames of a trial in which both are seen; a static trial shows
those that are taken off before the subject moves.

Axes are x forward, y up, z to the right, on both sides. Source: Wu et al. 2002, ISB recommendation on definitions of
joint coordinate systems, part I; Grood and Suntay 1983 for the angles between them, whose order is z, x, y.

- pelvis: z between the anterior spines, x in the plane of these and the middle of the posterior ones (or the sacrum).
- thigh: y from the middle of the epicondyles to the hip, z in the plane of y and the epicondyles.
- shank: y from the middle of the malleoli to the knee, z in the plane of y and the malleoli.
- foot: x from the heel to the middle of the first and fifth metatarsals, z in the plane of x and these. Without them
  x goes to the toe's marker, and y is in the plane of x and the ankle, some 4 cm above. An ankle that is known to 1 cm
  shows the foot's adduction to some 15° only, but its flexion well. Where a file of Plug-in Gait has the static trial's
  plantar flexion (LStaticPlantFlex), x is the line from ankle to toe tilted up by it, as Vicon has the foot's zero.

Plug-in Gait has no medial epicondyle and no medial malleolus, but measured widths. By its chord method the centre of a
knee is half the knee's width and half a marker's diameter from the lateral marker, in the plane of this marker, the
thigh's marker and the hip, and sees marker and hip at a right angle; the ankle follows likewise from shank and knee.
The medial point is as far on the other side. Rotation offsets of a static trial are not applied; a note names them.
Source: Davis et al. 1991, Hum Mov Sci 10:575-587; Vicon, Plug-in Gait Reference Guide.

The regression is Harrington et al. 2007, J Biomech 40:595-602, by the pelvis' width w between the anterior spines and
its depth d from their middle to that of the posterior ones. From the middle of the anterior spines the hip is
0.24 d + 9.9 mm back, 0.30 w + 10.9 mm down and 0.33 w + 7.3 mm to the side. The error is that of another sample: 67
adults imaged by CT, 12.3 ± 5.9 mm from the truth (Mantovani et al. 2016, Gait & Posture 44:48-54), or 7.9 mm on each
axis; Harrington's own, left out one by one, are 5.2, 3.6 and 3.2 mm. A centre that the laboratory left in the file is
taken before the regression; it comes without an error and gets the same.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from study.arrays import Floats
from study.recordings.joints.estimate import ANATOMICAL, SHORT_TEXTS, JointStatus
from study.recordings.joints.find import Calibration, JointPlace, SegmentShape, moved_along_axis
from study.recordings.markersets import MarkerSet, MarkerSetError, landmarks, side, side_of
from study.recordings.recording import Recording
from study.recordings.rigid import across, nearest_rotation, relative_rotation, to_local, to_world
from study.recordings.skeleton.draw import Flag, Skeleton, draw_skeleton

Hips = Literal["motion", "regression"]
"""Centres of hips: by motion alone, or for those that motion leaves in doubt by regression."""
LANDMARK = 0.01
"""Standard error of the middle of two points of the body along each axis, metres. Examiners differ by r = 13 to 25 mm,
root mean square, in where they put one (Della Croce et al. 1999, Med Biol Eng Comput 37:155-161): r/√6 on each axis."""
_FARTHEST = 2.5
"""Standard errors of their distance beyond which a hinge is not where its points of the body are."""
SIGMA = 0.0079
"""Standard error of a hip by regression along each axis, metres."""
_AGREE = 0.99
"""Probability of the difference between motion and regression up to which both count, weighted by their errors."""
_SHORT = 0.005
"""Metres between points below which they show no direction."""
_STEEP = float(np.tan(np.radians(10.0)))
"""Error of the joint above, over the segment's length, from which its long axis is not known."""
_PARTS = ("thigh", "shank", "foot")
_POINTS = {
    "pelvis": ("asis", "psis", "sacrum", "hip centre"),
    "thigh": ("thigh marker", "lateral epicondyle", "medial epicondyle"),
    "shank": ("shank marker", "lateral malleolus", "medial malleolus"),
    "foot": ("heel", "toe", "fifth metatarsal", "first metatarsal"),
}
"""Points of each part of the body; the last two of a part of a leg are the lateral and the medial one at its end."""
_OWNERS = {point: part for part, points in _POINTS.items() for point in points}
"""The part of the body that each point is on."""
_MIRROR = {"left": -1.0, "right": 1.0}


def legs(markerset: MarkerSet) -> dict[str, str]:
    """The segments of pelvis and legs by what they are: "pelvis", "left thigh", …; those that the set has.

    The pelvis is the segment with both anterior spines. From it each leg follows from joint to joint.
    """
    spines = {"left asis", "right asis"}
    pelvis = next(
        (s.name for s in markerset.segments if spines <= landmarks(s.markers, markerset.landmarks).keys()), None
    )
    if pelvis is None:
        return {}
    result = {"pelvis": pelvis}
    for one in _MIRROR:
        above = pelvis
        for part in _PARTS:
            below = [joint.child for joint in markerset.joints if joint.parent == above]
            own = [name for name in below if (side(name) or side_of(markerset.segment(name).markers)) == one]
            if len(own) != 1:
                break
            result[f"{one} {part}"] = above = own[0]
    return result


def part_of(markerset: MarkerSet, wanted: str) -> MarkerSet:
    """Some segments of a marker set, and the joints between them.

    Args:
        markerset: the whole set.
        wanted: names of segments with commas between them, or "legs" for pelvis and legs.

    Raises:
        MarkerSetError: if it has no such segment.
    """
    known = [segment.name for segment in markerset.segments]
    names = list(legs(markerset).values()) if wanted == "legs" else [name.strip() for name in wanted.split(",")]
    listed = f"its segments are {', '.join(known)}"
    if not names:
        raise MarkerSetError(f"marker set {markerset.name} has no pelvis with both spines, so no legs; {listed}")
    if unknown := [name for name in names if name not in known]:
        raise MarkerSetError(f"--segments {wanted}: marker set {markerset.name} has no {unknown[0]}; {listed}")
    segments = [s.model_copy(update={"parent": s.parent if s.parent in names else None}) for s in markerset.segments]
    segments = [s for s in segments if s.name in names]
    markers = {marker for segment in segments for marker in segment.markers}
    joints = [joint for joint in markerset.joints if {joint.parent, joint.child} <= {*names}]
    known_points = markers | {point for joint in joints for point in joint.across}
    parts = {
        "segments": tuple(segments),
        "joints": tuple(joints),
        "optional": tuple(marker for marker in markerset.optional if marker in markers),
        "aliases": {marker: others for marker, others in markerset.aliases.items() if marker in known_points},
    }
    return MarkerSet.model_validate({"name": markerset.name, "about": markerset.about} | parts)


def points_of_the_body(skeleton: Skeleton, source: Recording) -> dict[str, Floats]:
    """Places of points of the body in the axes of their segments, metres (3,).

    A point that is a marker of its segment is in its place there, if the segment is seen in no frame with it.

    Args:
        skeleton: of the trial.
        source: the whole recording of the trial, with the file's labels.

    Returns:
        The place of each point, such as "left asis", that is seen together with its segment.
    """
    markerset = skeleton.calibration.markerset
    segments, places = legs(markerset), {}
    for point, label in landmarks(source.markers, markerset.landmarks).items():
        name = _owner(point, segments)
        if name is None:
            continue
        number = skeleton.segments.index(name)
        seen = (skeleton.segment_flags[number] == Flag.SEEN) & ~np.isnan(source.of(label)[0])
        if seen.any():
            rotation, origin = skeleton.rotations[number][:, :, seen], skeleton.origins[number][:, seen]
            places[point] = np.median(to_local(rotation, origin, source.of(label)[:, seen]), axis=1)
    for point, marker in landmarks(markerset.markers(), markerset.landmarks).items():
        name = _owner(point, segments)
        if point not in places and name is not None and marker in (shape := skeleton.calibration.shape(name)).markers:
            places[point] = shape.places[shape.markers.index(marker)]
    return places


def _owner(point: str, segments: Mapping[str, str]) -> str | None:
    """The segment that a point of the body is on; None if the marker set has none."""
    one, _, kind = point.rpartition(" ") if point == "sacrum" else point.partition(" ")
    part = _OWNERS[kind]
    return segments.get(part if part == "pelvis" else f"{one} {part}")


def _frame(first: int, along: Floats, second: int, towards: Floats) -> Floats | None:
    """Axes (3, 3), columns x, y, z, of which one lies along a direction, another in the plane of two.

    None if the directions, metres, are too short or too much alike to show them.
    """
    axes = np.empty((3, 3))
    if np.linalg.norm(along) < _SHORT:
        return None
    axes[:, first] = along / np.linalg.norm(along)
    rest = towards - (towards @ axes[:, first]) * axes[:, first]
    if np.linalg.norm(rest) < _SHORT:
        return None
    axes[:, second] = rest / np.linalg.norm(rest)
    third = 3 - first - second
    axes[:, third] = np.cross(axes[:, (third + 1) % 3], axes[:, (third + 2) % 3])
    return axes


def _pelvis(points: Mapping[str, Floats]) -> tuple[Floats, Floats, float, float] | None:
    """Axes of the pelvis (3, 3), the middle of the anterior spines (3,), width and depth, metres; None without them."""
    behind = [points[name] for name in ("left psis", "right psis") if name in points]
    back = np.mean(behind, axis=0) if len(behind) == 2 else points.get("sacrum")
    if back is None or not {"left asis", "right asis"} <= points.keys():
        return None
    left, right = points["left asis"], points["right asis"]
    middle = 0.5 * (left + right)
    axes = _frame(2, right - left, 0, middle - back)
    width, depth = float(np.linalg.norm(right - left)), float(np.linalg.norm(middle - back))
    return None if axes is None else (axes, middle, width, depth)


def anatomical_axes(calibration: Calibration, points: Mapping[str, Floats]) -> dict[str, Floats]:
    """Anatomical axes of the segments whose points are known: (3, 3), columns x, y, z, in the segment's axes."""
    segments = legs(calibration.markerset)
    result: dict[str, Floats | None] = {}
    above = {place.joint.child: place for place in calibration.joints}
    if (pelvis := _pelvis(points)) is not None:
        result[segments["pelvis"]] = pelvis[0]
    for name, segment in segments.items():
        one, _, part = name.partition(" ")
        if part not in _PARTS:
            continue
        top, error = above[segment].in_child, above[segment].standard_error
        lateral, medial, heel, toe = (points.get(f"{one} {end}") for end in (*_POINTS[part][-2:], "heel", "toe"))
        if lateral is None or medial is None:
            if (
                part == "foot"
                and heel is not None
                and toe is not None
                and round(error, 9) <= LANDMARK
                and above[segment].known
            ):
                result[segment] = _frame(0, toe - heel, 1, top - heel)
            continue
        middle, outwards = 0.5 * (lateral + medial), _MIRROR[one] * (lateral - medial)  # to the right on both sides
        if part == "foot" and heel is not None:
            result[segment] = _frame(0, middle - heel, 2, outwards)
        elif part != "foot" and not np.isnan(top).any():
            tilted = error > _STEEP * np.linalg.norm(top - middle)
            result[segment] = None if tilted else _frame(1, top - middle, 2, outwards)
    return {name: axes for name, axes in result.items() if axes is not None}


def static_feet(
    calibration: Calibration, points: Mapping[str, Floats], offsets: Mapping[str, float]
) -> dict[str, Floats]:
    """Axes of feet without metatarsals (3, 3) whose plantar flexion a static trial of Plug-in Gait has, radians.

    The line from ankle to toe is tilted up by it, in the plane of heel, toe and ankle.
    """
    segments, above = legs(calibration.markerset), {place.joint.child: place for place in calibration.joints}
    result = {}
    for one in _MIRROR:
        segment, tilt = segments.get(f"{one} foot"), offsets.get(f"{one} foot flexion")
        heel, toe, *ends = (points.get(f"{one} {end}") for end in ("heel", "toe", *_POINTS["foot"][-2:]))
        whole = all(end is not None for end in ends)
        if segment is None or tilt is None or heel is None or toe is None or whole or not above[segment].known:
            continue
        ankle = above[segment].in_child
        if (axes := _frame(0, toe - ankle, 1, ankle - heel)) is not None:
            cosine, sine = np.cos(tilt), np.sin(tilt)
            result[segment] = axes @ [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]
    return result


def axes_errors(calibration: Calibration, points: Mapping[str, Floats]) -> dict[str, Floats]:
    """Covariance of the rotation of anatomical axes (3, 3), rad², in the segments' axes, from errors of their points.

    Each point is moved by its standard error along each axis: by `LANDMARK`, or a joint by its own.
    """
    axes, leg = anatomical_axes(calibration, points), set(legs(calibration.markerset).values())
    squares = {name: np.zeros((3, 3)) for name in axes}
    moved = [(calibration, {**points, name: x + LANDMARK * e}) for name, x in points.items() for e in np.eye(3)]
    for k, place in enumerate(calibration.joints):
        if place.joint.child in leg and place.known:
            for e in np.eye(3):
                other = replace(place, in_child=place.in_child + place.standard_error * e)
                joints = (*calibration.joints[:k], other, *calibration.joints[k + 1 :])
                moved.append((replace(calibration, joints=joints), {**points}))
    for each in moved:
        for name, changed in anatomical_axes(*each).items():
            if name not in axes:  # a moved point may show axes that the points where they are do not
                continue
            turn = Rotation.from_matrix(changed @ axes[name].T).as_rotvec()
            squares[name] += np.outer(turn, turn)
    return squares


def hip_by_regression(points: Mapping[str, Floats], one: str) -> Floats | None:
    """Centre of the left or right hip (3,) in the axes of the pelvis' segment, metres; None without the points."""
    pelvis = _pelvis(points)
    if pelvis is None:
        return None
    axes, middle, width, depth = pelvis
    back, down, aside = 0.24 * depth + 0.0099, 0.30 * width + 0.0109, 0.33 * width + 0.0073
    return middle + axes @ [-back, -down, _MIRROR[one] * aside]


class DrawnTrial(NamedTuple):
    """A trial with its skeleton, and its markers under the names of the marker set."""

    skeleton: Skeleton
    markers: Recording


def with_anatomy(calibration: Calibration, trial: DrawnTrial, source: Recording, hips: Hips = "motion") -> Calibration:
    """Add anatomical axes to the segments whose points a trial shows, and joints by these points.

    Args:
        calibration: of the subject.
        trial: drawn with it.
        source: the whole recording of the trial, with the file's labels.
        hips: "regression" to place hips that motion leaves in doubt, or does not show, by regression.
    """
    points, segments = points_of_the_body(trial.skeleton, source), legs(calibration.markerset)
    places = {place.joint.child: place for place in calibration.joints}
    regressed = {child: _with_regression(place, trial, points) for child, place in places.items()}
    medial: dict[str, Floats] = {}
    if hips == "regression":
        places = regressed
    for part, (upper, *_) in _ENDS.items():  # what follows from a joint is drawn with it, so that its frame is its own
        calibration, trial = _redrawn(calibration, places, trial)
        points = points_of_the_body(trial.skeleton, source) | medial
        for one in _MIRROR:
            name, above = (segments.get(f"{one} {own}") for own in (part, upper))
            if name is not None and above is not None:
                top = (regressed if part == "shank" else places)[above]
                by_width = _medial_by_width(f"{one} {part}", top, points, source.widths)
                medial |= by_width
                place = _with_landmarks(places[name], f"{one} {part}", trial, points | medial, bool(by_width))
                places = places | {name: place}
    calibration, trial = _redrawn(calibration, places, trial)
    points = points_of_the_body(trial.skeleton, source) | medial
    axes, errors = anatomical_axes(calibration, points), axes_errors(calibration, points)
    feet = static_feet(calibration, points, source.laboratory.offsets)
    axes |= {name: foot for name, foot in feet.items() if name in axes}
    shapes = (
        replace(s, anatomy=axes[s.segment], anatomy_covariance=errors[s.segment]) if s.segment in axes else s
        for s in calibration.shapes
    )
    drawn = {place.joint.child for place in calibration.joints if place.status in ANATOMICAL}
    joints = (
        _with_mean_rotation(place, trial.skeleton) if drawn & {place.joint.parent, place.joint.child} else place
        for place in calibration.joints
    )
    return replace(calibration, shapes=tuple(shapes), joints=tuple(joints))


def _with_mean_rotation(place: JointPlace, skeleton: Skeleton) -> JointPlace:
    """A joint with the mean rotation of a skeleton, which has other poses than those that the joint was found with."""
    ends = [skeleton.segments.index(name) for name in (place.joint.parent, place.joint.child)]
    both = (skeleton.segment_flags[ends] == Flag.SEEN).all(axis=0)
    if not both.any():
        return place
    turns = relative_rotation(*(skeleton.rotations[k][:, :, both] for k in ends))
    return replace(place, mean_rotation=nearest_rotation(turns.sum(axis=2)))


def _redrawn(
    calibration: Calibration, places: Mapping[str, JointPlace], trial: DrawnTrial
) -> tuple[Calibration, DrawnTrial]:
    """The calibration with these joints, by the segment below each, and the trial drawn with it, if one is new."""
    joints = tuple(places.values())
    if all(new is old for new, old in zip(joints, calibration.joints, strict=True)):
        return calibration, trial
    placed = {p.joint.child for p in joints if p.status in ANATOMICAL and p.known}
    shapes = tuple((s.segment in placed and _of_two(s, trial)) or s for s in calibration.shapes)
    calibration = replace(calibration, joints=joints, shapes=shapes)
    return calibration, trial._replace(skeleton=draw_skeleton(calibration, trial.markers))


def _of_two(shape: SegmentShape, trial: DrawnTrial) -> SegmentShape | None:
    """The shape of a segment of two markers without a pose, for a joint to fix it; None for any other."""
    markers = trial.skeleton.calibration.markerset.segment(shape.segment).markers
    if shape.has_pose or len(markers) != 2 or not {*markers} <= {*trial.markers.markers}:
        return None
    one, two = trial.markers.select(markers).positions
    apart = np.linalg.norm(two - one, axis=0)
    if np.isnan(apart).all():
        return None
    places = np.array([[0.0, 0.0, 0.0], [np.nanmedian(apart), 0.0, 0.0]])
    return SegmentShape(shape.segment, markers, places, np.zeros(2), False, "")


_ENDS = {"shank": ("thigh", "knee", "epicondyles"), "foot": ("shank", "ankle", "malleoli")}
"""For a part of a leg the one above, the joint between them, and the points on both sides of that."""
_MARKER = 0.014
"""Diameter of a marker, metres, if the file does not have it: Plug-in Gait's."""


def joint_by_chord(above: Floats, aside: Floats, lateral: Floats, far: float) -> Floats | None:
    """Centre of a joint (3,) by the chord method, metres; None if the points do not show it.

    Args:
        above: the next joint of the limb (3,).
        aside: a marker on the side of the limb (3,), which shows in which plane the centre is.
        lateral: the marker at the joint (3,).
        far: distance of the centre from that marker, metres.
    """
    along, away = above - lateral, lateral - aside
    length = float(np.linalg.norm(along))
    if not length > far + _SHORT:
        return None
    along = along / length
    away = away - (away @ along) * along
    if np.linalg.norm(away) < _SHORT:
        return None
    cosine = far / length
    return np.asarray(lateral + far * (cosine * along + np.sqrt(1.0 - cosine**2) * away / np.linalg.norm(away)))


def _medial_by_width(
    name: str, top: JointPlace, points: Mapping[str, Floats], widths: Mapping[str, float]
) -> dict[str, Floats]:
    """The medial epicondyle or malleolus (3,) by the chord method; none if the file has one, or no width.

    Args:
        name: of the part below the joint, as "left shank".
        top: the next joint above.
        points: of the body.
        widths: of the joints.
    """
    one, _, part = name.partition(" ")
    above, joint, _ = _ENDS[part]
    aside, lateral, medial = (f"{one} {point}" for point in _POINTS[above])
    width = widths.get(f"{one} {joint}")
    if width is None or medial in points or not {aside, lateral} <= points.keys():
        return {}
    if not (top.usable or top.status in ANATOMICAL):
        return {}
    far = 0.5 * (width + widths.get("marker", _MARKER))
    center = joint_by_chord(top.in_child, points[aside], points[lateral], far)
    return {} if center is None else {medial: 2.0 * center - points[lateral]}


def _with_landmarks(
    place: JointPlace, name: str, trial: DrawnTrial, points: Mapping[str, Floats], by_width: bool
) -> JointPlace:
    """A knee or an ankle, compared with the middle of epicondyles or malleoli, and there if motion leaves it in doubt.

    A hinge is doubted that is farther from there, across its axis, than 2.5 √(error² + (1 cm)²). It is not compared
    with a middle by width, which is as wrong as the plane of the markers. A hinge that is not doubted moves along its
    axis to there.
    """
    one, _, part = name.partition(" ")
    above, joint, kind = _ENDS[part]
    both = [points.get(f"{one} {point}") for point in _POINTS[above][-2:]]
    if both[0] is None or both[1] is None:
        return place
    middle = 0.5 * (both[0] + both[1])
    if place.axis is not None and place.known and not by_width:
        basis = across(place.axis)
        far = float(np.linalg.norm(basis.T @ (middle - place.in_parent)))
        place = replace(place, beside=far)
        if place.usable and far > _FARTHEST * np.hypot(place.standard_error, LANDMARK):
            place = replace(place, status=JointStatus.IMPLAUSIBLE)
    if place.usable:  # motion does not show where along its axis a hinge is
        return place if place.axis is None or not place.known else moved_along_axis(place, middle)
    away = "" if np.isnan(place.beside) else f", {1000 * place.beside:.0f} mm from there across its axis"
    source = f"by the {joint}'s width (chord method)" if by_width else f"midway between the {kind}"
    words = f"{source}; by motion: {SHORT_TEXTS[place.status]}{away}"
    return _placed(place, middle, LANDMARK**2 * np.eye(3), JointStatus.LANDMARK, words, trial)


def _with_regression(place: JointPlace, trial: DrawnTrial, points: Mapping[str, Floats]) -> JointPlace:
    """A joint by regression, weighted with motion where both agree, if it is a hip that motion leaves in doubt."""
    segments = legs(trial.skeleton.calibration.markerset)
    one = next((one for one in _MIRROR if segments.get(f"{one} thigh") == place.joint.child), None)
    if one is None or place.usable:
        return place
    center, words = points.get(f"{one} hip centre"), "the laboratory's own centre, left in the file"
    if center is None:
        center, words = hip_by_regression(points, one), "by regression on the pelvis' width and depth (Harrington 2007)"
    if center is None:
        return place
    center, covariance, both = weighted(center, place.in_parent, place.covariance)
    words += ", weighted with motion by their errors" * both
    reason = f"{words}; by motion: {SHORT_TEXTS[place.status]}"
    return _placed(place, center, covariance, JointStatus.REGRESSION, reason, trial)


def _placed(
    place: JointPlace, center: Floats, covariance: Floats, status: JointStatus, reason: str, trial: DrawnTrial
) -> JointPlace:
    """A joint at a place in its parent (3,), metres, that its motion does not give; in its child, at the median.

    A child of two markers has its poses by the joint as motion has it. So the joint is placed anew beside the two.
    """
    skeleton, shape = trial.skeleton, trial.skeleton.calibration.shape(place.joint.child)
    i, j = (skeleton.segments.index(name) for name in (place.joint.parent, place.joint.child))
    world = to_world(skeleton.rotations[i], skeleton.origins[i], center)
    local = to_local(skeleton.rotations[j], skeleton.origins[j], world)
    shown = skeleton.segment_flags[[i, j]] == Flag.SEEN
    both = shown.all(axis=0) & ~np.isnan(local[0])
    in_child = np.median(local[:, both], axis=1) if both.any() else np.full(3, np.nan)
    shape = _of_two(shape, trial) or shape
    two = not shape.has_own_pose and len(shape.markers) == 2 and {*shape.markers} <= {*trial.markers.markers}
    if two and shown[0].any():
        x = trial.markers.select(shape.markers, np.flatnonzero(shown[0])).positions
        in_child = _beside_two(shape.places, place.in_child, x, world[:, shown[0]])
    place = replace(place, status=status, reason=reason, floor=float("nan"), covariance=covariance)
    return replace(place, in_parent=center, in_child=in_child)


def _beside_two(places: Floats, before: Floats, x: Floats, joint: Floats) -> Floats:
    """Place of a joint (3,) in the axes of a segment of two markers, by its median place along and beside their line.

    Args:
        places: of the markers (2, 3), metres.
        before: a place of the joint (3,), which shows to which side of the line it is; the axes leave this open.
        x: the markers in the world (2, 3, n), metres; NaN where missing.
        joint: in the world (3, n), metres.
    """
    line, away = x[1] - x[0], joint - x[0]
    line = line / np.linalg.norm(line, axis=0)
    along = (line * away).sum(axis=0)
    beside = np.linalg.norm(away - along * line, axis=0)
    own = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    aside = before - places[0]
    aside = aside - (aside @ own) * own
    if not np.linalg.norm(aside) > 0.0:
        aside = np.cross(own, np.eye(3)[np.abs(own).argmin()])
    return np.asarray(places[0] + np.nanmedian(along) * own + np.nanmedian(beside) * aside / np.linalg.norm(aside))


def weighted(center: Floats, motion: Floats, covariance: Floats) -> tuple[Floats, Floats, bool]:
    """A regression's centre (3,), weighted with that of motion and its covariance (3, 3) where both agree.

    They do not agree if their difference is beyond the quantile of χ² for the sum of their covariances: motion is then
    wrong by more than it says, and does not count.

    Returns:
        The centre, its covariance, and true if motion counts.
    """
    own = SIGMA**2 * np.eye(3)
    total, apart = own + covariance, motion - center
    known = np.isfinite(total).all() and np.isfinite(apart).all()
    if not known or apart @ np.linalg.solve(total, apart) > chdtri(3, 1.0 - _AGREE):
        return center, own, False
    gain = own @ np.linalg.inv(total)
    return center + gain @ apart, own - gain @ own, True


def regression_hint(calibration: Calibration, source: Recording) -> list[str]:
    """The line that tells of the regression where every hip is doubted and the file has its points; none otherwise."""
    segments, known = legs(calibration.markerset), landmarks(source.markers, calibration.markerset.landmarks).keys()
    hips = [place for place in calibration.joints if place.joint.child in (segments.get(f"{s} thigh") for s in _MIRROR)]
    back = {"left psis", "right psis"} <= known or "sacrum" in known
    own = {"left hip centre", "right hip centre"} <= known
    undoubted = any(place.usable or place.status == JointStatus.REGRESSION for place in hips)
    if not hips or undoubted or not (back or own):
        return []
    where = "the file's own LHJC and RHJC" if own else "the pelvis' width and depth (Harrington 2007)"
    return [f"every hip is doubted: --hips regression takes them from {where}, ± {1000 * SIGMA:.0f} mm on each axis"]

"""Errors of joints from skin that moves with them: the part that markers show, and a floor for the unseen part.

A marker at lever arm a, whose skin moves by Bθ for the joint's rotation vector θ, moves the centre by about (Bᵀâ) × â,
without a trace in the residuals (theory §12). So the covariance rests on the size of B alone. The entries of B have the
variance β² of the segment: for the segment on which the markers are, half of it common to its markers; for the segment
in whose axes the centre is fitted, each marker's own.

The slope β of a segment's skin, m/rad, is how far its markers leave their rigid template as a joint rotates. It is
measured where three markers of its own fix its pose (`skin_slope`), and drawn to the mean of those that were measured
in the body so far; a segment without such a pose, as a thigh with two markers, gets that mean. Few coordinates show β
badly, and markers differ in it, so errors are those of Student's law. `sphere_skin`,
`pair_skin` and `image_skin` turn the slope into a covariance. Skin that does not follow the angle makes the centre from
frames in which the joint bends differ from that of frames in which it straightens.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from study.arrays import Bools, Floats, Ints
from study.recordings import rigid
from study.recordings.joints.center import fit_center
from study.recordings.joints.estimate import Estimate, PlaceDifference, local_marker, symmetric_fit
from study.recordings.joints.poses import SegmentPoses
from study.recordings.markersets import Joint
from study.recordings.recording import Recording

_COMMON = 0.5
"""Share of the variance of the skin that is common to the markers of a segment."""
_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_i, _k, _j] = 1.0, -1.0


def pose_shifts(points: Floats, on_skin: Bools, place: Floats) -> Floats:
    """Displacements (k, 3, 3) of a point (3,) fixed in a segment per displacement of each of its k markers.

    Args:
        points: that the segment's pose is fitted to (m, 3), metres.
        on_skin: which of them are markers (m,), and not joints.
        place: of the point (3,), metres.
    """
    middle = points.mean(axis=0)
    k = rigid.skew(points - middle)
    shifts = np.eye(3) / len(points) - rigid.skew(place - middle) @ np.linalg.pinv(np.einsum("mij,mkj->ik", k, k)) @ k
    return np.asarray(shifts[on_skin])


def sphere_skin(
    inverse: Floats, slopes: Floats, arms: Floats, shifts: Sequence[Floats], markers: float, own: float
) -> Floats:
    """Covariance (3, 3), m², of a centre that is fitted to spheres.

    Args:
        inverse: of the fit's normal matrix (3, 3), 0 along a dropped axis.
        slopes: Σ over the frames of w r z θᵀ for each marker on a sphere (M, 3, 3), which is the centre's response to
            radial displacements that are linear in the joint's angles θ.
        arms: unit lever arms (M, 3).
        shifts: displacement of each of these markers' places (k, 3, 3) in the axes of the fit, per displacement of the
            markers on the segment that has these axes.
        markers: β² of the skin below the markers on spheres, (m/rad)².
        own: β² of the skin of the segment in whose axes they are.
    """
    if not len(arms):
        return np.zeros((3, 3))
    shared = markers * (_COMMON * (arms @ arms.T) + (1.0 - _COMMON) * np.eye(len(arms)))
    h = np.stack([np.einsum("i,kij->kj", arm, shift) for arm, shift in zip(arms, shifts, strict=True)])
    total = np.einsum("jl,jai,lbi->ab", shared + own * np.einsum("jki,lki->jl", h, h), slopes, slopes)
    return np.asarray(inverse @ total @ inverse)


def pair_skin(angles: Floats, basis: Floats, moved: Floats) -> Floats:
    """Covariance (3, 3), m², of the point in which two segments agree.

    Args:
        angles: second moments of the joint's rotation vectors (3, 3), rad².
        basis: directions in which the point is known (3, d), in the same axes.
        moved: covariance of the displacement between the point's two images per radian about each axis (3, 3),
            (m/rad)².
    """
    matrix = np.trace(angles) * np.eye(3) - angles
    inverse = basis @ np.linalg.pinv(basis.T @ matrix @ basis, hermitian=True) @ basis.T
    total = np.einsum("ijk,abc,jb,kc->ia", _LEVI_CIVITA, _LEVI_CIVITA, angles @ angles, moved)
    return np.asarray(inverse @ total @ inverse)


def image_skin(shifts: Floats, own: float) -> Floats:
    """Covariance (3, 3) of the displacement of a point of a segment, for skin of unit variance along each axis.

    Args:
        shifts: displacement of the point per displacement of each of the segment's markers (k, 3, 3).
        own: share of the variance that is each marker's own; the rest is common to all.
    """
    return np.asarray(own * np.einsum("kij,klj->il", shifts, shifts) + (1.0 - own) * np.eye(3))


_BLOCKS = 16
"""Stretches of time from which the share of the noise is found, long enough to be independent of each other."""
_FEWEST = 6
"""Fewest frames for each regressor."""
_CLEAR = 10.0
"""Times what noise explains that the change of radii must be to count: the centre's own error is no skin."""
_RANK = 1e-9
"""Size of a regressor, relative to the largest, below which it is rounding."""


def skin_slope(departures: Floats, angles: Floats) -> float:
    """Measure the mean square slope of the skin of a segment against the angles of a joint.

    The departures from the rigid template are regressed on the rotation vector and its six quadratics. What these
    explain, less what noise alone would explain, belongs to the skin. The rigid fit takes six of the 3m coordinates.

    Args:
        departures: of the markers from their places in the template (m, 3, frames), metres; NaN where one is missing.
        angles: rotation vectors of the joint (3, frames), radians; NaN where unknown.

    Returns:
        Mean square of an entry of the tensor (3, 3) that takes the rotation vector to a marker's displacement,
        (m/rad)²; NaN if the frames are too few, or m < 3.
    """
    m = len(departures)
    if m < 3:
        return float("nan")
    explained, noise = _explained(departures.reshape(3 * m, -1), angles)
    return explained if np.isnan(explained) else max(explained - noise, 0.0) * 3 * m / (3 * m - 6)


def radius_slope(radii: Floats, angles: Floats) -> float:
    """Measure the mean square slope of the skin below markers by the change of their radii with a joint's angles.

    A marker that slides with the joint that it moves about leaves its sphere. The fit moves the centre to where these
    changes are least, which takes one marker's share of them.

    Args:
        radii: distances of the markers from the centre, less their means (M, frames), metres; NaN where missing.
        angles: rotation vectors of the joint (3, frames), radians; NaN where unknown.

    Returns:
        The mean square slope along a radius, (m/rad)²; NaN for one marker, or if the frames are too few.
    """
    parts = np.array([_explained(row[None], angles) for row in radii])
    parts = parts[~np.isnan(parts[:, 0])]
    if len(parts) < 2:
        return float("nan")
    explained, noise = parts.sum(axis=0)
    return float(explained - noise) / (len(parts) - 1) if explained > _CLEAR * noise else 0.0


def _explained(displacements: Floats, angles: Floats) -> tuple[float, float]:
    """Mean square of displacements (k, frames) per radian that angles explain, and what of it noise would explain."""
    known = ~(np.isnan(displacements).any(axis=0) | np.isnan(angles[0]))
    n = int(known.sum())
    if n < 9 * _FEWEST:
        return float("nan"), float("nan")
    d, x = displacements[:, known], angles[:, known]
    x = x - x.mean(axis=1, keepdims=True)
    quadratics = [x[i] * x[j] for i in range(3) for j in range(i, 3)]
    regressors = np.concatenate([x, quadratics])
    regressors -= regressors.mean(axis=1, keepdims=True)
    d = d - d.mean(axis=1, keepdims=True)
    sizes, rows = np.linalg.svd(regressors, full_matrices=False)[1:]
    rows = rows[sizes > _RANK * sizes[0]]  # orthonormal; of angles that lack a direction fewer than nine
    coefficients = rows @ d.T
    rest = d - coefficients.T @ rows
    edges = np.linspace(0, n, _BLOCKS + 1).astype(int)
    blocks = [rows[:, a:b] @ rest[:, a:b].T for a, b in itertools.pairwise(edges)]
    noise = sum(float((block**2).sum()) for block in blocks) * _BLOCKS / (_BLOCKS - 1)
    scale = len(d) * max(float((x**2).sum()), 1e-300)
    return float((coefficients**2).sum()) / scale, noise / scale


_FRAMES = 600
"""Frames, spread over the recording, on which skin is measured."""
_LEAST_RATE = 10.0
"""Frames for each second that are kept, whatever the length of the recording."""
_LAG = 0.05
"""Seconds before and after a frame whose angles decide which way the joint rotates in it."""
_PRIOR = 3.0
"""Coordinates that a segment's markers must show for its own slope to weigh as much as the mean of the body's."""
_LOST = 3.0
"""Coordinates less in a mean square that few show: Student's variance, where k of them are 2k/3 degrees of freedom."""
_UNSEEN = 1.5
"""Factor on the mean for a segment that shows none of its slope, as the others scatter about their mean."""
_FLOOR = 0.005
"""m/rad: slope of skin that is common to the markers of a segment, half of it on the segment of the axes."""


class SkinErrors:
    """Skin of the segments of one recording, measured joint by joint.

    Args:
        recording: with the markers.
        poses: of the segments whose own markers fix them.
    """

    def __init__(self, recording: Recording, poses: Mapping[str, SegmentPoses]) -> None:
        self.recording, self.own = recording, dict(poses)
        step = max(min(recording.frames // _FRAMES, int(recording.rate / _LEAST_RATE)), 1)
        self.part: Ints = np.arange(0, recording.frames, step)
        self.lag = max(round(_LAG * recording.rate / step), 1)
        self.departures = {name: self._departures(own) for name, own in self.own.items()}
        self.measured: list[float] = []
        self.by_radius: dict[tuple[str, str], float] = {}

    def add(self, estimate: Estimate, joint: Joint) -> Estimate:
        """Add the error from skin to an estimate's covariance, and find its floor.

        Args:
            estimate: of the joint.
            joint: that it is of.
        """
        angles, frame = self._angles(estimate, joint), estimate.poses.segment
        other = joint.parent if frame == joint.child else joint.child
        if estimate.sphere is not None and estimate.axis is None:  # a hinge's radii change with its axis' own error
            y = self._local(estimate)
            radii = np.linalg.norm(y - estimate.center[:, None], axis=1)
            slope = radius_slope(np.where(estimate.used[:, self.part], radii, np.nan), angles)
            self.by_radius[joint.name, other] = 0.0 if np.isnan(slope) else slope
        slopes = [max(self._slope(one, angles), self.by_radius.get((joint.name, one), 0.0)) for one in (frame, other)]
        skin, floor = self._covariances(estimate, angles, (slopes, ((0.5 * _FLOOR) ** 2, _FLOOR**2)))
        size = float(np.sqrt(max(np.linalg.eigvalsh(floor)[-1], 0.0)))
        return replace(estimate, covariance=estimate.covariance + skin, skin=estimate.skin + skin, floor=size)

    def ways(self, estimate: Estimate, joint: Joint) -> list[PlaceDifference]:
        """Compare an estimate's centres from the frames in which the joint rotates one way and the other.

        Args:
            estimate: of the joint.
            joint: that it is of.

        Returns:
            A difference for each axis about which the joint rotates: two, one for a hinge, fewer where a fit fails.
        """
        differences = []
        both = rigid.turning_ways(self._angles(estimate, joint), self.lag, 2 if estimate.axis is None else 1)
        for ways in both:
            one, two = (self._refit(estimate, self.part[frames]) for frames in ways)
            if one is not None and two is not None:
                differences.append(PlaceDifference.of(two[0] - one[0], one[1] + two[1], estimate.axis, "ways"))
        return differences

    def _refit(self, estimate: Estimate, part: Ints) -> tuple[Floats, Floats] | None:
        """Centre (3,) and covariance (3, 3) of an estimate from some of the frames; None if they do not give one."""
        poses = estimate.poses.in_frames(part)
        if estimate.pair is not None:
            pair = symmetric_fit(poses, estimate.pair.child.in_frames(part), estimate.pair.hinge)
            return None if pair is None else (pair.in_parent, pair.covariance)
        x, pairs = self.recording, zip(estimate.markers, estimate.used, strict=True)
        markers = [local_marker(poses, x.of(name)[:, part], used[part]) for name, used in pairs]
        fit = fit_center(markers, *estimate.noise_model(poses))
        return (fit.center, fit.covariance) if fit is not None and fit.significant else None

    def _angles(self, estimate: Estimate, joint: Joint) -> Floats:
        """Rotation vectors of the joint (3, frames of the part) in the axes of an estimate, radians."""
        frame = estimate.poses.segment
        two = self.own.get(joint.parent if frame == joint.child else joint.child)
        two = two if estimate.pair is None else estimate.pair.child
        if two is not None:
            rotation = estimate.poses.rotation[:, :, self.part]
            return rigid.rotation_vectors(rigid.relative_rotation(rotation, two.rotation[:, :, self.part]))
        return rigid.angles_about_center(self._local(estimate), estimate.used[:, self.part], estimate.center)

    def _local(self, estimate: Estimate) -> Floats:
        """The markers of an estimate in its axes (M, 3, frames of the part), metres."""
        x = np.stack([self.recording.of(name)[:, self.part] for name in estimate.markers])
        return estimate.poses.in_frames(self.part).to_local(x)

    def _slope(self, segment: str, angles: Floats) -> float:
        """β² of a segment's skin with a joint, (m/rad)²; 0 if no segment showed any so far."""
        own = skin_slope(self.departures[segment], angles) if segment in self.departures else float("nan")
        if not np.isnan(own):
            self.measured.append(own)
        if not self.measured:
            return 0.0
        mean = float(np.mean(self.measured))
        if np.isnan(own):
            return _UNSEEN * mean
        shown = 3 * len(self.departures[segment]) - 6
        return (shown * own + _PRIOR * mean) / (shown + _PRIOR - _LOST)

    def _departures(self, poses: SegmentPoses) -> Floats:
        """Distances of a segment's markers from its template (m, 3, frames of the part); NaN unless all are good."""
        x = np.stack([self.recording.of(name)[:, self.part] for name in poses.points])
        y = poses.in_frames(self.part).to_local(x) - poses.template[:, :, None]
        return np.where(poses.good[:, self.part].all(axis=0), y, np.nan)

    def _covariances(self, estimate: Estimate, angles: Floats, several: Sequence[Sequence[float]]) -> list[Floats]:
        """Covariance of an estimate's centre from skin (3, 3), m², for each of several pairs of slopes.

        They are the mean square slopes β² on the segment of the estimate's axes, and on the other, (m/rad)².
        """
        if estimate.pair is None:
            inverse, slopes, arms, places = self._response(estimate, angles)
            shifts = [self._shifts(estimate.poses, place) for place in places]
            return [sphere_skin(inverse, slopes, arms, shifts, other, own) for own, other in several]
        x = angles[:, ~np.isnan(angles[0])]
        x = x - x.mean(axis=1, keepdims=True)
        one, two = estimate.poses.in_frames(self.part), estimate.pair.child.in_frames(self.part)
        both = one.known & two.known
        rotation = rigid.relative_rotation(one.rotation[:, :, both], two.rotation[:, :, both])
        images = image_skin(self._shifts(one, estimate.center), 1.0)
        others = rigid.mean_rotated_covariance(rotation, image_skin(self._shifts(two, estimate.pair.in_child), 0.5))
        basis, second = rigid.across(estimate.axis), x @ x.T / max(x.shape[1], 1)
        return [pair_skin(second, basis, own * images + other * others) for own, other in several]

    def _response(self, estimate: Estimate, angles: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Inverse, slopes and arms of a sphere fit for `sphere_skin`, and the markers' mean places (M, 3), metres."""
        fit = estimate.sphere
        assert fit is not None
        basis = rigid.across(fit.axis)
        within = basis @ basis.T
        inverse = basis @ np.linalg.pinv(basis.T @ fit.normal @ basis, hermitian=True) @ basis.T
        slopes, arms, places = [], [], []
        for y, seen, weight in zip(self._local(estimate), estimate.used, fit.weights, strict=True):
            used = seen[self.part] & ~np.isnan(angles[0]) & ~np.isnan(y[0])
            if weight > 0.0 and used.sum() > 1:
                places.append(y[:, used].mean(axis=1))
                arm = within @ (places[-1] - estimate.center)
                length = max(float(np.linalg.norm(arm)), 1e-300)
                arms.append(arm / length)
                z = within @ (y[:, used] - places[-1][:, None])
                slopes.append(weight * length * z @ angles[:, used].T / used.sum())
        return inverse, np.array(slopes), np.array(arms), np.array(places)

    def _shifts(self, poses: SegmentPoses, place: Floats) -> Floats:
        """Displacements (k, 3, 3) of a point (3,) fixed in a segment per displacement of each of its markers."""
        on_skin = np.array([name in self.recording.markers for name in poses.points])
        return pose_shifts(poses.template, on_skin, place)

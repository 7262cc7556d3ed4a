"""Estimates of one joint, from markers on spheres in one segment's axes, or from the poses of both segments.

A sphere fit uses the noise of the segment's pose (`PoseNoise`) as long as the markers' motion exceeds it. Where that
noise would explain the motion along some direction, the noise is taken for isotropic, as slowly sliding soft tissue may
be. Where even that hides the motion, no noise is taken off: that is GDKE's answer, which is biased towards the markers
but never far away.

A joint whose segments both have poses is estimated up to three times. Soft tissue that moves alike in every frame shows
in no standard error, but it makes the estimates differ. A joint whose estimate another reliable one contradicts is not
known to its standard error.

Two estimates contradict each other if they are more than a centimetre apart, across a hinge's axis, and that is beyond
the 80 % quantile of χ² for the sum of their covariances; or if their axes differ by more than 20°, which over a limb's
thickness (3 cm) is a centimetre. The covariances are added as for independent errors. In truth the estimates share
their markers, and errors in common do not make them differ, so the rule is conservative. With noise of 1-5 mm alone it
flags one in a hundred of the joints with two sides. If soft tissue slides by 2-3 cm, it flags two in three of the
joints that this moves by more than 2 cm. A joint with one estimate cannot be checked.

Only estimates with a valid standard error can contradict: not those that noise hides or could explain. Two estimates of
a hinge that are more than 5 cm apart along the axis are not compared, because the error of the axis would decide their
distance across it.

The symmetric fit of a joint is the point in which the poses of two segments agree, and the axis of their rotation:

    minimise Σ |R_P c_P + t_P - R_Q c_Q - t_Q|²                                              (SCoRE, Ehrig et al. 2006)

These are six linear equations. Their matrix holds RᵀR = I, which has no noise, and M = mean R_PᵀR_Q, which noise makes
smaller: the mean of a pose whose rotation is uncertain by δ is R (I - B), B = ½ (Tr Cov δ - Cov δ). Multiplication by
I + B corrects for that, as UGDK corrects C for noise. For a hinge both c may slide along the axis together. The
singular vectors of M are that axis in both segments (SARA, Ehrig et al. 2007, in closed form).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np
from scipy import special

from study.arrays import Bools, Floats
from study.fits.points.samples import Worded
from study.recordings.joints.center import SHAPE_ERROR, CenterFit, LocalMarker, center_only, fit_center, reject_outliers
from study.recordings.joints.poses import PoseNoise, SegmentPoses, long_run_covariance, times
from study.recordings.rigid import across, implied_angles, mean_rotated_covariance, relative_rotation

CENTIMETRE = 0.01
"""Metres: the accuracy that the paper asks for. A larger standard error in some direction makes a centre unsure."""
FEWEST_FRAMES = 10
"""Fewest frames that show how they scatter, and so give a standard error."""

_STILL = 0.005
"""Standard deviation of a marker's place, over its distance from the template's middle, below which it did not move."""

Side = Literal["parent", "child", "both"]
"""Segment in whose axes the markers were, or both."""
Compared = Side | Literal["ways"]
"""Source of another estimate; ways: from frames in which the joint rotates one way and the other."""
NoiseModel = Literal["pose", "isotropic", "none"]
"""Noise that a fit took off: that of the pose and the markers, the same in all directions, or none."""


class JointStatus(Worded):
    """Reliability of a joint, with the text that a user reads."""

    OK = 0, "ok"
    HINGE = 1, "hinge: known across its axis; its place along the axis is not known, or from soft tissue alone"
    DISAGREE = 2, "its two segments contradict each other by more than 1 cm or 20°, beyond what their errors explain"
    REVERSES = 3, "bending and straightening put it more than 1 cm apart, beyond what their errors explain"
    IMPLAUSIBLE = 4, "its place is unlike any body's"
    ONE_AXIS = 5, "a ball joint that moved about one axis: its place along it is not known, or from soft tissue alone"
    UNSURE = 6, "moved too little for its noise and its skin, or was seen too briefly: a standard error may exceed 1 cm"
    INSIGNIFICANT = 7, "along some direction the noise of the segment's pose would explain how far the markers moved"
    NOT_POSITIVE_DEFINITE = 8, "the noise hides how far the markers moved: the centre is biased towards them"
    STILL = 9, "did not move: the markers stay in place in the segment's axes"
    NO_FRAME = 10, "neither of its segments has a pose"
    UNSEEN = 11, "its markers were not seen, or never together with a pose"
    REGRESSION = 12, "not by motion, but by regression or as the file has it"
    LANDMARK = 13, "not by motion, but between points of the body, or by its width"


_SHORT = "ok, hinge, sides disagree, ways disagree, implausible, one axis, unsure, insignificant, hidden by noise"
SHORT_TEXTS = dict(
    zip(JointStatus, f"{_SHORT}, still, no frame, unseen, regression, landmark".split(", "), strict=True)
)
"""A status in a table, which has no room for its whole text."""
USABLE = (JointStatus.OK, JointStatus.HINGE)
"""A joint that a skeleton can be built on without reservation."""
ANATOMICAL = (JointStatus.REGRESSION, JointStatus.LANDMARK)
"""A joint that points of the body place, and not its motion."""
DOUBTED = tuple(status for status in JointStatus if USABLE[-1] < status < JointStatus.UNSURE)
"""A joint that is drawn, and doubted: its estimates, or a body, contradict it, or it moved about one axis only."""


def largest_error(covariance: Floats, axis: Floats | None) -> float:
    """Largest standard error, metres, of a place with a covariance (3, 3), m², across an axis (3,) if there is one."""
    if np.isnan(covariance).any():
        return float("nan")
    across = np.eye(3) if axis is None else np.eye(3) - np.outer(axis, axis)
    return float(np.sqrt(max(np.linalg.eigvalsh(across @ covariance @ across)[-1], 0.0)))


_NOISE = 3.0
"""Standard errors within which a rotation of the axis is noise."""
_UNTURNED = 0.02
"""Radians: segments that rotate by less, root mean square, about every axis show no joint."""


@dataclass(frozen=True)
class SymmetricFit:
    """A joint from the poses of both of its segments.

    Attributes:
        child: poses of the child.
        in_parent: c_P (3,), metres.
        in_child: c_Q (3,), metres.
        covariance: of c_P (3, 3), m²: the sandwich over frames in its long-run form, and the error that follows if the
            poses' noise is not what their markers say.
        gap: root mean square distance between the two images of the joint, metres.
        axes: direction that changes least in both segments, in the parent's axes and in the child's (2, 3).
        rms_angles: root mean square angles by which the segments rotate against each other about three axes, that one
            first, radians.
        hinge: True if that direction changes by no more than noise; the two c are then the shortest that agree.
        normal: matrix of the normal equations of c_P (3, 3), 1 - M Mᵀ: what the rotation shows of it, rad².
        frames: number of frames used.
        effective_frames: effective number of independent frames.
    """

    child: SegmentPoses
    in_parent: Floats
    in_child: Floats
    covariance: Floats
    gap: float
    axes: Floats
    rms_angles: Floats
    hinge: bool
    normal: Floats
    frames: int
    effective_frames: float


def symmetric_fit(parent: SegmentPoses, child: SegmentPoses, known_hinge: bool | None = None) -> SymmetricFit | None:
    """Fit the point in which two segments agree.

    Args:
        parent: poses of one segment.
        child: poses of the other.
        known_hinge: True if the joint is a hinge, False if not, None to decide by the data.

    Returns:
        The fit; None if the segments share fewer than four frames or do not rotate against each other.
    """
    n = int((parent.known & child.known).sum())
    if n < 4:
        return None
    system = _Agreement(parent, child, 1.0)
    s, u, v = system.spectrum()
    angles = implied_angles(s)
    if angles.max() < _UNTURNED:
        return None
    along = np.einsum("i,ijt,j->t", u, system.m, v) - s[0]
    error = np.sqrt(long_run_covariance(along[None])[0][0, 0]) / n
    hinge = bool(1.0 - s[0] < _NOISE * error) if known_hinge is None else known_hinge
    c, inverse = system.solve(hinge)
    inflated, independent = (inverse @ part @ inverse / n**2 for part in long_run_covariance(system.scores(c)))
    share = float(np.trace(independent[:3, :3]) / max(np.trace(inflated[:3, :3]), 1e-300))
    doubt = inverse @ _Agreement(parent, child, 1.0 + SHAPE_ERROR).residual(c)
    apart = parent.to_world(c[:3]) - child.to_world(c[3:])
    covariance = inflated[:3, :3] + np.outer(doubt[:3], doubt[:3])
    gap, normal = float(np.sqrt(np.nansum(apart**2) / n)), np.eye(3) - system.mean @ system.mean.T
    fitted = c[:3], c[3:], covariance, gap, np.stack([u, v]), angles, hinge, normal
    return SymmetricFit(child, *fitted, n, n * min(share, 1.0))


class _Agreement:
    """The six equations for a size of the poses' noise: mean of c_P - M c_Q = a, and the same for the child.

    With G = I + B, p and q the centroids and w the vector in the world from R_P p + o_P to R_Q q + o_Q, a frame has

        M = G_P R_PᵀR_Q G_Q,  a = p + G_P R_Pᵀ w - M q - shift,  b = q - G_Q R_Qᵀ w - Mᵀ p - shift.

    Attributes:
        m, a, b: of the n frames that both know (3, 3, n), (3, n), (3, n).
        mean, mean_a, mean_b: their means.
    """

    def __init__(self, parent: SegmentPoses, child: SegmentPoses, size: float) -> None:
        both = parent.known & child.known
        back_p, p, world_p, shift_p = _side(parent, both, size)
        back_q, q, world_q, shift_q = _side(child, both, size)
        w = world_q - world_p
        self.m = np.einsum("ijt,kjt->ikt", back_p, back_q)
        self.a = p + times(back_p, w) - times(self.m, q) - shift_p
        self.b = q - times(back_q, w) - times(self.m.swapaxes(0, 1), p) - shift_q
        self.mean, self.mean_a, self.mean_b = (part.mean(axis=-1) for part in (self.m, self.a, self.b))

    def spectrum(self) -> tuple[Floats, Floats, Floats]:
        """Singular values of M, at most 1, and its first singular vectors."""
        u, s, vt = np.linalg.svd(self.mean)
        return np.minimum(s, 1.0), u[:, 0], vt[0]

    def solve(self, hinge: bool) -> tuple[Floats, Floats]:
        """The two places (6,), and the inverse that gives them (6, 6)."""
        matrix = np.block([[np.eye(3), -self.mean], [-self.mean.T, np.eye(3)]])
        basis = np.linalg.eigh(matrix)[1][:, 1 if hinge else 0 :]
        inverse = basis @ np.linalg.pinv(basis.T @ matrix @ basis) @ basis.T
        return inverse @ np.concatenate([self.mean_a, self.mean_b]), inverse

    def residual(self, c: Floats) -> Floats:
        """Mean residual of the equations at c (6,)."""
        of_child = self.mean_b - c[3:] + self.mean.T @ c[:3]
        return np.concatenate([self.mean_a - c[:3] + self.mean @ c[3:], of_child])

    def scores(self, c: Floats) -> Floats:
        """Each frame's contribution to the residuals at c (6,), less the mean (6, n)."""
        of_child = self.b + times(self.m.swapaxes(0, 1), c[:3])
        scores = np.concatenate([self.a + times(self.m, c[3:]), of_child])
        return np.asarray(scores - scores.mean(axis=1, keepdims=True))


def _side(poses: SegmentPoses, frames: Bools, size: float) -> tuple[Floats, Floats, Floats, Floats]:
    """G Rᵀ (3, 3, n) of a segment, its centroid in its axes and in the world, and the noise's mean shift (3, n)."""
    rotation, origin = poses.rotation[:, :, frames], poses.origin[:, frames]
    expansion, centroid, shift = poses.noise.mean_effects(frames, size)
    back = np.einsum("ijt,kjt->ikt", np.broadcast_to(expansion, rotation.shape), rotation)
    return back, centroid, times(rotation, centroid) + origin, shift


@dataclass(frozen=True)
class Estimate:
    """A joint's place in one of its segments.

    Attributes:
        side: "parent" for the child's markers in the parent's axes; "child" for the reverse; "both" for the point in
            which the two poses agree, in the parent's axes.
        poses: of the segment in whose axes it is.
        markers: names of the markers that it is fitted to.
        center: (3,), metres.
        covariance: of the centre (3, 3), m², errors of the joints that the poses rest on included.
        axis: direction along which the centre is not known (3,), or None.
        noise: the noise that was taken off.
        used: samples used (M, frames).
        sphere: the fit of one side, or None.
        pair: the fit of both sides, or None.
        status: reliability.
        skin: part of the covariance that comes from skin, of this joint and of those that the poses rest on (3, 3), m².
        floor: standard error from skin that is common to the markers of a segment, for a slope of 5 mm/rad, metres. No
            marker shows such skin, so it is part of no covariance. NaN until it is known.
    """

    side: Side
    poses: SegmentPoses
    markers: tuple[str, ...]
    center: Floats
    covariance: Floats
    axis: Floats | None
    noise: NoiseModel
    used: Bools
    sphere: CenterFit | None = None
    pair: SymmetricFit | None = None
    status: JointStatus = JointStatus.OK
    skin: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    floor: float = float("nan")

    @property
    def fit(self) -> CenterFit | SymmetricFit:
        """The fit of one side or of both."""
        fit = self.sphere or self.pair
        assert fit is not None
        return fit

    @property
    def standard_error(self) -> float:
        """Largest standard error across the axis, metres."""
        return largest_error(self.covariance, self.axis)

    def noise_model(self, poses: SegmentPoses) -> tuple[PoseNoise, bool, float | None]:
        """Arguments of `center_only` and `fit_center` that repeat a sphere fit with other poses: noise, hinge and η."""
        noise = poses.noise if self.noise == "pose" else poses.noise.removed
        return noise, self.sphere is not None and self.sphere.axis is not None, 0.0 if self.noise == "none" else None

    def placed_along_axis(self, x: Floats) -> "Estimate":
        """The estimate moved along its axis to where a point of the world (3, frames), metres, is on average.

        It stays where it is if it has no axis, or the point is never seen together with the pose.
        """
        place = self.poses.mean_place(x)
        if self.axis is None or np.isnan(place).any():
            return self
        return replace(self, center=self.center + ((place - self.center) @ self.axis) * self.axis)

    def with_status(self) -> "Estimate":
        """The same estimate with the status that follows from its noise, error and frames."""
        if self.noise == "none":
            status = JointStatus.NOT_POSITIVE_DEFINITE
        elif self.noise == "isotropic" or (self.sphere is not None and not self.sphere.exceeds_noise):
            status = JointStatus.INSIGNIFICANT
        elif not (self.standard_error < CENTIMETRE and self.fit.frames >= FEWEST_FRAMES):
            status = JointStatus.UNSURE
        else:
            status = JointStatus.OK if self.axis is None else JointStatus.HINGE
        return replace(self, status=status)


def estimate_from_spheres(
    side: Side, poses: SegmentPoses, names: Sequence[str], markers: Sequence[LocalMarker], hinge: bool
) -> Estimate | None:
    """Estimate a joint from the spheres on which markers move in a segment's axes.

    Args:
        side: "parent" or "child": the segment that the poses belong to.
        poses: of that segment.
        names: of the markers.
        markers: in the segment's axes.
        hinge: True if the joint is known to be a hinge.

    Returns:
        The estimate, without its status; None if the markers do not move.
    """
    fitted = _fit_with_noise(markers, poses, hinge)
    if fitted is None:
        return None
    noise, fit, accepted = fitted
    covariance = fit.covariance + fit.shape + _doubt_of_noise(noise, fit, accepted, poses)
    axis, used = fit.least if hinge and fit.axis is None else fit.axis, np.stack([marker.used for marker in accepted])
    return Estimate(side, poses, tuple(names), fit.center, covariance, axis, noise, used, fit)


def estimate_from_poses(parent: SegmentPoses, pair: SymmetricFit, hinge: bool) -> Estimate:
    """Estimate a joint from the point in which its two segments agree; the status is not set yet."""
    axis, used = pair.axes[0] if hinge or pair.hinge else None, pair.child.good & parent.known
    place = pair.child.points, pair.in_parent, pair.covariance, axis
    return Estimate("both", parent, *place, "pose", used, pair=pair)


def local_marker(poses: SegmentPoses, x: Floats, accepted: Bools) -> LocalMarker:
    """Express a marker (3, frames) in a segment's axes; its noise is taken to be that of the segment's own markers.

    ``accepted`` (frames,) are the samples that may be used.
    """
    y = poses.to_local(x)
    return LocalMarker(y, poses.known & accepted & ~np.isnan(y[0]), poses.sigma**2)


def _fit_with_noise(
    markers: Sequence[LocalMarker], poses: SegmentPoses, hinge: bool
) -> tuple[NoiseModel, CenterFit, list[LocalMarker]] | None:
    """Fit a centre without outliers, with the first noise model that leaves the markers' motion significant."""
    clean, exact = reject_outliers(markers), poses.noise.removed
    if all(_is_still(marker, poses) for marker in clean):
        return None
    models: dict[NoiseModel, tuple[PoseNoise, float | None]]
    models = {"pose": (poses.noise, None), "isotropic": (exact, None), "none": (exact, 0.0)}
    for name, (noise, size) in models.items():
        fit = fit_center(clean, noise, size=size)
        if fit is not None and hinge and fit.axis is None and not fit.clear and size is None:
            planar = fit_center(clean, noise, True)
            fit = planar if planar is not None and planar.significant else fit
        if fit is None:
            return None
        accepted = [marker.near_sphere(fit.center, fit.axis) for marker in clean]
        if any(a.used.sum() < b.used.sum() for a, b in zip(accepted, clean, strict=True)):
            fit = fit_center(accepted, noise, (hinge and fit.axis is not None) or None, size) or fit
        determined = fit.clear or fit.axis is not None or not hinge
        if name == "none" or (fit.significant and fit.exceeds_noise and determined):
            return name, fit, accepted
    return None


def _doubt_of_noise(noise: NoiseModel, fit: CenterFit, markers: Sequence[LocalMarker], poses: SegmentPoses) -> Floats:
    """Covariance (3, 3), m², of a centre whose noise is not what was taken off.

    Where the noise is not of its expected shape, the correction for noise is not known, and counts as an error. Where
    noise hides the motion, no more is known than that the joint is between the two segments.
    """
    if noise == "isotropic":
        plain = center_only(markers, poses.noise.removed, fit.axis is not None, 0.0)
        return np.zeros((3, 3)) if plain is None else np.outer(fit.center - plain, fit.center - plain)
    if noise == "none":
        away = [np.nanmean(m.y[:, m.used], axis=1) - poses.template.mean(axis=0) for m in markers if m.used.any()]
        return float(max((a @ a for a in away), default=0.0)) * np.eye(3)
    return np.zeros((3, 3))


def _is_still(marker: LocalMarker, poses: SegmentPoses) -> bool:
    """True if a marker stays in place in a segment's axes."""
    y = marker.y[:, marker.used]
    if y.shape[1] < 2:
        return True
    away = y.mean(axis=1) - poses.template.mean(axis=0)
    return bool(np.linalg.eigvalsh(np.cov(y))[-1] < _STILL**2 * (away @ away))


COMPARABLE = (*USABLE, JointStatus.UNSURE)
"""Estimates whose covariance is valid, be it large."""
_SIDES_LEVEL = 0.2
"""Chance at which two sides of like accuracy would count as apart if their errors were independent."""
_WAYS_LEVEL = 0.0125
"""Chance at which a joint without skin would count as contradictory about an axis; most are tested about two."""
_AXES = np.radians(20.0)
"""Angle between two axes above which they are not axes of one hinge."""
_ALONG = 0.05
"""Metres along a hinge's axis beyond which two places on it are not compared."""
_AXIS_ERROR = np.radians(10.0)
"""Standard error of a hinge's axis: it moves a place by that times the distance along the axis."""


@dataclass(frozen=True)
class PlaceDifference:
    """Difference of another place of a joint from the chosen one, in the chosen one's axes.

    Attributes:
        vector: from one to the other (3,), metres; across the axis of a hinge.
        chi_square: squared distance in units of the standard errors.
        directions: number of directions in which it is known.
        side: of the other estimate; "ways" if the two are from frames in which the joint rotates one way and the other.
        angle: between their axes, radians; 0 if not both have one.
    """

    vector: Floats
    chi_square: float
    directions: int
    side: Compared
    angle: float

    @classmethod
    def of(cls, off: Floats, errors: Floats, axis: Floats | None, side: Compared, angle: float = 0.0) -> Self:
        """The difference ``off`` (3,), of covariance ``errors`` (3, 3), across an axis (3,) if there is one."""
        basis = across(axis)
        part = basis.T @ off
        chi_square = float(part @ np.linalg.pinv(basis.T @ errors @ basis, hermitian=True) @ part)
        return cls(basis @ part, chi_square, len(part), side, angle)

    @property
    def distance(self) -> float:
        """Length of the difference, metres."""
        return float(np.linalg.norm(self.vector))

    @property
    def contradicts(self) -> bool:
        """True if not both can be as accurate as their errors say: they are too far apart, or their axes too unlike."""
        level = _WAYS_LEVEL if self.side == "ways" else _SIDES_LEVEL
        by_chance = special.chdtrc(self.directions, self.chi_square)
        return bool(self.distance > CENTIMETRE and by_chance < level) or self.angle > _AXES

    @property
    def text(self) -> str:
        """Description of the contradiction, for a user."""
        far, beyond = f"{1000 * self.distance:.0f} mm", "beyond what the errors explain"
        if self.side == "ways":
            return f"bending and straightening put it {far} apart, {beyond}: skin moves with it"
        axis = f"turns its axis by {np.degrees(self.angle):.0f}° and " if self.angle > _AXES else ""
        source = {"parent": "in its parent's axes", "child": "in its child's axes", "both": "from both segments"}
        return f"its estimate {source[self.side]} {axis}puts it {far} away, {beyond}"


def side_differences(chosen: Estimate, others: Sequence[Estimate]) -> list[PlaceDifference]:
    """Differences of the other estimates from the chosen one; those that cannot be compared are left out.

    Left out are those whose status or number of frames gives no valid covariance, that share no frame with the chosen
    one, or that lie too far from it along an axis.
    """
    differences, one = [], chosen.poses
    for other in others:
        two, axis, angle = other.poses, chosen.axis, 0.0
        both = one.known & two.known
        if other.status not in COMPARABLE or other.fit.frames < FEWEST_FRAMES or not both.any():
            continue
        rotation = relative_rotation(one.rotation[:, :, both], two.rotation[:, :, both])
        place = other.center if one is two else one.to_local(two.to_world(other.center))[:, both].mean(axis=1)
        off, errors = place - chosen.center, chosen.covariance + mean_rotated_covariance(rotation, other.covariance)
        if other.axis is not None:
            turned = rotation.mean(axis=2) @ other.axis
            turned /= np.linalg.norm(turned)
            axis = turned if axis is None else axis
            angle = 0.0 if chosen.axis is None else float(np.arccos(min(abs(axis @ turned), 1.0)))
        if axis is not None:
            along = float(off @ axis)
            if abs(along) > _ALONG:
                continue
            errors = errors + (_AXIS_ERROR * along) ** 2 * np.eye(3)
        differences.append(PlaceDifference.of(off, errors, axis, other.side, angle))
    return differences


def check_against_sides(chosen: Estimate, others: Sequence[Estimate]) -> tuple[Estimate, str]:
    """Flag an estimate that another side's contradicts, and widen its covariance.

    No fit can tell which of two contradictory estimates is right. The chosen one stays where it is, and its covariance
    grows by the square of the difference, which is its error if the other is right. So all that is printed, drawn and
    built on it covers both.

    Returns:
        The estimate, and the reason to doubt it, or "". An estimate that is not usable anyway is returned unchanged.
    """
    against = [difference for difference in side_differences(chosen, others) if difference.contradicts]
    if chosen.status not in USABLE or not against:
        return chosen, ""
    worst = max(against, key=lambda difference: difference.distance)
    covariance = chosen.covariance + np.outer(worst.vector, worst.vector)
    return replace(chosen, covariance=covariance, status=JointStatus.DISAGREE), worst.text


def check_both_ways(chosen: Estimate, ways: Sequence[PlaceDifference]) -> tuple[Estimate, str]:
    """Flag an estimate of which bending and straightening contradict each other, and widen its covariance likewise.

    Args:
        chosen: estimate.
        ways: differences about each axis, in its axes. The covariance grows by the square of each that contradicts.

    Returns:
        The estimate, and the reason to doubt it, or "".
    """
    against = [way for way in ways if way.contradicts]
    if not against:
        return chosen, ""
    worst = max(against, key=lambda way: way.distance)
    squares = sum(np.outer(way.vector, way.vector) for way in against)
    status = JointStatus.REVERSES if chosen.status in USABLE else chosen.status
    covariance, skin = chosen.covariance + squares, chosen.skin + squares
    return replace(chosen, covariance=covariance, skin=skin, status=status), worst.text


def mean_difference(chosen: Estimate, x: Floats) -> Floats:
    """Mean difference of a point of the world (3, frames) from an estimate, in its axes (3,), metres.

    It is taken across the axis, if the estimate has one; NaN if no frame has both.
    """
    y = chosen.poses.to_local(x)
    y = y[:, ~np.isnan(y[0])]
    if not y.shape[1]:
        return np.full(3, np.nan)
    off: Floats = y.mean(axis=1) - chosen.center
    return off if chosen.axis is None else np.asarray(off - (off @ chosen.axis) * chosen.axis)

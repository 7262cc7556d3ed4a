"""Agreement of the estimates of one joint from its two segments, against their errors.

A joint whose segments both have poses is estimated up to three times. Soft tissue that moves alike in every frame
shows in no standard error, but it makes the estimates differ. A joint whose estimate another reliable one contradicts
is not known to its standard error.

Two estimates contradict each other if they are more than a centimetre apart, across a hinge's axis, and that is beyond
the 80 % quantile of χ² for the sum of their covariances; or if their axes differ by more than 20°, which over a limb's
thickness (3 cm) is a centimetre. The covariances are added as for independent errors. In truth the estimates share
their markers, and errors in common do not make them differ, so the rule is conservative. With noise of 1-5 mm alone it
flags one in a hundred of the joints with two sides. If soft tissue slides by 2-3 cm, it flags two in three of the
joints that this moves by more than 2 cm. A joint with one estimate cannot be checked.

Only estimates with a valid standard error can contradict: not those that noise hides or could explain. Two estimates of
a hinge that are more than 5 cm apart along the axis are not compared, because the error of the axis would decide their
distance across it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from study.mocap.geometry.moving_axes import mean_rotated_covariance, relative_rotation
from study.mocap.joints.estimates import CENTIMETRE, FEWEST_FRAMES, USABLE, Estimate, JointStatus, Side
from study.sphere.types import Floats

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
    """Difference between two places of one joint.

    Attributes:
        vector: from one to the other (3,), metres; across the axis of a hinge.
        chi_square: squared distance in units of the standard errors.
        directions: number of directions in which it is known.
    """

    vector: Floats
    chi_square: float
    directions: int

    @property
    def distance(self) -> float:
        """Length of the difference, metres."""
        return float(np.linalg.norm(self.vector))

    def is_beyond(self, level: float) -> bool:
        """True if it is more than a centimetre, and errors would make it as large with less than this probability."""
        return bool(self.distance > CENTIMETRE and special.chdtrc(self.directions, self.chi_square) < level)


@dataclass(frozen=True)
class SideDifference(PlaceDifference):
    """Difference of another side's estimate from the chosen one, in the chosen one's axes.

    Attributes:
        side: of the other estimate.
        angle: between their axes, radians; 0 if not both have one.
    """

    side: Side
    angle: float

    @property
    def contradicts(self) -> bool:
        """True if not both estimates can be as accurate as their errors say."""
        return self.is_beyond(_SIDES_LEVEL) or self.angle > _AXES

    @property
    def text(self) -> str:
        """Description of the contradiction, for a user."""
        place = f"puts it {1000 * self.distance:.0f} mm away"
        axis = f"turns its axis by {np.degrees(self.angle):.0f}°"
        both = f"{axis} and {place}" if self.angle > _AXES else place
        source = {"parent": "in its parent's axes", "child": "in its child's axes", "both": "from both segments"}
        return f"its estimate {source[self.side]} {both}, beyond what the errors explain"


def side_differences(chosen: Estimate, others: Sequence[Estimate]) -> list[SideDifference]:
    """Differences of the other estimates from the chosen one; those that cannot be compared are left out."""
    comparable = [e for e in others if e.status in COMPARABLE and e.frames >= FEWEST_FRAMES]
    found = [_difference(chosen, other) for other in comparable]
    return [each for each in found if each is not None]


def check_against_sides(chosen: Estimate, others: Sequence[Estimate]) -> tuple[Estimate, str]:
    """Flag an estimate that another side's contradicts, and widen its covariance.

    No fit can tell which of two contradictory estimates is right. The chosen one stays where it is, and its covariance
    grows by the square of the difference, which is its error if the other is right. So all that is printed, drawn and
    built on it covers both.

    Returns:
        The estimate, and the reason to doubt it, or "". An estimate that is not usable anyway is returned unchanged.
    """
    if chosen.status not in USABLE:
        return chosen, ""
    against = [each for each in side_differences(chosen, others) if each.contradicts]
    if not against:
        return chosen, ""
    worst = max(against, key=lambda each: each.distance)
    covariance = chosen.covariance + np.outer(worst.vector, worst.vector)
    return replace(chosen, covariance=covariance, status=JointStatus.DISAGREE), worst.text


@dataclass(frozen=True)
class WayDifference(PlaceDifference):
    """Difference between the centres from frames in which a joint rotates one way and the other about an axis."""

    @property
    def contradicts(self) -> bool:
        """True if not both centres can be as accurate as their errors say."""
        return self.is_beyond(_WAYS_LEVEL)

    @property
    def text(self) -> str:
        """Description of the contradiction, for a user."""
        return (
            f"bending and straightening put it {1000 * self.distance:.0f} mm apart, beyond what the errors explain: "
            "skin moves with it"
        )


def way_difference(first: tuple[Floats, Floats], second: tuple[Floats, Floats], axis: Floats | None) -> WayDifference:
    """Difference of two centres (3,), each with its covariance (3, 3), across an axis (3,) if there is one."""
    (one, covariance), (two, other) = first, second
    basis = np.eye(3) if axis is None else np.linalg.svd(axis[None])[2][1:].T
    across = basis.T @ (two - one)
    errors = basis.T @ (covariance + other) @ basis
    chi_square = float(across @ np.linalg.pinv(errors, hermitian=True) @ across)
    return WayDifference(basis @ across, chi_square, len(across))


def check_both_ways(chosen: Estimate, ways: Sequence[WayDifference]) -> tuple[Estimate, str]:
    """Flag an estimate of which bending and straightening contradict each other, and widen its covariance likewise.

    Args:
        chosen: estimate.
        ways: differences about each axis, in its axes. The covariance grows by the square of each that contradicts.

    Returns:
        The estimate, and the reason to doubt it, or "".
    """
    against = [each for each in ways if each.contradicts]
    if not against:
        return chosen, ""
    worst = max(against, key=lambda each: each.distance)
    squares = sum(np.outer(each.vector, each.vector) for each in against)
    status = JointStatus.REVERSES if chosen.status in USABLE else chosen.status
    return replace(
        chosen, covariance=chosen.covariance + squares, skin=chosen.skin + squares, status=status
    ), worst.text


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


def _difference(chosen: Estimate, other: Estimate) -> SideDifference | None:
    """Difference of two estimates; None if no frame has both, or they are too far apart along an axis."""
    one, two = chosen.poses, other.poses
    both = one.known & two.known
    if not both.any():
        return None
    rotation = relative_rotation(one.rotation[:, :, both], two.rotation[:, :, both])
    mean = rotation.mean(axis=2)
    off = other.center if one is two else one.to_local(two.to_world(other.center))[:, both].mean(axis=1)
    off = off - chosen.center
    basis, angle = np.eye(3), 0.0
    errors = chosen.covariance + mean_rotated_covariance(rotation, other.covariance)
    other_axis = None if other.axis is None else mean @ other.axis / np.linalg.norm(mean @ other.axis)
    if chosen.axis is not None and other_axis is not None:
        angle = float(np.arccos(min(abs(chosen.axis @ other_axis), 1.0)))
    axis = other_axis if chosen.axis is None else chosen.axis
    if axis is not None:
        along = float(off @ axis)
        if abs(along) > _ALONG:
            return None
        basis = np.linalg.svd(axis[None])[2][1:].T
        errors = errors + (_AXIS_ERROR * along) ** 2 * np.eye(3)
    across = basis.T @ off
    chi_square = float(across @ np.linalg.pinv(basis.T @ errors @ basis, hermitian=True) @ across)
    return SideDifference(basis @ across, chi_square, len(across), other.side, angle)

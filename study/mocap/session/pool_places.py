"""One place for a joint from several trials of a session, weighted by what each trial knows of it.

The trials whose estimate is reliable are weighted by the inverse of their covariances, so a trial that did not move the
joint counts for next to nothing. A hinge counts across its axis only. Trials that contradict each other are found as
segments that do are (`side_agreement`): the best one's place stays, and its covariance covers the other.

Source: the weighted mean of independent estimates (Gauss-Markov).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.mocap.joints.estimates import USABLE, JointStatus
from study.mocap.joints.side_agreement import SideDifference
from study.mocap.skeleton.calibration import JointPlace
from study.sphere.types import Floats


@dataclass(frozen=True, eq=False)
class TrialPlace:
    """A joint as one trial places it, in the axes that all trials have in common."""

    trial: str
    place: JointPlace

    @property
    def usable(self) -> bool:
        """True if its place is known and reliable."""
        return self.place.status in USABLE and not np.isnan(self.place.in_parent).any()

    @property
    def rank(self) -> tuple[bool, JointStatus, float]:
        """Order by quality, the best first."""
        place = self.place
        error = place.standard_error
        return bool(np.isnan(place.in_parent).any()), place.status, np.inf if np.isnan(error) else error


@dataclass(frozen=True, eq=False)
class PooledPlace:
    """A joint from several trials.

    Attributes:
        place: of the joint, with the names of the trials that it comes from.
        parts: each trial's place that was looked at, the best first.
    """

    place: JointPlace
    parts: tuple[TrialPlace, ...]


def pool_places(parts: Sequence[TrialPlace]) -> PooledPlace:
    """Pool the places of one joint.

    Args:
        parts: one for each trial, at least one.

    Returns:
        The weighted mean of the reliable ones; the best one if none is reliable.
    """
    ranked = tuple(sorted(parts, key=lambda part: part.rank))
    best, used = ranked[0], [part for part in ranked if part.usable]
    if len(used) < 2:
        return PooledPlace(replace(best.place, trials=(best.trial,)), ranked)
    contradictions = [(part, difference(best.place, part.place)) for part in used[1:]]
    against = [(part, each) for part, each in contradictions if each.contradicts]
    if against:
        part, worst = max(against, key=lambda pair: pair[1].distance)
        place = replace(
            best.place,
            status=JointStatus.DISAGREE,
            reason=_contradiction(best.trial, part.trial, worst),
            covariance=best.place.covariance + np.outer(worst.vector, worst.vector),
            trials=(best.trial,),
        )
        return PooledPlace(place, ranked)
    known = [_information(part.place, best.place.axis_in_parent) for part in used]
    turn = best.place.mean_rotation
    turned = [turn.T @ each @ turn for each in known]
    place = replace(
        best.place,
        in_parent=_mean([part.place.in_parent for part in used], known),
        in_child=_mean([part.place.in_child for part in used], turned),
        covariance=np.linalg.pinv(np.sum(known, axis=0), hermitian=True),
        trials=tuple(part.trial for part in used),
    )
    return PooledPlace(place, ranked)


def difference(one: JointPlace, other: JointPlace) -> SideDifference:
    """Difference of another trial's place from a joint's, across the axis of either, in the parent's axes."""
    axes = [place.axis_in_parent for place in (one, other) if not np.isnan(place.axis_in_parent).any()]
    basis = _basis(axes[0]) if axes else np.eye(3)
    off = basis.T @ (other.in_parent - one.in_parent)
    errors = basis.T @ (one.covariance + other.covariance) @ basis
    angle = float(np.arccos(np.minimum(np.abs(axes[0] @ axes[1]), 1.0))) if len(axes) == 2 else 0.0
    chi_square = float(off @ np.linalg.pinv(errors, hermitian=True) @ off)
    return SideDifference(basis @ off, chi_square, len(off), "parent", angle)


def _contradiction(best: str, other: str, found: SideDifference) -> str:
    turn = f", its axis turned by {np.degrees(found.angle):.0f}°" if found.angle > 0.0 else ""
    return (
        f"{other} puts it {1000 * found.distance:.0f} mm from where {best} does{turn}: beyond what the errors explain"
    )


def _basis(axis: Floats) -> Floats:
    """Two directions across an axis, as columns (3, 2)."""
    return np.asarray(np.linalg.svd(axis[None])[2][1:].T)


def _information(place: JointPlace, axis: Floats) -> Floats:
    """Inverse of a covariance (3, 3) across the best trial's axis or, if that has none, across the place's own."""
    along = place.axis_in_parent if np.isnan(axis).any() else axis
    basis = np.eye(3) if np.isnan(along).any() else _basis(along)
    return np.asarray(basis @ np.linalg.pinv(basis.T @ place.covariance @ basis, hermitian=True) @ basis.T)


def _mean(points: Sequence[Floats], known: Sequence[Floats]) -> Floats:
    """Mean of points (3,) weighted by information; in directions without any it is the first point that is known."""
    there = [(point, each) for point, each in zip(points, known, strict=True) if not np.isnan(point).any()]
    if not there:
        return np.full(3, np.nan)
    first = there[0][0]
    total = np.sum([each for _, each in there], axis=0)
    pull = np.sum([each @ (point - first) for point, each in there], axis=0)
    return np.asarray(first + np.linalg.pinv(total, hermitian=True) @ pull)

"""Whether the sides of a joint agree: how far apart their answers are, against what their errors explain.

A joint that both of its segments show is estimated up to three times. Skin that moves alike in every frame shows in no
standard error, but it draws the sides apart: an answer that another credible one contradicts is not known to its error.

Two answers contradict each other if they are more than a centimetre apart, across a hinge's axis, and that is beyond
the 80 % quantile of χ² for their covariances together; or if their axes are more than 20° apart, which a limb's
thickness (3 cm) along them makes a centimetre. The covariances are added as if the errors were independent. They are
not: the sides share their markers, and what they share does not part them. So the rule is a careful one. Where noise
alone is at work, of 1-5 mm, it is met by one in a hundred of the joints that have two sides; of those that skin sliding
by 2-3 cm draws off by more than 2 cm it finds two in three. A joint with one side alone cannot be checked at all.

Only answers with an honest error can contradict: not those that noise hides or could explain, and no hinge's whose
place is so far along its axis from the other's (5 cm) that the axis itself decides how far it is across.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from study.mocap.joints.estimates import BRIEF, UNSURE, USABLE, Estimate, JointStatus
from study.sphere.types import Floats

_HEARD = (*USABLE, JointStatus.UNSURE)
"""Answers whose covariance is what it says, be it wide."""
_FAR = UNSURE
"""Metres: the paper's centimetre."""
_QUANTILE = 0.8
_TURNED = np.radians(20.0)
"""Angle between two axes of one hinge, above which they are not of one hinge."""
_ALONG = 0.05
"""Metres along a hinge's axis beyond which two places on it are not compared."""
_TILT = np.radians(10.0)
"""Standard error of a hinge's axis: what it turns is as far away as the two places are along it."""


@dataclass(frozen=True)
class Difference:
    """Another side's answer beside the one that was taken.

    Attributes:
        side: whose it is, as `Estimate.side`.
        away: from what was taken to it, in the taken one's axes (3,), metres; across the axis, if either has one.
        squares: of ``away`` in standard errors, summed over directions.
        directions: in which both are known.
        turned: angle between their axes, radians; 0 if not both have one.
    """

    side: str
    away: Floats
    squares: float
    directions: int
    turned: float

    @property
    def distance(self) -> float:
        """Length of ``away``, metres."""
        return float(np.linalg.norm(self.away))

    @property
    def contradicts(self) -> bool:
        """Whether both answers cannot be as right as they say."""
        beyond = self.squares > stats.chi2.ppf(_QUANTILE, self.directions)
        return bool((self.distance > _FAR and beyond) or self.turned > _TURNED)

    @property
    def words(self) -> str:
        """What is wrong, for a user."""
        place = f"puts it {1000 * self.distance:.0f} mm away"
        axis = f"turns its axis by {np.degrees(self.turned):.0f}°"
        said = f"{axis} and {place}" if self.turned > _TURNED else place
        seen = {"parent": "seen from its parent", "child": "seen from its child", "both": "from both frames"}
        return f"its answer {seen[self.side]} {said}, beyond what their errors explain"


def differences(taken: Estimate, others: Sequence[Estimate]) -> list[Difference]:
    """How the answers of other sides differ from the one that was taken, those left out that cannot be compared."""
    heard = [other for other in others if other.status in _HEARD and other.count >= BRIEF]
    found = [_difference(taken, other) for other in heard]
    return [each for each in found if each is not None]


def weighed(taken: Estimate, others: Sequence[Estimate]) -> tuple[Estimate, str]:
    """An answer against those of other sides.

    Which of two that contradict each other is right, no fit can tell. The one that was taken stays where it is and its
    covariance is widened by what parts them, as it would be about the truth if the other were right: what is printed
    beside the joint, drawn about it, and handed on to what is built on it then holds both.

    Returns:
        The answer, and why to doubt it, or "". One that is not to be relied on anyway is returned as it is.
    """
    if taken.status not in USABLE:
        return taken, ""
    against = [each for each in differences(taken, others) if each.contradicts]
    if not against:
        return taken, ""
    worst = max(against, key=lambda each: each.distance)
    covariance = taken.covariance + np.outer(worst.away, worst.away)
    return replace(taken, covariance=covariance, status=JointStatus.DISAGREE), worst.words


def away(taken: Estimate, there: Floats) -> Floats:
    """From what was taken to a point of the world (3, frames), in its axes (3,), metres; across its axis, if any.

    On average over the frames that have both; NaN if none has.
    """
    y = taken.frames.see(there)
    y = y[:, ~np.isnan(y[0])]
    if not y.shape[1]:
        return np.full(3, np.nan)
    off: Floats = y.mean(axis=1) - taken.center
    return off if taken.axis is None else np.asarray(off - (off @ taken.axis) * taken.axis)


def _difference(taken: Estimate, other: Estimate) -> Difference | None:
    """None if no frame has both, or they are too far apart along an axis."""
    one, two = taken.frames, other.frames
    both = one.known & two.known
    if not both.any():
        return None
    turns = np.einsum("jit,jkt->ikt", one.rotation[:, :, both], two.rotation[:, :, both])
    mean = turns.mean(axis=2)
    covariance = np.einsum("ijt,jk,lkt->il", turns, other.covariance, turns, optimize=True) / both.sum()
    off = other.center if one is two else one.see(two.show(other.center))[:, both].mean(axis=1)
    off = off - taken.center
    basis, turned = np.eye(3), 0.0
    errors = taken.covariance + covariance
    theirs = None if other.axis is None else mean @ other.axis / np.linalg.norm(mean @ other.axis)
    if taken.axis is not None and theirs is not None:
        turned = float(np.arccos(min(abs(taken.axis @ theirs), 1.0)))
    axis = theirs if taken.axis is None else taken.axis
    if axis is not None:
        along = float(off @ axis)
        if abs(along) > _ALONG:
            return None
        basis = np.linalg.svd(axis[None])[2][1:].T
        errors = errors + (_TILT * along) ** 2 * np.eye(3)
    across = basis.T @ off
    squares = float(across @ np.linalg.pinv(basis.T @ errors @ basis, hermitian=True) @ across)
    return Difference(other.side, basis @ across, squares, len(across), turned)

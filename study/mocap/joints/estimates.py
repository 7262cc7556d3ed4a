"""Estimates of one joint, each with what it rests on: spheres seen from one side, or both frames at once.

A sphere fit takes the noise as its frame has it (`carried.py`) as far as the markers' motion bears that. Where the
frame's own noise would explain the motion along some direction, noise is taken as isotropic, which a skin that slips
slowly may be; where even that hides it, as none: GDKE's answer, which is drawn to the markers but never far away.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from study.estimators.status import Worded
from study.mocap.joints.center import LIMIT, Center, Marker, center
from study.mocap.joints.outlier_samples import near_sphere, sifted
from study.mocap.joints.segments import Frames
from study.mocap.joints.symmetric_fit import TwoSided
from study.sphere.types import Bools, Floats

UNSURE = 0.01
"""Metres: a centre whose standard error exceeds this in some direction is not known to the paper's centimetre."""
BRIEF = 10
"""Frames of which fewer say nothing about how they scatter, and so give no standard error."""
_EXTENT = 2.0
"""Standard errors by which the least extent must exceed the noise, as for `als`."""
_MOVED = 0.005
"""Standard deviation of a marker's place, over its distance from the frame's middle, below which it did not move."""


class JointStatus(Worded):
    """What to think of a joint."""

    OK = 0, "ok"
    HINGE = 1, "hinge: known across the axis; along it, where the joint is put shows in nothing or in skin alone"
    DISAGREE = 2, "its sides contradict each other by more than 1 cm or 20°, beyond what their errors explain"
    UNSURE = 3, "moved too little for its noise, or was seen too briefly: a standard error may exceed 1 cm"
    INSIGNIFICANT = 4, "along some direction the frame's own noise would explain how far the markers moved"
    NOT_POSITIVE_DEFINITE = 5, "the noise hides how far the markers moved: the centre is drawn to them"
    STILL = 6, "did not move: the markers stay where they are in the frame"
    NO_FRAME = 7, "neither of its segments has a frame"
    UNSEEN = 8, "its markers were not seen, or never together with a frame"


USABLE = (JointStatus.OK, JointStatus.HINGE)
"""A joint that a skeleton can be built on without a word."""


@dataclass(frozen=True)
class Estimate:
    """A joint's place in one of its segments.

    Attributes:
        side: "parent": the child's markers seen from the parent's frame; "child" the other way round; "both": the point
            in which the two frames agree, in the parent's axes.
        frames: the frame in whose axes it is; ``markers``: names of what was seen from it.
        center: (3,), metres.
        covariance: of it (3, 3), m², what is unknown of the joints that the frame hangs on included.
        axis: direction along which it is not known (3,), or None.
        noise: as what the noise was taken: "carried", "isotropic" or "none"; "frames" for both sides.
        count: frames that took part; ``worth``: as many independent ones as these are worth.
        used: samples that count (M, frames).
        sphere: the fit, or None for both sides; ``pair``: the other way round.
        status: what to think of it.
    """

    side: str
    frames: Frames
    markers: tuple[str, ...]
    center: Floats
    covariance: Floats
    axis: Floats | None
    noise: str
    count: int
    worth: float
    used: Bools
    sphere: Center | None
    pair: TwoSided | None
    status: JointStatus = JointStatus.OK

    @property
    def worst(self) -> float:
        """Largest standard error across the axis, metres."""
        across = np.eye(3) if self.axis is None else np.eye(3) - np.outer(self.axis, self.axis)
        return float(np.sqrt(max(np.linalg.eigvalsh(across @ self.covariance @ across)[-1], 0.0)))

    def judged(self) -> "Estimate":
        """The same with its status."""
        if self.noise == "none":
            status = JointStatus.NOT_POSITIVE_DEFINITE
        elif self.noise == "isotropic" or (self.sphere is not None and not self.sphere.round):
            status = JointStatus.INSIGNIFICANT
        elif not (self.worst < UNSURE and self.count >= BRIEF):
            status = JointStatus.UNSURE
        else:
            status = JointStatus.OK if self.axis is None else JointStatus.HINGE
        return replace(self, status=status)


def from_spheres(
    side: str, frames: Frames, names: Sequence[str], markers: Sequence[Marker], hinge: bool
) -> Estimate | None:
    """A joint from the spheres on which markers move in a frame; None if they do not.

    Args:
        side: "parent" or "child", the one that the frame belongs to.
        frames: the frame.
        names: of the markers.
        markers: as seen from it.
        hinge: whether the joint is known to be a hinge.
    """
    found = _guarded(markers, frames)
    if found is None:
        return None
    noise, fit, near = found
    return Estimate(
        side=side, frames=frames, markers=tuple(names), center=fit.center, covariance=fit.covariance,
        axis=fit.least if hinge and fit.axis is None else fit.axis, noise=noise, count=fit.frames, worth=fit.worth,
        used=np.stack([marker.used for marker in near]), sphere=fit, pair=None,
    )  # fmt: skip


def from_frames(parent: Frames, child: Frames, pair: TwoSided, hinge: bool) -> Estimate:
    """A joint from where its two frames agree."""
    return Estimate(
        side="both", frames=parent, markers=child.points, center=pair.in_parent, covariance=pair.covariance,
        axis=pair.axes[0] if hinge or pair.hinge else None, noise="frames", count=pair.frames, worth=pair.worth,
        used=child.good & parent.known, sphere=None, pair=pair,
    )  # fmt: skip


def marker_from(frames: Frames, x: Floats, sane: Bools) -> Marker:
    """A marker (3, frames) as seen from a frame, with the noise of that frame's own markers."""
    y = frames.see(x)
    return Marker(y, frames.known & sane & ~np.isnan(y[0]), frames.spread**2)


def _guarded(markers: Sequence[Marker], frames: Frames) -> tuple[str, Center, list[Marker]] | None:
    """A centre, with stray samples left out, and with the noise taken as far as the markers' motion bears it."""
    used, plain = sifted(markers), frames.carried.level
    if all(_still(marker, frames) for marker in used):
        return None
    for noise, carried, size in (("carried", frames.carried, None), ("isotropic", plain, None), ("none", plain, 0.0)):
        fit = center(used, carried, size=size)
        if fit is None:
            return None
        near = [near_sphere(marker, fit.center, fit.axis) for marker in used]
        if any(a.used.sum() < b.used.sum() for a, b in zip(near, used, strict=True)):
            fit = center(near, carried, size=size) or fit
        if noise == "none" or fit.axis is not None or (fit.condition < LIMIT and fit.flat > _EXTENT):
            return noise, fit, near
    return None


def _still(marker: Marker, frames: Frames) -> bool:
    """Whether a marker stayed where it was in a frame."""
    y = marker.y[:, marker.used]
    if y.shape[1] < 2:
        return True
    away = y.mean(axis=1) - frames.template.mean(axis=0)
    return bool(np.linalg.eigvalsh(np.cov(y))[-1] < _MOVED**2 * (away @ away))

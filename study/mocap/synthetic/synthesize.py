"""A recording of an articulated figure whose joints are known: what estimators and skeletons are tested against."""

from dataclasses import dataclass, fields

import numpy as np

from study.mocap.io.recording import Recording, RecordingError
from study.mocap.synthetic import artefacts
from study.mocap.synthetic.body_model import JOINTS, MARKERS, PARTS, neighbours, unit
from study.mocap.synthetic.random_motion import move
from study.sphere.types import Bools, Floats


@dataclass(frozen=True)
class Recipe:
    """What to make. Lengths in metres."""

    frames: int = 3000
    rate: float = 120.0
    """Frames per second."""
    seed: int = 1
    noise: float = 0.001
    """Standard deviation of each coordinate of a marker."""
    soft_tissue: float = 0.0
    """How far at most the skin slides under a marker."""
    gaps: float = 0.0
    """Share of each marker's samples that are missing, in runs."""
    swaps: float = 0.0
    """Share of the frames in which two neighbouring markers are exchanged."""
    height: float = 1.75
    """Of the body: another height is another subject."""
    reach: float = 1.0
    """Share of the natural range of motion that is used."""
    independent: bool = False
    """Whether every frame is a pose drawn anew; else the figure moves smoothly."""

    def __post_init__(self) -> None:
        limits = {"frames": (2, 10**7), "rate": (1, 1e5), "seed": (0, 2**63), "height": (0.1, 10)}
        limits |= {"noise": (0, 10), "soft_tissue": (0, 10), "gaps": (0, 1), "swaps": (0, 1), "reach": (0, 1)}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in limits and not limits[field.name][0] <= value <= limits[field.name][1]:
                low, high = limits[field.name]
                raise RecordingError(f"{field.name} = {value:g} of a synthetic figure must be from {low:g} to {high:g}")


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of a synthetic figure. Lengths in metres; a segment's origin is the joint on which it hangs."""

    segments: tuple[str, ...]
    rotations: Floats
    """(segments, frames, 3, 3), from a segment's frame to the world's."""
    origins: Floats
    """(segments, 3, frames)."""
    markers: tuple[str, ...]
    offsets: Floats
    """(markers, 3): each in the frame of its segment, without soft tissue."""
    joints: tuple[str, ...]
    parents: tuple[str, ...]
    """Segment in whose frame each joint is fixed."""
    children: tuple[str, ...]
    centers: Floats
    """(joints, 3, frames)."""
    in_parent: Floats
    """(joints, 3): each joint in its parent's frame; in its child's it is the origin."""
    axes: Floats
    """(joints, 3): of hinges, in the parent's frame and in the child's, length 1; NaN for balls."""
    bones: dict[tuple[str, str], float]
    """Distances between joints that are fixed in one segment, the one on which it hangs first."""
    swaps: tuple[artefacts.Swap, ...]
    missing: Bools
    """(markers, frames)."""


def synthesize(recipe: Recipe | None = None) -> tuple[Recording, Truth]:
    """Make a recording and what is true of it.

    Motion, noise, soft tissue, gaps and swaps are drawn from streams of their own: changing one leaves the others as
    they are, and the same recipe gives the same bytes.
    """
    r = recipe or Recipe()
    motion = move(r.frames, r.rate, r.seed, height=r.height, reach=r.reach, independent=r.independent)
    on = np.array([i for i, part in enumerate(PARTS) for _ in part.markers])
    offsets = r.height * np.array([place for part in PARTS for place in part.markers.values()])
    # the pelvis hangs on nothing; its skin follows the waist
    phases = motion.phases[np.where(on == 0, 1, on)]
    local = offsets[:, :, None] + artefacts.soft_tissue(phases, r.rate, r.soft_tissue, r.seed)
    positions = np.empty((len(MARKERS), 3, r.frames))
    for row, segment in enumerate(on):
        positions[row] = np.einsum("tij,jt->it", motion.rotations[segment], local[row]) + motion.origins[segment]
    positions += artefacts.noise(positions.shape, r.noise, r.seed)
    swaps = artefacts.swaps(neighbours(), r.frames, r.rate, r.swaps, r.seed)
    for swap in swaps:
        pair = [MARKERS.index(marker) for marker in swap.markers]
        positions[pair, :, swap.first : swap.end] = positions[pair[::-1], :, swap.first : swap.end]
    missing = artefacts.hidden(len(MARKERS), r.frames, r.rate, r.gaps, r.seed)
    positions[np.broadcast_to(missing[:, None], positions.shape)] = np.nan
    recording = Recording(f"synthetic-{r.seed}", MARKERS, positions, r.rate)
    hanging = [i for i, part in enumerate(PARTS) if part.joint]
    in_parent = r.height * np.array([PARTS[i].at for i in hanging])
    truth = Truth(
        segments=tuple(part.name for part in PARTS),
        rotations=motion.rotations,
        origins=motion.origins,
        markers=MARKERS,
        offsets=offsets,
        joints=JOINTS,
        parents=tuple(str(PARTS[i].parent) for i in hanging),
        children=tuple(PARTS[i].name for i in hanging),
        centers=motion.origins[hanging],
        in_parent=in_parent,
        axes=np.array(
            [np.full(3, np.nan) if axis is None else unit(axis) for axis in (PARTS[i].axis for i in hanging)]
        ),
        bones=_bones(in_parent),
        swaps=tuple(swaps),
        missing=missing,
    )
    return recording, truth


def _bones(in_parent: Floats) -> dict[tuple[str, str], float]:
    """From the joint on which a segment hangs to each joint that is fixed in it."""
    above = {part.name: part.joint for part in PARTS}
    lengths = np.linalg.norm(in_parent, axis=1)
    found = {}
    for part, length in zip((part for part in PARTS if part.joint), lengths, strict=True):
        start = above[str(part.parent)]
        if start is not None:
            found[start, str(part.joint)] = float(length)
    return found

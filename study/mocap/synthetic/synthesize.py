"""Make a recording of an articulated body whose joints are known; estimators and skeletons are tested on it."""

import numpy as np

from study.mocap.io.recording import Recording
from study.mocap.synthetic import artefacts
from study.mocap.synthetic.body_model import JOINTS, MARKERS, PARTS, nearest_pairs, unit
from study.mocap.synthetic.body_truth import BodyTruth
from study.mocap.synthetic.random_motion import Style, draw_motion
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.skin import skin_motion
from study.sphere.types import Floats


def synthesize(recipe: Recipe | None = None) -> tuple[Recording, BodyTruth]:
    """Make a recording and the truth about it.

    Motion, noise, soft-tissue artefact, gaps and swaps are drawn from streams of their own: a change of one leaves the
    others as they are, and the same recipe gives the same bytes.

    Args:
        recipe: the settings; their defaults if None.
    """
    r = recipe or Recipe()
    style: Style = "independent" if r.independent else "gait" if r.gait else "smooth"
    motion = draw_motion(r.frames, r.rate, r.seed, height=r.height, reach=r.reach, style=style)
    segment_of = np.array([i for i, part in enumerate(PARTS) for _ in part.markers])
    offsets = r.height * np.array([place for part in PARTS for place in part.markers.values()])
    local = offsets[:, :, None] + skin_motion(r, motion, segment_of)
    positions = np.empty((len(MARKERS), 3, r.frames))
    for row, segment in enumerate(segment_of):
        positions[row] = np.einsum("tij,jt->it", motion.rotations[segment], local[row]) + motion.origins[segment]
    positions += artefacts.marker_noise(positions.shape, r.noise, r.seed)
    swaps = artefacts.swaps(nearest_pairs(), r.frames, r.rate, r.swaps, r.seed)
    for swap in swaps:
        pair = [MARKERS.index(marker) for marker in swap.markers]
        positions[pair, :, swap.first : swap.end] = positions[pair[::-1], :, swap.first : swap.end]
    missing = artefacts.gaps(len(MARKERS), r.frames, r.rate, r.gaps, r.seed)
    positions[np.broadcast_to(missing[:, None], positions.shape)] = np.nan
    recording = Recording(f"synthetic-{r.seed}", MARKERS, positions, r.rate)
    children = [i for i, part in enumerate(PARTS) if part.joint]
    in_parent = r.height * np.array([PARTS[i].at for i in children])
    axes = [PARTS[i].axis for i in children]
    truth = BodyTruth(
        segments=tuple(part.name for part in PARTS),
        rotations=motion.rotations,
        origins=motion.origins,
        markers=MARKERS,
        offsets=offsets,
        joints=JOINTS,
        parents=tuple(str(PARTS[i].parent) for i in children),
        children=tuple(PARTS[i].name for i in children),
        centers=motion.origins[children],
        in_parent=in_parent,
        axes=np.array([np.full(3, np.nan) if axis is None else unit(axis) for axis in axes]),
        bones=_bones(in_parent),
        swaps=tuple(swaps),
        missing=missing,
    )
    return recording, truth


def _bones(in_parent: Floats) -> dict[tuple[str, str], float]:
    """Length from a segment's joint to its parent to each joint that is fixed in the segment."""
    joint_of = {part.name: part.joint for part in PARTS}
    lengths = np.linalg.norm(in_parent, axis=1)
    found = {}
    for part, length in zip((part for part in PARTS if part.joint), lengths, strict=True):
        start = joint_of[str(part.parent)]
        if start is not None:
            found[start, str(part.joint)] = float(length)
    return found

"""Expected poses of a segment in frames that do not show it, from the frames around them that do."""

import numpy as np
from scipy.spatial.transform import Rotation

from study.mocap.geometry.moving_axes import relative_rotation
from study.mocap.skeleton.full_pose import SegmentPath
from study.mocap.skeleton.partial_pose import ExpectedPoses
from study.sphere.types import Bools, Floats, Ints


def expected_poses(
    path: SegmentPath, parent: Floats | None, known: Bools, wanted: Ints, rest: Floats, reach: int
) -> tuple[ExpectedPoses, Bools]:
    """Interpolate a segment's rotation in its parent over gaps; before the first and after the last fit it stays.

    Args:
        path: poses of the segment.
        parent: the parent's rotation (3, 3, frames); None for a segment without a pivot.
        known: frames in which the segment is fitted and the parent is known (frames,).
        wanted: numbers of the frames (w,) to interpolate.
        rest: mean rotation in the parent (3, 3), for a segment that is never fitted.
        reach: frames that an expected pose is valid for.

    Returns:
        The expected poses, NaN where the parent is unknown; and the frames with a fit within reach (w,).
    """
    rotation, origin, count = path.rotation, path.origin, len(wanted)
    fitted = np.flatnonzero(known)
    if not len(fitted):
        nowhere, far = np.full((3, count), np.nan), np.zeros(count, bool)
        if parent is None:
            return ExpectedPoses(wanted, np.full((3, 3, count), np.nan), nowhere), far
        return ExpectedPoses(wanted, np.einsum("ijw,jk->ikw", parent[:, :, wanted], rest), nowhere), far
    place = np.searchsorted(fitted, wanted)
    before, after = fitted[np.maximum(place - 1, 0)], fitted[np.minimum(place, len(fitted) - 1)]
    share = np.clip((wanted - before) / np.maximum(after - before, 1), 0.0, 1.0)
    first, last = rotation[:, :, before], rotation[:, :, after]
    if parent is not None:
        first, last = relative_rotation(parent[:, :, before], first), relative_rotation(parent[:, :, after], last)
    step = Rotation.from_matrix(np.einsum("jiw,jkw->wik", first, last)).as_rotvec()
    between = np.einsum("ijw,wjk->ikw", first, Rotation.from_rotvec(share[:, None] * step).as_matrix())
    if parent is not None:
        between = np.einsum("ijw,jkw->ikw", parent[:, :, wanted], between)
    near = np.minimum(np.abs(wanted - before), np.abs(after - wanted)) <= reach
    middle = (1.0 - share) * origin[:, before] + share * origin[:, after]
    return ExpectedPoses(wanted, np.ascontiguousarray(between), middle), near

"""A summary of a skeleton, for other programs."""

import numpy as np

from study.mocap.geometry.convex_hull import hull_distances
from study.mocap.skeleton.scene import Flag, Scene
from study.mocap.skeleton.skeleton_table import bone_table


def skeleton_data(scene: Scene) -> dict[str, object]:
    """Describe a skeleton.

    Returns:
        ``recording``, ``rate``, ``frames``, ``source`` of the joints; ``joints``, each with ``joint``, ``doubt`` (a
        reason, or null), ``error`` (its largest standard error, metres), the shares of the frames in which it is
        ``seen``, ``bridged``, ``unknown`` and ``outside`` of the markers' hull, and ``distance`` outside it, metres;
        ``bones``, as in `bone_table`; ``notes``.
    """
    hulls = hull_distances(scene.places, scene.centers)
    joints = []
    for name, doubt, errors, flags, hull in zip(
        scene.joints, scene.doubts, scene.errors, scene.flags, hulls, strict=True
    ):
        known = errors[~np.isnan(errors)]
        row = {"joint": name, "doubt": doubt or None, "error": float(known.max()) if len(known) else None}
        row |= {flag.name.lower(): float((flags == flag).mean()) for flag in Flag}
        joints.append(row | {"outside": hull.share_outside, "distance": hull.distance})
    return {
        "recording": scene.name,
        "rate": scene.rate,
        "frames": scene.frames,
        "source": scene.source,
        "joints": joints,
        "bones": bone_table(scene).to_dict("records"),
        "notes": list(scene.notes),
    }

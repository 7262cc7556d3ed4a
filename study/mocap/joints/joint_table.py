"""The answer of phase 1 as a table: each joint's place, its accuracy, and the data behind it."""

import numpy as np
import pandas as pd

from study.mocap.joints.estimates import JointStatus
from study.mocap.joints.found_joints import FoundJoint, FoundJoints
from study.mocap.joints.side_agreement import side_differences

SHORT_TEXTS = {
    JointStatus.OK: "ok",
    JointStatus.HINGE: "hinge",
    JointStatus.DISAGREE: "sides disagree",
    JointStatus.REVERSES: "ways disagree",
    JointStatus.ONE_AXIS: "one axis",
    JointStatus.UNSURE: "unsure",
    JointStatus.INSIGNIFICANT: "insignificant",
    JointStatus.NOT_POSITIVE_DEFINITE: "hidden by noise",
    JointStatus.STILL: "still",
    JointStatus.NO_FRAME: "no frame",
    JointStatus.UNSEEN: "unseen",
}
"""A status in the table, which has no room for its whole text."""


def joint_table(joints: FoundJoints) -> pd.DataFrame:
    """Tabulate joints, a row per joint of the marker set.

    Returns:
        Columns: joint, kind, parent, child; status and reason in words; side, the segment whose axes the markers were
        in, or both; markers; center_parent_* and center_child_* (metres, in the segments' axes); error, the largest
        standard error across a dropped axis (metres), with that from skin and the differences of estimates that
        contradict each other; floor (metres), what skin common to a segment's markers adds unseen (see `Estimate`);
        cov_xx ... cov_zz (m², in the parent's axes); axis_parent_* and axis_child_* of a hinge; radius_mean (metres) of
        the markers' spheres; sigma (metres), noise of one coordinate; rho, share of the smallest extent that is noise;
        moved_least, moved_most (degrees), root mean square angles of motion about the joint; frames; worth, the
        effective number of independent frames; apart (metres), distance of the farthest other side's estimate that can
        be compared (see `side_differences`). NaN where there is none.
    """
    rows: list[dict[str, object]] = []
    for found in joints.joints:
        estimate = found.estimate
        row: dict[str, object] = {
            "joint": found.joint.name,
            "kind": found.joint.kind,
            "parent": found.joint.parent,
            "child": found.joint.child,
            "status": SHORT_TEXTS[found.status],
            "reason": found.reason,
            "side": estimate.side if estimate else "",
            "markers": ", ".join(estimate.markers) if estimate else "",
        }
        vectors = {"center_parent": found.in_parent, "center_child": found.in_child}
        vectors |= {"axis_parent": found.axis_in_parent, "axis_child": found.axis_in_child}
        for name, vector in vectors.items():
            row |= {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}
        pairs = [(i, j) for i in range(3) for j in range(i, 3)]
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}": float(found.covariance[i, j]) for i, j in pairs}
        rows.append(row | accuracy_columns(found))
    return pd.DataFrame(rows)


def accuracy_columns(found: FoundJoint) -> dict[str, float]:
    """Accuracy of a joint and the data behind it, under the column names of `joint_table`; NaN where there is none."""
    names = ("error", "floor", "radius_mean", "sigma", "rho", "moved_least", "moved_most", "frames", "worth", "apart")
    values = dict.fromkeys(names, float("nan"))
    estimate = found.estimate
    if estimate is None:
        return values
    values |= {"error": found.standard_error, "floor": estimate.floor, "frames": float(estimate.frames)}
    values["worth"] = float(estimate.effective_frames)
    apart = (each.distance for each in side_differences(estimate, found.others))
    values["apart"] = max(apart, default=float("nan"))
    angles = np.zeros(0)
    if estimate.sphere is not None:
        radii = estimate.sphere.radii[np.isfinite(estimate.sphere.radii)]
        values |= {"sigma": float(estimate.sphere.noise), "rho": float(estimate.sphere.condition)}
        values |= {"radius_mean": float(radii.mean())} if len(radii) else {}
        angles = np.degrees(estimate.sphere.rms_angles)
    elif estimate.pair is not None:
        values["sigma"] = float(estimate.pair.gap) / np.sqrt(3.0)
        angles = np.degrees(estimate.pair.rms_angles)
    return values | ({"moved_least": float(angles.min()), "moved_most": float(angles.max())} if len(angles) else {})

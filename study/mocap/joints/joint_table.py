"""Phase 1's answer as a table: where each joint is, how well that is known, and from what."""

import numpy as np
import pandas as pd

from study.mocap.joints.estimates import JointStatus
from study.mocap.joints.fit_joints import FoundJoint, Joints
from study.mocap.joints.side_agreement import differences

WORDS = {
    JointStatus.OK: "ok",
    JointStatus.HINGE: "hinge",
    JointStatus.DISAGREE: "sides disagree",
    JointStatus.UNSURE: "unsure",
    JointStatus.INSIGNIFICANT: "insignificant",
    JointStatus.NOT_POSITIVE_DEFINITE: "hidden by noise",
    JointStatus.STILL: "still",
    JointStatus.NO_FRAME: "no frame",
    JointStatus.UNSEEN: "unseen",
}
"""A status in the table, where its whole text has no room."""


def joint_table(joints: Joints) -> pd.DataFrame:
    """A row per joint of the marker set.

    Returns:
        Columns: joint, kind, parent, child, status and reason in words; side, the segment from which the markers were
        seen, or both; markers; center_parent_* and center_child_* (metres, in the segments' axes); error, the largest
        standard error across a dropped axis (metres), what parts the sides included if they disagree; cov_xx ...
        cov_zz (m², in the parent's axes); axis_parent_* and axis_child_* of a hinge; radius_mean (metres) of the
        markers' spheres; sigma (metres), noise of one coordinate; rho, share of the least extent that is noise;
        moved_least, moved_most (degrees), root mean square angles about the joint; frames; worth, as many independent
        ones as these are worth; apart (metres), the farthest of the other sides' answers that can be compared with it
        (see `disagreement`). NaN where there is none.
    """
    rows: list[dict[str, object]] = []
    for found in joints.joints:
        row: dict[str, object] = {
            "joint": found.joint.name, "kind": found.joint.kind, "parent": found.joint.parent,
            "child": found.joint.child, "status": WORDS[found.status], "reason": found.reason,
            "side": found.estimate.side if found.estimate else "",
            "markers": ", ".join(found.estimate.markers) if found.estimate else "",
        }  # fmt: skip
        vectors = {"center_parent": found.in_parent, "center_child": found.in_child}
        vectors |= {"axis_parent": found.axis_in_parent, "axis_child": found.axis_in_child}
        for name, vector in vectors.items():
            row |= {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}
        pairs = [(i, j) for i in range(3) for j in range(i, 3)]
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}": float(found.covariance[i, j]) for i, j in pairs}
        rows.append(row | numbers(found))
    return pd.DataFrame(rows)


def numbers(found: FoundJoint) -> dict[str, float]:
    """What a joint's estimate rests on, by the names of the columns of `joint_table`; NaN where there is nothing."""
    names = ("error", "radius_mean", "sigma", "rho", "moved_least", "moved_most", "frames", "worth", "apart")
    known = dict.fromkeys(names, float("nan"))
    estimate = found.estimate
    if estimate is None:
        return known
    known |= {"error": estimate.worst, "frames": float(estimate.count), "worth": float(estimate.worth)}
    apart = (each.distance for each in differences(estimate, found.others))
    known["apart"] = max(apart, default=float("nan"))
    swing = np.zeros(0)
    if estimate.sphere is not None:
        radii = estimate.sphere.radii[np.isfinite(estimate.sphere.radii)]
        known |= {"sigma": float(estimate.sphere.noise), "rho": float(estimate.sphere.condition)}
        known |= {"radius_mean": float(radii.mean())} if len(radii) else {}
        swing = np.degrees(estimate.sphere.swing)
    elif estimate.pair is not None:
        known["sigma"] = float(estimate.pair.gap) / np.sqrt(3.0)
        swing = np.degrees(estimate.pair.turns)
    return known | ({"moved_least": float(swing.min()), "moved_most": float(swing.max())} if len(swing) else {})

"""How far the answer for a joint depends on the method: what each estimator says beside what was taken.

The paper's estimators fit the same samples with isotropic noise: `mgdk` all markers, weighted, its noise found as `als`
does; `gdke`, `ugdk` (told mgdk's noise) and `mle` the marker that moved most. The symmetric fit of both frames is the
fifth. Distances are across a hinge's axis, if there is one: along it no method knows.
"""

from typing import Any

import numpy as np
import pandas as pd

from study.estimators import fit, mgdk
from study.mocap.geometry.range_of_motion import cap_angle, turn_angle
from study.mocap.io.recording import Recording
from study.mocap.joints.fit_joints import FoundJoint, Joints
from study.mocap.joints.side_agreement import away
from study.sphere.types import Floats

ANSWERS = ("mgdk", "gdke", "ugdk", "mle", "two_sided")


def agreement_table(joints: Joints, recording: Recording) -> pd.DataFrame:
    """A row per joint, in the marker set's order.

    Args:
        joints: phase 1's answer.
        recording: that they were found in.

    Returns:
        Columns ``joint``; ``radii``: of each marker's sphere (metres), a list; ``cap`` (degrees): half-angle that holds
        95 % of the samples of the marker that moved most; ``turn`` (degrees): the same of the child's turns; ``gap``
        (metres): root mean square distance between the joint's images in both segments; ``from_mgdk, from_gdke,
        from_ugdk, from_mle, from_two_sided`` (metres): how far their answers are from what was taken. NaN where there
        is none.
    """
    return pd.DataFrame([_row(found, joints, recording) for found in joints.joints])


def _row(found: FoundJoint, joints: Joints, recording: Recording) -> dict[str, Any]:
    row: dict[str, Any] = {"joint": found.joint.name, "radii": [], "cap": np.nan, "turn": np.nan, "gap": np.nan}
    parent, child = joints.frames.get(found.joint.parent), joints.frames.get(found.joint.child)
    if parent is not None and child is not None:
        row["turn"] = float(np.degrees(turn_angle(np.einsum("jit,jkt->ikt", parent.rotation, child.rotation))))
        apart = ((parent.show(found.in_parent) - child.show(found.in_child)) ** 2).sum(axis=0)
        if not np.isnan(apart).all():
            row["gap"] = float(np.sqrt(np.nanmean(apart)))
    row |= {f"from_{name}": np.nan for name in ANSWERS}
    if found.estimate is None:
        return row
    every = (found.estimate, *found.others)
    pair = next((each for each in every if each.side == "both"), None)
    if pair is not None:
        row["from_two_sided"] = float(np.linalg.norm(away(found.estimate, pair.frames.show(pair.center))))
    sphere = next((each for each in every if each.sphere is not None), None)
    if sphere is not None and sphere.sphere is not None:
        row["radii"] = sphere.sphere.radii.tolist()
        seen = [sphere.frames.see(recording.of(name)) for name in sphere.markers]
        caps = [cap_angle(y, used, sphere.center) for y, used in zip(seen, sphere.used, strict=True) if used.any()]
        row["cap"] = float(np.degrees(max(caps, default=np.nan)))
        points = [y[:, used].T for y, used in zip(seen, sphere.used, strict=True) if used.sum() >= 5]
        for name, center in _centers(points).items():
            row[f"from_{name}"] = float(np.linalg.norm(away(found.estimate, sphere.frames.show(center))))
    return row


def _centers(points: list[Floats]) -> dict[str, Floats]:
    """What the library's estimators say of markers' samples (n, 3) in one frame."""
    if not points:
        return {}
    together = mgdk(points)
    most = max(points, key=lambda y: float(np.trace(np.cov(y.T))))
    centers = {"mgdk": together.center, "gdke": fit(most, "gdke").center, "mle": fit(most, "mle").center}
    if together.noise_variance > 0.0:
        centers["ugdk"] = fit(most, "ugdk", noise=float(np.sqrt(together.noise_variance))).center
    return centers

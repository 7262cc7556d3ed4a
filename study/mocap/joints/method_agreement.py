"""Agreement of methods: the distances of other estimators' centres from the chosen one, joint by joint.

The paper's estimators fit the same samples with isotropic noise: `mgdk` fits all markers, weighted, and finds the noise
as `als` does; `gdke`, `ugdk` (with mgdk's noise) and `mle` fit the marker that moved most. The symmetric fit of both
segments is the fifth. Distances are across a hinge's axis, for no method knows the place along it.
"""

import numpy as np
import pandas as pd

from study.estimators import fit, mgdk
from study.mocap.geometry.moving_axes import relative_rotation
from study.mocap.geometry.range_of_motion import cap_angle, rotation_range
from study.mocap.io.recording import Recording
from study.mocap.joints.found_joints import FoundJoint, FoundJoints
from study.mocap.joints.side_agreement import mean_difference
from study.sphere.types import Floats

METHODS = ("mgdk", "gdke", "ugdk", "mle", "two_sided")
_FEWEST_SAMPLES = 5
"""Fewest samples of a marker that other estimators fit."""


def agreement_table(joints: FoundJoints, recording: Recording) -> pd.DataFrame:
    """Tabulate the agreement of methods, a row per joint in the marker set's order.

    Args:
        joints: answer of phase 1.
        recording: that they were found in.

    Returns:
        Columns ``joint``; ``radii``: of each marker's sphere (metres), a list; ``cap`` (degrees): half-angle of the cap
        with 95 % of the samples, of the marker that moved most; ``turn`` (degrees): angle within which 95 % of the
        child's rotations in the parent lie; ``gap`` (metres): root mean square distance between the joint's images in
        both segments; ``from_mgdk, from_gdke, from_ugdk, from_mle, from_two_sided`` (metres): distances of their
        centres from the chosen one. NaN where there is none.
    """
    return pd.DataFrame([_row(found, joints, recording) for found in joints.joints])


def _row(found: FoundJoint, joints: FoundJoints, recording: Recording) -> dict[str, object]:
    row: dict[str, object] = {"joint": found.joint.name, "radii": [], "cap": np.nan, "turn": np.nan, "gap": np.nan}
    parent, child = joints.poses.get(found.joint.parent), joints.poses.get(found.joint.child)
    if parent is not None and child is not None:
        row["turn"] = float(np.degrees(rotation_range(relative_rotation(parent.rotation, child.rotation))))
        apart = ((parent.to_world(found.in_parent) - child.to_world(found.in_child)) ** 2).sum(axis=0)
        if not np.isnan(apart).all():
            row["gap"] = float(np.sqrt(np.nanmean(apart)))
    row |= {f"from_{name}": np.nan for name in METHODS}
    if found.estimate is None:
        return row
    every = (found.estimate, *found.others)
    pair = next((each for each in every if each.side == "both"), None)
    if pair is not None:
        row["from_two_sided"] = _distance(mean_difference(found.estimate, pair.poses.to_world(pair.center)))
    one = next((each for each in every if each.sphere is not None), None)
    if one is not None and one.sphere is not None:
        row["radii"] = one.sphere.radii.tolist()
        local = [one.poses.to_local(recording.of(name)) for name in one.markers]
        caps = [cap_angle(y, used, one.center) for y, used in zip(local, one.used, strict=True) if used.any()]
        row["cap"] = float(np.degrees(max(caps, default=np.nan)))
        points = [y[:, used].T for y, used in zip(local, one.used, strict=True) if used.sum() >= _FEWEST_SAMPLES]
        for name, center in _centers(points).items():
            row[f"from_{name}"] = _distance(mean_difference(found.estimate, one.poses.to_world(center)))
    return row


def _distance(vector: Floats) -> float:
    return float(np.linalg.norm(vector))


def _centers(points: list[Floats]) -> dict[str, Floats]:
    """Centres (3,) that the library's estimators fit to markers' samples (n, 3) in one segment's axes."""
    if not points:
        return {}
    together = mgdk(points)
    most = max(points, key=lambda y: float(np.trace(np.cov(y.T))))
    centers = {"mgdk": together.center, "gdke": fit(most, "gdke").center, "mle": fit(most, "mle").center}
    if together.noise_variance > 0.0:
        centers["ugdk"] = fit(most, "ugdk", noise=float(np.sqrt(together.noise_variance))).center
    return centers

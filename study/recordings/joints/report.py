"""The answer of phase 1 as a table and as lines: each joint's place, its accuracy, and the reasons to doubt it.

A second table has the agreement of methods: the distances of other estimators' centres from the chosen one. The paper's
estimators fit the same samples with isotropic noise: `mgdk` fits all markers, weighted, and finds the noise as `als`
does; `gdke`, `ugdk` (with mgdk's noise) and `mle` fit the marker that moved most. The symmetric fit of both segments is
the fifth. Distances are across a hinge's axis, for no method knows the place along it.
"""

from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np
import pandas as pd

from study.arrays import Floats
from study.fits import fit
from study.fits.answers.markers import Incremental, mgdk_so_far
from study.recordings.joints.estimate import SHORT_TEXTS, SymmetricFit, mean_difference, side_differences
from study.recordings.joints.find import Calibration, JointPlace
from study.recordings.recording import Recording
from study.recordings.rigid import cap_angle, relative_rotation, rms_rotation, rotation_range
from study.text import columns, number


def joint_table(joints: Calibration) -> pd.DataFrame:
    """Tabulate joints, a row per joint of the marker set.

    Returns:
        Columns: joint, kind, parent, child; status and reason in words; side, the segment whose axes the markers were
        in, or both; markers; center_parent_* and center_child_* (metres, in the segments' axes); error, the largest
        standard error across a dropped axis (metres), with that from skin and the differences of estimates that
        contradict each other; floor (metres), what skin common to a segment's markers adds unseen (see `Estimate`);
        cov_xx ... cov_zz (m², in the parent's axes); axis_parent_* and axis_child_* of a hinge; radius_mean (metres) of
        the markers' spheres; sigma (metres), noise of one coordinate; rho, share of the smallest extent that is noise;
        moved_least, moved_most (degrees), least and greatest root mean square angle of motion about the joint, for a
        hinge that of the relative rotation of both segments; frames; effective_frames, the independent of these;
        apart (metres), distance of the farthest other side's estimate that can be compared (see `side_differences`).
        NaN where there is none.
    """
    rows: list[dict[str, object]] = []
    for place in joints.joints:
        joint, estimate = place.joint, place.estimate
        row: dict[str, object] = {"joint": joint.name, "kind": joint.kind, "parent": joint.parent, "child": joint.child}
        row |= {"status": SHORT_TEXTS[place.status], "reason": place.reason, "side": estimate.side if estimate else ""}
        row |= {"markers": ", ".join(estimate.markers) if estimate else ""}
        in_child = place.in_child if joints.shape(joint.child).has_pose else np.full(3, np.nan)
        vectors = {"center_parent": place.in_parent, "center_child": in_child}
        vectors |= {"axis_parent": place.axis_in_parent, "axis_child": place.axis_in_child}
        for name, vector in vectors.items():
            row |= {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}
        pairs = combinations_with_replacement(range(3), 2)
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}": float(place.covariance[i, j]) for i, j in pairs}
        rows.append(row | accuracy_columns(joints, place))
    return pd.DataFrame(rows)


def accuracy_columns(joints: Calibration, place: JointPlace) -> dict[str, float]:
    """Accuracy of a joint and the data behind it, under the column names of `joint_table`; NaN where there is none."""
    names = ["error", "floor", "radius_mean", "sigma", "rho", "moved_least", "moved_most"]
    names += ["frames", "effective_frames", "apart"]
    values, estimate = dict.fromkeys(names, float("nan")), place.estimate
    if estimate is None:
        return values
    apart = max((side.distance for side in side_differences(estimate, place.estimates[1:])), default=np.nan)
    parent, child = joints.poses.get(place.joint.parent), joints.poses.get(place.joint.child)
    fit, angles = estimate.fit, np.degrees(estimate.fit.rms_angles)
    if place.joint.kind == "hinge" and estimate.sphere is not None and parent is not None and child is not None:
        angles = np.degrees(rms_rotation(relative_rotation(parent.rotation, child.rotation)))
    values |= {"error": place.standard_error, "floor": estimate.floor, "frames": float(fit.frames), "apart": apart}
    values |= {"effective_frames": float(fit.effective_frames)}
    values |= {"moved_least": float(angles.min()), "moved_most": float(angles.max())}
    if isinstance(fit, SymmetricFit):
        return values | {"sigma": float(fit.gap) / np.sqrt(3.0)}
    radii = fit.radii[np.isfinite(fit.radii)]
    values |= {"radius_mean": float(radii.mean())} if len(radii) else {}
    return values | {"sigma": float(fit.noise), "rho": float(fit.condition)}


_FAR = 10.0
"""Error, metres, from which its digits say nothing: the joint moved about one axis, and may lie anywhere along it."""


def agreement_lines(table: pd.DataFrame) -> Iterator[str]:
    """Lay out the agreement of methods, a line per joint, in millimetres.

    Args:
        table: a row per joint; its columns ``from_…`` are distances, metres (see `agreement_table`).
    """
    others = [name for name in table.columns if str(name).startswith("from_")]
    titles = ["distance to / mm", *(str(name).removeprefix("from_").replace("_", "-") for name in others)]
    distances = zip(table["joint"], table[others].to_numpy(dtype=float), strict=True)
    yield from columns([[name, *map(millimetres, row)] for name, row in distances], titles, "<>")


def joint_lines(joints: Calibration) -> Iterator[str]:
    """Lay out the joints, a line each in millimetres and degrees, then the reasons to doubt some of them."""
    titles = ["joint", "status", "from", *(f"{axis} / mm" for axis in "xyz"), "error", "floor", "noise", "range"]
    rows = []
    for place in joints.joints:
        n = accuracy_columns(joints, place)
        moved = "-" if np.isnan(n["moved_least"]) else f"{n['moved_least']:.0f}°-{n['moved_most']:.0f}°"
        row = [place.joint.name, SHORT_TEXTS[place.status], place.estimate.side if place.estimate else "-"]
        row += [millimetres(float(x)) for x in place.in_parent]
        row += [f"> {1000 * _FAR:.0f}" if n["error"] > _FAR else millimetres(n["error"])]
        row += [millimetres(n["floor"]), millimetres(n["sigma"]), moved, number(n["rho"], ".3f")]
        rows.append([*row, number(n["frames"], ".0f"), number(n["effective_frames"], ".0f"), millimetres(n["apart"])])
    yield from columns(rows, [*titles, "ρ", "frames", "n_eff", "apart"], "<<<>")
    yield "x, y, z: centre in its parent; error: largest standard error; noise: of a coordinate; all in mm"
    yield "floor: error from skin that moves all markers of a segment alike, by 5 mm/rad, which no marker shows, mm"
    yield "apart: distance to the farthest other side with an error, mm; n_eff: effective number of independent frames"
    yield "range: of motion, least and greatest root mean square angle; ρ: share of the smallest extent that is noise"
    for place in joints.joints:
        if place.joint.across and not np.isnan(place.axis_in_parent).any():
            yield f"{place.joint.name}: along its axis midway between {' and '.join(place.joint.across)}"
        if place.estimate is not None and np.isnan(place.in_parent).any():
            two = f"{place.joint.parent} and {place.joint.child}"
            yield f"{place.joint.name}: no place in its parent: no frame has poses of both {two}"
    yield from joints.reasons()
    poseless = joints.without_pose.items()  # why a joint without any marker cannot be found is said above
    yield from (f"no pose of its own: {why}" for name, why in poseless if joints.markerset.segment(name).markers)


def millimetres(metres: float) -> str:
    """A length in millimetres, as it is printed."""
    return number(1000 * metres, ".1f")


METHODS = ("mgdk", "gdke", "ugdk", "mle", "two_sided")
_FEWEST_SAMPLES = 5
"""Fewest samples of a marker that other estimators fit."""


def agreement_table(joints: Calibration, recording: Recording) -> pd.DataFrame:
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
    rows = []
    for place in joints.joints:
        row: dict[str, object] = {"joint": place.joint.name, "radii": [], "cap": np.nan, "turn": np.nan, "gap": np.nan}
        row |= {f"from_{name}": np.nan for name in METHODS}
        rows.append(row)
        parent, child = joints.poses.get(place.joint.parent), joints.poses.get(place.joint.child)
        if parent is not None and child is not None:
            row["turn"] = float(np.degrees(rotation_range(relative_rotation(parent.rotation, child.rotation))))
            apart = ((parent.to_world(place.in_parent) - child.to_world(place.in_child)) ** 2).sum(axis=0)
            row["gap"] = float(np.sqrt(np.nanmean(apart))) if not np.isnan(apart).all() else np.nan
        worlds = {}  # the centres of other methods
        for other in place.estimates:
            if other.pair is not None:
                worlds["two_sided"] = other.poses.to_world(other.center)
            elif other.sphere is not None and not row["radii"]:
                row["radii"] = other.sphere.radii.tolist()
                local = [other.poses.to_local(recording.of(name)) for name in other.markers]
                samples = list(zip(local, other.used, strict=True))
                caps = [cap_angle(y, used, other.center) for y, used in samples if used.any()]
                row["cap"] = float(np.degrees(max(caps, default=np.nan)))
                points = [y[:, used].T for y, used in samples if used.sum() >= _FEWEST_SAMPLES]
                worlds |= {name: other.poses.to_world(center) for name, center in _centers(points).items()}
        for name, world in worlds.items():
            row[f"from_{name}"] = float(np.linalg.norm(mean_difference(place.estimates[0], world)))
    return pd.DataFrame(rows)


def _centers(points: list[Floats]) -> dict[str, Floats]:
    """Centres (3,) that the library's estimators fit to markers' samples (n, 3) in one segment's axes."""
    if not points:
        return {}
    markers = [Incremental(3) for _ in points]
    for marker, y in zip(markers, points, strict=True):
        marker.update(y)
    together = mgdk_so_far(markers)  # from moments, without the test whether the markers agree
    most = max(points, key=lambda y: float(np.trace(np.cov(y.T))))
    centers = {"mgdk": together.center, "gdke": fit(most, "gdke").center, "mle": fit(most, "mle").center}
    if together.noise_variance > 0.0:
        centers["ugdk"] = fit(most, "ugdk", noise=float(np.sqrt(together.noise_variance))).center
    return centers

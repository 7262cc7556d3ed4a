"""Phase 1's answer as a table and as lines for people: where each joint is, how well that is known, and from what."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.mocap.estimates import USABLE, Estimate, JointStatus
from study.mocap.joints import FoundJoint, Joints

_WORDS = {
    JointStatus.OK: "ok",
    JointStatus.HINGE: "hinge",
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
        standard error across a dropped axis (metres); cov_xx ... cov_zz (m², in the parent's axes); axis_parent_* and
        axis_child_* of a hinge; radius_mean (metres) of the markers' spheres; sigma (metres), noise of one coordinate;
        rho, share of the least extent that is noise; moved_least, moved_most (degrees), root mean square angles about
        the joint; frames; worth, as many independent ones as these are worth; apart (metres), the farthest of the other
        sides' answers. NaN where there is none.
    """
    rows: list[dict[str, object]] = []
    for found in joints.joints:
        row: dict[str, object] = {
            "joint": found.joint.name, "kind": found.joint.kind, "parent": found.joint.parent,
            "child": found.joint.child, "status": _WORDS[found.status], "reason": found.reason,
            "side": found.estimate.side if found.estimate else "",
            "markers": ", ".join(found.estimate.markers) if found.estimate else "",
        }  # fmt: skip
        vectors = {"center_parent": found.in_parent, "center_child": found.in_child}
        vectors |= {"axis_parent": found.axis_in_parent, "axis_child": found.axis_in_child}
        for name, vector in vectors.items():
            row |= {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}
        pairs = [(i, j) for i in range(3) for j in range(i, 3)]
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}": float(found.covariance[i, j]) for i, j in pairs}
        rows.append(row | _numbers(found))
    return pd.DataFrame(rows)


def _numbers(found: FoundJoint) -> dict[str, float]:
    """What a joint's estimate rests on."""
    names = ("error", "radius_mean", "sigma", "rho", "moved_least", "moved_most", "frames", "worth", "apart")
    numbers = dict.fromkeys(names, np.nan)
    estimate = found.estimate
    if estimate is None:
        return numbers
    numbers |= {"error": estimate.worst, "frames": float(estimate.count), "worth": float(estimate.worth)}
    numbers["apart"] = max((_apart(estimate, other) for other in found.others), default=np.nan)
    if estimate.sphere is not None:
        sphere = estimate.sphere
        radii = sphere.radii[np.isfinite(sphere.radii)]
        numbers |= {"sigma": float(sphere.noise), "rho": float(sphere.condition)}
        numbers["radius_mean"] = float(radii.mean()) if len(radii) else np.nan
        swing = np.degrees(sphere.swing)
    elif estimate.pair is not None:
        swing = np.degrees(np.sort(estimate.pair.turns))
        numbers["sigma"] = float(estimate.pair.gap) / np.sqrt(3.0)
    else:
        return numbers
    return numbers | {"moved_least": float(swing[0]), "moved_most": float(swing[-1])}


def _apart(one: Estimate, other: Estimate) -> float:
    """Root mean square distance of two estimates of a joint over the frames that both have, metres."""
    between = one.frames.show(one.center) - other.frames.show(other.center)
    if one.axis is not None:  # along it neither knows where the joint is
        axis = np.einsum("ijt,j->it", one.frames.rotation, one.axis)
        between = between - axis * (axis * between).sum(axis=0)
    squares = (between**2).sum(axis=0)
    squares = squares[~np.isnan(squares)]
    return float(np.sqrt(squares.mean())) if len(squares) else float("nan")


def printed(joints: Joints) -> Iterator[str]:
    """The table, a line per joint in millimetres and degrees, and then what is to be said of some of them."""
    table = joint_table(joints)
    wide = max(len(name) for name in [*table["joint"], "joint"])
    yield (
        f"{'joint':{wide}}  {'status':15}  {'from':6}  {'centre in its parent / mm':>25}  {'error':>6}  {'noise':>6}  "
        f"{'moved':>9}  {'ρ':>5}  {'frames':>6}  {'worth':>6}  {'apart':>6}"
    )
    for row in table.itertuples():
        place = " ".join(_mm(getattr(row, f"center_parent_{axis}"), 8) for axis in "xyz")
        moved = "-" if np.isnan(row.moved_least) else f"{row.moved_least:.0f}°-{row.moved_most:.0f}°"
        frames, worth = ("-" if np.isnan(n) else f"{n:.0f}" for n in (row.frames, row.worth))
        rho = "-" if np.isnan(row.rho) else f"{row.rho:.3f}"
        yield (
            f"{row.joint:{wide}}  {row.status:15}  {row.side or '-':6}  {place}  {_mm(row.error, 6)}  "
            f"{_mm(row.sigma, 6)}  {moved:>9}  {rho:>5}  {frames:>6}  {worth:>6}  {_mm(row.apart, 6)}"
        ).rstrip()
    yield "error: largest standard error; noise: of a coordinate; moved: root mean square angles; worth: independent frames;"
    yield "apart: of the other sides' answers, all in mm."
    for found in joints.joints:
        if found.status not in USABLE:
            yield f"{found.joint.name}: {found.reason}"
    for segment, why in joints.frameless.items():
        yield f"no frame of its own: {segment}: {why}"


def _mm(metres: float, width: int) -> str:
    return f"{'-':>{width}}" if np.isnan(metres) else f"{1000 * metres:{width}.1f}"

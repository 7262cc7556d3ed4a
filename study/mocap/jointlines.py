"""Phase 1's answer in lines for people: where each joint is, how well that is known, and from what."""

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


def agreed(table: pd.DataFrame) -> Iterator[str]:
    """How far other estimators' answers are from the one that is taken, a line per joint, in millimetres.

    Args:
        table: a row per joint; its columns ``from_…`` are distances, metres (see `agreement.agreement_table`).
    """
    others = [name for name in table.columns if str(name).startswith("from_")]
    wide = max([len(str(name)) for name in table["joint"]] + [16])
    heads = (str(name).removeprefix("from_").replace("_", "-") for name in others)
    yield f"{'distance to / mm':{wide}}" + "".join(f"  {head:>9}" for head in heads)
    for name, row in zip(table["joint"], table[others].to_numpy(dtype=float), strict=True):
        yield f"{name:{wide}}" + "".join(f"  {_mm(float(x), 9)}" for x in row)


def _numbers(found: FoundJoint) -> dict[str, float]:
    """What a joint's estimate rests on; metres and degrees, NaN for what there is not."""
    numbers = dict.fromkeys(("error", "noise", "rho", "least", "most", "frames", "worth", "apart"), float("nan"))
    estimate = found.estimate
    if estimate is None:
        return numbers
    numbers |= {"error": estimate.worst, "frames": float(estimate.count), "worth": float(estimate.worth)}
    numbers["apart"] = max((_apart(estimate, other) for other in found.others), default=float("nan"))
    swing = np.zeros(0)
    if estimate.sphere is not None:
        numbers |= {"noise": float(estimate.sphere.noise), "rho": float(estimate.sphere.condition)}
        swing = np.degrees(estimate.sphere.swing)
    elif estimate.pair is not None:
        numbers["noise"] = float(estimate.pair.gap) / np.sqrt(3.0)
        swing = np.degrees(estimate.pair.turns)
    return numbers | ({"least": float(swing.min()), "most": float(swing.max())} if len(swing) else {})


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
    wide = max([len(found.joint.name) for found in joints.joints] + [5])
    yield (
        f"{'joint':{wide}}  {'status':15}  {'from':6}  {'centre in its parent / mm':>25}  {'error':>6}  {'noise':>6}  "
        f"{'moved':>9}  {'ρ':>5}  {'frames':>6}  {'worth':>6}  {'apart':>6}"
    )
    for found in joints.joints:
        n = _numbers(found)
        place = " ".join(_mm(float(x), 8) for x in found.in_parent)
        moved = "-" if np.isnan(n["least"]) else f"{n['least']:.0f}°-{n['most']:.0f}°"
        counts = "  ".join(f"{'-' if np.isnan(n[key]) else f'{n[key]:.0f}':>6}" for key in ("frames", "worth"))
        rho = "-" if np.isnan(n["rho"]) else f"{n['rho']:.3f}"
        side = found.estimate.side if found.estimate else "-"
        yield (
            f"{found.joint.name:{wide}}  {_WORDS[found.status]:15}  {side:6}  {place}  {_mm(n['error'], 6)}  "
            f"{_mm(n['noise'], 6)}  {moved:>9}  {rho:>5}  {counts}  {_mm(n['apart'], 6)}"
        )
    yield "error: largest standard error; noise: of a coordinate; apart: how far the other sides' answers are; in mm"
    yield "moved: least and greatest root mean square angle; worth: independent frames that the frames are worth"
    for found in joints.joints:
        if found.status not in USABLE:
            yield f"{found.joint.name}: {found.reason}"
    for segment, why in joints.frameless.items():
        yield f"no frame of its own: {segment}: {why}"


def _mm(metres: float, width: int) -> str:
    return f"{'-':>{width}}" if np.isnan(metres) else f"{1000 * metres:{width}.1f}"

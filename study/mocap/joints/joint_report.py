"""The answer of phase 1 as lines for a reader: each joint's place, its accuracy, and the reasons to doubt it."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.mocap.joints.estimates import USABLE
from study.mocap.joints.found_joints import FoundJoints
from study.mocap.joints.joint_table import SHORT_TEXTS, accuracy_columns


def agreement_lines(table: pd.DataFrame) -> Iterator[str]:
    """Lay out the agreement of methods, a line per joint, in millimetres.

    Args:
        table: a row per joint; its columns ``from_…`` are distances, metres (see `agreement_table`).
    """
    others = [name for name in table.columns if str(name).startswith("from_")]
    wide = max([len(str(name)) for name in table["joint"]] + [16])
    heads = (str(name).removeprefix("from_").replace("_", "-") for name in others)
    yield f"{'distance to / mm':{wide}}" + "".join(f"  {head:>9}" for head in heads)
    for name, row in zip(table["joint"], table[others].to_numpy(dtype=float), strict=True):
        yield f"{name:{wide}}" + "".join(f"  {_mm(float(x), 9)}" for x in row)


def joint_lines(joints: FoundJoints) -> Iterator[str]:
    """Lay out the joints, a line each in millimetres and degrees, then the reasons to doubt some of them."""
    wide = max([len(found.joint.name) for found in joints.joints] + [5])
    yield (
        f"{'joint':{wide}}  {'status':15}  {'from':6}  {'centre in its parent / mm':>25}  {'error':>6}  {'noise':>6}  "
        f"{'moved':>9}  {'ρ':>5}  {'frames':>6}  {'worth':>6}  {'apart':>6}"
    )
    for found in joints.joints:
        n = accuracy_columns(found)
        place = " ".join(_mm(float(x), 8) for x in found.in_parent)
        moved = "-" if np.isnan(n["moved_least"]) else f"{n['moved_least']:.0f}°-{n['moved_most']:.0f}°"
        counts = "  ".join(f"{'-' if np.isnan(n[key]) else f'{n[key]:.0f}':>6}" for key in ("frames", "worth"))
        rho = "-" if np.isnan(n["rho"]) else f"{n['rho']:.3f}"
        side = found.estimate.side if found.estimate else "-"
        yield (
            f"{found.joint.name:{wide}}  {SHORT_TEXTS[found.status]:15}  {side:6}  {place}  {_mm(n['error'], 6)}  "
            f"{_mm(n['sigma'], 6)}  {moved:>9}  {rho:>5}  {counts}  {_mm(n['apart'], 6)}"
        )
    yield "error: largest standard error; noise: of a coordinate; apart: farthest other side with an error; all in mm"
    yield "moved: least and greatest root mean square angle of motion; worth: effective number of independent frames"
    for found in joints.joints:
        if found.status not in USABLE:
            yield f"{found.joint.name}: {found.reason}"
    for segment, reason in joints.without_pose.items():
        yield f"no pose of its own: {segment}: {reason}"


def _mm(metres: float, width: int) -> str:
    return f"{'-':>{width}}" if np.isnan(metres) else f"{1000 * metres:{width}.1f}"

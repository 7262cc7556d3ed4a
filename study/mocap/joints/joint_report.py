"""Phase 1's answer in lines for people: where each joint is, how well that is known, and from what."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.mocap.joints.estimates import USABLE
from study.mocap.joints.fit_joints import Joints
from study.mocap.joints.joint_table import WORDS, numbers


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


def printed(joints: Joints) -> Iterator[str]:
    """The table, a line per joint in millimetres and degrees, and then what is to be said of some of them."""
    wide = max([len(found.joint.name) for found in joints.joints] + [5])
    yield (
        f"{'joint':{wide}}  {'status':15}  {'from':6}  {'centre in its parent / mm':>25}  {'error':>6}  {'noise':>6}  "
        f"{'moved':>9}  {'ρ':>5}  {'frames':>6}  {'worth':>6}  {'apart':>6}"
    )
    for found in joints.joints:
        n = numbers(found)
        place = " ".join(_mm(float(x), 8) for x in found.in_parent)
        moved = "-" if np.isnan(n["moved_least"]) else f"{n['moved_least']:.0f}°-{n['moved_most']:.0f}°"
        counts = "  ".join(f"{'-' if np.isnan(n[key]) else f'{n[key]:.0f}':>6}" for key in ("frames", "worth"))
        rho = "-" if np.isnan(n["rho"]) else f"{n['rho']:.3f}"
        side = found.estimate.side if found.estimate else "-"
        yield (
            f"{found.joint.name:{wide}}  {WORDS[found.status]:15}  {side:6}  {place}  {_mm(n['error'], 6)}  "
            f"{_mm(n['sigma'], 6)}  {moved:>9}  {rho:>5}  {counts}  {_mm(n['apart'], 6)}"
        )
    yield "error: largest standard error; noise: of a coordinate; apart: the farthest other side with an error; in mm"
    yield "moved: least and greatest root mean square angle; worth: independent frames that the frames are worth"
    for found in joints.joints:
        if found.status not in USABLE:
            yield f"{found.joint.name}: {found.reason}"
    for segment, why in joints.frameless.items():
        yield f"no frame of its own: {segment}: {why}"


def _mm(metres: float, width: int) -> str:
    return f"{'-':>{width}}" if np.isnan(metres) else f"{1000 * metres:{width}.1f}"

"""The answer of phase 1 as lines for a reader: each joint's place, its accuracy, and the reasons to doubt it."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.mocap.joints.estimates import USABLE
from study.mocap.joints.found_joints import FoundJoint, FoundJoints
from study.mocap.joints.joint_table import SHORT_TEXTS, accuracy_columns
from study.text.columns import columns
from study.text.numbers import number

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
    yield from columns([[name, *map(_millimetres, row)] for name, row in distances], titles, "<>")


def joint_lines(joints: FoundJoints) -> Iterator[str]:
    """Lay out the joints, a line each in millimetres and degrees, then the reasons to doubt some of them."""
    titles = ["joint", "status", "from", *(f"{axis} / mm" for axis in "xyz"), "error", "floor", "noise", "range"]
    titles += ["ρ", "frames", "n_eff", "apart"]
    yield from columns(map(_joint_row, joints.joints), titles, "<<<>")
    yield "x, y, z: centre in its parent; error: largest standard error; noise: of a coordinate; all in mm"
    yield "floor: error from skin that moves all markers of a segment alike, by 5 mm/rad, which no marker shows, mm"
    yield "apart: distance to the farthest other side with an error, mm; n_eff: effective number of independent frames"
    yield "range: of motion, least and greatest root mean square angle; ρ: share of the smallest extent that is noise"
    for found in joints.joints:
        if found.joint.across and not np.isnan(found.axis_in_parent).any():
            yield f"{found.joint.name}: along its axis midway between {' and '.join(found.joint.across)}"
        if found.status not in USABLE:
            yield f"{found.joint.name}: {found.reason}"
        if found.estimate is not None and np.isnan(found.in_parent).any():
            two = f"{found.joint.parent} and {found.joint.child}"
            yield f"{found.joint.name}: no place in its parent: no frame has poses of both {two}"
    yield from (f"no pose of its own: {reason}" for reason in joints.without_pose.values())


def _joint_row(found: FoundJoint) -> list[str]:
    """A joint's texts, in the order of the titles."""
    n = accuracy_columns(found)
    moved = "-" if np.isnan(n["moved_least"]) else f"{n['moved_least']:.0f}°-{n['moved_most']:.0f}°"
    side = found.estimate.side if found.estimate else "-"
    return [
        *(found.joint.name, SHORT_TEXTS[found.status], side),
        *(_millimetres(float(x)) for x in found.in_parent),
        f"> {1000 * _FAR:.0f}" if n["error"] > _FAR else _millimetres(n["error"]),
        *(_millimetres(n[key]) for key in ("floor", "sigma")),
        *(moved, number(n["rho"], ".3f")),
        *(number(n[key], ".0f") for key in ("frames", "worth")),
        _millimetres(n["apart"]),
    ]


def _millimetres(metres: float) -> str:
    return number(1000 * metres, ".1f")

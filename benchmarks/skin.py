"""Coverage of the joints' errors on synthetic bodies whose skin moves, by law of the skin and range of motion.

    python benchmarks/skin.py --bodies 200 --out results/skin.csv

A body has 41 markers, 1 mm of noise, 10 % gaps, 16 seconds at 50 frames per second, and skin of 5 to 30 mm at the ends
of its joints' ranges, evenly over the bodies of a cell. Where only markers over joints slide, it is 10 to 30 mm, and
the markers are 32 landmarks of trunk and legs, among them trochanters, epicondyles and malleoli. A row of the table is
a cell: the share of joints whose 95 % region holds the truth, of all and of knees and elbows; the shares undoubted, and
undoubted though more than 2 cm off; the share of the undoubted whose region holds the truth; median error and median
standard error, mm; and the standard errors of the shares, from the scatter between bodies. A hinge is compared with its
true axis. A joint without an estimate counts as doubted and has no region.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from study.recordings.joints.estimate import USABLE
from study.recordings.joints.find import find_joints
from study.recordings.markersets import load_markerset
from study.recordings.synthetic.make import Recipe, synthesize

LAWS = ("none", "random", "angle", "velocity", "cluster", "slide")
LEAST, GREATEST = 0.005, 0.030
LEAST_SLIDE = 0.010
HINGES = ("left_elbow", "right_elbow", "left_knee", "right_knee")
FAR = 0.02


def compared(joint, truth):
    """A row for a joint: its name, its distance from the truth, whether its region holds it, its standard error."""
    k, estimate = truth.joints.index(joint.joint.name), joint.estimate
    row = {"joint": joint.joint.name, "undoubted": joint.status in USABLE}
    if estimate is None:
        return row | {"off": np.nan, "covered": np.nan, "error": np.nan}
    off = estimate.center - estimate.poses.mean_place(truth.centers[k])
    axis = estimate.axis
    if axis is not None and not np.isnan(truth.axes[k]).any():
        parent = truth.rotations[truth.segments.index(truth.parents[k])]
        axis = np.nanmean(estimate.poses.to_local((parent @ truth.axes[k]).T + estimate.poses.origin), axis=1)
    basis = np.eye(3) if axis is None else np.linalg.svd(axis[None])[2][1:].T
    off = basis.T @ off
    square = off @ np.linalg.pinv(basis.T @ estimate.covariance @ basis, hermitian=True) @ off
    covered = float(square < stats.chi2.ppf(0.95, len(off)))
    return row | {"off": np.linalg.norm(off), "covered": covered, "error": estimate.standard_error}


def cell(law, gait, bodies, every=1):
    """The joints of the bodies of a cell, or of every fifth, say, a row each."""
    markers, least = ("rizzoli", LEAST_SLIDE) if law == "slide" else ("cmu41", LEAST)
    markerset, rows = load_markerset(markers), []
    for body in range(0, bodies, every):
        skin = {} if law == "none" else {"soft_tissue": least + (GREATEST - least) * (body + 0.5) / bodies, "skin": law}
        recipe = Recipe(800, 50.0, seed=1 + body, gaps=0.1, gait=gait, markers=markers, **skin)
        recording, truth = synthesize(recipe)
        rows += [{"body": body} | compared(joint, truth) for joint in find_joints(markerset, recording).joints]
    return pd.DataFrame(rows)


def mean_by_body(joints, values):
    """Mean of a value of each joint, and its standard error: joints of one body are not independent."""
    values = values.astype(float)
    mean, bodies = values.mean(), joints["body"].nunique()
    residuals = (values - mean).groupby(joints["body"]).sum() / values.notna().sum()
    return mean, np.sqrt((residuals**2).sum() * bodies / max(bodies - 1, 1))


def summary(law, gait, joints):
    """The row of a cell, from its joints."""
    hinges = joints["joint"].isin(HINGES)
    covered, covered_se = mean_by_body(joints, joints["covered"])
    undoubted, undoubted_se = mean_by_body(joints, joints["undoubted"])
    far, far_se = mean_by_body(joints, joints["undoubted"] & (joints["off"] > FAR))
    undoubted_covered, undoubted_covered_se = mean_by_body(joints, joints["covered"].where(joints["undoubted"]))
    return {
        "skin": law,
        "motion": "gait" if gait else "functional",
        "bodies": joints["body"].nunique(),
        "covered": covered,
        "covered_hinges": joints.loc[hinges, "covered"].mean(),
        "without_estimate": joints["covered"].isna().mean(),
        "undoubted": undoubted,
        "undoubted_far": far,
        "undoubted_covered": undoubted_covered,
        "median_off_mm": 1000 * joints["off"].median(),
        "median_error_mm": 1000 * joints["error"].median(),
        "covered_se": covered_se,
        "undoubted_se": undoubted_se,
        "undoubted_far_se": far_se,
        "undoubted_covered_se": undoubted_covered_se,
    }


def main():
    parser = argparse.ArgumentParser(description="coverage of joints' errors where skin moves")
    parser.add_argument("--bodies", type=int, default=200, help="bodies in each cell")
    parser.add_argument("--every", type=int, default=1, help="take every fifth of these bodies, say")
    parser.add_argument("--skin", choices=LAWS, action="append", help="laws [default: all]")
    parser.add_argument("--motion", choices=("functional", "gait"), action="append", help="ranges [default: both]")
    parser.add_argument("--out", type=Path, help="CSV file, to which rows are added")
    chosen = parser.parse_args()
    for motion in chosen.motion or ("functional", "gait"):
        for law in chosen.skin or LAWS:
            joints = cell(law, motion == "gait", chosen.bodies, chosen.every)
            row = pd.DataFrame([summary(law, motion == "gait", joints)])
            print(row.round(3).to_string(index=False), flush=True)
            if chosen.out:
                row.to_csv(chosen.out, mode="a", header=not chosen.out.exists(), index=False, float_format="%.4g")


if __name__ == "__main__":
    main()

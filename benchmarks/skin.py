"""Coverage of the joints' errors on synthetic bodies whose skin moves, by law of the skin and range of motion.

    python benchmarks/skin.py     # stores docs/assets/tables/skin.csv

A body has 41 markers, 1 mm of noise, 10 % gaps, 16 seconds at 50 frames per second, and skin of 5 to 30 mm at the ends
of its joints' ranges, evenly over the bodies of a cell. Where only markers over joints slide, it is 10 to 30 mm, and
the markers are 32 landmarks of trunk and legs, among them trochanters, epicondyles and malleoli. A row of the table is
a cell: the share of joints whose 95 % region, that of the fit, holds the truth, of all and of knees and elbows; the
shares undoubted, as the commands doubt a joint that hardly moved, and undoubted though more than 2 cm off; the share of
the undoubted whose region holds the truth; median error and median standard error, mm; and the standard errors of the
shares, from the scatter between bodies. A hinge is compared with its true axis. A joint without an estimate counts as
doubted and has no region.
"""

from itertools import product

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy import stats
from studies import store

from study.recordings.joints.estimate import USABLE
from study.recordings.joints.find import find_joints, with_allowance
from study.recordings.markersets import load_markerset
from study.recordings.synthetic.make import Recipe, synthesize

LAWS = ("none", "random", "angle", "velocity", "cluster", "slide")
LEAST, GREATEST = 0.005, 0.030
LEAST_SLIDE = 0.010
HINGES = ("left_elbow", "right_elbow", "left_knee", "right_knee")
FAR = 0.02
BODIES = 200
"""Bodies of a cell."""


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


def joints_of(law, gait):
    """The joints of the bodies of a cell, a row each."""
    markers, least = ("rizzoli", LEAST_SLIDE) if law == "slide" else ("cmu41", LEAST)
    markerset, rows = load_markerset(markers), []
    for body in range(BODIES):
        skin = {} if law == "none" else {"soft_tissue": least + (GREATEST - least) * (body + 0.5) / BODIES, "skin": law}
        recipe = Recipe(800, 50.0, seed=1 + body, gaps=0.1, gait=gait, markers=markers, **skin)
        recording, truth = synthesize(recipe)
        joints = map(with_allowance, find_joints(markerset, recording).joints)
        rows += [{"body": body} | compared(joint, truth) for joint in joints]
    return pd.DataFrame(rows)


def mean_by_body(joints, values):
    """Mean of a value of each joint, and its standard error: joints of one body are not independent."""
    values = values.astype(float)
    mean = values.mean()
    residuals = (values - mean).groupby(joints["body"]).sum() / values.notna().sum()
    return mean, np.sqrt((residuals**2).sum() * BODIES / (BODIES - 1))


def cell(motion, law):
    """The row of a cell."""
    joints = joints_of(law, motion == "gait")
    covered, undoubted = joints["covered"], joints["undoubted"]
    row = {"skin": law, "motion": motion, "bodies": BODIES, "without_estimate": covered.isna().mean()}
    row["covered_hinges"] = covered[joints["joint"].isin(HINGES)].mean()
    row |= {f"median_{name}_mm": 1000 * joints[name].median() for name in ("off", "error")}
    shares = {"covered": covered, "undoubted": undoubted, "undoubted_covered": covered.where(undoubted)}
    for name, values in (shares | {"undoubted_far": undoubted & (joints["off"] > FAR)}).items():
        row[name], row[f"{name}_se"] = mean_by_body(joints, values)
    return row


if __name__ == "__main__":
    cells = product(("functional", "gait"), LAWS)
    store("skin", Parallel(2, return_as="generator")(delayed(cell)(*each) for each in cells), "%.4g")

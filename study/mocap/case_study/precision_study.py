"""The paper's case study (§9.1): how a joint's centre scatters when it is fitted to parts of a recording.

Four data sets, each a random half of the frames; from each a quarter of the subsets. A centre is MGDK's in the parent's
frame (paper eq. 22, corrected), told the noise that it finds in the whole recording, as UGDK is; once as it stands and
once, for a hinge, without the direction across which the markers did not move.

Random subsets of one recording scatter about the whole recording's answer as independent frames would, whatever that
answer is worth: N of T frames by √(1 - N/T) less, which is divided out. Frames that follow each other are what a
shorter recording has, and those scatter more. With a memory of τ frames (`timeseries.py`), so that T are worth T/τ, N
random ones have a mean of the variance

    σ² / N_eff,    N_eff = N / (1 + (N - 1) (τ - 1)/(T - 1)),

about the truth: no more than T/τ, however many. That axis is the honest one; the error on it is the subsets' scatter
and the whole answer's own standard error together.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from study.experiment.streams import stream
from study.mocap.case_study.subset_fits import SETS, Whole, taken
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.joints.estimates import Estimate
from study.mocap.joints.fit_joints import FoundJoint, Joints
from study.sphere.types import Floats

SUBSETS = 400
NEAR = 0.01
"""Metres: the paper's centimetre."""
_NUMBERS = (20, 50, 100, 200, 500, 1000, 2000, 5000)
_LAW = 50
"""Frames from which on the power law is fitted: with fewer, fits fail or have no variance."""
_ROUNDS = 400
"""Of the bootstrap over joints."""
_SMALL_CAP, _HIDDEN, _WIDE = 30.0, 0.3, 2.0
"""Degrees of a cap that is small; ρ above which the noise hides the motion; times the median joint's scatter."""
_MOSTLY = 0.6
"""Share of the scatter along a hinge's axis that shows that it is the hinge's."""


@dataclass(frozen=True)
class CaseStudy:
    """What came of it; lengths in metres.

    Attributes:
        recording: its name.
        frames: how many it has.
        subsets: how many of each size.
        scatter: a row per joint, way of taking frames (``random`` or ``window``), whether a hinge's axis is dropped,
            and N: ``mean_x, …`` and ``sd_x, …``: mean and standard deviation of the centre in the parent's axes, of
            fits that are ok; ``sd``: root of the summed variances; ``median``: median distance from the whole
            recording's answer, fits that are not ok counted as farther than any; ``near``: share within a centimetre;
            ``failed``: share not positive definite; ``effective``: N_eff; ``error``: the scatter and the whole
            answer's standard error together.
        joints: a row per joint: ``cap`` in degrees, ``condition`` ρ, ``hinge``, ``memory`` τ in frames, ``worth`` T/τ,
            ``sets``: the largest distance between two of the four sets' medians at the middle N, ``along``: share of
            the scatter along the direction in which the markers moved least, ``median``: scatter at the largest N,
            ``outlier``: whether that is more than twice the median joint's, ``reason``: why.
        laws: exponents by ``axis`` (``raw``, ``window``, ``effective``), the median over joints, with ``low`` and
            ``high``, a 95 % interval over joints.
        skipped: joints that have no sphere in their parent's frame, and why.
    """

    recording: str
    frames: int
    subsets: int
    scatter: pd.DataFrame
    joints: pd.DataFrame
    laws: pd.DataFrame
    skipped: dict[str, str]


def case_study(
    joints: Joints, recording: Recording, subsets: int = SUBSETS, seed: int = 1, numbers: Sequence[int] = _NUMBERS
) -> CaseStudy:
    """Fit every joint to many parts of a recording.

    Args:
        joints: phase 1's answer.
        recording: that they were found in.
        subsets: of each size, a multiple of four.
        seed: of the subsets.
        numbers: of frames in a subset; those above a quarter of the recording's are left out.

    Raises:
        RecordingError: if the recording is too short, no joint has a sphere, or subsets are no multiple of four.
    """
    sizes = [n for n in numbers if n <= recording.frames // SETS]
    if len(sizes) < 2:
        least = SETS * sorted(numbers)[1]
        raise RecordingError(f"{recording.name}: {recording.frames} frames; a case study needs at least {least}")
    if subsets < SETS or subsets % SETS:
        raise RecordingError(f"subsets = {subsets}; give a multiple of {SETS}: they come from four data sets")
    rows, about, skipped = [], [], {}
    for found in joints.joints:
        sphere = _sphere(found)
        if sphere is None:
            skipped[found.joint.name] = f"no sphere in its parent's frame ({found.reason})"
            continue
        name = found.joint.name
        y = np.stack([sphere.frames.see(recording.of(marker)) for marker in sphere.markers])
        whole = Whole(y, sphere.used, sphere)
        joint_rows, answers = _joint(whole, name, sizes, subsets, seed)
        rows += joint_rows
        about.append({"joint": name} | whole.about(sizes[len(sizes) // 2], answers))
    if not rows:
        raise RecordingError(f"{recording.name}: none of its joints has a sphere in its parent's frame")
    scatter, table = pd.DataFrame(rows), pd.DataFrame(about)
    _explain(scatter, table)
    laws = pd.DataFrame([_law(scatter, axis) for axis in ("raw", "window", "effective")])
    return CaseStudy(recording.name, recording.frames, subsets, scatter, table, laws, skipped)


def _sphere(found: FoundJoint) -> Estimate | None:
    """The estimate from the child's markers in the parent's frame."""
    every = [] if found.estimate is None else [found.estimate, *found.others]
    return next((e for e in every if e.side == "parent" and e.sphere is not None), None)


def _joint(
    whole: Whole, name: str, sizes: Sequence[int], subsets: int, seed: int
) -> tuple[list[dict[str, object]], dict[tuple[str, bool, int], Floats]]:
    """Rows of the scatter, and the centres themselves by way, dropped axis and N."""
    rows: list[dict[str, object]] = []
    answers: dict[tuple[str, bool, int], Floats] = {}
    seen = np.flatnonzero(whole.used.any(axis=0))
    for way in ("random", "window"):
        for number in sizes:
            index = taken(way, seen, number, subsets, stream(seed, "case study", name, way, number))
            for dropped in (False, True) if whole.hinge else (False,):
                axis = whole.least if dropped else None
                found = np.concatenate([whole.centers(part, axis)[0] for part in np.array_split(index, 8)])
                answers[way, dropped, number] = found
                middle = whole.centers(seen[None], axis)[0][0]
                rows.append({"joint": name, "way": way, "dropped": dropped, "samples": number})
                rows[-1] |= _scatter(whole, found, middle, number, way, axis)
    return rows, answers


def _scatter(
    whole: Whole, found: Floats, middle: Floats, number: int, way: str, axis: Floats | None
) -> dict[str, object]:
    """How centres (B, 3) lie about the whole recording's answer (3,), if they are positive definite."""
    away = found - middle
    if axis is not None:
        away = away - np.outer(away @ axis, axis)
    distance = np.linalg.norm(away, axis=1)
    there = np.isfinite(distance)
    ranked = np.where(there, distance, np.inf)
    # N random ones of T frames are within √(1 - N/T) of what as many independent ones would be
    share = np.sqrt(max(1.0 - number / whole.frames, 1e-12)) if way == "random" else 1.0
    median = float(np.sort(ranked)[len(ranked) // 2]) / share
    mean, sd = (found[there].mean(axis=0), found[there].std(axis=0)) if there.any() else (np.full(3, np.nan),) * 2
    effective = whole.effective(number) if way == "random" else max(number / whole.memory, 1.0)
    # a median of |Gaussian| in three directions is about 0.9 of its root mean square, as the standard error is one
    own = 0.9 * whole.error
    return {
        **{f"mean_{a}": float(v) for a, v in zip("xyz", mean, strict=True)},
        **{f"sd_{a}": float(v) for a, v in zip("xyz", sd, strict=True)},
        "sd": float(np.sqrt((sd**2).sum())), "median": median, "near": float((ranked <= NEAR).mean()),
        "failed": float((~there).mean()), "effective": effective,
        "error": float(np.hypot(median * share, own)) if way == "random" else median,
    }  # fmt: skip


def best(scatter: pd.DataFrame) -> pd.DataFrame:
    """Rows without a hinge's axis where that can be dropped, else all of a joint's."""
    hinges = set(scatter.loc[scatter["dropped"], "joint"])
    return scatter[scatter["dropped"] == scatter["joint"].isin(hinges)]


def _law(scatter: pd.DataFrame, axis: str) -> dict[str, object]:
    """Median of the joints' exponents, so that all count alike; 95 % interval by bootstrap over joints."""
    way = "window" if axis == "window" else "random"
    x_name, y_name = ("effective", "error") if axis == "effective" else ("samples", "median")
    part = best(scatter)
    part = part[(part["way"] == way) & (part["samples"] >= _LAW) & np.isfinite(part["median"]) & (part["median"] > 0)]
    exponents = np.array(
        [
            np.polyfit(np.log(group[x_name]), np.log(group[y_name]), 1)[0]
            for _, group in part.groupby("joint", sort=False)
            if group[x_name].nunique() > 1
        ]
    )
    if not len(exponents):
        return {"axis": axis, "exponent": np.nan, "low": np.nan, "high": np.nan, "joints": 0}
    rng = stream(0, "case study", "law", axis, len(exponents))
    again = np.median(exponents[rng.integers(0, len(exponents), (_ROUNDS, len(exponents)))], axis=1)
    low, high = np.quantile(again, [0.025, 0.975])
    return {
        "axis": axis, "exponent": float(np.median(exponents)), "low": float(low), "high": float(high),
        "joints": len(exponents),
    }  # fmt: skip


def _explain(scatter: pd.DataFrame, table: pd.DataFrame) -> None:
    """Say which joints are outliers as the paper counts, with every axis kept, and why."""
    largest = scatter["samples"].max()
    plain = scatter[(scatter["way"] == "random") & ~scatter["dropped"] & (scatter["samples"] == largest)]
    medians = plain.set_index("joint")["median"].reindex(table["joint"]).to_numpy()
    table["median"] = medians
    table["outlier"] = medians > _WIDE * np.nanmedian(medians)
    reasons = []
    for row in table.to_dict("records"):
        words = []
        if row["hinge"] and row["along"] > _MOSTLY:
            words.append(f"a hinge: {row['along']:.0%} of the scatter is along its axis")
        if row["cap"] < _SMALL_CAP:
            words.append(f"moved by {row['cap']:.0f}° only")
        if row["condition"] > _HIDDEN:
            words.append(f"ρ = {row['condition']:.2f}: noise hides the motion in one direction")
        reasons.append("; ".join(words))
    table["reason"] = reasons

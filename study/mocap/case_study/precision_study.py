"""The paper's precision study (§9.1): the scatter of joint centres that are fitted to parts of a recording.

There are four data sets, each a random half of the frames; a quarter of the subsets comes from each. A centre is MGDK's
in the parent's axes (paper eq. 22, corrected), with the noise that the whole recording shows, as in UGDK. A hinge has
two centres: with its axis, and without the direction across which its markers did not move.

Random subsets of one recording scatter about the centre of the whole recording as independent frames would, whatever
the error of that centre is; N of T frames scatter less by √(1 - N/T), which is divided out. Consecutive frames are what
a shorter recording has, and they scatter more. With an autocorrelation time of τ frames (`long_run_covariance.py`) the
effective number of independent frames in all T is T/τ, and the mean of N random frames has the variance

    σ² / N_eff,    N_eff = N / (1 + (N - 1) (τ - 1)/(T - 1)),

about the truth: N_eff is at most T/τ, for any N. The error over this axis is the scatter of the subsets and the
standard error of the whole recording's centre together.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from study.experiment.streams import stream
from study.mocap.case_study.scatter_summary import power_law, with_outliers
from study.mocap.case_study.subset_fits import SETS, JointSamples, subset_frames
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.joints.estimates import USABLE, Estimate
from study.mocap.joints.found_joints import FoundJoint, FoundJoints
from study.sphere.types import Floats

NEAR = 0.01
"""The paper's centimetre, metres."""
_NUMBERS = (20, 50, 100, 200, 500, 1000, 2000, 5000)
_PIECES = 8
"""Number of pieces in which the subsets of one size are fitted, to save memory."""
_MEDIAN_TO_RMS = 0.9
"""The median length of a Gaussian vector in three dimensions, about, in units of its root mean square."""


@dataclass(frozen=True)
class CaseStudy:
    """The tables of a precision study; lengths in metres.

    Attributes:
        recording: name of the recording.
        frames: its number of frames.
        subsets: number of subsets of each size.
        scatter: a row per joint, way of taking frames (``random``, or ``window``: consecutive), whether the axis of a
            hinge is dropped, and N. ``mean_x, …`` and ``sd_x, …``: mean and standard deviation of the centre in the
            parent's axes, over fits that are ok; ``sd``: root of the summed variances; ``median``: median distance
            from the whole recording's centre, where a failed fit counts as farther than any other; ``near``: share
            within a centimetre; ``failed``: share of fits that are not positive definite; ``effective``: N_eff;
            ``error``: the scatter and the standard error of the whole recording's centre together; ``doubted``: whether
            phase 1 doubts the joint.
        joints: a row per joint. ``cap``: half-angle of the largest cap, degrees; ``condition``: ρ; ``hinge``;
            ``memory``: τ in frames; ``worth``: T/τ; ``sets``: largest distance between the medians of two data sets at
            the middle N; ``along``: share of the scatter in the direction in which the markers moved least; ``median``:
            scatter at the largest N; ``outlier``: whether that is more than twice the median joint's; ``reason``.
        laws: a row per axis (``raw``, ``window``, ``effective``): the exponent, the median over joints, with the ends
            ``low`` and ``high`` of a 95 % interval over joints.
        skipped: joints without a sphere in their parent's axes, each with the reason.
    """

    recording: str
    frames: int
    subsets: int
    scatter: pd.DataFrame
    joints: pd.DataFrame
    laws: pd.DataFrame
    skipped: dict[str, str]


def case_study(
    joints: FoundJoints, recording: Recording, subsets: int = 400, seed: int = 1, numbers: Sequence[int] = _NUMBERS
) -> CaseStudy:
    """Fit each joint to many parts of a recording.

    Args:
        joints: the fitted joints (phase 1).
        recording: the recording that they were fitted to.
        subsets: number of subsets of each size, a multiple of four.
        seed: of the subsets.
        numbers: sizes of the subsets, in frames; those above a quarter of the recording are left out.

    Raises:
        RecordingError: if the recording is too short, no joint has a sphere, or ``subsets`` is not a multiple of four.
    """
    sizes = [n for n in numbers if n <= recording.frames // SETS]
    if len(sizes) < 2:
        least = SETS * sorted(numbers)[1]
        raise RecordingError(f"{recording.name}: {recording.frames} frames; a case study needs at least {least}")
    if subsets < SETS or subsets % SETS:
        raise RecordingError(f"subsets = {subsets}; give a multiple of {SETS}: they come from four data sets")
    rows, about, skipped = [], [], {}
    for found in joints.joints:
        name = found.joint.name
        sphere = _sphere(found)
        if sphere is None:
            skipped[name] = f"no sphere in its parent's axes ({found.reason})"
            continue
        y = np.stack([sphere.poses.to_local(recording.of(marker)) for marker in sphere.markers])
        samples = JointSamples(y, sphere.used, sphere)
        joint_rows, centers = _scatter_of(samples, name, sizes, subsets, seed)
        rows += [row | {"doubted": found.status not in USABLE} for row in joint_rows]
        about.append({"joint": name} | samples.causes(centers["random", False, sizes[len(sizes) // 2]]))
    if not rows:
        raise RecordingError(f"{recording.name}: none of its joints has a sphere in its parent's axes")
    scatter = pd.DataFrame(rows)
    table = with_outliers(pd.DataFrame(about), scatter)
    laws = pd.DataFrame([power_law(scatter, axis) for axis in ("raw", "window", "effective")])
    return CaseStudy(recording.name, recording.frames, subsets, scatter, table, laws, skipped)


def _sphere(found: FoundJoint) -> Estimate | None:
    """The estimate from the child's markers in the parent's axes."""
    estimates = [] if found.estimate is None else [found.estimate, *found.others]
    return next((e for e in estimates if e.side == "parent" and e.sphere is not None), None)


def _scatter_of(
    samples: JointSamples, name: str, sizes: Sequence[int], subsets: int, seed: int
) -> tuple[list[dict[str, object]], dict[tuple[str, bool, int], Floats]]:
    """Rows of the scatter of one joint, and its centres by way, dropped axis and N."""
    rows: list[dict[str, object]] = []
    centers: dict[tuple[str, bool, int], Floats] = {}
    seen = np.flatnonzero(samples.used.any(axis=0))
    for way in ("random", "window"):
        for number in sizes:
            index = subset_frames(way, seen, number, subsets, stream(seed, "case study", name, way, number))
            for dropped in (False, True) if samples.hinge else (False,):
                axis = samples.least if dropped else None
                pieces = np.array_split(index, _PIECES)
                found = np.concatenate([samples.centers(piece, axis)[0] for piece in pieces])
                centers[way, dropped, number] = found
                away = found - samples.centers(seen[None], axis)[0][0]
                if axis is not None:
                    away = away - np.outer(away @ axis, axis)
                rows.append({"joint": name, "way": way, "dropped": dropped, "samples": number})
                rows[-1] |= _moments(found) | _distances(samples, np.linalg.norm(away, axis=1), number, way)
    return rows, centers


def _moments(centers: Floats) -> dict[str, object]:
    """Mean and standard deviation of those centres (B, 3) whose fit is ok."""
    ok = centers[np.isfinite(centers).all(axis=1)]
    mean, sd = (ok.mean(axis=0), ok.std(axis=0)) if len(ok) else (np.full(3, np.nan),) * 2
    return {
        **{f"mean_{a}": float(v) for a, v in zip("xyz", mean, strict=True)},
        **{f"sd_{a}": float(v) for a, v in zip("xyz", sd, strict=True)},
        "sd": float(np.sqrt((sd**2).sum())),
    }


def _distances(samples: JointSamples, distance: Floats, number: int, way: str) -> dict[str, object]:
    """Summary of the distances (B,) from the whole recording's centre; NaN for a fit that is not ok."""
    ok = np.isfinite(distance)
    ranked = np.where(ok, distance, np.inf)
    # N random frames of T scatter about the whole recording's centre by √(1 - N/T) less than independent ones
    share = np.sqrt(max(1.0 - number / samples.frames, 1e-12)) if way == "random" else 1.0
    median = float(np.sort(ranked)[len(ranked) // 2]) / share
    error = float(np.hypot(median * share, _MEDIAN_TO_RMS * samples.error)) if way == "random" else median
    effective = samples.effective(number) if way == "random" else max(number / samples.autocorrelation_time, 1.0)
    near, failed = float((ranked <= NEAR).mean()), float((~ok).mean())
    return {"median": median, "near": near, "failed": failed, "effective": effective, "error": error}

"""Summaries of a case study's scatter: power laws over the number of frames, and the reasons for outliers."""

import numpy as np
import pandas as pd

from study.experiment.streams import stream

_LEAST = 50
"""Smallest number of frames for the power law: with fewer, fits fail or have no finite variance."""
_BOOTSTRAPS = 400
_SMALL_CAP = 30.0
"""Half-angle of a cap below which the range of motion is small, degrees."""
_HIDDEN = 0.3
"""ρ above which the noise hides the motion."""
_WIDE = 2.0
"""A joint is an outlier if it scatters more than the median joint by this factor."""
_ALONG = 0.6
"""Share of the scatter along a hinge's axis above which the hinge is its reason."""


def without_hinge_axes(scatter: pd.DataFrame) -> pd.DataFrame:
    """The rows that drop the axis of a hinge, and all rows of the other joints."""
    hinges = set(scatter.loc[scatter["dropped"], "joint"])
    return scatter[scatter["dropped"] == scatter["joint"].isin(hinges)]


def power_law(scatter: pd.DataFrame, axis: str) -> dict[str, object]:
    """Exponent of the scatter over the number of frames: the median over joints, so that all count alike.

    Args:
        scatter: of a case study.
        axis: ``raw``, random frames over N; ``window``, consecutive frames over N; or ``effective``, random frames with
            the error of the whole recording's centre over the effective number of independent frames.

    Returns:
        The axis, the exponent, ends of a 95 % bootstrap interval over joints, and the number of joints.
    """
    way = "window" if axis == "window" else "random"
    x_name, y_name = ("effective", "error") if axis == "effective" else ("samples", "median")
    part = without_hinge_axes(scatter)
    part = part[(part["way"] == way) & (part["samples"] >= _LEAST) & np.isfinite(part["median"]) & (part["median"] > 0)]
    exponents = np.array(
        [
            np.polyfit(np.log(group[x_name]), np.log(group[y_name]), 1)[0]
            for _, group in part.groupby("joint", sort=False)
            if group[x_name].nunique() > 1
        ]
    )
    count = len(exponents)
    if not count:
        return {"axis": axis, "exponent": np.nan, "low": np.nan, "high": np.nan, "joints": 0}
    rng = stream(0, "case study", "law", axis, count)
    medians = np.median(exponents[rng.integers(0, count, (_BOOTSTRAPS, count))], axis=1)
    low, high = map(float, np.quantile(medians, [0.025, 0.975]))
    return {"axis": axis, "exponent": float(np.median(exponents)), "low": low, "high": high, "joints": count}


def with_outliers(joints: pd.DataFrame, scatter: pd.DataFrame) -> pd.DataFrame:
    """The table of joints with the columns ``median``, ``outlier`` and ``reason``.

    Outliers are counted as in the paper: at the largest N, with the axis of each hinge kept.
    """
    largest = scatter["samples"].max()
    rows = scatter[(scatter["way"] == "random") & ~scatter["dropped"] & (scatter["samples"] == largest)]
    medians = rows.set_index("joint")["median"].reindex(joints["joint"]).to_numpy()
    causes = joints[["hinge", "along", "cap", "condition"]]
    reasons = [_reason(*row) for row in causes.itertuples(index=False)]
    return joints.assign(median=medians, outlier=medians > _WIDE * np.nanmedian(medians), reason=reasons)


def _reason(hinge: bool, along: float, cap: float, condition: float) -> str:
    """The reasons for a joint's scatter, as far as there are any; the arguments are columns of `CaseStudy.joints`."""
    reasons = []
    if hinge and along > _ALONG:
        reasons.append(f"a hinge: {along:.0%} of the scatter is along its axis")
    if cap < _SMALL_CAP:
        reasons.append(f"its range of motion is small: {cap:.0f}°")
    if condition > _HIDDEN:
        reasons.append(f"ρ = {condition:.2f}: noise hides the motion in one direction")
    return "; ".join(reasons)

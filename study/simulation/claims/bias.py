"""Claims of section 4.4 on GDKE's bias: its order in the noise, and its limit for many samples."""

import math

import numpy as np
import pandas as pd
import scipy

from study.arrays import Floats
from study.fits.cap import cap_moments
from study.simulation.claims import claim as shared
from study.simulation.claims.claim import Claim, Evidence, Number, Verdict
from study.simulation.statistics import UNKNOWN, Measure, mean, moments_exist, share

_BEFORE_SATURATION = 0.15
"""GDKE's bias is proportional to σ²/v to 2 % for σ below this share of √v, v being the variance along the axis."""
_LEVEL = 0.95


def _order(errors: pd.DataFrame, angle: float) -> Number:
    """Exponent of σ in GDKE's bias on a cap, before it saturates.

    The bias is the median over data sets of the axis error of GDKE minus that of MLE, which has no bias of this order;
    the difference cancels most of the scatter. The noise levels share their draws, so the deviations of the medians
    from the law are alike, and the exponent's true error is below the one given.
    """
    words = f"exponent of σ in GDKE's bias, cap of {angle:g}°"
    along = cap_moments(math.radians(angle), 3).along
    part = errors[(errors["angle"] == angle) & (shared.relative_noise(errors) <= _BEFORE_SATURATION * math.sqrt(along))]
    if part.empty:
        return Number.unknown(words)
    axis = shared.by_estimator(part, part["error_1"] / part["radius"])
    at = shared.by_estimator(part, shared.relative_noise(part))["gdke"].to_numpy()
    enough = shared.in_large_groups(at)
    return shared.exponent(
        words, at[enough], (axis["gdke"] - axis["mle"]).fillna(math.inf).to_numpy()[enough], at[enough]
    )


class GdkeBiasOrder(Claim):
    """GDKE's bias is of the order of the standard deviation of the measurements, O(σ).

    The bias is (C₀ + Σ)⁻¹Σ(c₀ - μ̄). It is of order σ² until it saturates at the distance of the centroid. Section
    5 of the paper agrees: it calls the bias proportional to the variance.
    """

    name, section, figure = "gdke-bias-order", "4.4, 10", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "exponent of σ in GDKE's bias along the cap's axis, before it saturates"
    answer = (
        "as an upper bound: the bias grows as σ to the power {0:power}, {1:power} and {2:power} on three caps, "
        "which is of the order of the variance."
    )

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("efficiency", "error_1")
        angles = sorted({float(angle) for angle in errors["angle"].unique()} - {shared.WHOLE})
        if not (angles and shared.has_estimators(errors, "gdke", "mle")):
            return [Number.unknown("exponent of σ in GDKE's bias")]
        return [_order(errors, angle) for angle in angles]

    def judge(self, numbers: list[Number]) -> Verdict:
        """Reproduced if the exponent is within .1 of 1 on every cap, two standard errors allowed; partly if it
        is not, but at least .9 on every cap, so that O(σ) is an upper bound for small noise; not reproduced
        otherwise. All fits count as computed.
        """
        off = [abs(number.value - 1.0) for number in numbers]
        if all(distance - 2.0 * number.error <= 0.1 for distance, number in zip(off, numbers, strict=True)):
            return Verdict.REPRODUCED
        bounded = all(number.value + 2.0 * number.error >= 0.9 for number in numbers)
        return Verdict.PARTLY if bounded else Verdict.NOT_REPRODUCED


def _covered(vectors: Floats, trials: int) -> Measure:
    """Share of trials whose 95 % ellipse contains the truth; the ellipse has the scatter's covariance.

    Args:
        vectors: errors of the estimates that have a number; of the other trials no ellipse contains the truth.
        trials: number of all trials.
    """
    if len(vectors) < shared.LEAST:
        return UNKNOWN
    inverse = np.linalg.inv(np.cov(vectors.T))
    distance = np.einsum("ti,ij,tj->t", vectors, inverse, vectors)
    return share(int(np.sum(distance <= scipy.special.chdtri(vectors.shape[1], 1.0 - _LEVEL))), trials)


def _axis_bias(rows: pd.DataFrame) -> Measure:
    """Mean error along the axis; unknown if the errors' tail is too heavy for a mean."""
    return mean(rows["error_1"].to_numpy()) if moments_exist(rows["error"].dropna().to_numpy()) else UNKNOWN


class GdkeBiasStays(Claim):
    """GDKE's bias can be significant and does not vanish with more samples; in figure 3 the true centre is outside
    the estimate's error ellipse, because of the bias alone.

    Each ellipse is centred on an estimate and has the size of the scatter over all trials. Without the bias 95 % of
    the ellipses would contain the truth.
    """

    name, section, figure = "gdke-bias-stays", "4.4", "fig3_gdke_ellipse"
    reads = ("ellipse/errors", "power-law/errors")
    quantity = (
        "GDKE's bias over its scatter and the coverage of its ellipses in the setting of figure 3; its bias against N"
    )
    answer = (
        "the bias is {0:times} the scatter, {1:share} of the 95 % ellipses hold the true centre, and at the "
        "largest number of samples the bias is {2:times} that at the smallest."
    )
    heads = ("GDKE is biased, and more points do not help.", "GDKE's bias.", "GDKE's bias.")
    story = "The bias is {0:times} its scatter, and {1:share} of its 95 % ellipses hold the truth."

    def measure(self, evidence: Evidence) -> list[Number]:
        ellipse = evidence.errors("ellipse", "error", "error_1", "error_2")
        grid = shared.rows_of(evidence.errors("power-law", "error_1"), "gdke")
        cell = shared.rows_of(ellipse, "gdke")
        of_mle = shared.rows_of(ellipse, "mle")
        bias, held = _axis_bias(cell), [_covered(shared.center_errors(rows), len(rows)) for rows in (cell, of_mle)]
        spread = float(np.std(cell["error_1"], ddof=1)) if len(cell) >= shared.LEAST else math.nan
        of_spread = spread / math.sqrt(2.0 * max(len(cell) - 1, 1))  # the standard error for Gaussian errors
        few, many = (grid[grid["samples"] == n] for n in (grid["samples"].min(), grid["samples"].max()))
        growth = f"from N = {few['samples'].min():g} to {many['samples'].max():g}"
        left = shared.ratio(*(shared.median(part["error_1"] / part["radius"]) for part in (many, few)))
        return [
            Number.of(
                "GDKE's bias over its standard deviation", shared.ratio(bias, Measure(spread, of_spread)), len(cell)
            ),
            Number.of("share of GDKE's 95 % ellipses that contain the true centre", held[0], len(cell)),
            Number.of(f"share of GDKE's bias that remains {growth}, by medians", left, min(len(few), len(many))),
            Number.of("for comparison, share of MLE's 95 % ellipses that contain it", held[1], len(of_mle)),
        ]

    def judge(self, numbers: list[Number]) -> Verdict:
        """Two conditions, each by two standard errors. First: the bias exceeds 2 standard deviations, and less
        than 5 % of the ellipses contain the truth. Second: more than half of the bias remains at the largest N.
        Reproduced with both, partly with one, not reproduced with neither. All fits count.
        """
        bias, held, left = numbers[:3]
        outside = held.value + 2.0 * held.error < 0.05 and bias.value - 2.0 * bias.error > 2.0
        stays = left.value - 2.0 * left.error > 0.5
        return Verdict.graded(outside and stays, outside or stays)


CLAIMS: tuple[Claim, ...] = (GdkeBiasOrder(), GdkeBiasStays())

"""Claims on the Cramér-Rao bound: efficiency, also below the radius, errors below it, GDKE on the whole sphere.

Cells of the efficiency grid that differ only in the noise share their draws, so their results at small noise are
nearly equal. If a claim's number is the extreme over many cells, its criterion allows for that selection.
"""

import math
from itertools import pairwise
from statistics import NormalDist

import numpy as np
import pandas as pd
import scipy

from study.fits.cap import CapMoments, cap_moments
from study.simulation.analysis.regret import bound_shares, kappa, median_at_bound, median_attainable, ugdk_variance
from study.simulation.claims.claim import (
    LEAST,
    WHOLE,
    CellMeasure,
    Claim,
    Evidence,
    Number,
    Verdict,
    cells,
    error_over,
    furthest_from_one,
    greatest,
    median,
    on_par,
    ratio,
    relative_noise,
    rows_of,
)
from study.simulation.statistics import Measure, mean, moments_exist, quantile, root_mean_square

_NORMAL_MEDIAN = NormalDist().inv_cdf(0.75)
"""Median of the absolute value of a standard normal deviate."""

# UGDK attains the bound ----------------------------------------------------------------------------------------------

_SAFE = 20.0
"""Least κ = (v/σ²) √(N/2) for which the large-sample formula of theory (5.3) is compared."""


def _variance_ratio(part: pd.DataFrame, moments: CapMoments) -> Measure:
    """Variance of the axis error over its bound, from the median of the absolute error: no mean need exist."""
    axis, _ = bound_shares(moments, 3)
    scaled = (part["error_1"].abs() / (part["bound"] * math.sqrt(axis))).fillna(math.inf)
    root = median(scaled)
    value = (root.value / _NORMAL_MEDIAN) ** 2
    return Measure(value, 2.0 * value * root.error / root.value)


def _measure_efficiency(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("efficiency", "error_1", "bound")
    samples = float(errors["samples"].max())
    results = []
    for angle, noise, part in cells(errors, "ugdk"):
        moments = cap_moments(math.radians(angle), 3)
        if angle < WHOLE and kappa(noise, samples, moments) >= _SAFE and len(part) >= LEAST:
            results.append(CellMeasure(_variance_ratio(part, moments), angle, noise, len(part)))
    if not results:
        return [Number.unknown("UGDK's variance over the bound")]
    most, quiet = greatest(results), furthest_from_one(results)
    theory = ugdk_variance(most.relative_noise, cap_moments(math.radians(most.angle), 3), 3)
    words = "UGDK's variance along the axis over the bound's"
    least = f"{words}, σ = {quiet.relative_noise:.2g} r, at the angle where it is furthest from 1"
    return [
        Number.of(f"{words}, greatest with κ ≥ 20 ({most})", most.measure, most.trials),
        Number(f"{words} by theory (5.3), {most}", theory, 0.0, 0),
        Number.of(least, quiet.measure, quiet.trials),
    ]


def _judge_efficiency(numbers: list[Number]) -> Verdict:
    most, _, quiet = numbers
    return on_par(most, quiet)


# no error is below the bound -----------------------------------------------------------------------------------------

_COMPARED = ("mle", "gdke", "ugdk")
_SIGNIFICANT = 3.0
"""Standard errors above which a mean error is a significant bias."""


def _measure_bound(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("efficiency", "error", "error_1", "bound")
    results: list[tuple[Measure, str, int, float]] = []
    for name in _COMPARED:
        for angle, noise, part in cells(errors, name):
            over_bound = np.asarray(error_over(part, "bound"))
            if np.isfinite(over_bound).all() and moments_exist(part["error"].to_numpy()):
                root, bias = root_mean_square(over_bound), mean(part["error_1"].to_numpy())
                where = f"{name.upper()}, φ = {angle:g}°, σ = {noise:.2g} r"
                results.append((root, where, len(part), abs(bias.value) / bias.error))
    words = "least root mean square error over √tr CRLB"
    unbiased = [entry for entry in results if entry[3] <= _SIGNIFICANT]
    if not unbiased:
        return [Number.unknown(words)]
    least, where, trials, pull = min(results)
    of_unbiased, elsewhere, few, _ = min(unbiased)
    return [
        Number.of(f"{words} ({where})", least, trials),
        Number("mean error along the axis there over its standard error", pull, 1.0, trials),
        Number.of(f"{words} without significant bias ({elsewhere})", of_unbiased, few),
    ]


def _judge_bound(numbers: list[Number]) -> Verdict:
    of_all, _, of_unbiased = numbers
    holds = [number.value + 5.0 * number.error >= 1.0 for number in (of_all, of_unbiased)]
    if all(holds):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if holds[1] else Verdict.NOT_REPRODUCED


# GDKE on evenly distributed data -------------------------------------------------------------------------------------


def _measure_even(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("efficiency", "error", "error_1", "bound")
    efficient = math.sqrt(scipy.special.chdtri(3, 0.5) / 3.0)  # three equal variances, as on the whole sphere
    rows = rows_of(errors, "gdke")
    rows = rows[relative_noise(rows) <= 0.32]
    words = "GDKE's median error over that of an efficient estimator, greatest for σ ≤ .3 r"
    sphere = [(median(error_over(part, "bound")), part) for angle, _, part in cells(rows, "gdke") if angle == WHOLE]
    if not sphere:
        return [Number.unknown(f"{words}, whole sphere")]
    most, _ = max(sphere, key=lambda entry: entry[0].value)
    pull = max((_pull(part) for _, part in sphere), key=abs)
    trials = min(len(part) for _, part in sphere)
    numbers = [
        Number.of(f"{words}, whole sphere", Measure(*(v / efficient for v in most)), trials),
        Number("GDKE's bias there over its Monte-Carlo error, furthest from 0", pull, 1.0, trials),
    ]
    for clumped in sorted({float(angle) for angle in rows["angle"].unique()} - {WHOLE}, reverse=True):
        levels = [(median(error_over(part, "bound")), len(part)) for a, _, part in cells(rows, "gdke") if a == clumped]
        results, few = max(levels, key=lambda entry: entry[0].value)
        numbers.append(Number.of(f"GDKE's median error over bound, greatest for φ = {clumped:g}°", results, few))
    return numbers


def _pull(part: pd.DataFrame) -> float:
    """Median axis error over its Monte-Carlo error."""
    results = quantile(part["error_1"].fillna(math.inf).to_numpy(), 0.5)
    return results.value / results.error


def _judge_even(numbers: list[Number]) -> Verdict:
    even, pull, *clumped = numbers
    good = even.value - 3.0 * even.error <= 1.2 and abs(pull.value) <= 4.0
    rising = [even, *clumped]
    worse = len(clumped) > 0 and all(
        b.value - a.value > 2.0 * math.hypot(a.error, b.error) for a, b in pairwise(rising)
    )
    if good and worse:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if good or worse else Verdict.NOT_REPRODUCED


# efficient where the noise is below the radius -----------------------------------------------------------------------


def _over_attainable(evidence: Evidence, estimator: str) -> list[CellMeasure]:
    """Median error over that of a Gaussian at the attainable bound, in each condition with σ < r."""
    results = []
    for angle, noise, part in cells(evidence.errors("efficiency", "error", "bound"), estimator):
        error = median(error_over(part, "bound"))
        if noise < 1.0 and not math.isnan(error.value):
            unit = median_attainable(angle, noise, 3)
            if math.isnan(unit):  # the noise hides the cap, and the attainable bound cannot be formed
                unit = median_at_bound(cap_moments(math.radians(angle), 3), 3)
            results.append(CellMeasure(ratio(error, Measure(unit, 0.0)), angle, noise, len(part)))
    return results


def _measure_efficient(evidence: Evidence) -> list[Number]:
    results, of_mle = _over_attainable(evidence, "ugdk"), _over_attainable(evidence, "mle")
    words = "UGDK's median error over that at the attainable bound"
    if not (results and of_mle):
        return [Number.unknown(words)]
    most, quiet, beside = greatest(results), furthest_from_one(results), greatest(of_mle)
    good = sum(at.measure.value - 3.0 * at.measure.error <= 1.1 for at in results)
    least = f"{words}, σ = {quiet.relative_noise:.2g} r, at the angle where it is furthest from 1"
    return [
        Number.of(f"{words}, greatest with σ < r ({most})", most.measure, most.trials),
        Number.of(least, quiet.measure, quiet.trials),
        Number("share of the conditions with σ < r in which it is at most 1.1", good / len(results), 0.0, most.trials),
        Number.of(f"the same of MLE, greatest with σ < r ({beside})", beside.measure, beside.trials),
    ]


def _judge_efficient(numbers: list[Number]) -> Verdict:
    return on_par(numbers[0], numbers[1])


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="ugdk-efficient",
        section="10.1",
        statement="UGDK has the same efficiency with respect to the Cramér-Rao bound as slower methods: it attains it.",
        quantity="UGDK's variance along the cap's axis over the bound's, by medians, N = 1000",
        criterion="Reproduced if the greatest ratio with κ = (v/σ²)√(N/2) ≥ 20 is at most 1.1, three standard errors "
        "allowed; partly if the ratio is 1 at the smallest noise, within .1 or three standard errors; not reproduced "
        "otherwise.",
        answer="UGDK's variance along the axis is up to {0:times} the bound's; at the smallest noise it is {2:times} "
        "the bound's.",
        reads=("efficiency/errors",),
        measure=_measure_efficiency,
        judge=_judge_efficiency,
        figure="fig_efficiency",
        remark="UGDK is efficient only for σ² ≪ v/2. It subtracts σ² and not the variance that the noise has in the "
        "sample; on small caps this raises its variance by the factor 1 + 96 σ²/(r²φ⁴). Estimators that measure the "
        "noise in the same points avoid this.",
    ),
    Claim(
        name="bound-for-all",
        section="4.2",
        statement="The error of every estimator is at least the Cramér-Rao bound.",
        quantity="least root mean square error over √tr CRLB among MLE, GDKE and UGDK, in cells where it exists",
        criterion="Reproduced if the least value is at least 1, five standard errors allowed; partly if that holds "
        "only in cells without significant bias (a mean error of up to three standard errors); not reproduced "
        "otherwise.",
        answer="the least root mean square error is {0:times} the bound; where the bias is not significant it is "
        "{2:times} the bound.",
        reads=("efficiency/errors",),
        measure=_measure_bound,
        judge=_judge_bound,
        figure="fig_efficiency",
        remark="The bound holds for unbiased estimators. For σ ≥ r, GDKE and MLE stay near the points with an error of "
        "about r, while the bound grows in proportion to σ.",
    ),
    Claim(
        name="gdke-even-data",
        section="5",
        statement="GDKE estimates well if the data are evenly distributed over the whole sphere, and the worse the "
        "more they are clumped to one side.",
        quantity="GDKE's median error over bound for σ ≤ .3 r, by cap",
        criterion="Two conditions. Good: on the whole sphere the greatest error is at most 1.2 times that of an "
        "efficient estimator, three standard errors allowed, and the bias is within four standard errors of 0. Worse: "
        "the error grows from each cap to the next smaller one by two standard errors. Reproduced with both, partly "
        "with one, not reproduced with neither. All fits count.",
        answer="on the whole sphere GDKE errs up to {0:times} as far as an efficient estimator; on the smallest cap "
        "its error is up to {last:times} the bound.",
        reads=("efficiency/errors",),
        measure=_measure_even,
        judge=_judge_even,
        figure="fig_efficiency",
        remark="On the whole sphere the bias vanishes by symmetry.",
    ),
    Claim(
        name="efficient-below-distance",
        section="abstract",
        statement="The methods are statistically efficient when the measurement error is smaller than the distance "
        "from joint to marker.",
        quantity="UGDK's median error over that of a Gaussian at the attainable bound, for σ < r, N = 1000",
        criterion="Reproduced if the greatest ratio is at most 1.1, three standard errors allowed; partly if the ratio "
        "is 1 at the smallest noise, within .1 or three standard errors; not reproduced otherwise. All fits count. "
        "The attainable bound, which does not take the directions as known, is the larger of the two.",
        answer="with noise below the radius UGDK's median error is up to {0:times} that of an efficient estimator; it "
        "is efficient in {2:share} of the conditions.",
        reads=("efficiency/errors",),
        measure=_measure_efficient,
        judge=_judge_efficient,
        figure="fig_efficiency",
        remark="What counts is not σ/r alone: on a cap the noise must be small against the extent along its axis, "
        "σ² ≪ v/2, and that extent is r²φ⁴/48 on small caps.",
    ),
)

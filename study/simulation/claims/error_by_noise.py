"""Claims on error against noise: one line for all methods, the method closest to the bound, and GDKE beside MLE.

Cells of the efficiency grid that differ only in the noise share their draws, so their results at small noise are
nearly equal. If a claim's number is the greatest of many cells, its criterion allows for that selection.
"""

import math

import numpy as np
import pandas as pd

from study.arrays import Floats
from study.fits.cap import cap_moments
from study.simulation.analysis.regret import gdke_leaves
from study.simulation.analysis.summary import decade
from study.simulation.claims.claim import (
    LEAST,
    WHOLE,
    CellMeasure,
    Claim,
    Evidence,
    Number,
    Verdict,
    by_estimator,
    cells,
    error_over,
    exponent,
    furthest_from_one,
    greatest,
    has_estimators,
    in_large_groups,
    is_one,
    on_par,
    ratio,
    relative_noise,
    rows_of,
)
from study.simulation.statistics import UNKNOWN

_OTHERS = ("mle", "lls", "gdke")
_PAPERS = (*_OTHERS, "ugdk")
"""The estimators of the paper's experiment."""


# one line for all methods --------------------------------------------------------------------------------------------


def _slope(evidence: Evidence, words: str, errors: pd.DataFrame, groups: Floats) -> Number:
    """Exponent of σ/r in the average of error over r, over groups with enough data sets."""
    enough = in_large_groups(groups)
    values, at = np.asarray(error_over(errors, "radius")), np.asarray(relative_noise(errors))
    return exponent(words, at[enough], values[enough], groups[enough], evidence.average)


def _measure_slopes(evidence: Evidence) -> list[Number]:
    paper, grid = evidence.errors("paper", "error"), evidence.errors("efficiency", "error")
    words = f"exponent of σ in {{}}'s {evidence.rules.average} error over r, {{}}"
    numbers = []
    for name in _PAPERS:
        rows = rows_of(paper, name)
        decades = decade(relative_noise(rows))
        numbers.append(_slope(evidence, words.format(name.upper(), "paper's design"), rows, decades))
    angle = float(grid["angle"].min())
    moments = cap_moments(math.radians(angle), 3)
    leaves = gdke_leaves(float(grid["samples"].max()), moments)
    rows = rows_of(grid, "gdke")
    at = relative_noise(rows)
    rows = rows[(rows["angle"] == angle) & (at >= 1.5 * leaves) & (at <= 0.25 * math.sqrt(moments.along))]
    where = f"φ = {angle:g}°, 1.5 s* ≤ σ ≤ √v/4, where the bias dominates"
    numbers.append(_slope(evidence, words.format("GDKE", where), rows, np.asarray(relative_noise(rows))))
    for name in ("mle", "ugdk"):
        rows = rows_of(grid, name)
        at = relative_noise(rows)
        rows = rows[(rows["angle"] == 90.0) & (at > 0.099) & (at < 1.01)]
        where = "φ = 90°, r/10 ≤ σ ≤ r"
        numbers.append(_slope(evidence, words.format(name.upper(), where), rows, np.asarray(relative_noise(rows))))
    return numbers


def _judge_slopes(numbers: list[Number]) -> Verdict:
    if all(map(is_one, numbers)):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if is_one(numbers[0]) else Verdict.NOT_REPRODUCED


# the method closest to the bound -------------------------------------------------------------------------------------

_CLEAR = 3.0
"""A method is clearly closer than another if it errs less in more trials by this many standard errors."""
_TIE = 0.01
"""Errors that agree to this share are ties."""


def _lead(one: "pd.Series[float]", other: "pd.Series[float]") -> float:
    """Excess of data sets in which the first errs less than the second, in standard errors; ties are left out."""
    closer, farther = int((one < (1.0 - _TIE) * other).sum()), int((other < (1.0 - _TIE) * one).sum())
    return (closer - farther) / math.sqrt(max(closer + farther, 1))


def _measure_closest(evidence: Evidence) -> list[Number]:
    return compared(evidence, evidence.errors("paper", "error", "bound"))


def compared(evidence: Evidence, errors: pd.DataFrame) -> list[Number]:
    """UGDK beside the other methods: shares of decades in which it is clearly closer and farther, and two ratios."""
    closer = "share of decades of σ/r in which UGDK is clearly closer to the truth than each other method"
    farther = "share of decades of σ/r in which UGDK is clearly farther from the truth than another method"
    if not has_estimators(errors, *_PAPERS):
        return [Number.unknown(closer)]
    results, noise = (
        by_estimator(errors, error_over(errors, "bound")),
        by_estimator(errors, relative_noise(errors))["ugdk"],
    )
    decades = decade(noise)
    used = np.unique(decades[in_large_groups(decades)])
    if len(used) == 0:
        return [Number.unknown(closer)]
    leads = [[_lead(part["ugdk"], part[name]) for name in _OTHERS] for part in (results[decades == d] for d in used)]
    first = sum(min(lead) > _CLEAR for lead in leads) / len(used)
    behind = sum(min(lead) < -_CLEAR for lead in leads) / len(used)
    trials = min(int(np.sum(decades == d)) for d in used)
    large, middle = results[noise >= 1.0], results[(noise >= 0.01) & (noise < 0.1)]
    average, word = evidence.average, evidence.rules.average
    best, name = min((average(large[name]), name) for name in _OTHERS)
    above = ratio(average(large["ugdk"]), best)
    between = ratio(average(middle["ugdk"]), average(middle["mle"]))
    return [
        Number(closer, first, 0.0, trials),
        Number(farther, behind, 0.0, trials),
        Number.of(f"{word} of UGDK's error over bound, over {name.upper()}'s, σ ≥ r", above, len(large)),
        Number.of(f"{word} of UGDK's error over bound, over MLE's, .01 r ≤ σ < .1 r", between, len(middle)),
    ]


def judge_closest(numbers: list[Number]) -> Verdict:
    """Verdict on UGDK beside the other methods, by the first two numbers of `compared`."""
    alone, behind = numbers[0].value > 0.0, numbers[1].value > 0.0
    if alone and not behind:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if alone or not behind else Verdict.NOT_REPRODUCED


# GDKE beside MLE -----------------------------------------------------------------------------------------------------


def _measure_par(evidence: Evidence) -> list[Number]:
    grid = evidence.errors("efficiency", "error")
    average = evidence.average
    mle = {(angle, noise): average(error_over(part, "radius")) for angle, noise, part in cells(grid, "mle")}
    results = [
        CellMeasure(ratio(average(error_over(part, "radius")), mle[angle, noise]), angle, noise, len(part))
        for angle, noise, part in cells(grid, "gdke")
        if (angle, noise) in mle
    ]
    results = [at for at in results if not math.isnan(at.measure.value)]
    words = f"GDKE's {evidence.rules.average} error over MLE's"
    if not results:
        return [Number.unknown(words)]
    most, quiet = greatest(results), furthest_from_one(results)
    whole = [at for at in results if at.angle == WHOLE]
    even = greatest(whole) if whole else CellMeasure(UNKNOWN, WHOLE, 0.0, 0)
    least = f"{words}, σ = {quiet.relative_noise:.2g} r, at the angle where it is furthest from 1"
    return [
        Number.of(f"{words}, greatest ({most})", most.measure, most.trials),
        Number.of(least, quiet.measure, quiet.trials),
        Number.of(f"{words}, greatest on the whole sphere", even.measure, even.trials),
    ]


def _judge_par(numbers: list[Number]) -> Verdict:
    most, quiet, _ = numbers
    return on_par(most, quiet)


# noise beyond the radius, and two ranges of it ------------------------------------------------------------------------

_USELESS = 0.5
"""Error over the radius from which a centre is of no use."""


def _measure_troubles(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("paper", "error")
    numbers = []
    for name in _PAPERS:
        rows = rows_of(errors, name)
        useless = (error_over(rows, "radius") > _USELESS)[relative_noise(rows) >= 1.0]
        words = f"share of trials, σ ≥ r, in which {name.upper()}'s error exceeds half the radius"
        numbers.append(Number.share(words, useless, LEAST))
    return numbers


def _judge_troubles(numbers: list[Number]) -> Verdict:
    mostly = [number.value - 2.0 * number.error > 0.5 for number in numbers]
    if all(mostly):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if any(mostly) else Verdict.NOT_REPRODUCED


_NARROW = (1e-11, 1e12)
"""Range of σ in section 10."""


def _measure_ranges(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("paper", "error", "bound")
    inside = errors[(errors["noise"] >= _NARROW[0]) & (errors["noise"] <= _NARROW[1])]
    if not has_estimators(inside, *_PAPERS):
        return [Number.unknown("UGDK beside the others over section 10's range of noise")]
    narrow, wide = (compared(evidence, table) for table in (inside, errors))
    return [
        *(n._replace(words=f"{n.words}, 1e-11 ≤ σ ≤ 1e12") for n in narrow[:2]),
        *(n._replace(words=f"{n.words}, 1e-13 ≤ σ ≤ 1e14") for n in wide[:2]),
    ]


def _judge_ranges(numbers: list[Number]) -> Verdict:
    narrow, wide = numbers[:2], numbers[2:]
    if judge_closest(narrow) == judge_closest(wide):
        alike = all(abs(a.value - b.value) <= 0.1 for a, b in zip(narrow, wide, strict=True))
        return Verdict.REPRODUCED if alike else Verdict.PARTLY
    return Verdict.NOT_REPRODUCED


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="one-line",
        section="4.1",
        statement="Relative error against relative noise is a straight line for each of the four methods: the error is "
        "proportional to the standard deviation.",
        quantity="exponents of σ in the median error over r",
        criterion="Reproduced if all exponents are 1 within .1 or three standard errors, over the paper's 27 decades "
        "and in parts of the range; partly if MLE's is over the whole range; not reproduced otherwise. All fits count "
        "as computed.",
        answer="over the paper's range MLE's median error grows as σ to the power {0:power}; where GDKE's bias "
        "dominates, GDKE's as σ to the power {4:power}.",
        reads=("paper/errors", "efficiency/errors"),
        measure=_measure_slopes,
        judge=_judge_slopes,
        figure="fig2_error",
        remark="A fit over 27 decades hides the two decades below σ = r. There GDKE's error is its bias, of order σ², "
        "above s* = r√(Kₐ/N)/m₁; MLE's and GDKE's errors level off at the distance of the centroid; UGDK's error rises "
        "by a factor of the order of √N.",
    ),
    Claim(
        name="ugdk-closest",
        section="4.1",
        statement="UGDK is consistently close to the Cramér-Rao bound, closer than the other methods.",
        quantity="errors of the four methods on the same points, by decade of σ/r",
        criterion="In a decade one method is clearly closer than another if it errs less in more trials, by three "
        "standard errors of the difference, without the trials that agree to 1 %. Two conditions: UGDK is clearly "
        "closer than each other method in some decade; no method is clearly closer than UGDK in any decade. Reproduced "
        "with both, partly with one, not reproduced with neither. All fits count as computed.",
        answer="UGDK is clearly the closest in {0:share} of the decades of noise, and another method is clearly "
        "closer in {1:share}.",
        reads=("paper/errors",),
        measure=_measure_closest,
        judge=judge_closest,
        figure="fig2_error",
        remark="Up to σ ≈ .01 r the methods agree, apart from GDKE's bias. Above σ ≈ .3 r the matrix C - Σ̂ is mostly "
        "not positive definite; then UGDK's error is of order σ, while the others' is σ/√N.",
        heads={
            Verdict.REPRODUCED: "The paper's main claim holds{otherwise}.",
            Verdict.PARTLY: "The paper's main claim holds in part{otherwise}.",
            Verdict.NOT_REPRODUCED: "The paper's main claim does not hold{otherwise}.",
        },
        story="It says that UGDK comes closest to the Cramér-Rao bound. UGDK is clearly the closest in {0:share} of "
        "the decades of noise; another method is clearly closer in {1:share}. With noise above the radius it errs "
        "{2:times} as far as the best of the others.",
    ),
    Claim(
        name="gdke-on-par",
        section="4.1",
        statement="GDKE is on par with MLE, except for MLE's outliers.",
        quantity="median error of GDKE over that of MLE, N = 1000",
        criterion="Reproduced if the greatest ratio is at most 1.1, three standard errors allowed; partly if the "
        "ratios at the smallest noise are 1 within .1 or three standard errors; not reproduced otherwise. All fits "
        "count.",
        answer="GDKE's median error is up to {0:times} MLE's; at the smallest noise it is {1:times} MLE's.",
        reads=("efficiency/errors",),
        measure=_measure_par,
        judge=_judge_par,
        figure="fig_efficiency",
        remark="They are on par where GDKE's bias is below its scatter: for σ < s* = r√(Kₐ/N)/m₁, and on the whole "
        "sphere, where there is no bias. Elsewhere the ratio grows as √N.",
    ),
    Claim(
        name="troubles-beyond-radius",
        section="6",
        statement="All methods have troubles where the measurement error is larger than the item that is measured.",
        quantity="share of trials with σ ≥ r in which each of the four methods errs by more than half the radius",
        criterion="Reproduced if each method errs so far in more than half of the trials, by two standard errors; "
        "partly if some method does; not reproduced otherwise. All fits count.",
        answer="with noise above the radius MLE errs by more than half the radius in {0:share} of the trials, LLS in "
        "{1:share}, GDKE in {2:share} and UGDK in {3:share}.",
        reads=("paper/errors",),
        measure=_measure_troubles,
        judge=_judge_troubles,
        figure="fig2_error",
        remark="The bound itself exceeds the radius there, unless there are very many samples.",
    ),
    Claim(
        name="noise-ranges",
        section="4.1, 10",
        statement="The standard deviation of the samples goes from 1e-13 to 1e14 (§4.1); the measurement error varies "
        "from 1e-11 to 1e12 (§10).",
        quantity="shares of decades of σ/r in which UGDK is clearly closer, and clearly farther, over either range",
        criterion="Reproduced, in that it makes no difference, if the main claim's verdict is the same over both "
        "ranges and its shares agree within .1; partly if only the verdict is the same; not reproduced otherwise.",
        answer="over section 10's range UGDK is clearly the closest in {0:share} of the decades and clearly farther in "
        "{1:share}; over section 4.1's in {2:share} and {3:share}.",
        reads=("paper/errors",),
        measure=_measure_ranges,
        judge=_judge_ranges,
        figure="fig2_error",
        remark="The paper gives two ranges of the same experiment; the study has the wider one.",
    ),
)

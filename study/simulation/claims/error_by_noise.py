"""Claims on error against noise: one line for all methods, the method closest to the bound, and GDKE beside MLE.

Cells of the efficiency grid that differ only in the noise share their draws, so their results at small noise are
nearly equal. If a claim's number is the greatest of many cells, its criterion allows for that selection.
"""

import math

import numpy as np
import pandas as pd

from study.arrays import Floats
from study.fits.cap import cap_moments
from study.simulation.analysis.error_table import decade
from study.simulation.analysis.theory import gdke_leaves
from study.simulation.claims import claim as shared
from study.simulation.claims.claim import Claim, Evidence, Number, Verdict
from study.simulation.statistics import UNKNOWN, Measure

_OTHERS = ("mle", "lls", "gdke")
_PAPERS = (*_OTHERS, "ugdk")
"""The estimators of the paper's experiment."""


# one line for all methods --------------------------------------------------------------------------------------------


def _slope(evidence: Evidence, words: str, errors: pd.DataFrame, groups: Floats) -> Number:
    """Exponent of σ/r in the average of error over r, over groups with enough data sets."""
    enough = shared.in_large_groups(groups)
    values, at = shared.error_over(errors, "radius"), shared.relative_noise(errors)
    return shared.exponent(words, at[enough], values[enough], groups[enough], evidence.average)


class OneLine(Claim):
    """Relative error against relative noise is a straight line for each of the four methods: the error is
    proportional to the standard deviation.

    A fit over 27 decades hides the two decades below σ = r. There GDKE's error is its bias, of order σ², above s* =
    r√(Kₐ/N)/m₁; MLE's and GDKE's errors level off at the distance of the centroid; UGDK's error rises by a factor
    of the order of √N.
    """

    number, name, section, figure = 1, "one-line", "4.1", "fig2_error"
    reads = ("paper/errors", "efficiency/errors")
    quantity = "exponents of σ in the median error over r"
    answer = """
        over the paper's range MLE's median error grows as σ to the power {0:power}; where GDKE's bias dominates, GDKE's
        as σ to the power {4:power}.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        paper, grid = evidence.errors("paper"), evidence.errors("efficiency")
        words = f"exponent of σ in {{}}'s {evidence.rules.average} error over r, {{}}"
        numbers = []
        for name in _PAPERS:
            rows = shared.rows_of(paper, name)
            decades = decade(shared.relative_noise(rows))
            numbers.append(_slope(evidence, words.format(name.upper(), "paper's design"), rows, decades))
        angle = float(grid["angle"].min())
        moments = cap_moments(math.radians(angle), 3)
        leaves = gdke_leaves(float(grid["samples"].max()), moments)
        where = f"φ = {angle:g}°, 1.5 s* ≤ σ ≤ √v/4, where the bias dominates"
        ranges = [("gdke", where, angle, 1.5 * leaves, 0.25 * math.sqrt(moments.along))]
        ranges += [(name, "φ = 90°, r/10 ≤ σ ≤ r", 90.0, 0.099, 1.01) for name in ("mle", "ugdk")]
        for name, where, half_angle, low, high in ranges:
            rows = shared.rows_of(grid, name)
            at = shared.relative_noise(rows)
            rows = rows[(rows["angle"] == half_angle) & (at >= low) & (at <= high)]
            numbers.append(_slope(evidence, words.format(name.upper(), where), rows, shared.relative_noise(rows)))
        return numbers

    def judge(self, numbers: list[Number]) -> Verdict:
        """Reproduced if all exponents are 1 within .1 or three standard errors, over the paper's 27 decades and
        in parts of the range; partly if MLE's is over the whole range; not reproduced otherwise. All fits count
        as computed.
        """
        return Verdict.graded(all(map(shared.is_one, numbers)), shared.is_one(numbers[0]))


# the method closest to the bound -------------------------------------------------------------------------------------

_CLEAR = 3.0
"""A method is clearly closer than another if it errs less in more trials by this many standard errors."""
_TIE = 0.01
"""Errors that agree to this share are ties."""


def _lead(one: "pd.Series[float]", other: "pd.Series[float]") -> float:
    """Excess of data sets in which the first errs less than the second, in standard errors; ties are left out."""
    closer, farther = int((one < (1.0 - _TIE) * other).sum()), int((other < (1.0 - _TIE) * one).sum())
    return (closer - farther) / math.sqrt(max(closer + farther, 1))


def compared(evidence: Evidence, errors: pd.DataFrame) -> list[Number]:
    """UGDK beside the other methods: shares of decades in which it is clearly closer and farther, and two ratios."""
    closer = "share of decades of σ/r in which UGDK is clearly closer to the truth than each other method"
    farther = "share of decades of σ/r in which UGDK is clearly farther from the truth than another method"
    if not shared.has_estimators(errors, *_PAPERS):
        return [Number.unknown(closer)]
    results = shared.by_estimator(errors, shared.error_over(errors, "bound"))
    noise = shared.by_estimator(errors, shared.relative_noise(errors))["ugdk"]
    decades = decade(noise)
    used = np.unique(decades[shared.in_large_groups(decades)])
    if len(used) == 0:
        return [Number.unknown(closer)]
    leads = [[_lead(part["ugdk"], part[name]) for name in _OTHERS] for part in (results[decades == d] for d in used)]
    first = sum(min(lead) > _CLEAR for lead in leads) / len(used)
    behind = sum(min(lead) < -_CLEAR for lead in leads) / len(used)
    trials = min(int(np.sum(decades == d)) for d in used)
    large, middle = results[noise >= 1.0], results[(noise >= 0.01) & (noise < 0.1)]
    average, word = evidence.average, evidence.rules.average
    best, name = min((average(large[name]), name) for name in _OTHERS)
    above = shared.ratio(average(large["ugdk"]), best)
    between = shared.ratio(average(middle["ugdk"]), average(middle["mle"]))
    return [
        Number(closer, first, 0.0, trials),
        Number(farther, behind, 0.0, trials),
        Number.of(f"{word} of UGDK's error over bound, over {name.upper()}'s, σ ≥ r", above, len(large)),
        Number.of(f"{word} of UGDK's error over bound, over MLE's, .01 r ≤ σ < .1 r", between, len(middle)),
    ]


def judge_closest(numbers: list[Number]) -> Verdict:
    """Verdict on UGDK beside the other methods, by the first two numbers of `compared`."""
    alone, behind = numbers[0].value > 0.0, numbers[1].value > 0.0
    return Verdict.graded(alone and not behind, alone or not behind)


class UgdkClosest(Claim):
    """UGDK is consistently close to the Cramér-Rao bound, closer than the other methods.

    Up to σ ≈ .01 r the methods agree, apart from GDKE's bias. Above σ ≈ .3 r the matrix C - Σ̂ is mostly not
    positive definite; then UGDK's error is of order σ, while the others' is σ/√N.
    """

    number, name, section, figure = 2, "ugdk-closest", "4.1", "fig2_error"
    reads = ("paper/errors",)
    quantity = "errors of the four methods on the same points, by decade of σ/r"
    answer = """
        UGDK is clearly the closest in {0:share} of the decades of noise, and another method is clearly closer in
        {1:share}.
    """
    heads = (
        "The paper's main claim holds{otherwise}.",
        "The paper's main claim holds in part{otherwise}.",
        "The paper's main claim does not hold{otherwise}.",
    )
    story = """
        It says that UGDK comes closest to the Cramér-Rao bound. UGDK is clearly the closest in {0:share} of the decades
        of noise; another method is clearly closer in {1:share}. With noise above the radius it errs {2:times} as far as
        the best of the others.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        return compared(evidence, evidence.errors("paper"))

    def judge(self, numbers: list[Number]) -> Verdict:
        """In a decade one method is clearly closer than another if it errs less in more trials, by three
        standard errors of the difference, without the trials that agree to 1 %. Two conditions: UGDK is clearly
        closer than each other method in some decade; no method is clearly closer than UGDK in any decade.
        Reproduced with both, partly with one, not reproduced with neither. All fits count as computed.
        """
        return judge_closest(numbers)


# GDKE beside MLE -----------------------------------------------------------------------------------------------------


class GdkeOnPar(Claim):
    """GDKE is on par with MLE, except for MLE's outliers.

    They are on par where GDKE's bias is below its scatter: for σ < s* = r√(Kₐ/N)/m₁, and on the whole sphere, where
    there is no bias. Elsewhere the ratio grows as √N.
    """

    number, name, section, figure = 3, "gdke-on-par", "4.1", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "median error of GDKE over that of MLE, N = 1000"
    answer = "GDKE's median error is up to {0:times} MLE's; at the smallest noise it is {1:times} MLE's."

    def measure(self, evidence: Evidence) -> list[Number]:
        grid = evidence.errors("efficiency")

        def average(part: pd.DataFrame, *_: float) -> Measure:
            return evidence.average(shared.error_over(part, "radius"))

        of_mle = {(at.angle, at.relative_noise): at.measure for at in shared.in_cells(grid, "mle", average)}

        def over_mle(part: pd.DataFrame, angle: float, noise: float) -> Measure:
            return shared.ratio(average(part), of_mle.get((angle, noise), UNKNOWN))

        results = shared.in_cells(grid, "gdke", over_mle)
        words = f"GDKE's {evidence.rules.average} error over MLE's"
        if not results:
            return [Number.unknown(words)]
        most, whole = shared.greatest(results), [at for at in results if at.angle == shared.WHOLE]
        even = shared.greatest(whole) if whole else shared.CellMeasure(UNKNOWN, shared.WHOLE, 0.0, 0)
        return [
            most.number(f"{words}, greatest ({most})"),
            shared.furthest_from_one(words, results),
            even.number(f"{words}, greatest on the whole sphere"),
        ]

    def judge(self, numbers: list[Number]) -> Verdict:
        """Reproduced if the greatest ratio is at most 1.1, three standard errors allowed; partly if the ratios
        at the smallest noise are 1 within .1 or three standard errors; not reproduced otherwise. All fits
        count.
        """
        return shared.on_par(numbers[0], numbers[1])


# noise beyond the radius, and two ranges of it ------------------------------------------------------------------------

_USELESS = 0.5
"""Error over the radius from which a centre is of no use."""


class TroublesBeyondRadius(Claim):
    """All methods have troubles where the measurement error is larger than the item that is measured.

    The bound itself exceeds the radius there, unless there are very many samples.
    """

    number, name, section, figure = 25, "troubles-beyond-radius", "6", "fig2_error"
    reads = ("paper/errors",)
    quantity = "share of trials with σ ≥ r in which each of the four methods errs by more than half the radius"
    answer = """
        with noise above the radius MLE errs by more than half the radius in {0:share} of the trials, LLS in {1:share},
        GDKE in {2:share} and UGDK in {3:share}.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("paper")
        numbers = []
        for name in _PAPERS:
            rows = shared.rows_of(errors, name)
            useless = (shared.error_over(rows, "radius") > _USELESS)[shared.relative_noise(rows) >= 1.0]
            words = f"share of trials, σ ≥ r, in which {name.upper()}'s error exceeds half the radius"
            numbers.append(Number.share(words, useless, shared.LEAST))
        return numbers

    def judge(self, numbers: list[Number]) -> Verdict:
        """Reproduced if each method errs so far in more than half of the trials, by two standard errors; partly
        if some method does; not reproduced otherwise. All fits count.
        """
        mostly = [number.value - 2.0 * number.error > 0.5 for number in numbers]
        return Verdict.graded(all(mostly), any(mostly))


_NARROW = (1e-11, 1e12)
"""Range of σ in section 10."""


class NoiseRanges(Claim):
    """The standard deviation of the samples goes from 1e-13 to 1e14 (§4.1); the measurement error varies from 1e-11
    to 1e12 (§10).

    The paper gives two ranges of the same experiment; the study has the wider one.
    """

    number, name, section, figure = 28, "noise-ranges", "4.1, 10", "fig2_error"
    reads = ("paper/errors",)
    quantity = "shares of decades of σ/r in which UGDK is clearly closer, and clearly farther, over either range"
    answer = """
        over section 10's range UGDK is clearly the closest in {0:share} of the decades and clearly farther in
        {1:share}; over section 4.1's in {2:share} and {3:share}.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("paper")
        inside = errors[(errors["noise"] >= _NARROW[0]) & (errors["noise"] <= _NARROW[1])]
        if not shared.has_estimators(inside, *_PAPERS):
            return [Number.unknown("UGDK beside the others over section 10's range of noise")]
        narrow, wide = (compared(evidence, table) for table in (inside, errors))
        return [
            *(n._replace(words=f"{n.words}, 1e-11 ≤ σ ≤ 1e12") for n in narrow[:2]),
            *(n._replace(words=f"{n.words}, 1e-13 ≤ σ ≤ 1e14") for n in wide[:2]),
        ]

    def judge(self, numbers: list[Number]) -> Verdict:
        """Reproduced, in that it makes no difference, if the main claim's verdict is the same over both ranges
        and its shares agree within .1; partly if only the verdict is the same; not reproduced otherwise.
        """
        narrow, wide = numbers[:2], numbers[2:]
        same = judge_closest(narrow) == judge_closest(wide)
        alike = all(abs(a.value - b.value) <= 0.1 for a, b in zip(narrow, wide, strict=True))
        return Verdict.graded(same and alike, same)

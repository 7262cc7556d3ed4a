"""Claims on error against noise: one line for all methods, the method closest to the bound, and GDKE beside MLE.

Cells of the efficiency grid that differ only in the noise share their draws, so their results at small noise are
nearly equal. If a claim's number is the greatest of many cells, its criterion allows for that selection.
"""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.arrays import Bools, Floats
from study.fits.points.cap import cap_moments
from study.simulation.analysis.error_table import decade
from study.simulation.analysis.theory import gdke_leaves
from study.simulation.claims import claim as shared
from study.simulation.claims.claim import Claim, Evidence, Number
from study.simulation.statistics import UNKNOWN, Measure, share

_OTHERS = ("mle", "lls", "gdke")
_PAPERS = (*_OTHERS, "ugdk")
"""The estimators of the paper's experiment."""


# one line for all methods --------------------------------------------------------------------------------------------


def _slope(evidence: Evidence, words: str, errors: pd.DataFrame, groups: Floats) -> Number:
    """Exponent of σ/r in the average of error over r, over groups with enough data sets."""
    enough = shared.in_large_groups(groups)
    values, at = shared.error_over(errors, "radius"), shared.relative_noise(errors)
    return shared.exponent(words, at[enough], values[enough], groups[enough], evidence.average)


def of_decades(evidence: Evidence, errors: pd.DataFrame, estimator: str) -> Iterator[Measure]:
    """Excess of an estimator's error over bound, in each decade of σ/r, over a factor of two.

    The unit is its error over bound for σ < .01 r. Decades with too few trials are left out.
    """
    rows = shared.rows_of(errors, estimator)
    at, over_bound = shared.relative_noise(rows), shared.error_over(rows, "bound")
    small, decades = evidence.average(over_bound[at < 0.01]), decade(at)
    for one in np.unique(decades[shared.in_large_groups(decades)]):
        yield shared.of_order(evidence.average(over_bound[decades == one]), small)


def _off_the_line(evidence: Evidence, errors: pd.DataFrame) -> Iterator[Measure]:
    for name in _PAPERS:
        yield from of_decades(evidence, errors, name)


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
    criterion = """
        share of decades of σ/r, over the paper's range and its four methods, in which the median of error over bound is
        within a factor of two of the same method's for σ < .01 r
    """
    answer = """
        over the paper's range MLE's median error grows as σ to the power {1:power}; where GDKE's bias dominates, GDKE's
        as σ to the power {5:power}.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        paper, grid = evidence.errors("paper"), evidence.errors("efficiency")
        words = f"exponent of σ in {{}}'s {evidence.rules.average} error over r, {{}}"
        numbers = [shared.holding(self.criterion, _off_the_line(evidence, paper))]
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


# the method closest to the bound -------------------------------------------------------------------------------------

_CLEAR = 3.0
"""A method is clearly closer than another if it errs less in more trials by this many standard errors."""
_TIE = 0.01
"""Errors that agree to this share are ties."""


def _lead(one: "pd.Series[float]", other: "pd.Series[float]") -> float:
    """Excess of data sets in which the first errs less than the second, in standard errors; ties are left out."""
    closer, farther = int((one < (1.0 - _TIE) * other).sum()), int((other < (1.0 - _TIE) * one).sum())
    return (closer - farther) / math.sqrt(max(closer + farther, 1))


def _by_decade(evidence: Evidence, errors: pd.DataFrame) -> list[Number]:
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
    first = shared.holding(closer, (Measure(_CLEAR - min(lead), 1.0) for lead in leads))
    behind = shared.holding(farther, (Measure(min(lead) + _CLEAR, 1.0) for lead in leads))
    trials = min(int(np.sum(decades == d)) for d in used)
    large, middle = results[noise >= 1.0], results[(noise >= 0.01) & (noise < 0.1)]
    average, word = evidence.average, evidence.rules.average
    best, name = min((average(large[name]), name) for name in _OTHERS)
    above = shared.ratio(average(large["ugdk"]), best)
    between = shared.ratio(average(middle["ugdk"]), average(middle["mle"]))
    return [
        first._replace(trials=trials),
        behind._replace(trials=trials),
        Number.of(f"{word} of UGDK's error over bound, over {name.upper()}'s, σ ≥ r", above, len(large)),
        Number.of(f"{word} of UGDK's error over bound, over MLE's, .01 r ≤ σ < .1 r", between, len(middle)),
    ]


_GRIDS = ("mle", "gdke")
"""The other methods of the grid: LLS is GDKE's fit by another program."""


def _beside_best(grid: pd.DataFrame) -> list[shared.CellMeasure]:
    """UGDK's median error over the least of the other methods', in each cell of the grid."""
    if not shared.has_estimators(grid, "ugdk", *_GRIDS):
        return []
    errors = {name: {at[:2]: shared.error_over(at[2], "radius") for at in shared.cells(grid, name)} for name in _GRIDS}

    def over_best(part: pd.DataFrame, angle: float, noise: float) -> Measure:
        own, others = shared.error_over(part, "radius"), [of[angle, noise] for of in errors.values()]
        best = min(others, key=lambda values: float(np.median(values)))
        return shared.paired_ratio(own, best) if len(own) >= shared.LEAST else UNKNOWN

    return shared.in_cells(grid, "ugdk", over_best)


class UgdkClosest(Claim):
    """UGDK is consistently close to the Cramér-Rao bound, closer than the other methods.

    Up to σ ≈ .01 r the methods agree, apart from GDKE's bias. Above σ ≈ .3 r the matrix C - Σ̂ is mostly not
    positive definite; then UGDK's error is of order σ, while the others' is σ/√N.
    """

    number, name, section, figure = 2, "ugdk-closest", "4.1", "fig2_error"
    reads = ("efficiency/errors", "paper/errors")
    quantity = "errors of the methods on the same points, in the cells of a grid and by decade of σ/r"
    criterion = """
        share of the cells of the grid (σ/r from 1e-4 to 3.2, caps of 20° to 180°, N = 1000) in which UGDK's median
        error is below each other method's by more than 1 %; a tie is not closer
    """
    answer = """
        UGDK's median error is the least in {0:share} of the cells of the grid, level with the least in {1:share} and
        above it in {2:share}; at worst it is {3:times} the least.
    """
    heads = (
        "The paper's main claim holds{otherwise}.",
        "The paper's main claim holds in part{otherwise}.",
        "The paper's main claim does not hold{otherwise}.",
    )
    story = """
        It says that UGDK comes closest to the Cramér-Rao bound. Its median error is the least in {0:share} of the cells
        of the grid and above the least in {2:share}. In the paper's own trials UGDK is clearly the closest in {4:share}
        of the decades of noise, and another method is clearly closer in {5:share}.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        results = _beside_best(evidence.errors("efficiency"))
        words = "UGDK's median error over the least of the others'"
        if not results:
            return [Number.unknown(self.criterion)]
        ratios, most = [at.measure for at in results], shared.greatest(results)
        return [
            shared.holding(self.criterion, (shared.above(one, 1.0 - _TIE) for one in ratios)),
            shared.holding(
                "share of the cells in which it is within 1 % of the least",
                (shared.apart(one, 1.0, _TIE) for one in ratios),
            ),
            shared.holding(
                "share of the cells in which it is above the least by more than 1 %",
                (Measure(1.0 + _TIE - one.value, one.error) for one in ratios),
            ),
            most.number(f"{words}, greatest ({most})"),
            *_by_decade(evidence, evidence.errors("paper")),
        ]


# GDKE beside MLE -----------------------------------------------------------------------------------------------------


class GdkeOnPar(Claim):
    """GDKE is on par with MLE, except for MLE's outliers.

    They are on par where GDKE's bias is below its scatter: for σ < s* = r√(Kₐ/N)/m₁, and on the whole sphere, where
    there is no bias. Elsewhere the ratio grows as √N.
    """

    number, name, section, figure = 3, "gdke-on-par", "4.1", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "median error of GDKE over that of MLE, N = 1000"
    criterion = """
        share of the cells of the grid (σ/r from 1e-4 to 3.2, caps of 20° to 180°) in which GDKE's median error is at
        most 1.1 times MLE's
    """
    answer = "GDKE's median error is up to {1:times} MLE's; at the smallest noise it is {2:times} MLE's."

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
            return [Number.unknown(self.criterion)]
        most, whole = shared.greatest(results), [at for at in results if at.angle == shared.WHOLE]
        even = shared.greatest(whole) if whole else shared.CellMeasure(UNKNOWN, shared.WHOLE, 0.0, 0)
        return [
            shared.holding(self.criterion, (shared.above(at.measure, 1.1) for at in results)),
            most.number(f"{words}, greatest ({most})"),
            shared.furthest_from_one(words, results),
            even.number(f"{words}, greatest on the whole sphere"),
        ]


# noise beyond the radius ---------------------------------------------------------------------------------------------

_USELESS = 0.5
"""Error over the radius from which a centre is of no use."""


class TroublesBeyondRadius(Claim):
    """All methods have troubles where the measurement error is larger than the item that is measured.

    The bound itself exceeds the radius there, unless there are very many samples.
    """

    number, name, section, figure = 25, "troubles-beyond-radius", "6", "fig2_error"
    reads = ("paper/errors",)
    quantity = "share of trials with σ ≥ r in which each of the four methods errs by more than half the radius"
    criterion = "share of trials with σ ≥ r, all four methods together, in which the error exceeds half the radius"
    answer = """
        with noise above the radius MLE errs by more than half the radius in {1:share} of the trials, LLS in {2:share},
        GDKE in {3:share} and UGDK in {4:share}.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("paper")
        numbers, every = list[Number](), list[Bools]()
        for name in _PAPERS:
            rows = shared.rows_of(errors, name)
            every.append((shared.error_over(rows, "radius") > _USELESS)[shared.relative_noise(rows) >= 1.0])
            words = f"share of trials, σ ≥ r, in which {name.upper()}'s error exceeds half the radius"
            numbers.append(Number.share(words, every[-1], shared.LEAST))
        # the methods share their trials, which are counted once
        value, trials = float(np.mean([number.value for number in numbers])), min(number.trials for number in numbers)
        return [Number.of(self.criterion, share(value * trials, trials), trials), *numbers]

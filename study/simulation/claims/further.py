"""Claims of the abstract and of asides: efficiency, large noise, two answers, two factors, and two ranges of noise."""

import math

from study.fits.cap import cap_moments
from study.simulation.analysis.regret import median_at_bound, median_attainable
from study.simulation.claims import costs, error_by_noise
from study.simulation.claims.claim import (
    LEAST,
    CellMeasure,
    Claim,
    Evidence,
    Number,
    Verdict,
    cells,
    error_over,
    furthest_from_one,
    greatest,
    has_estimators,
    median,
    on_par,
    ratio,
    relative_noise,
    rows_of,
)
from study.simulation.claims.recordings import hinge_spreads
from study.simulation.statistics import Measure

# efficient where the noise is below the radius ---------------------------------------------------------------------


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


# noise beyond the radius ---------------------------------------------------------------------------------------------

_PAPERS = ("mle", "lls", "gdke", "ugdk")
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


# two answers at hinges -----------------------------------------------------------------------------------------------


def _measure_hinges(evidence: Evidence) -> list[Number]:
    return hinge_spreads(evidence.spreads())


def _judge_hinges(numbers: list[Number]) -> Verdict:
    hinges, others = numbers[:2]
    more = hinges.value - others.value
    if more - 2.0 * math.hypot(hinges.error, others.error) > 0.0:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if more > 0.0 else Verdict.NOT_REPRODUCED


# the abstract's factors ----------------------------------------------------------------------------------------------


def _measure_factors(evidence: Evidence) -> list[Number]:
    return [costs.over_gdke(evidence, "lls"), costs.mle_over_gdke(evidence, longest=True), costs.formula(evidence)]


def _judge_factors(numbers: list[Number]) -> Verdict:
    lls, mle, formula = numbers[:3]
    hits = costs.near(lls, 9.0), mle.value >= 75.0
    if all(hits):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if any(hits) or costs.near(formula, 9.0) else Verdict.NOT_REPRODUCED


# two ranges of the noise ---------------------------------------------------------------------------------------------

_NARROW = (1e-11, 1e12)
"""Range of σ in section 10."""


def _measure_ranges(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("paper", "error", "bound")
    inside = errors[(errors["noise"] >= _NARROW[0]) & (errors["noise"] <= _NARROW[1])]
    if not has_estimators(inside, *_PAPERS):
        return [Number.unknown("UGDK beside the others over section 10's range of noise")]
    narrow, wide = (error_by_noise.compared(evidence, table) for table in (inside, errors))
    return [
        *(n._replace(words=f"{n.words}, 1e-11 ≤ σ ≤ 1e12") for n in narrow[:2]),
        *(n._replace(words=f"{n.words}, 1e-13 ≤ σ ≤ 1e14") for n in wide[:2]),
    ]


def _judge_ranges(numbers: list[Number]) -> Verdict:
    narrow, wide = numbers[:2], numbers[2:]
    if error_by_noise.judge_closest(narrow) == error_by_noise.judge_closest(wide):
        alike = all(abs(a.value - b.value) <= 0.1 for a, b in zip(narrow, wide, strict=True))
        return Verdict.REPRODUCED if alike else Verdict.PARTLY
    return Verdict.NOT_REPRODUCED


CLAIMS: tuple[Claim, ...] = (
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
        name="two-answers",
        section="9.1",
        statement="At ankles and elbows repeated fits to one recording gave two answers, because of the orientation of "
        "the parent segment.",
        quantity="share of spreads of a centimetre or more above 200 samples, of hinges and of other joints, every "
        "axis fitted as in the paper",
        criterion="Reproduced if the share is larger for hinges than for other joints by two standard errors over "
        "joints; partly if it is larger; not reproduced otherwise.",
        answer="{0:share} of the spreads of hinges are a centimetre or more, and {1:share} of those of other joints.",
        reads=("case-study",),
        measure=_measure_hinges,
        judge=_judge_hinges,
        remark="A marker on a hinge moves on a circle. Two spheres, mirror images in the circle's plane, fit it "
        "equally, and every centre on the axis fits nearly as well: so random frames give one answer or the other.",
    ),
    Claim(
        name="speed-abstract",
        section="abstract, 10.1",
        statement="The closed forms are about 9 times faster than LLS and as much as about 100 times faster than MLE; "
        "or 10 and 100 times.",
        quantity="operations of LLS, and of the longest fit of MLE, over GDKE's",
        criterion="Reproduced if LLS's operations are within 25 % of 9 times GDKE's, and those of the longest MLE fit "
        "are 75 times or more; partly if one of them is, or LLS's by the paper's own formulas; not reproduced "
        "otherwise.",
        answer="LLS takes {0:times} the operations of GDKE, and {2:times} by the paper's own formulas; the longest fit "
        "of MLE takes {1:times}.",
        reads=("cost", "paper/errors"),
        measure=_measure_factors,
        judge=_judge_factors,
        remark="Section 10 has 11.05 and about 80 times. The formula of LLS over that of GDKE is 236/26 = 9.08 for "
        "many samples, the abstract's 9, and 11.09 for four.",
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

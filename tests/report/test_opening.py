"""The top of the page: findings and answers say what the numbers say, whatever they are."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest

from study.analysis.claims import CLAIMS
from study.analysis.claims.claim import Number, Verdict
from study.figures.fig_efficiency import EfficiencyFrame
from study.report import findings as found
from study.report import words
from study.report.answers import ANSWERS, answer, parts, power, times
from study.report.blocks import InlineCode, coded
from study.report.pictures import draw_lead


def finding(*values):
    """Lines of a claim's numbers, as the claims table has them."""
    return "\n".join(str(Number(f"a: number {i}", value, 0.1 * i, 7)) for i, value in enumerate(values))


def judged(name, verdict, *values, number=2):
    """A row of the claims table, as far as the findings read it."""
    return {"number": number, "name": name, "verdict": str(verdict), "finding": finding(*values)}


@pytest.fixture(scope="module")
def efficiency():
    """Three estimators on two caps: `als` twice as far as `mle` below the radius, much nearer beyond."""
    rows = [
        {"angle": angle, "estimator": name, "level": level, "ratio": ratio if level < 1 else 1 / ratio, "error": 0.01}
        for angle in (30.0, 60.0)
        for level in (0.1, 0.3, 10.0)
        for name, ratio in (("mle", 1.5), ("als", 3.0), ("ugdk", 6.0))
    ]
    reached = pd.DataFrame([{"angle": a, "level": n, "ratio": 2.0} for a in (30.0, 60.0) for n in (0.1, 0.3, 10.0)])
    marks = pd.DataFrame({"angle": [30.0, 60.0], "gdke": 0.1, "ugdk": 0.1, "fails": 0.1})
    return EfficiencyFrame(pd.DataFrame(rows).assign(trials=9), reached, marks, 100, "made up")


def test_every_claim_has_an_answer():
    """A claim without one would be answered by a bare number."""
    assert set(ANSWERS) == {claim.name for claim in CLAIMS}


@pytest.mark.parametrize("claim", CLAIMS, ids=[claim.name for claim in CLAIMS])
def test_answers_are_sentences(claim):
    """An answer begins with its verdict, has a number in it, and ends; it fits the numbers that the judge reads."""
    text = answer(claim.name, "partly", finding(0.25, 0.5, 0.75, 1.5, 2.5))
    assert text.startswith("In part: ")
    assert text.endswith(".")
    assert any(digits in text for digits in ("25", "50", "0.75", "1.5", "2.5"))


def test_answers_follow_the_verdict_and_the_numbers():
    """The same claim with other numbers."""
    none = answer("ugdk-closest", "not reproduced", finding(0.0, 13 / 28, 25.96, 1.073))
    assert none == (
        "No: UGDK is clearly the closest in none of the decades of noise, and another method is clearly closer in "
        "46\u00a0%."
    )
    most = answer("ugdk-closest", "reproduced", finding(0.75, 0.0, 1.0, 1.0))
    assert most.startswith("Yes: UGDK is clearly the closest in 75\u00a0% of the decades")


@pytest.mark.parametrize("name", ["unheard-of", "one-line"])
def test_an_answer_without_its_numbers(name):
    """A claim of another version is answered by its first number."""
    assert answer(name, "reproduced", "an exponent: 2.5 ± 0.1\nanother: 3") == "Yes: an exponent: 2.50\u00a0±\u00a00.10"
    assert answer(name, "hardly", "no number") == "Hardly: no number"


def test_numbers_in_words():
    """Shares, ratios and exponents as a reader says them."""
    assert [parts(share) for share in (0.0, 1.0, 0.1386, 0.996)] == ["none", "all", "14\u00a0%", "99.6\u00a0%"]
    assert [times(value) for value in (0.176, 1.0, 25.96, 1234.0)] == [
        "0.18\u00a0times",
        "1.0\u00a0times",
        "26\u00a0times",
        "1.23\u00a0×\u00a010³\u00a0times",
    ]
    assert power(-0.5022) == "−0.50"
    assert words.values(finding(1.5, math.nan, math.inf))[::2] == [1.5, math.inf]


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        (Verdict.REPRODUCED, "The paper's main claim holds."),
        (Verdict.PARTLY, "The paper's main claim holds in part."),
        (Verdict.NOT_REPRODUCED, "The paper's main claim does not hold."),
    ],
)
def test_the_main_claim_comes_first(efficiency, verdict, says):
    """It is said first whether the claim holds, then which estimator to use; each by the numbers."""
    claims = pd.DataFrame(
        [judged("mle-outliers", "partly", 0.04, 0.0), judged("ugdk-closest", verdict, 0.25, 0.5, 3.0)]
    )
    first, second, third, last = found.findings(claims, efficiency)
    assert (first.head, first.claim) == (says, 2)
    assert "in 25\u00a0% of the decades" in first.rest
    assert first.rest.endswith("it errs 3.0\u00a0times as far as the best of the others.")  # whichever that is
    assert second.head == "Use the estimator MLE instead."  # not ALS, which is the nearest beyond the radius alone
    assert "Over 4 conditions with 100 points" in second.rest
    assert "1.00 times the least of all estimators, UGDK's 4.00 times." in second.rest
    assert "noise of 0.3\u00a0r the attainable bound" in third.rest
    assert "is 2.0\u00a0times the Cramér-Rao bound; UGDK reaches 6.0\u00a0times." in third.rest
    assert last.head == "MLE's outliers do not come from other minima."


def test_a_name_that_is_a_word_is_code(efficiency):
    """In the finding, and on the page between its own tags."""
    curves = efficiency.curves.assign(estimator=efficiency.curves["estimator"].replace("mle", "corrected"))
    claims = pd.DataFrame(columns=["number", "name", "verdict", "finding"])
    first, reached = found.findings(claims, dataclasses.replace(efficiency, curves=curves))
    assert first.head == "Use the estimator `corrected` instead."
    assert "`corrected` reaches" in reached.rest
    assert coded(first.head) == ["Use the estimator ", InlineCode("corrected"), " instead."]


def test_findings_without_tables(efficiency):
    """What the tables do not say is left out; nothing is said of claims that were not evaluated."""
    columns = ["number", "name", "verdict", "finding"]
    assert found.findings(pd.DataFrame(columns=columns), None) == []
    row = judged("ugdk-closest", Verdict.NOT_EVALUATED) | {"finding": "needs a run of configs/paper.toml"}
    assert found.findings(pd.DataFrame([row]), None) == []
    assert [f.head[:3] for f in found.findings(pd.DataFrame([row]), efficiency)] == ["Use", "Wha"]


def test_gdke_and_lls():
    """The words about them follow the numbers."""
    rows = [
        judged("gdke-bias-stays", "reproduced", 10.0, 0.0, 1.1),
        judged("gdke-bias-order", "not reproduced", 1.996, 1.998, 1.999),
        judged("lls-outliers-small", "partly", 0.0, 0.14),
    ]
    first, second = found.findings(pd.DataFrame(rows), None)
    assert first.head == "GDKE is biased, and more points do not help."
    assert first.rest.endswith("It grows as σ to the power 2.00.")
    assert second.head == "LLS's outliers come from a cut of small singular values."
    rows[2] = judged("lls-outliers-small", "reproduced", 0.2, 0.14)
    assert found.findings(pd.DataFrame(rows), None)[1].head == "LLS's outliers."


def test_the_picture_has_both_bounds(efficiency):
    """A curve for each estimator, the attainable bound where it is, the Cramér-Rao bound at 1."""
    (axes,) = draw_lead(efficiency).axes
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axes.lines}
    assert list(lines) == ["UGDK", "MLE", "ALS", "attainable bound", "Cramér-Rao bound"]
    assert np.array_equal(lines["attainable bound"], [2.0, 2.0, 2.0])
    assert np.array_equal(lines["Cramér-Rao bound"], [1.0, 1.0])
    assert np.array_equal(lines["UGDK"], [6.0, 6.0, 1 / 6.0])

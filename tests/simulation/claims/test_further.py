"""Claims of the abstract and of asides: each verdict follows its table, and turns with it."""

import math

import numpy as np
import pandas as pd
import pytest

from study.simulation.analysis.regret import median_attainable
from study.simulation.claims import CLAIMS, costs
from study.simulation.claims.claim import Verdict

PAPERS = ("mle", "lls", "gdke", "ugdk")
LEVELS = np.geomspace(1e-4, 0.5, 6)


@pytest.fixture(scope="module")
def grid(error_rows, scores):
    """Errors of MLE and UGDK whose median over the bound is factor(name, σ/r) times that at the attainable bound."""

    def make(factor, trials=400, levels=LEVELS):
        parts = []
        for angle in (45.0, 180.0):
            for level in levels:
                where = {"cell": f"{angle}, {level}", "angle": angle, "noise": level, "samples": 1000}
                for name in ("mle", "ugdk"):
                    ratio = factor(name, level) * median_attainable(angle, level, 3) * np.exp(0.3 * scores(trials))
                    parts.append(error_rows(name, ratio * 0.1 * level, bound=0.1 * level, **where))
        return pd.concat(parts, ignore_index=True)

    return make


@pytest.mark.parametrize(
    ("quiet", "loud", "verdict"),
    [
        (1.0, 1.0, Verdict.REPRODUCED),
        (1.0, 2.5, Verdict.PARTLY),
        (1.5, 2.5, Verdict.NOT_REPRODUCED),
    ],
)
def test_efficient_below_the_distance(find, grid, quiet, loud, verdict):
    """The greatest ratio decides, then that at the smallest noise; noise beyond the radius does not count."""
    table = grid(lambda name, level: (loud if level > 0.01 else quiet) if name == "ugdk" else 1.0)
    beyond = table[table["noise"] == LEVELS[0]].assign(noise=2.0, cell="beyond")
    beyond["error"] *= np.where(beyond["estimator"] == "ugdk", 1e4, 1.0)
    found = find(CLAIMS, "efficient-below-distance", {"efficiency/errors": pd.concat([table, beyond])})
    assert found.verdict is verdict
    assert [n.value for n in found.numbers[:2]] == pytest.approx([loud, quiet], rel=1e-6)
    assert found.numbers[2].value == pytest.approx(np.mean([quiet <= 1.1] * 3 + [loud <= 1.1] * 3))
    assert found.numbers[3].value == pytest.approx(1.0, rel=1e-6)


@pytest.fixture(scope="module")
def paper(error_rows):
    """A random design of 27 decades with errors of factor(name, σ/r) times σ/10 and MLE's passes."""

    def make(factor=lambda name, level: np.ones_like(level), trials=2700, passes=4):
        level = np.geomspace(1.01e-13, 0.99e14, trials)
        order = np.random.default_rng(3).permutation(trials)
        spread = np.exp(0.5 * np.linspace(-1, 1, trials))[order]
        parts = [
            error_rows(
                name, 0.1 * level * spread * factor(name, level), noise=level, bound=0.1 * level, iterations=passes
            )
            for name in PAPERS
        ]
        return pd.concat(parts, ignore_index=True)

    return make


@pytest.mark.parametrize(
    ("useless", "verdict"),
    [
        (PAPERS, Verdict.REPRODUCED),
        (("ugdk",), Verdict.PARTLY),
        ((), Verdict.NOT_REPRODUCED),
    ],
)
def test_troubles(find, paper, useless, verdict):
    """Errors beyond half the radius where σ ≥ r, of all methods, of one, or of none; less noise does not count."""
    table = paper(lambda name, level: np.where(level < 1.0, 1e20, 100.0 if name in useless else 1e-20))
    found = find(CLAIMS, "troubles-beyond-radius", {"paper/errors": table})
    assert found.verdict is verdict
    assert [n.value for n in found.numbers] == [float(name in useless) for name in PAPERS]
    assert found.numbers[0].trials == np.sum(np.geomspace(1.01e-13, 0.99e14, 2700) >= 1.0)


def spreads(hinges, others):
    """Spreads of six hinges and eight other joints with all axes, at 400 samples."""
    rows = [("h", 6, hinges, True), ("o", 8, others, False)]
    return pd.DataFrame(
        [
            {
                "joint": f"{kind}{i}",
                "recording": "a",
                "samples": 400,
                "with_axes": 0.02 if i < far else 0.005,
                "hinge": h,
            }
            for kind, count, far, h in rows
            for i in range(count)
        ]
    ).assign(spread=0.005, error=0.005, doubted=False)


@pytest.mark.parametrize(
    ("hinges", "others", "verdict"),
    [(6, 0, Verdict.REPRODUCED), (2, 2, Verdict.PARTLY), (1, 4, Verdict.NOT_REPRODUCED)],
)
def test_two_answers(find, hinges, others, verdict):
    """Hinges that scatter by more than a centimetre, beside the other joints."""
    found = find(CLAIMS, "two-answers", {}, recordings=spreads(hinges, others))
    assert found.verdict is verdict
    assert [n.value for n in found.numbers] == pytest.approx([hinges / 6, others / 8])


def test_too_few_hinges(find):
    """Two hinges say nothing."""
    table = spreads(6, 0)
    found = find(CLAIMS, "two-answers", {}, recordings=table[~table["joint"].isin(["h2", "h3", "h4", "h5"])])
    assert found.verdict is Verdict.NOT_EVALUATED


@pytest.mark.parametrize(
    ("lls", "passes", "formula", "verdict"),
    [
        (9.0, 60, 9.0, Verdict.REPRODUCED),  # 1 + 60 · 44/35 = 76.4
        (1.5, 60, 1.5, Verdict.PARTLY),
        (1.5, 4, 9.0885, Verdict.PARTLY),
        (1.5, 4, 1.5, Verdict.NOT_REPRODUCED),
    ],
)
def test_the_abstracts_factors(find, paper, lls, passes, formula, verdict):
    """LLS's operations, MLE's longest fit, and the paper's own formula, each beside GDKE's."""
    table = pd.DataFrame(
        {
            "estimator": ["gdke", "lls", "mle"],
            "flops_per_sample": [35.0, 35.0 * lls, 44.0],
            "paper_flops": [1.0, formula, 80.0],
        }
    )
    errors = paper(passes=4)
    errors.loc[errors.index[errors["estimator"] == "mle"][5], "iterations"] = passes
    found = find(CLAIMS, "speed-abstract", {"paper/errors": errors}, table)
    assert found.verdict is verdict
    assert [n.value for n in found.numbers] == pytest.approx([lls, 1 + passes * 44 / 35, formula])
    assert costs.near(found.numbers[2], 9.0) is (formula > 7)


@pytest.mark.parametrize(
    ("beyond", "elsewhere", "verdict"),
    [(1.0, 1.0, Verdict.REPRODUCED), (5.0, 5.0, Verdict.REPRODUCED), (0.2, 1.0, Verdict.NOT_REPRODUCED)],
)
def test_two_ranges(find, paper, beyond, elsewhere, verdict):
    """UGDK's errors in the decades that section 10 leaves out, and in the others."""

    def factor(name, level):
        outside = (level < 1e-11) | (level > 1e12)
        return np.where(outside, beyond, elsewhere) if name == "ugdk" else np.ones_like(level)

    found = find(CLAIMS, "noise-ranges", {"paper/errors": paper(factor)})
    assert found.verdict is verdict
    closer, farther, _, all_farther = (n.value for n in found.numbers)
    assert (closer, farther) == (0.0, float(elsewhere > 1.1))
    assert math.isfinite(all_farther)


@pytest.mark.parametrize("name", ["efficient-below-distance", "troubles-beyond-radius", "noise-ranges"])
def test_too_few_trials(find, grid, paper, name):
    """With a handful of trials there is no number to judge by, and so no verdict."""
    tables = {"efficiency/errors": grid(lambda *_: 1.0, trials=5), "paper/errors": paper(trials=8)}
    assert find(CLAIMS, name, tables).verdict is Verdict.NOT_EVALUATED

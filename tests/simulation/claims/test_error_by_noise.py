"""Claims on error against noise: each verdict follows its table, and turns with it."""

import numpy as np
import pandas as pd
import pytest

from study.simulation.claims.claim import Verdict

PAPERS = ("mle", "lls", "gdke", "ugdk")
LEVELS = np.geomspace(1e-4, 10**0.5, 19)
TRIALS = 40


def spread(trials):
    """Positive numbers about 1 with median 1, in an order that says nothing, the same each time."""
    order = np.random.default_rng(3).permutation(trials)
    return np.exp(0.5 * np.linspace(-1, 1, trials))[order]


@pytest.fixture(scope="module")
def paper(error_rows):
    """A random design of 27 decades: errors of an estimator are factor(name, σ/r) · σ, up to a spread."""

    def make(factor=lambda name, level: 1.0, trials=TRIALS):
        parts = []
        for i, low in enumerate(range(-13, 14)):
            level = 10.0**low * np.geomspace(1.01, 9.9, trials)
            trial = i * trials + np.arange(trials)
            for name in PAPERS:
                error = 0.1 * level * spread(trials) * np.array([factor(name, x) for x in level])
                parts.append(error_rows(name, error, trial=trial, noise=level, bound=0.1 * level))
        return pd.concat(parts, ignore_index=True)

    return make


@pytest.fixture(scope="module")
def grid(grid_of):
    """A grid of caps and noises with N = 1000: errors are factor(name, angle, σ/r) · σ, up to a spread."""

    def make(factor=lambda name, angle, level: 1.0):
        def columns(name, angle, level):
            return {"error": 0.1 * level * spread(TRIALS) * factor(name, angle, level), "bound": 0.1 * level}

        return grid_of(columns, ("mle", "gdke", "ugdk"), (20.0, 90.0, 180.0), LEVELS)

    return make


def test_one_line(find, paper, grid):
    """One exponent for all is the claim; a GDKE that grows as σ² past s* is not, nor an MLE that does not start as σ.

    On the cap of 20° at N = 1000, s* = r√(Kₐ/N)/m₁ is 5.7e-4 r (theory §3).
    """

    def tables(factor, of_paper=lambda name, level: 1.0):
        return {"paper/errors": paper(of_paper), "efficiency/errors": grid(factor)}

    straight = find("one-line", tables(lambda name, angle, level: 1.0))
    assert straight.verdict == Verdict.REPRODUCED
    np.testing.assert_allclose([number.value for number in straight.numbers], 1.0, atol=0.01)
    bent = find("one-line", tables(lambda name, angle, level: max(1.0, level / 5.7e-4) if name == "gdke" else 1.0))
    assert bent.numbers[5].value == pytest.approx(2.0, abs=0.01)
    other = find("one-line", tables(lambda name, angle, level: 1.0, lambda name, level: level**0.2))
    assert other.numbers[1].value == pytest.approx(1.2, abs=0.01)
    # the unit is the median for σ < .01 r, the middle of those 11 decades; its neighbours are off by 10^.2 = 1.6
    assert other.numbers[0].value == pytest.approx(3 / 27)
    assert other.verdict == Verdict.NOT_REPRODUCED
    lost = find("one-line", tables(lambda *_: 1.0, lambda name, level: 5.0 if name == "ugdk" and level > 1.0 else 1.0))
    assert (lost.numbers[0].value, lost.verdict) == (pytest.approx(1.0 - 14 / (4 * 27)), Verdict.MOSTLY)


@pytest.mark.parametrize(
    ("below", "above", "verdict"),
    [
        (0.8, 0.8, Verdict.REPRODUCED),
        (1.0, 1.0, Verdict.NOT_REPRODUCED),
        (0.8, 5.0, Verdict.IN_PART),
        (1.0, 5.0, Verdict.NOT_REPRODUCED),
        (0.995, 1.5, Verdict.NOT_REPRODUCED),
    ],
)
def test_ugdk_closest(find, paper, grid, below, above, verdict):
    """UGDK's error relative to the others' decides, below .01 r and above; half a per cent is a tie.

    The grid has 9 of its 19 noises from .01 r on, of which the share of cells is counted; the paper's design 14 of 27
    decades from r on.
    """
    table = paper(lambda name, level: (below if level < 1.0 else above) if name == "ugdk" else 1.0)
    cells = grid(lambda name, angle, level: (below if level < 0.0099 else above) if name == "ugdk" else 1.0)
    found = find("ugdk-closest", {"paper/errors": table, "efficiency/errors": cells})
    assert found.verdict == verdict
    share, level, over, worst, alone, behind, large, _ = (number.value for number in found.numbers)
    quiet, loud = 8 / 19, 11 / 19
    assert share == pytest.approx(quiet * (below < 0.99) + loud * (above < 0.99))
    assert level == pytest.approx(quiet * (0.99 <= below <= 1.01) + loud * (0.99 <= above <= 1.01))
    assert over == pytest.approx(1.0 - share - level)
    assert worst == pytest.approx(max(below, above))
    assert alone == pytest.approx((13 * (below < 0.99) + 14 * (above < 0.99)) / 27)
    assert behind == pytest.approx(14 / 27 * (above > 1.01))
    assert large == pytest.approx(above)


def test_ugdk_without_numbers_is_farther(find, paper, grid):
    """Fits without a number are errors without limit: they make UGDK farther, not absent."""
    table = paper()
    table.loc[(table["estimator"] == "ugdk") & (table["noise"] >= 1.0), "error"] = np.nan
    cells = grid()
    cells.loc[(cells["estimator"] == "ugdk") & (cells["noise"] >= 0.99), "error"] = np.nan
    found = find("ugdk-closest", {"paper/errors": table, "efficiency/errors": cells})
    assert found.numbers[2].value == pytest.approx(3 / 19)
    assert found.numbers[3].value == np.inf
    assert found.numbers[5].value == pytest.approx(14 / 27)
    assert found.numbers[6].value == np.inf


def test_ugdk_by_luck_is_no_verdict(find, paper, grid):
    """Where each trial's winner is a coin's toss no method is clearly closer.

    Three comparisons in 27 decades: one beyond three standard errors by chance in 10 % of seeds.
    """
    rng = np.random.default_rng(11)
    table = paper()
    table["error"] *= np.exp(0.3 * rng.standard_normal(len(table)))
    found = find("ugdk-closest", {"paper/errors": table, "efficiency/errors": grid()})
    assert [number.value for number in found.numbers[4:6]] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("quiet", "middle", "verdict"),
    [(1.0, 1.0, Verdict.REPRODUCED), (1.0, 20.0, Verdict.IN_PART), (20.0, 20.0, Verdict.IN_PART)],
)
def test_gdke_on_par(find, grid, quiet, middle, verdict):
    """The share of cells in which GDKE's error is MLE's decides: a cap of three here, but for two noises."""

    def factor(name, angle, level):
        return (quiet if level < 2e-4 else middle) if name == "gdke" and angle == 20.0 else 1.0

    found = find("gdke-on-par", {"efficiency/errors": grid(factor)})
    assert found.verdict == verdict
    share = 1.0 - (17 * (middle > 1.1) + 2 * (quiet > 1.1)) / 57
    np.testing.assert_allclose([number.value for number in found.numbers], [share, middle, quiet, 1.0], rtol=1e-9)


def test_gdke_without_numbers_is_not_on_par(find, grid):
    """If most of GDKE's fits have no number, its error is infinite."""
    table = grid()
    table.loc[(table["estimator"] == "gdke") & (table["noise"] > 1.0), "error"] = np.nan
    found = find("gdke-on-par", {"efficiency/errors": table})
    assert found.numbers[1].value == np.inf
    assert (found.numbers[0].value, found.verdict) == (pytest.approx(17 / 19), Verdict.MOSTLY)


@pytest.mark.parametrize(("lost", "verdict"), [(PAPERS, "reproduced"), (("ugdk",), "in part"), ((), "not reproduced")])
def test_troubles(find, paper, lost, verdict):
    """Errors beyond half the radius where σ ≥ r, of all methods, of one, or of none; less noise does not count."""
    table = paper(lambda name, level: 1e20 if level < 1.0 else 100.0 if name in lost else 1e-20)
    found = find("troubles-beyond-radius", {"paper/errors": table})
    assert str(found.verdict) == verdict
    assert [n.value for n in found.numbers[1:]] == [float(name in lost) for name in PAPERS]
    assert found.numbers[1].trials == 14 * TRIALS

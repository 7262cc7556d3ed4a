"""Rows of a summary that a user chooses, and those that fit a screen."""

import itertools

import numpy as np
import pandas as pd
import pytest

from study.analysis.summary import summarise
from study.analysis.summary_choice import RowChoice, evenly_spread, once_by_scaling
from study.analysis.summary_text import ROWS, as_csv, as_data, printed
from study.experiment.config import parse
from study.runs import runner

HEAD = 'name = "test"\nseed = 1\nestimators = ["lls", "ugdk"]\n[design]\ntrials = 8\n'
SCALED = HEAD + (
    'kind = "grid"\nsamples = [5, 40]\nnoise_over_radius = { logspace = [1e-3, 0.1, 9] }\nangle = [30, 90, 180]\n'
    "radius = [1, 7.5]\ncenter = [0, 1]\n"
)
RANDOM = HEAD + (
    'kind = "random"\nsamples = { law = "log_uniform", low = 4, high = 50 }\n'
    'noise = { law = "log_uniform", low = 0.01, high = 1 }\nangle = 90\n'
)


def make(text, folder):
    """A finished run, summarised."""
    done = runner.run(parse(text), text, folder)
    summarise(done)
    return done


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """A grid of 2 · 9 · 3 cells, each in four spaces that differ by scale and centre."""
    return make(SCALED, tmp_path_factory.mktemp("choice") / "grid")


@pytest.fixture(scope="module")
def random(tmp_path_factory):
    """A run of a random design."""
    return make(RANDOM, tmp_path_factory.mktemp("choice") / "random")


def table_of(lines):
    """The lines of a print below its header, and the notes after them."""
    start = next(i for i, line in enumerate(lines) if line.split()[-2:] == ["lls", "ugdk"]) + 1
    rows = [line for line in lines[start:] if line.startswith("N = ")]
    return rows, lines[start + len(rows) :]


def test_it_fits_a_screen(grid):
    """At most forty lines; of 216 cells 162 repeat others by scaling, and the notes count what is left out."""
    lines = list(printed(grid))
    assert len(lines) <= 40
    rows, (scaled, left) = table_of(lines)
    assert len(rows) <= ROWS
    assert scaled.startswith("162 cells have the numbers of one above")
    assert left.startswith(f"{len(rows)} of 54 rows, evenly spread; --all shows all")
    assert lines[2].startswith("N: number of samples; σ/r: ")
    assert " r = " not in "".join(rows)
    for end in ("N = 5, σ/r = 0.001, φ = 30°", "N = 40, σ/r = 0.1, φ = 180°"):
        assert any(row.startswith(end + " ") for row in rows)


def test_all(grid):
    """Each cell is printed, with the conditions that tell it apart, and nothing is left out."""
    rows, notes = table_of(list(printed(grid, every=True)))
    assert len(rows) == 216
    assert len({row.split("  ")[0] for row in rows}) == 216
    assert notes == []


def test_scaling_leaves_one_of_each(grid):
    """One cell of each N, σ/r and φ is left, and the error over the bound of the others is that of its cell."""
    summary = grid.table("summary")
    once = once_by_scaling(summary)
    ratio = (summary["noise"] / summary["radius"]).round(9)
    assert once["group"].nunique() == 54
    assert not once.assign(ratio=ratio).duplicated(["samples", "ratio", "angle", "estimator"]).any()
    spread = summary.assign(ratio=ratio).groupby(["samples", "ratio", "angle", "estimator"], observed=True)
    ends = spread["ratio_median"].agg(["min", "max"])
    np.testing.assert_allclose(ends["max"], ends["min"], rtol=1e-3)


def test_a_cell_of_other_numbers_is_not_the_same_by_scaling(grid):
    """A cell whose median differs by a hundredth, as rounding far from the origin may make it, is kept."""
    summary = grid.table("summary")
    last = (summary["group"] == summary["group"].iloc[-1]) & (summary["estimator"] == "lls")
    summary["ratio_median"] = summary["ratio_median"] * np.where(last, 1.01, 1.0)
    assert once_by_scaling(summary)["group"].nunique() == 55


@pytest.mark.parametrize(
    ("where", "conditions"),
    [
        (["angle=30"], {"angle": [30]}),
        (["φ=30°, N=5"], {"angle": [30], "samples": [5]}),
        (["angle=30,angle=180", "radius=7.5"], {"angle": [30, 180], "radius": [7.5]}),
        (["σ/r=0.00178"], {"ratio": [10**-2.75]}),  # as a label has it
        (["noise_over_radius=0.1,center=1"], {"ratio": [0.1], "center": [1]}),
    ],
)
def test_where(grid, where, conditions):
    """Conditions stand with their names or symbols; several values of one are alternatives, several conditions not."""
    summary = grid.table("summary")
    expected = summary.assign(ratio=(summary["noise"] / summary["radius"]))
    for name, values in conditions.items():
        expected = expected[[np.isclose(value, values).any() for value in expected[name]]]
    found = RowChoice.of(grid, where, "ugdk").rows(summary)
    assert len(found) > 0
    assert list(found.index) == list(expected[expected["estimator"] == "ugdk"].index)


def test_where_in_a_random_design(random):
    """A value of σ/r chooses its decade; the other conditions vary within the rows."""
    summary = random.table("summary")
    found = RowChoice.of(random, ["noise_over_radius=0.05"], None).rows(summary)
    assert set(found["decade"]) == {-2.0}
    with pytest.raises(ValueError, match="samples: not a condition of the rows; known are noise_over_radius"):
        RowChoice.of(random, ["samples=5"], None)


@pytest.mark.parametrize(
    ("where", "estimators", "words"),
    [
        (["angel=30"], None, "angel: not a condition of the rows; did you mean 'angle'"),
        (["angle"], None, "'angle': not CONDITION=VALUE, such as angle=45"),
        (["angle=a"], None, "angle=a: must be above 0 and at most 180 degrees"),
        (["angle=-3"], None, "angle=-3: must be above 0"),
        (["angle=31"], None, "angle=31°: no cell has it; there are 30°, 90°, 180°"),
        ([], "ugd", "--estimators ugd: not in this run; did you mean 'ugdk'"),
    ],
)
def test_faults(grid, where, estimators, words):
    """A choice that cannot be met says which word, and what there is."""
    with pytest.raises(ValueError, match=words):
        list(printed(grid, RowChoice.of(grid, where, estimators)))


def test_data(grid):
    """The rows for other programs are those of the table, all of them; the bounds' medians stand beside them."""
    choice = RowChoice.of(grid, ["samples=5"], "lls")
    data = as_data(grid, choice)
    assert list(data) == ["run", "bound", "conditions", "rows"]
    assert data["run"] == grid.study.run_name()
    summary = grid.table("summary")
    expected = summary[(summary["samples"] == 5) & (summary["estimator"] == "lls")]
    found = pd.DataFrame(data["rows"])
    assert list(found["ratio_median_ok"]) == list(expected["ratio_median_ok"])
    np.testing.assert_allclose(found["noise_over_radius"], expected["noise"] / expected["radius"])
    assert (found["median_attainable"] >= 0.999 * found["median_cramer_rao"]).all()
    lines = as_csv(grid, choice).splitlines()
    assert lines[0].split(",") == list(summary.columns)
    assert len(lines) == 1 + len(expected)


@pytest.mark.parametrize("most", [1, 7, 8, 12, 27, 63, 64, 100])
def test_evenly_spread(most):
    """A factorial is thinned to a factorial with the ends of each condition, where there is room for them."""
    keys = list(itertools.product([10, 100, 1000, 10000], [0.1, 1.0, 0.01, 0.001], ["a", "b", "c", "d"]))
    use = [key for key, chosen in zip(keys, evenly_spread(keys, most), strict=True) if chosen]
    values = [set(axis) for axis in zip(*use, strict=True)]
    assert 1 <= len(use) <= most
    assert len(use) == np.prod([len(axis) for axis in values])
    if most >= 8:
        assert all(len(axis) >= 2 for axis in values)
        assert [{10, 10000} <= values[0], {0.001, 1.0} <= values[1], {"a", "d"} <= values[2]] == [True] * 3
    if most >= 27:
        assert min(len(axis) for axis in values) >= 3


def test_evenly_spread_by_weight():
    """A condition of twice the weight keeps about twice the values."""
    keys = list(itertools.product(range(10), range(10)))
    use = [key for key, chosen in zip(keys, evenly_spread(keys, 32, [2.0, 1.0]), strict=True) if chosen]
    assert [len({key[i] for key in use}) for i in (0, 1)] == [8, 4]

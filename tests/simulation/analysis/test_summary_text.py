"""Rows of a summary that a user chooses, and those that fit a screen.

The summary as it is stored beside a run, and as it is printed.
"""

import itertools

import numpy as np
import pytest

from study.simulation.analysis.summary import ROWS, chosen_rows, evenly_spread, once_by_scaling, printed
from tests.configs import config

TWO = {"estimators": ["lls", "ugdk"]}
LEVELS = {"noise_over_radius": {"logspace": [1e-3, 0.1, 9]}, "samples": [5, 40], "angle": [30, 90, 180]}


@pytest.fixture(scope="module")
def grid(make_run):
    """A grid of 2 · 9 · 3 cells, each in four spaces that differ by scale and centre."""
    return make_run(config(TWO, trials=8, radius=[1, 7.5], center=[0, 1], **LEVELS))


def parts(run, **options):
    """What is printed: the lines above the header, the header, the rows, and the notes below them."""
    lines, names = list(printed(run, chosen_rows(run), **options)), list(run.study.estimators)
    place = next(i for i, line in enumerate(lines) if line.split()[-len(names) :] == names)
    rows = [line for line in lines[place:] if line.startswith(("N = ", "σ/r = "))]
    return lines[:place], lines[place], rows, lines[place + 1 + len(rows) :]


def test_it_fits_a_screen(grid):
    """At most forty lines; of 216 cells 162 repeat others by scaling, and the notes count what is left out."""
    above, _, rows, (scaled, left) = parts(grid)
    assert len(list(printed(grid, chosen_rows(grid)))) <= 40
    assert len(rows) <= ROWS
    assert scaled.startswith("162 cells have the numbers of one above")
    assert left.startswith(f"{len(rows)} of 54 rows, evenly spread; --all shows all")
    assert above[2].startswith("N: number of samples; σ/r: ")
    assert " r = " not in "".join(rows)
    for end in ("N = 5, σ/r = 0.001, φ = 30°", "N = 40, σ/r = 0.1, φ = 180°"):
        assert any(row.startswith(end + " ") for row in rows)


def test_all(grid):
    """Each cell is printed, with the conditions that tell it apart, and nothing is left out."""
    _, _, rows, notes = parts(grid, every=True)
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
    found = chosen_rows(grid, where, "ugdk")
    assert len(found) > 0
    assert list(found.index) == list(expected[expected["estimator"] == "ugdk"].index)


def test_where_in_a_random_design(random):
    """A value of σ/r chooses its decade; the other conditions vary within the rows."""
    found = chosen_rows(random, ["noise_over_radius=0.05"], None)
    assert set(found["decade"]) == {-2.0}
    with pytest.raises(ValueError, match="samples: not a condition of the rows; known are noise_over_radius"):
        chosen_rows(random, ["samples=5"], None)


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


@pytest.mark.parametrize("kind", ["grid", "random"])
def test_every_value_has_its_error(request, kind):
    """Each measure stands beside its Monte-Carlo error, and neither is negative where it cannot be."""
    stored = request.getfixturevalue(kind).table("summary")
    errors = [name for name in stored.columns if name.endswith("_error")]
    assert len(errors) > 15
    for name in errors:
        value, error = stored[name.removesuffix("_error")], stored[name]
        assert not (error < 0).any()
        assert error.isna()[value.isna()].all()
        assert error.notna()[np.isfinite(value)].all()


@pytest.mark.parametrize("kind", ["grid", "random"])
def test_printed(request, kind):
    """A title, a note, a header and a line per group, each with a label of its own; failures are named."""
    run = request.getfixturevalue(kind)
    stored = run.table("summary")
    (title, note, legend, *bounds), header, lines, _ = parts(run, every=True)
    assert title.startswith(run.study.run_name())
    assert "Brackets" in note
    assert "σ/r" in legend
    assert header.split() == ["CRLB", "attainable"] * len(bounds) + list(run.study.estimators)
    assert ["attainable" in line for line in bounds] == [True] * (run.study.design.kind == "grid")
    assert len(lines) == stored["group"].nunique()
    assert all(len(line) < 120 for line in lines)
    assert len({line[: header.index(header.split()[0])] for line in lines}) == len(lines)
    for line, (_, part) in zip(lines, stored.groupby("group", sort=False), strict=True):
        failed = (part["ok"] < part["planned"]).sum()
        assert line.count("%)") == failed

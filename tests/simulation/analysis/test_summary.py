"""The summary of a small error table whose measures are known by hand: failures count, and nothing is lost.

The worst trials of a table: each counts once, by its worst fit.

Rows of a summary that a user chooses, and those that fit a screen.

The summary as it is stored beside a run, and as it is printed.
"""

import itertools
import math
import re

import numpy as np
import pandas as pd
import pytest

from study.fits import Status
from study.simulation.analysis import summary as module
from study.simulation.analysis.error_table import decade
from study.simulation.analysis.summary import ROWS, chosen_rows, evenly_spread, once_by_scaling, printed, worst
from study.simulation.runs import schemas
from tests.configs import config
from tests.summaries import summary

NAN, INF = math.nan, math.inf
OK, HIDDEN, FLAT = Status.OK, Status.NOT_POSITIVE_DEFINITE, Status.SINGULAR


def table(rows):
    """An error table of (cell, estimator, error, error_1, status), radius 2 and bound 0.5."""
    frame = pd.DataFrame(rows, columns=["cell", "estimator", "error", "error_1", "status"])
    frame["trial"] = frame.groupby(["cell", "estimator"]).cumcount()
    frame["status"] = frame["status"].map(int)
    return frame.assign(samples=10, noise=0.1, angle=90.0, radius=2.0, center=0.0, bound=0.5)


HAND = table(
    [
        ("bb", "ugdk", 1.0, -1.0, OK),
        ("bb", "ugdk", 2.0, 0.5, OK),
        ("bb", "ugdk", 3.0, 3.0, OK),
        ("bb", "ugdk", 1e9, 1e9, FLAT),
        ("bb", "ugdk", NAN, NAN, HIDDEN),
        *(("bb", "lls", float(e), 0.0, OK) for e in (1, 2, 3, 4, 6)),
        *(("aa", "ugdk", NAN, NAN, FLAT) for _ in range(3)),
        *(("aa", "lls", 1.0, 1.0, OK) for _ in range(2)),
    ]
)

OF_ALL = ["relative_median_all", "ratio_median_all", "ratio_q05_all", "ratio_q95_all", "far_all"]
OF_OK = ["relative_median_ok", "ratio_median_ok", "ratio_q05_ok", "ratio_q95_ok", "far_ok", "axis_median_ok"]
BY_HAND = {  # counts, quantiles of all fits, and of those that are ok
    "bb ugdk": ([5, 3, 1, 1], [1.5, 6.0, 2.0, INF, 0.4], [1.0, 4.0, 2.0, 6.0, 0.0, 1.0]),
    "bb lls": ([5, 5, 0, 0], [1.5, 6.0, 2.0, 12.0, 0.2], [1.5, 6.0, 2.0, 12.0, 0.2, 0.0]),
    "aa ugdk": ([3, 0, 3, 0], [INF, INF, INF, INF, 1.0], [NAN] * 6),
    "aa lls": ([2, 2, 0, 0], [0.5, 2.0, 2.0, 2.0, 0.0], [0.5, 2.0, 2.0, 2.0, 0.0, 2.0]),
}


def test_measures_by_hand():
    """Failures are infinite among all fits, and far (beyond ten bounds, 5 here); what no fit gives is unknown.

    Rows come in the order of the table, columns are those declared, and a cell's conditions stand beside its measures.
    If the directions do not determine the centre an error over the bound is unknown, not zero.
    """
    found = summary(HAND, by_decade=False)
    assert list(found["group"] + " " + found["estimator"]) == list(BY_HAND)
    assert sorted(found.columns) == sorted(column.name for column in schemas.summary())
    counts, of_all, of_ok = zip(*BY_HAND.values(), strict=True)
    assert found[["planned", "ok", "singular", "not_positive_definite"]].to_numpy().tolist() == list(counts)
    np.testing.assert_array_equal(found[OF_ALL], of_all)
    np.testing.assert_array_equal(found[OF_OK], of_ok)
    assert (found[[status.name.lower() for status in Status]].sum(axis=1) == found["planned"]).all()
    assert (found[["samples", "noise", "angle", "radius", "center"]] == [10, 0.1, 90, 2, 0]).all(axis=None)
    assert found["decade"].isna().all()
    unbound = summary(HAND.assign(bound=INF), by_decade=False).iloc[1]
    assert unbound["ratio_median_ok"] == unbound["axis_median_ok"] == INF


@pytest.mark.parametrize("power", range(-13, 15))
def test_decades_by_their_lower_end(power):
    """A ratio σ/r of 10^k, to the 12 digits that conditions have, opens its decade; one below is of the last."""
    radius = np.array([1.0, 3.0, 0.7, 37.0])
    noise = float(f"1e{power}") * radius
    assert set(decade(noise / radius)) == set(decade(noise * (1 - 1e-12) / radius)) == {power}
    assert set(decade(noise * (1 - 1e-6) / radius)) == {power - 1}


def test_decades_in_order_and_whole():
    """Decades ascend, hold every trial once, and say a condition only where it does not vary."""
    noise = 2.0 * 10.0 ** np.array([2.5, -3.0, 0.1, -2.01, 0.9] * 3)
    found = summary(HAND.assign(noise=noise, samples=np.arange(15)), by_decade=True)
    assert found["decade"].is_monotonic_increasing
    assert set(found["group"]) == {"1e-03", "1e+00", "1e+02"}
    assert found["planned"].sum() == 15
    several = found["planned"] > 1
    assert several.any()
    assert found.loc[several, "samples"].isna().all()
    assert found.loc[~several, "samples"].notna().all()
    assert (found["radius"] == 2.0).all()


def large(errors, axis):
    """An error table of one cell of so many ok fits."""
    rows = [("cc", "ugdk", e, a, OK) for e, a in zip(errors, axis, strict=True)]
    return summary(table(rows), by_decade=False).iloc[0]


def test_moments_where_they_exist():
    """Of normal errors, bias and RMSE over the bound are numpy's."""
    vector = np.random.default_rng(4).standard_normal((5000, 3)) + np.array([0.3, 0.0, 0.0])
    error = np.linalg.norm(vector, axis=1)
    row = large(error, vector[:, 0])
    assert row["bias"] == pytest.approx(vector[:, 0].mean() / 0.5)
    assert row["rmse"] == pytest.approx(math.sqrt((error**2).mean()) / 0.5)
    assert row["bias_error"] == pytest.approx(vector[:, 0].std(ddof=1) / 0.5 / math.sqrt(5000))


def test_moments_where_they_do_not_exist():
    """Of Cauchy errors, and of too few, there is no bias and no RMSE; medians there are."""
    tail = np.random.default_rng(4).standard_cauchy(5000)
    for errors in (tail, tail[:150]):
        row = large(np.abs(errors), errors)
        assert all(math.isnan(row[name]) for name in ("bias", "bias_error", "rmse", "rmse_error"))
        assert math.isfinite(row["ratio_median_ok"])
    assert large(np.abs(tail), tail)["tail_index"] == pytest.approx(1.0, abs=0.3)


def worst_table(*rows):
    """An error table of (cell, trial, estimator, error, bound, status)."""
    return pd.DataFrame(rows, columns=["cell", "trial", "estimator", "error", "bound", "status"])


def in_short(frame):
    """The rows in short."""
    return [(row.cell, row.trial, row.estimator, row.ratio) for row in frame.itertuples()]


ERRORS = worst_table(
    ("b", 0, "mle", 3.0, 1.0, int(OK)),
    ("b", 0, "gdke", 4.0, 1.0, int(OK)),  # the worse of the same trial
    ("a", 0, "mle", 1.0, 0.5, int(OK)),  # another cell's trial of the same number
    ("a", 1, "mle", 9.0, 1.0, int(Status.NOT_CONVERGED)),
    ("a", 1, "gdke", 0.1, 1.0, int(OK)),
    ("a", 2, "mle", 8.0, np.inf, int(OK)),  # the directions do not determine the centre
    ("a", 3, "mle", np.nan, 1.0, int(OK)),
    ("a", 4, "mle", np.inf, 1.0, int(OK)),  # lost without saying so: the worst there is
)


def test_largest_error_over_the_bound_of_each_trial():
    """A trial counts once, by its worst ok fit; infinite bounds and missing errors do not count."""
    expected = [("a", 4, "mle", np.inf), ("b", 0, "gdke", 4.0), ("a", 0, "mle", 2.0), ("a", 1, "gdke", 0.1)]
    assert in_short(worst(ERRORS)) == expected
    assert in_short(worst(ERRORS, 2)) == expected[:2]
    assert list(worst(ERRORS, 2).index) == [0, 1]


def test_one_estimator():
    """Only the estimator's fits are used; an estimator that is not in the table has none."""
    assert in_short(worst(ERRORS, estimator="gdke")) == [("b", 0, "gdke", 4.0), ("a", 1, "gdke", 0.1)]
    assert in_short(worst(ERRORS, estimator="mle"))[1] == ("b", 0, "mle", 3.0)
    assert worst(ERRORS, estimator="ugdk").empty


@pytest.mark.parametrize("seed", range(4))
def test_order_of_equal_ones(seed):
    """Ties are in the order of cell, trial and estimator by name, whatever the table's order and its categories."""
    rows = [(cell, trial, name, 2.0, 1.0, int(OK)) for cell in "cab" for trial in (10, 9) for name in ("mle", "gdke")]
    frame = worst_table(*rows).sample(frac=1.0, random_state=seed)
    for name in ("cell", "estimator"):  # as they are stored: dictionaries in the order of first appearance
        frame[name] = pd.Categorical(frame[name], categories=list(dict.fromkeys(frame[name])))
    expected = [(cell, trial, "gdke", 2.0) for cell in "abc" for trial in (9, 10)]
    assert in_short(worst(frame, 6)) == expected


def test_the_table_is_left_as_it_is():
    """Nothing is written into the table that is given, and all its columns come back."""
    before = ERRORS.copy()
    assert [*ERRORS.columns, "ratio"] == list(worst(ERRORS).columns)
    assert before.equals(ERRORS)
    assert worst(ERRORS[:0]).empty


def test_part_by_part(circles, random, monkeypatch):
    """The worst trials of a run, found some rows at a time, are those of its whole error table."""
    for run in (circles, random):
        errors, by_decade = run.table("errors"), run.study.design.one_trial_a_cell
        parts = np.array_split(np.arange(len(errors)), 7)
        monkeypatch.setattr(module, "_parts", lambda _, e=errors, p=parts: (e.iloc[rows] for rows in p))
        trials, of_groups = module.worst_of_run(run, 6)
        told = worst(errors, 6)
        pd.testing.assert_frame_equal(trials[told.columns], told, check_dtype=False)
        (one, _), told = module.worst_of_run(run, 6, "ugdk"), worst(errors, 6, "ugdk")
        pd.testing.assert_frame_equal(one[told.columns], told, check_dtype=False)
        keys = ["group", "estimator"]
        whole = module.worst_of_groups(errors, by_decade).sort_values(keys, ignore_index=True)
        pd.testing.assert_frame_equal(of_groups.sort_values(keys, ignore_index=True), whole)


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
        (["angle=30, 180,radius=7.5"], {"angle": [30, 180], "radius": [7.5]}),
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


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("angle=30,31", "--where angle=31°: no cell has it; there are "),
        ("angle=30,samples", "--where 'samples': not CONDITION=VALUE, such as angle=45"),
        ("30,angle=30", "--where '30': not CONDITION=VALUE, such as angle=45"),
    ],
)
def test_where_refuses(grid, text, words):
    """A value that no cell has is named, also beside one that cells have; so is what is no condition with a value."""
    with pytest.raises(ValueError, match=re.escape(words)):
        chosen_rows(grid, [text], None)


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

"""A stored error table read a part at a time: the parts are the table, whatever memory there is and the rows' order."""

import itertools

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import study
from study.simulation.analysis import error_table, losses, rank, regret
from study.simulation.analysis.compare import Difference
from study.simulation.analysis.error_table import Grouped
from study.simulation.figures import Tables, fig2_error
from study.simulation.runs.run_folder import Run

GRID = """
name = "parts"
seed = 1
dimension = 2
estimators = ["lls", "gdke", "als"]
[design]
kind = "grid"
draws = "{draws}"
trials = 60
samples = [8, 20]
noise_over_radius = [0.01, 0.1, 0.3]
angle = 45
"""
RANDOM = """
name = "parts"
seed = 1
estimators = ["lls", "gdke"]
[design]
kind = "random"
trials = 90
samples = 20
noise = {{ law = "log_uniform", low = 1e-3, high = 50.0 }}
radius = 4.0
angle = {{ law = "uniform", low = 30, high = 180 }}
"""
COLUMNS = ("cell", "samples", "trial", "estimator", "error", "status")


def cut_small(patch, design):
    """Let row groups and units be small; blocks of trials, which share a stream, too."""
    patch.setattr("study.files._ROWS_PER_GROUP", 50 if design == "random" else 200)
    patch.setattr("study.simulation.experiment.designs.BLOCK_TRIALS", 4)
    patch.setattr("study.simulation.experiment.designs._SAMPLES_PER_UNIT", 500)


@pytest.fixture(scope="module", params=["shared", "independent", "random"])
def run(request, tmp_path_factory):
    """A run whose table has many small row groups and units, so that the rows of a cell lie in several of them."""
    folder = tmp_path_factory.mktemp(request.param)
    config = folder / "parts.toml"
    config.write_text((RANDOM if request.param == "random" else GRID).format(draws=request.param))
    with pytest.MonkeyPatch.context() as patch:
        cut_small(patch, request.param)
        study.run(config, folder=folder / "run")
    assert pq.ParquetFile(folder / "run" / "errors.parquet").num_row_groups > 3
    return Run.open(folder / "run")


@pytest.fixture(scope="module")
def shorter(run, tmp_path_factory):
    """A run of the same config with fewer trials."""
    folder = tmp_path_factory.mktemp("shorter")
    text = (run.folder / "config.toml").read_text()
    (folder / "parts.toml").write_text(text.replace("trials = 60", "trials = 40").replace("= 90", "= 70"))
    with pytest.MonkeyPatch.context() as patch:
        cut_small(patch, run.study.design.kind)
        study.run(folder / "parts.toml", folder=folder / "run")
    return Run.open(folder / "run")


@pytest.fixture(params=[1, 6000, 1 << 28])
def memory(request, monkeypatch):
    """Bytes for a part: one key each, some, all."""
    monkeypatch.setattr(error_table, "_MEMORY", request.param)
    return request.param


def test_the_parts_are_the_table(run, memory):
    """Every group and estimator has its rows, in their order, whether it is read alone or with others."""
    whole, grouped = error_table.label(run.table("errors"), run.study.design.one_trial_a_cell), Grouped(run)
    batches = list(grouped.batches(COLUMNS))
    assert [key for batch in batches for key in batch] == list(grouped.counts)
    assert (len(batches) > 1) == (memory < 1 << 28)
    for batch in batches:
        for key, columns in grouped.read(batch, COLUMNS).items():
            mine = whole[(whole["group"] == key[0]) & (whole["estimator"] == key[1])]
            assert len(mine) == grouped.counts[key]
            for name in COLUMNS:
                assert columns[name].tolist() == mine[name].tolist()
    assert sum(grouped.counts.values()) == len(whole)


def test_parts_fill_the_memory(run, memory):
    """A part is one key, or what its rows take, eight bytes a value, fits; the next key would not fit beside it.

    That holds to the byte: where a part and the next key fill the memory, they are one part.
    """
    grouped, row = Grouped(run), 8 * (len(COLUMNS) + 1)

    def sizes():
        return [[row * grouped.counts[key] for key in batch] for batch in grouped.batches(COLUMNS)]

    for _ in range(2):
        parts = sizes()
        assert all(len(part) == 1 or sum(part) <= error_table._MEMORY for part in parts)
        assert all(sum(one) + other[0] > error_table._MEMORY for one, other in itertools.pairwise(parts))
        error_table._MEMORY = sum(parts[0]) + (parts[1][0] if len(parts) > 1 else 0)
    assert len(sizes()[0]) == len(parts[0]) + (len(parts) > 1)
    key = list(grouped.counts)[-1]
    assert list(grouped.batches(COLUMNS, [key])) == [[key]]


def test_groups_are_cells_or_decades(run):
    """Of a grid the cells in the table's order; of a random design the decades of σ/r, ascending, by their names."""
    errors, grouped = run.table("errors"), Grouped(run)
    groups = list(dict.fromkeys(group for group, _ in grouped.counts))
    if not grouped.by_decade:
        assert groups == list(errors["cell"].unique())
        return
    lower = np.floor(np.log10(errors["noise"] / 4.0)).astype(int)
    assert [float(group) for group in groups] == [10.0**power for power in sorted(set(lower))]
    for (group, estimator), rows in grouped.counts.items():
        mine = (lower == round(np.log10(float(group)))) & (errors["estimator"] == estimator)
        read = grouped.read([(group, estimator), ("nowhere", estimator)], ["noise"])
        assert list(read) == [(group, estimator)]
        assert read[group, estimator]["noise"].tolist() == errors["noise"][mine].tolist()
        assert set(read[group, estimator]["decade"]) == {round(np.log10(float(group)))}
        assert rows == mine.sum()
    assert grouped.read([("nowhere", "lls")], ["noise"]) == {}


def test_decades_begin_at_powers_of_ten():
    """A power belongs to the decade that it begins, also where rounding leaves it just below; a part less does not."""
    powers = np.arange(-12, 13)
    for factor, lower in ((1.0, powers), (1.0 - 1e-15, powers), (9.999, powers), (1.0 - 1e-6, powers - 1)):
        np.testing.assert_array_equal(error_table.decade(factor * 10.0**powers), lower)
    assert error_table.decade(3 * 0.1 / 3) == -1


@pytest.mark.parametrize("run", ["shared", "independent"], indirect=True)
def test_some_cells(run, memory):
    """Those that are asked for come, and no others; a table without rows is refused."""
    names = list(run.table("errors")["cell"].unique()[[0, 3, 4]])
    found = pd.concat(Grouped(run).cells(COLUMNS, names))
    assert set(found["cell"]) == set(names)
    assert len(found) == 3 * 60 * 3
    assert list(Grouped(run).cells(COLUMNS, [])) == []


@pytest.mark.parametrize("run", ["shared", "independent"], indirect=True)
def test_cells_are_whole(run, memory):
    """Each part has all rows of its cells; together they are the table."""
    parts = list(Grouped(run).cells(COLUMNS))
    assert (len(parts) > 1) == (memory < 1 << 28)
    seen = [set(part["cell"]) for part in parts]
    assert sum(map(len, seen)) == len(set().union(*seen)) == run.study.cells()
    order = ["cell", "trial", "estimator"]
    rows = [frame[list(COLUMNS)].astype({"cell": str, "estimator": str}) for frame in (*parts, run.table("errors"))]
    found = pd.concat(rows[:-1]).sort_values(order, ignore_index=True)
    pd.testing.assert_frame_equal(found, rows[-1].sort_values(order, ignore_index=True))


@pytest.mark.parametrize("run", ["shared", "independent"], indirect=True)
def test_comparisons_do_not_depend_on_the_parts(run, memory):
    """Regret and rankings of the parts are those of the table in one."""
    errors, names = run.table("errors"), list(run.study.estimators)
    pd.testing.assert_frame_equal(regret.of_run(run), regret.by_cell([errors], names))
    whole = errors.astype({"cell": str, "estimator": str})
    found = rank.ranked([rank.compared(losses.of_run(run))]).drop(columns="seconds")
    whole = rank.ranked(
        [rank.compared(losses.Losses(run.study.run_name(), names, [whole], f"{run.study.name}-{run.study.seed}", 2))]
    ).drop(columns="seconds")
    pd.testing.assert_frame_equal(found, whole)


@pytest.mark.usefixtures("memory")
@pytest.mark.parametrize("memory", [6000], indirect=True)
def test_differences_do_not_depend_on_the_parts(run, shorter):
    """A run is identical with itself, and in the trials that both have with a shorter one, in any parts."""
    assert Difference(run, run).verdict == "identical"
    for pair in ((run, shorter), (shorter, run)):
        found = Difference(*pair)
        assert found.verdict == "identical in the trials that both have"
        assert not found.comparisons["same_trials"].all()


def test_rows_of_cells_and_estimators(run):
    """A table's rows can be read for some cells and estimators alone, in their order."""
    whole = run.table("errors")
    cells, names = list(whole["cell"].unique()[[1, 3]]), [run.study.estimators[-1]]
    found = run.table("errors", ["cell", "estimator", "error"], names, cells)
    expected = whole[whole["cell"].isin(cells) & whole["estimator"].isin(names)]
    assert found["error"].tolist() == expected["error"].tolist()


@pytest.mark.parametrize("run", ["random"], indirect=True)
def test_a_long_random_run_is_drawn_by_its_first_trials(run, monkeypatch):
    """The stamp says so, and all of it is of these trials."""
    monkeypatch.setattr(fig2_error, "_MOST_TRIALS", 60)
    frame = fig2_error.prepare(Tables(run))
    assert "the first 60 of 90 trials" in frame.stamp
    first = run.table("errors").head(120)
    assert frame.dots["cell"].tolist() == first["cell"].tolist()
    assert frame.panels["planned"].tolist() == [60, 60]

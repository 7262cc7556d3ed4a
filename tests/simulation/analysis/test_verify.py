"""Verification: one bit in one row is found, whatever the digests say; untouched runs of every kind are verified."""

import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from study.files import RunError
from study.simulation.analysis.summary import summarise
from study.simulation.analysis.verify import Verification, chosen, difference, printed
from study.simulation.posterior.run import compute
from study.simulation.runs import runner
from study.simulation.runs.run_folder import Run

HEAD = 'name = "checked"\nseed = 5\nestimators = ["lls", "ugdk"]\n'
GRID = '[design]\nkind = "grid"\ntrials = 5\nsamples = [5, 20]\nnoise = [0.01, 0.1]\nangle = 90\n'
CHAINS = '[posterior]\ntrials = 1\nwalkers = 16\nmax_steps = 100\nnoise = "known"\nwhere = { samples = 20 }\n'
KINDS = {
    "grid": HEAD + "keep_points = 2\n" + GRID + CHAINS,
    "independent": HEAD + GRID + 'draws = "independent"\n',
    "random": HEAD + '[design]\nkind = "random"\ntrials = 30\nsamples = 7\nnoise = 0.1\nangle = 90\n',
    "summary": HEAD + 'keep = "summary"\n' + GRID,
    "moments": HEAD.replace("lls", "gdke") + 'route = "moments"\n' + GRID,
    "adaptive": HEAD
    + '[design]\nkind = "grid"\ntrials = 800\nsamples = 8\nnoise = [0.01, 0.3]\nangle = [40, 180]\n'
    + '[precision]\nmeasure = "ratio_median_ok"\nrelative_target = 0.08\nfirst = 100\n',
}


@pytest.fixture(scope="module")
def runs(make_run):
    """A finished run of each kind, made when it is first wanted."""
    made = {}
    return lambda kind: made.get(kind) or made.setdefault(kind, make_run(KINDS[kind]))


@pytest.fixture
def copy(runs, tmp_path):
    """A copy of a run, to be altered."""
    return lambda kind: Run.open(shutil.copytree(runs(kind).folder, tmp_path / kind))


def flip(run, name, column, row):
    """Flip the last bit of one number, and give the manifest the digest of the altered table."""
    table = pq.read_table(run.path(name))
    values = table[column].to_numpy().copy()
    values[row : row + 1].view(np.int64)[...] ^= 1
    index = table.schema.get_field_index(column)
    pq.write_table(table.set_column(index, table.schema.field(index), pa.array(values)), run.path(name))
    run.record(name)


@pytest.mark.parametrize("kind", KINDS)
def test_untouched(runs, kind):
    """Every table is as written, everything that can be computed again is equal, and the last line says so."""
    found = Verification(runs(kind), 1.0)
    assert found.faults == []
    for name, result in found.again.items():
        assert result.done == result.total > 0, name
    assert runs(kind).study.keep in found.again
    assert list(printed(found))[-1].startswith("verified: ")
    assert len(list(printed(found))) >= 2 + len(found.digests)


@pytest.mark.parametrize(
    ("kind", "name", "column", "row"),
    [
        ("grid", "errors", "error_2", 17),
        ("grid", "errors", "bound", 0),
        ("grid", "points", "x_1", 30),
        ("grid", "summary", "ratio_median_ok", 3),
        ("grid", "posterior", "mean_1", 1),
        ("grid", "answers", "distance", 2),
        ("grid", "draws", "error_3", 100),
        ("independent", "errors", "radius_error", 39),
        ("random", "errors", "error_1", 31),
        ("summary", "summary", "ratio_median_ok", 5),
        ("moments", "errors", "error", 11),
        ("adaptive", "errors", "error_1", 777),
    ],
)
def test_one_bit(copy, kind, name, column, row):
    """One flipped bit in one row is found by computing it again, though the digests are right; no other table is."""
    run = copy(kind)
    flip(run, name, column, row)
    found = Verification(run, 1.0)
    assert all(fault is None for fault in found.digests.values())
    wrong = {table for table, result in found.again.items() if result.faults}
    assert wrong - {"summary"} == {name} - {"summary"}
    assert name in wrong
    assert f"{column} is " in "".join(found.again[name].faults)
    assert list(printed(found))[-1].startswith("not verified: ")


def test_rows_that_are_left_out(copy):
    """Rows that are missing are found, with the digest of what is left."""
    run = copy("grid")
    for name in ("summary", "posterior", "points", "errors"):  # the errors last, since the others belong to them
        table = pq.read_table(run.path(name))
        pq.write_table(table.slice(0, table.num_rows - 2), run.path(name))
        run.record(name)
        assert Verification(run, 1.0).again[name].faults, name


@pytest.mark.parametrize("name", ["points", "posterior", "answers", "draws"])
def test_rows_of_nothing(copy, name):
    """Rows of a trial that the config does not have are found when all is computed again, with the digest of them."""
    run = copy("grid")
    table = pq.read_table(run.path(name))
    place = table.schema.get_field_index("trial")
    strays = table.slice(0, 1).set_column(place, table.schema.field(place), pa.array([999], pa.int64()))
    pq.write_table(pa.concat_tables([table, strays]), run.path(name))
    run.record(name)
    found = Verification(run, 1.0)
    assert "1 rows are of no " in found.again[name].faults[-1]
    assert {table for table, result in found.again.items() if result.faults} == {name}


def test_numbers_of_the_manifest(copy):
    """Cells and failures that are not those of the config and the tables are told, whatever the manifest's digest."""
    run = copy("independent")
    for name in ("cells", "failures", "lost"):
        whole = run.manifest()
        run.save_manifest(whole | {name: 77})
        (fault,) = Verification(run).faults
        assert f"manifest.json: {name} = 77, where the tables have {whole[name]}" in fault
        run.save_manifest(whole)
    assert Verification(run).faults == []


def test_the_remedy(copy):
    """The last line says what to remove, and the command in it makes that again."""
    run = copy("grid")
    good = {name: run.fingerprint(name) for name in ("errors", "points", "summary", "draws")}
    flip(run, "points", "x_1", 0)
    flip(run, "draws", "error_3", 100)
    command = f"`study run {run.folder}/config.toml --out {run.folder}`"
    last = list(printed(Verification(run, 1.0)))[-1]
    assert last == f"not verified: 2 faults; remove points.parquet, draws.parquet, and {command} makes it again"
    for name in ("points", "draws"):
        run.path(name).unlink()
    runner.run(run.study, (run.folder / "config.toml").read_text(), run.folder, 1, warn=lambda line: None)
    summarise(run)
    compute(run, 1)
    assert {name: run.fingerprint(name) for name in good} == good
    assert Verification(run, 1.0).faults == []


def test_digests(copy):
    """A table with another digest, a missing one, and one that the manifest does not have are told, and not used."""
    run = copy("grid")
    shutil.copy(run.path("draws"), run.path("answers"))
    run.path("points").unlink()
    run.forget("timings")
    found = Verification(run, 1.0)
    faults = {name for name, fault in found.digests.items() if fault}
    assert faults == {"answers", "points", "timings"}
    assert not {"answers", "points", "posterior"} & set(found.again)
    assert found.again["errors"].done
    assert all("; `study run" in fault for fault in found.faults)


def test_failures(make_run, monkeypatch):
    """Rows of failures are computed again, too; a unit whose worker died is left out."""
    from dataclasses import replace

    import study

    def raising(samples):
        if samples.shape[2] == 20:
            raise ZeroDivisionError("my own mistake")
        return study.ESTIMATORS["lls"](samples)

    monkeypatch.setitem(study.ESTIMATORS, "lls2", replace(study.ESTIMATORS["lls"], function=raising))
    run = make_run((HEAD + GRID).replace('"ugdk"', '"lls2"'))
    found = Verification(run, 1.0)
    assert found.faults == []
    assert found.again["failures"].done == 2
    table = pq.read_table(run.path("failures"))
    index = table.schema.get_field_index("cause")
    causes = pa.array(["worker"] * table.num_rows).dictionary_encode()
    for altered in (table.slice(1), table.set_column(index, table.schema.field(index), causes)):
        pq.write_table(altered.cast(table.schema), run.path("failures"))
        run.record("failures")
        last = Verification(run, 1.0)
        assert bool(last.again["failures"].faults) == (altered.num_rows < table.num_rows)
    assert last.again["failures"].done == 1


def test_shares(runs):
    """A small share is at least one of each; none is no verification."""
    assert {name: result.done for name, result in Verification(runs("grid"), 1e-9).again.items()} == dict.fromkeys(
        ("errors", "points", "summary", "posterior", "answers", "draws"), 1
    )
    found = Verification(runs("grid"), 0.0)
    assert (found.again, found.faults) == ({}, [])
    assert "nothing was computed again" in list(printed(found))[-1]


def test_a_run_that_is_not_finished(copy):
    """One line says so, and the command that finishes it."""
    run = copy("random")
    run.forget("errors")
    with pytest.raises(RunError, match="not finished, so there is nothing to verify; `study run"):
        Verification(run)


def test_the_choice():
    """A choice follows from its seed, keeps the order, has the size asked for, and takes everything about equally."""
    things = list(range(50))
    assert chosen("a", things, 0.1) == chosen("a", things, 0.1) != chosen("b", things, 0.1)
    assert chosen("a", things, 1.0) == things
    assert chosen("a", things, 0.0) == []
    assert len(chosen("a", things, 0.01)) == 1
    counts = np.zeros(50)
    for seed in range(1000):
        picked = chosen(str(seed), things, 0.2)
        assert picked == sorted(picked)
        counts[picked] += 1
    # each count is binomial (1000, 1/5), with a standard error of 12.6; one of 50 is off by 5 once in 35,000 times
    assert np.all(np.abs(counts - 200) < 5 * 12.6)


def test_differences():
    """Values are compared by their bits; those that are not numbers are equal."""
    one = pa.table({"cell": ["a", "b"], "x": [0.0, np.nan]})
    assert difference(one, pa.table({"cell": ["a", "b"], "x": [0.0, -np.nan]})) is None
    other = pa.table({"cell": ["a", "b"], "x": [-0.0, np.nan]})
    assert difference(one, other) == "a: x is 0.0, and -0.0 when computed again"
    for older, newer, same in ((np.nan, 0.5, True), (0.25, 0.5, False), (0.25, np.nan, False)):
        tables = [pa.table({"cell": ["a"], "rank_likelihood": [value]}) for value in (older, newer)]
        assert (difference(*tables) is None) == same, "rows that are older than the column have no number in it"
    assert "1 rows are stored" in difference(one.slice(1), one)

"""Adaptive runs: the trials of each cell, the same for any workers and interruptions, and the effect of a budget."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import study
from study.simulation.analysis.summary import summarise
from study.simulation.experiment.config import parse
from study.simulation.runs import adaptive as cell_measures
from study.simulation.runs import runner
from study.simulation.runs.adaptive import Rounds, TimeBudget
from study.simulation.runs.parts import Parts
from study.simulation.runs.status import RunStatus
from study.simulation.runs.workers import Workers
from tests.configs import config
from tests.summaries import summary

pytestmark = pytest.mark.usefixtures("same_software")

TOP = {"seed": 7, "estimators": ["lls", "ugdk", "als"], "keep_points": 2}
GRID = {"trials": 800, "samples": [6, 60], "noise": [0.02, 0.1, 0.6], "angle": [60, 180]}
PRECISION = "[precision]\nrelative_target = 0.05\nfirst = 100\n"
FIXED = config(TOP, **GRID)
CONFIG = FIXED + PRECISION
APART = config(TOP, **GRID, draws="independent") + PRECISION
MOMENTS = config({"seed": 7, "estimators": ["gdke", "ugdk", "als"], "route": "moments"}, **GRID) + PRECISION
CHECKPOINTS = (100, 200, 400, 800)


def cut_small(patch):
    """Let units be of one block, whose size divides no checkpoint."""
    patch.setattr("study.simulation.experiment.designs.BLOCK_TRIALS", 30)
    patch.setattr("study.simulation.experiment.designs._SAMPLES_PER_UNIT", 100)


@pytest.fixture
def small(monkeypatch, small_parts):
    """Small units, and a part for each."""
    cut_small(monkeypatch)


@pytest.fixture
def go(tmp_path):
    """Run a config into a folder of its own, by default an adaptive one."""

    def run(text=CONFIG, folder="run", jobs=2, **arguments):
        study = parse(text)
        return runner.run(study, text, tmp_path / folder, jobs, **arguments)

    return run


@pytest.fixture(scope="module")
def whole(software, tmp_path_factory):
    """An unbroken run of small units, by two threads, whose tables stay as they are."""
    with pytest.MonkeyPatch.context() as patch:
        cut_small(patch)
        patch.setattr("study.simulation.runs.provenance.software", software)
        return runner.run(parse(CONFIG), CONFIG, tmp_path_factory.mktemp("whole") / "run", 2)


def told(run):
    """Bytes of the tables that do not depend on time."""
    return {name: run.path(name).read_bytes() for name in ("errors", "points", "precision")}


def stopped_after(go, units):
    """A run that its budget stops after so many tasks, by a clock that advances by a second with each."""
    calls = []
    clock = TimeBudget(units, lambda: len(calls))
    return go(budget=clock, progress=lambda *numbers: calls.append(numbers), jobs=1)


def rule(rows, estimators, target):
    """The trials that a cell should have by the documented rule, found from a run that has all of them."""
    for count in CHECKPOINTS:
        table = summary(rows[rows["trial"] < count], by_decade=False).set_index("estimator")
        chosen = table.loc[list(estimators)]
        if (chosen["ratio_median_ok_error"] <= target * chosen["ratio_median_ok"]).all():
            return count, "target"
    return CHECKPOINTS[-1], "cap"


@pytest.mark.parametrize("text", [CONFIG, APART, MOMENTS], ids=["shared", "independent", "moments"])
def test_the_rule(go, text):
    """Each cell has the trials that follow from the summary's errors of a larger, fixed run, and its rows, bit for bit.

    The order of the rows is that of the fixed run.
    """
    run, fixed = go(text), go(text[: text.index("[precision]")], "fixed").table("errors")
    adaptive, table = run.table("errors"), run.table("precision").set_index("cell")
    assert set(table["reason"]) == {"target", "cap"}
    assert table["trials"].nunique() >= 3
    for cell, rows in fixed.groupby("cell", observed=True):
        count, reason = rule(rows, run.study.estimators, 0.05)
        found = tuple(table.loc[cell, ["trials", "reason", "checkpoints"]])
        assert found == (count, reason, 1 + CHECKPOINTS.index(count))
    limits = fixed["cell"].astype(str).map(table["trials"].to_dict())
    expected = fixed[fixed["trial"] < limits].reset_index(drop=True)
    for name in expected.columns:
        words = str if name in ("cell", "estimator") else adaptive[name].dtype
        np.testing.assert_array_equal(adaptive[name].astype(words), expected[name].astype(words), err_msg=name)


def test_a_measure_of_the_study_decides(go):
    """A share of the study's own measure stops each cell at the first checkpoint at which its error is small enough.

    The errors are those of Agresti and Coull, written out here; the cap stops what is never precise enough.
    """
    asked = '[precision]\nmeasure = "own_errors_radius"\ntarget = 0.025\nfirst = 100\n'
    run = go(config(TOP | {"measures": ["own_errors"]}, **GRID) + asked)
    table, errors = run.table("precision").set_index("cell"), run.table("errors")
    assert table["trials"].nunique() >= 3
    for cell, rows in errors.groupby("cell", observed=True):
        errs = {}
        for count in (c for c in CHECKPOINTS if c <= table.loc[cell, "trials"]):
            held = rows[rows["trial"] < count].groupby("estimator", observed=True)["own_errors_radius"].sum()
            p = (held + 2.0) / (count + 4.0)
            errs[count] = np.sqrt(p * (1.0 - p) / (count + 4.0)).max()
        *before, last = errs
        assert all(errs[count] > 0.025 for count in before)
        assert (errs[last] <= 0.025) == (table.loc[cell, "reason"] == "target")
        assert table.loc[cell, "error"] == pytest.approx(errs[last])


def test_the_table_tells_what_decided(whole):
    """The estimator farthest from the target, its measure and error as the stored summary has them, and the goal."""
    summarise(whole)
    found = whole.table("summary").astype({"estimator": str})
    for row in whole.table("precision").astype({"cell": str, "estimator": str}).to_dict("records"):
        mine = found[found["group"] == row["cell"]].set_index("estimator")
        away = mine["ratio_median_ok_error"] / mine["ratio_median_ok"]
        assert row["estimator"] == away.idxmax()
        assert row["value"] == mine["ratio_median_ok"][row["estimator"]]
        assert row["error"] == mine["ratio_median_ok_error"][row["estimator"]]
        assert row["goal"] == 0.05 * row["value"]
        assert row["trials"] == mine["planned"].iloc[0]
        assert (row["error"] <= row["goal"]) == (row["reason"] == "target")


def test_the_manifest_counts_what_there_is(go):
    """The manifest has the number of fits, and of cells by their reason, and nothing is left to compute."""
    run = go()
    said = run.manifest()
    assert said["fits"] == len(run.table("errors"))
    assert said["precision"] == run.table("precision")["reason"].value_counts().to_dict()
    assert sum(said["precision"].values()) == said["cells"] == 12
    assert run.stopped() is None
    assert not (run.folder / "parts").exists()
    before = run.path("errors").stat().st_mtime_ns
    assert go().path("errors").stat().st_mtime_ns == before


@pytest.mark.parametrize("jobs", [1, Workers("loky", 2)], ids=["one thread", "two processes"])
def test_workers_do_not_show(go, jobs, small, whole, monkeypatch):
    """The same trials and bytes on one worker and two, threads and processes; also from units of few trials.

    So they are if the cells of a group are measured a few at a time.
    """
    monkeypatch.setattr(cell_measures, "_ROWS", 700)
    assert told(go(jobs=jobs)) == told(whole)


def test_cells_do_not_depend_on_others(go, small, whole):
    """More cells, and estimators that do not count for the target, do not change a cell's trials."""
    named = CONFIG + 'estimators = ["lls", "ugdk", "als"]\n'
    alone = go(named.replace("[0.02, 0.1, 0.6]", "[0.1]"), "alone").trials()
    more = go(named.replace('"als"]\nkeep', '"als", "taubin", "mle"]\nkeep'), "more").trials()
    assert len(alone) == 4
    assert alone.items() <= whole.trials().items()
    assert more == whole.trials()


def test_most_samples_is_a_cap(go):
    """A cell that may have fewer trials than the first checkpoint is measured once, at its own cap."""
    run = go(CONFIG.replace("trials = 800", "trials = 800\nmost_samples = 3000"))
    table = run.table("precision")
    assert set(table.loc[table["samples"] == 60, "trials"]) == {50}
    assert table.loc[table["samples"] == 60, "reason"].isin(["cap", "target"]).all()
    assert table.loc[table["samples"] == 6, "trials"].max() > 100


def test_no_answers_at_all(go, monkeypatch):
    """An estimator without an ok fit has no measure: its cells go to the cap, and the table names the estimator."""

    def never(samples):
        raise ZeroDivisionError("never")

    monkeypatch.setitem(study.ESTIMATORS, "never", replace(study.ESTIMATORS["lls"], function=never))
    run = go(CONFIG.replace('"lls",', '"lls", "never",').replace("[0.02, 0.1, 0.6]", "0.02"))
    table = run.table("precision")
    assert set(table["reason"]) == {"cap"}
    assert set(table["estimator"]) == {"never"}
    assert set(table["trials"]) == {800}


@pytest.mark.usefixtures("small")
class TestResume:
    """A run that is interrupted and resumed."""

    @pytest.mark.parametrize("after", [1, 30])
    def test_broken_off(self, go, whole, computed, after):
        """Interrupted in any round, it computes no stored row again, and its tables are those of an unbroken run."""
        calls = []

        def stop(*numbers):
            calls.append(numbers)
            return 1 / (after - len(calls))

        with pytest.raises(ZeroDivisionError):
            go(progress=stop)
        go()
        assert len(set(computed)) == len(computed)
        assert told(go()) == told(whole)

    def test_damaged_parts(self, go, whole):
        """Damaged parts are computed again, and decisions that were taken from them are taken again."""
        run = stopped_after(go, 40)
        for path in sorted((run.folder / "parts").iterdir())[::9]:
            path.write_bytes(path.read_bytes()[:-50])
        assert told(go(warn=str)) == told(whole)

    def test_parts_damaged_while_it_runs(self, go, whole, tmp_path):
        """A part that changes after its cells were measured is found at the end, and all decisions are taken again."""
        calls = []

        def harm(*numbers):
            calls.append(numbers)
            if len(calls) == 50:
                path = min((tmp_path / "run" / "parts").iterdir())
                path.write_bytes(path.read_bytes()[:-50])

        lines = []
        assert told(go(progress=harm, warn=lines.append)) == told(whole)
        assert any("damaged" in line for line in lines)

    def test_a_damaged_table(self, go, whole):
        """The run is made again, to the same bytes."""
        go().path("precision").write_bytes(b"not parquet")
        assert told(go(warn=str)) == told(whole)


@pytest.mark.usefixtures("small")
class TestBudget:
    """A budget that ends a run before all cells have enough trials."""

    @pytest.mark.parametrize("units", [0, 1, 20, 45, 70])
    def test_stopped_and_gone_on_with(self, go, whole, units):
        """Cells stay at their last complete checkpoint; a resumed run has the tables of an unbroken one."""
        run = stopped_after(go, units)
        table = run.table("precision")
        counts = table["reason"].value_counts().to_dict()
        assert run.stopped() == units
        assert counts == run.manifest()["precision"]
        assert counts["budget"] > 0
        assert set(table["trials"]) <= {0, *CHECKPOINTS}
        usual, rows = whole.trials(), run.table("errors").astype({"cell": str})
        for row in table.astype({"cell": str}).to_dict("records"):
            assert (rows["cell"] == row["cell"]).sum() == 3 * row["trials"]
            if row["reason"] == "budget":
                assert row["trials"] < usual[row["cell"]]
            else:
                assert row["trials"] == usual[row["cell"]]
        assert (run.folder / "parts").exists() == (units > 0)
        summarise(run)
        assert len(run.table("summary")) == 3 * (table["trials"] > 0).sum()
        assert told(go()) == told(whole)
        assert go().stopped() is None
        assert not (run.folder / "parts").exists()

    def test_little_by_little(self, go, whole, computed):
        """Of many budgets, one after the other, each resumes where the last ended, and nothing is computed twice."""
        stops = 0
        while stopped_after(go, 15).stopped() is not None:
            stops += 1
        assert stops > 2
        assert len(set(computed)) == len(computed)
        assert told(go()) == told(whole)

    def test_it_names_no_run(self, go, whole):
        """A config with another budget is the same run, and resumes it; one of a fixed number of trials has none."""
        stopped_after(go, 20)
        assert told(go(CONFIG + "seconds = 1e9\n")) == told(whole)
        with pytest.raises(ValueError, match="a budget is for a config with"):
            go(FIXED, "fixed", budget=TimeBudget(1.0))


@pytest.mark.usefixtures("small")
def test_dear_fits(go, whole, dear, computed):
    """Where units are cut for what their fits cost, each fit is computed once, and the tables keep their bytes."""
    dear(12)
    assert told(go()) == told(whole)
    assert len(set(computed)) == len(computed)


def test_progress_stays_within_one(go):
    """The shares add up to no more than 1, and to 1 if every cell goes to its cap."""
    shares = []
    go(progress=lambda share, *units: shares.append(share))
    assert 0.0 < sum(shares) <= 1.0
    shares.clear()
    go(CONFIG.replace("0.05\nfirst", "1e-9\nfirst"), "cap", progress=lambda share, *units: shares.append(share))
    assert sum(shares) == pytest.approx(1.0)


def test_neither_takes_rows_nor_gives_any(go, computed):
    """An adaptive run takes no rows of a finished fixed run beside it, nor the other way round."""
    go(FIXED, f"test-{parse(FIXED).digest()}")
    fixed = len(computed)
    computed.clear()
    run = go(folder=f"test-{parse(CONFIG).digest()}")
    assert len(computed) == run.manifest()["fits"]
    computed.clear()
    shutil.rmtree(run.folder.parent / f"test-{parse(FIXED).digest()}")
    go(FIXED, f"test-{parse(FIXED).digest()}")
    assert len(computed) == fixed


def test_a_run_that_is_not_so_far(go):
    """Numbers of trials are known from the precision table alone, and never for a fixed run."""
    assert go(FIXED, "fixed").trials() == {}
    run = go()
    assert len(run.trials()) == 12
    run.path("precision").unlink()
    assert run.trials() == {}


def test_units_are_known_from_the_rounds():
    """Before any part is stored, the first checkpoint of every group is pending."""
    rounds = Rounds(parse(CONFIG))
    pending = list(rounds.pending())
    assert {unit.group.stream for unit in pending} == set(rounds.progress)
    assert sum(unit.rows for unit in pending) == 12 * 100
    assert rounds.ahead() == pytest.approx(1 / 8)


@pytest.mark.usefixtures("small")
def test_status_of_a_run_that_finishes_meanwhile(go, monkeypatch):
    """A run that finishes while its parts are read is finished, and no part is missed."""
    run, load, loaded = stopped_after(go, 40), Parts.load, []

    def load_and_finish(parts, set_aside=True):
        names = load(parts, set_aside)
        loaded.append(parts)
        if len(loaded) == 1:
            go()
        return names

    monkeypatch.setattr(Parts, "load", load_and_finish)
    found = RunStatus(run.folder)
    assert found.finished
    assert found.units["missing"] == found.parts["whole"] == found.cells["open"] == 0

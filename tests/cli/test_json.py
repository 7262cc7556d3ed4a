"""Option --json: one object on standard output, with keys that do not change, and null where there is no number.

The report command: a page beside the run or in the given file, and one line if it cannot be written.

A figure that fails: its place in the code on standard error, exit code 1, and the other figures all the same.
"""

import csv
import json
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from study.fits import Status
from study.simulation import figures
from study.simulation.analysis.summary import worst
from study.simulation.experiment.config import parse
from study.simulation.figures import figure
from study.simulation.runs import schemas
from study.simulation.runs.run_folder import Run
from study.text import json_text


@pytest.fixture
def ask(finished, well):
    """Run a command with --json beside the finished run; the object."""

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return lambda *arguments: json.loads(well(finished[0], *arguments, "--json"), parse_constant=refuse)


@pytest.fixture
def out(finished):
    """The finished run."""
    return Run.open(finished[0] / "out")


def test_summary(ask, out):
    """Every row of the summary table, each value as it is stored; infinities and NaN are null."""
    told = ask("summary", "out")
    assert list(told) == ["run", "bound", "conditions", "rows"]
    stored = out.table("summary")
    assert (told["run"], len(told["rows"]), len(stored)) == (out.study.run_name(), 8, 8)
    for row, expected in zip(told["rows"], stored.to_dict("records"), strict=True):
        assert list(row) == [*stored.columns, "noise_over_radius", "median_cramer_rao", "median_attainable"]
        assert (row["estimator"], row["decade"]) == (expected["estimator"], None)
        assert row["ratio_median_ok"] == pytest.approx(expected["ratio_median_ok"], rel=0)
        assert row["noise_over_radius"] == pytest.approx(expected["noise"] / expected["radius"], rel=1e-7)
        assert row["median_attainable"] >= 0.999 * row["median_cramer_rao"]


def test_summary_of_some(well, finished):
    """--where and --estimators choose rows; --csv has a header and one line for each of them."""
    arguments = ("summary", "out", "--where", "samples=5,noise=0.1", "--estimators", "ugdk")
    said = well(finished[0], *arguments, "--csv")
    (row,) = csv.DictReader(said.splitlines())
    assert (row["samples"], row["noise"], row["estimator"], row["planned"]) == ("5.0", "0.1", "ugdk", "5")
    said = well(finished[0], *arguments)
    assert (said.count("N = "), "lls" in said) == (1, False)


def test_claims(ask, out, tmp_path):
    """A mapping per claim with the columns of the stored table, and the count of each verdict."""
    shutil.copytree(out.folder, tmp_path / "out")
    told = ask("claims", tmp_path / "out")
    assert list(told) == ["runs", "verdicts", "claims"]
    assert len(told["runs"]) == 1
    assert sum(told["verdicts"].values()) == len(told["claims"]) > 20
    assert all(list(claim) == [column.name for column in schemas.CLAIMS] for claim in told["claims"])
    assert any(claim["value"] is None and claim["verdict"] == "not evaluated" for claim in told["claims"])


def test_status(ask, out):
    """The counts of the finished run: two units' fits, none failed or lost, three tables or more, none damaged."""
    told = ask("status", "out")
    keys = "run folder state finished writer units cells parts failures tables damaged made_by"
    assert list(told) == keys.split()
    assert (told["run"], told["state"], told["finished"]) == (out.study.run_name(), "finished", True)
    assert told["units"]["total"] == told["units"]["done"] > 0 == told["units"]["missing"]
    assert told["failures"]["fits"] == 2 * 2 * 2 * 5
    assert (told["cells"], told["writer"], told["damaged"]) == (None, None, [])
    assert {"errors", "summary", "timings"} <= set(told["tables"])


def test_status_of_a_run_that_is_not_finished(well, tmp_path, config):
    """What is not known yet is null, and nothing is done."""
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "config.toml").write_text(config)
    told = json.loads(well(tmp_path, "status", "half", "--json"))
    assert (told["finished"], told["failures"], told["tables"]) == (False, None, [])
    assert told["units"]["done"] == 0 < told["units"]["missing"] == told["units"]["total"]


def test_diff(ask):
    """A run and itself are identical, in every comparison."""
    told = ask("diff", "out", "out")
    assert list(told) == ["verdict", "runs", "test", "threshold", "comparisons"]
    assert (told["verdict"], len(told["comparisons"])) == ("identical", 8)
    assert all(row["equal"] and row["chance"] == 1.0 and not row["different"] for row in told["comparisons"])
    assert [run["folder"] for run in told["runs"]] == ["out", "out"]


def test_plan(ask, config):
    """The counts of the config: four cells of five trials, two estimators."""
    told = ask("plan", "tiny.toml", "--jobs", "3")
    assert list(told) == ["run", "jobs", "parts"]
    assert (told["run"], told["jobs"]) == (parse(config).run_name(), 3)
    (part,) = told["parts"]
    assert list(part) == ["title", "cells", "units", "trials", "draws", "samples", "fits", "bytes", "seconds"]
    assert (part["cells"], part["trials"], part["fits"]) == (4, 20, 40)
    assert part["seconds"] > 0


def test_worst(ask, out):
    """The trials of the library's function, each by the name that `study replay` takes."""
    told = ask("worst", "out", "--count", "3")
    assert list(told) == ["run", "bound", "trials"]
    errors = out.table("errors")
    ok = errors[errors["status"] == Status.OK]
    assert told["trials"][0]["ratio"] == pytest.approx((ok["error"] / ok["bound"]).max(), rel=1e-15)
    expected = worst(errors, 3)
    assert [trial["name"] for trial in told["trials"]] == list(expected["cell"] + "/" + expected["trial"].astype(str))
    keys = ["name", "cell", "trial", "estimator", "ratio", "error", "bound", "samples", "noise", "angle"]
    assert list(told["trials"][0])[:10] == keys


def test_what_json_does_not_have():
    """NaN and infinities are null, at any depth; arrays are lists; what is no number or text is refused."""
    nan, infinity = float("nan"), float("inf")
    data = {"a": [nan, {"b": (infinity, -infinity, 1.5)}], "σ": "é", "x": np.array([[1.0, nan], [np.inf, 2.0]])}
    expected = {"a": [None, {"b": [None, None, 1.5]}], "σ": "é", "x": [[1.0, None], [None, 2.0]]}
    assert json.loads(json_text([data, np.int8(3), np.array(True)])) == [expected, 3, True]
    with pytest.raises(TypeError, match="not JSON serializable"):
        json_text({"a": object()})


@pytest.fixture(scope="module")
def folder(finished, config, tmp_path_factory):
    """A folder with a finished run in ``out`` and another config."""
    folder = shutil.copytree(finished[0], tmp_path_factory.mktemp("report") / "runs")
    (folder / "other.toml").write_text(config.replace("tiny", "other"))
    return folder


def page(path):
    """A page's text; fails if the file is no page."""
    text = path.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>\n")
    assert text.endswith("</html>\n")
    return text


def test_writes_beside_the_first_run(well, folder):
    """Without --out the page lies in the run's folder; its path is the last that is said, after what was found."""
    assert well(folder, "report", "out").splitlines()[-1] == "out/report.html"
    text = page(folder / "out" / "report.html")
    assert "<title>tiny: tiny-" in text
    assert "study replay out " in text


def test_several_runs_into_a_file(well, folder):
    """Runs in the order given, into a file in a folder that is made."""
    well(folder, "run", "other.toml", "--out", "other", "--jobs", "1")
    assert well(folder, "report", "other", "out", "--out", "a/b.html").splitlines()[-1] == "a/b.html"
    text = page(folder / "a" / "b.html")
    assert re.search(r"<title>other, tiny: other-\w+, tiny-\w+</title>", text)
    assert not (folder / "other" / "report.html").exists()


def test_a_cost_table(well, folder, monkeypatch):
    """Claims are judged by the given runs and the path of the cost table."""
    given = []

    def judge_all(runs, cost, spreads):
        assert spreads is None
        given.append(([str(run.folder) for run in runs], str(cost)))
        return pd.DataFrame(columns=[column.name for column in schemas.CLAIMS])

    monkeypatch.setattr("study.simulation.claims.judge_all", judge_all)
    said = well(folder, "report", "out", "--cost", "some.parquet", "--out", "cost.html")
    assert said.splitlines()[-1] == "cost.html"
    assert given == [(["out"], "some.parquet")]
    assert "No claim of the paper was judged" in page(folder / "cost.html")


@pytest.mark.parametrize(
    ("step", "broken", "place"),
    [
        ("prepare", lambda tables: tables.stamp, r"no attribute 'stamp'\"\) at test_json\.py, line \d+, in <lambda>"),
        ("draw", lambda _: figure.at_first(None, []), r"at study/simulation/figures/figure\.py, line \d+, in at_first"),
    ],
    ids=["own code", "package"],
)
def test_a_figure_that_fails(finished, call_here, tmp_path, monkeypatch, step, broken, place):
    """Exception, file and line are told in one line; the next figure is drawn, and the exit code is 1."""
    whole = SimpleNamespace(prepare=lambda tables: tables.name, draw=lambda frame: Figure())
    faulty = SimpleNamespace(**{"prepare": lambda tables: 1} | {step: broken})
    monkeypatch.setattr(figures, "FIGURES", {"broken": faulty, "whole": whole})
    code, said, complained = call_here(finished[0], "figures", "out", "--out", tmp_path / "drawn")
    assert code == 1
    assert [line.rpartition("/")[2] for line in said.splitlines()] == ["whole.png", "whole.svg", "whole.pdf"]
    assert re.fullmatch(f"broken: failed: .*{place}\n", complained)


@pytest.mark.parametrize("runs", [["out"], ["out", "out"]])
def test_a_figure_that_does_not_apply_is_no_failure(finished, call_here, tmp_path, runs):
    """A run that cannot feed a figure is code 0 and a reason; runs and figures are told apart by the figures' names."""
    code, said, complained = call_here(finished[0], "figures", *runs, "fig2_error", "--out", tmp_path / "drawn")
    assert (code, said) == (0, "")
    assert complained.startswith("fig2_error: not drawn: ")

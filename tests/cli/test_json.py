"""Option --json: one object on standard output, with keys that do not change, and null where there is no number.

The report command: a page beside the run or in the given file, and one line if it cannot be written.

A figure that fails: its place in the code on standard error, exit code 1, and the other figures all the same.
"""

import csv
import inspect
import json
import re
import shutil

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


def refuse(word):
    raise AssertionError(f"{word} is not JSON")


@pytest.fixture
def ask(finished, call_here):
    """Run a command with --json beside the finished run; the exit code and the object."""

    def asked(*arguments):
        code, said, complained = call_here(finished[0], *arguments, "--json")
        assert complained == ""
        return code, json.loads(said, parse_constant=refuse)

    return asked


@pytest.fixture
def out(finished):
    """The finished run."""
    return Run.open(finished[0] / "out")


def test_summary(ask, out):
    """Every row of the summary table, each value as it is stored; infinities and NaN are null."""
    code, found = ask("summary", "out")
    assert code == 0
    assert list(found) == ["run", "bound", "conditions", "rows"]
    stored = out.table("summary")
    assert len(found["rows"]) == len(stored) == 8
    for row, expected in zip(found["rows"], stored.to_dict("records"), strict=True):
        assert list(row) == [*stored.columns, "noise_over_radius", "median_cramer_rao", "median_attainable"]
        assert row["estimator"] == expected["estimator"]
        assert row["ratio_median_ok"] == pytest.approx(expected["ratio_median_ok"], rel=0)
        assert row["decade"] is None


def test_summary_of_some(finished, call_here):
    """--where and --estimators choose rows; --csv has a header and one line for each of them."""
    arguments = ("summary", "out", "--where", "samples=5,noise=0.1", "--estimators", "ugdk")
    code, said, complained = call_here(finished[0], *arguments, "--csv")
    assert (code, complained) == (0, "")
    (row,) = csv.DictReader(said.splitlines())
    assert (row["samples"], row["noise"], row["estimator"], row["planned"]) == ("5.0", "0.1", "ugdk", "5")
    code, said, _ = call_here(finished[0], *arguments)
    assert (code, said.count("N = ")) == (0, 1)
    assert "lls" not in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--where", "angle=91"], "angle=91°: no cell has it; there are 90°"),
        (["--where", "colour=red"], "colour: not a condition"),
        (["--estimators", "kasa"], "kasa: not in this run"),
        (["--json", "--csv"], "give one of --json, --csv and --ok"),
    ],
    ids=str,
)
def test_a_choice_that_cannot_be_met(finished, call_here, arguments, words):
    """It is code 2 and the reason."""
    code, said, complained = call_here(finished[0], "summary", "out", *arguments)
    assert (code, said) == (2, "")
    assert words in complained


def test_claims(ask, out, tmp_path):
    """A mapping per claim with the columns of the stored table, and the count of each verdict."""
    shutil.copytree(out.folder, tmp_path / "out")
    code, found = ask("claims", tmp_path / "out")
    assert code == 0
    assert list(found) == ["runs", "verdicts", "claims"]
    assert len(found["runs"]) == 1
    assert sum(found["verdicts"].values()) == len(found["claims"]) > 20
    assert all(list(claim) == [column.name for column in schemas.CLAIMS] for claim in found["claims"])
    assert any(claim["value"] is None and claim["verdict"] == "not evaluated" for claim in found["claims"])


def test_status(ask, out):
    """The counts of the finished run: two units' fits, none failed or lost, three tables or more, none damaged."""
    code, found = ask("status", "out")
    assert code == 0
    keys = "run folder state finished writer units cells parts failures tables damaged made_by"
    assert list(found) == keys.split()
    assert (found["run"], found["state"], found["finished"]) == (out.study.run_name(), "finished", True)
    assert found["units"]["total"] == found["units"]["done"] > 0 == found["units"]["missing"]
    assert found["failures"]["fits"] == 2 * 2 * 2 * 5
    assert (found["cells"], found["writer"], found["damaged"]) == (None, None, [])
    assert {"errors", "summary", "timings"} <= set(found["tables"])


def test_status_of_a_run_that_is_not_finished(tmp_path, config, call_here):
    """What is not known yet is null, and nothing is done."""
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "config.toml").write_text(config)
    code, said, complained = call_here(tmp_path, "status", "half", "--json")
    found = json.loads(said)
    assert (code, complained) == (0, "")
    assert (found["finished"], found["failures"], found["tables"]) == (False, None, [])
    assert found["units"]["done"] == 0 < found["units"]["missing"] == found["units"]["total"]


def test_diff(ask):
    """A run and itself are identical, in every comparison."""
    code, found = ask("diff", "out", "out")
    assert code == 0
    assert list(found) == ["verdict", "runs", "test", "threshold", "comparisons"]
    assert found["verdict"] == "identical"
    assert len(found["comparisons"]) == 8
    assert all(each["equal"] and each["chance"] == 1.0 and not each["different"] for each in found["comparisons"])
    assert [each["folder"] for each in found["runs"]] == ["out", "out"]


def test_plan(ask, config):
    """The counts of the config: four cells of five trials, two estimators."""
    code, found = ask("plan", "tiny.toml", "--jobs", "3")
    assert code == 0
    assert list(found) == ["run", "jobs", "parts"]
    assert (found["run"], found["jobs"]) == (parse(config).run_name(), 3)
    (part,) = found["parts"]
    assert list(part) == ["title", "cells", "units", "trials", "draws", "samples", "fits", "bytes", "seconds"]
    assert (part["cells"], part["trials"], part["fits"]) == (4, 20, 40)
    assert part["seconds"] > 0


def test_worst(ask, out):
    """The trials of the library's function, each by the name that `study replay` takes."""
    code, found = ask("worst", "out", "--count", "3")
    assert code == 0
    assert list(found) == ["run", "bound", "trials"]
    errors = out.table("errors")
    ok = errors[errors["status"] == Status.OK]
    assert found["trials"][0]["ratio"] == pytest.approx((ok["error"] / ok["bound"]).max(), rel=1e-15)
    expected = worst(errors, 3)
    assert [each["name"] for each in found["trials"]] == list(expected["cell"] + "/" + expected["trial"].astype(str))
    keys = ["name", "cell", "trial", "estimator", "ratio", "error", "bound", "samples", "noise", "angle"]
    assert list(found["trials"][0])[:10] == keys


def test_what_json_does_not_have():
    """NaN and infinities are null, at any depth; arrays are lists; what is no number or text is refused."""
    nan, infinity = float("nan"), float("inf")
    data = {"a": [nan, {"b": (infinity, -infinity, 1.5)}], "σ": "é", "x": np.array([[1.0, nan], [np.inf, 2.0]])}
    assert json.loads(json_text([data, np.int8(3), np.array(True)])) == [
        {"a": [None, {"b": [None, None, 1.5]}], "σ": "é", "x": [[1.0, None], [None, 2.0]]},
        3,
        True,
    ]
    with pytest.raises(TypeError, match="not JSON serializable"):
        json_text({"a": object()})


@pytest.fixture(scope="module")
def folder(finished, config, tmp_path_factory):
    """A folder with two finished runs of different configs, ``out`` and ``other``, and one that is half there."""
    folder = tmp_path_factory.mktemp("report")
    shutil.copytree(finished[0] / "out", folder / "out")
    (folder / "half").mkdir()
    (folder / "half" / "config.toml").write_text(config.replace("tiny", "half"))
    (folder / "other.toml").write_text(config.replace("tiny", "other"))
    return folder


def page(path):
    """A page's text; fails if the file is no page."""
    text = path.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>\n")
    assert text.endswith("</html>\n")
    return text


def test_writes_beside_the_first_run(call_here, folder):
    """Without --out the page lies in the run's folder; its path is all that is said."""
    assert call_here(folder, "report", "out") == (0, "out/report.html\n", "")
    text = page(folder / "out" / "report.html")
    assert "<title>Sphere fits, put to the test: tiny-" in text
    assert "study replay out " in text


def test_several_runs_into_a_file(call_here, folder):
    """Runs in the order given, into a file in a folder that is made."""
    assert call_here(folder, "run", "other.toml", "--out", "other", "--jobs", "1")[0] == 0
    assert call_here(folder, "report", "other", "out", "--out", "a/b.html") == (0, "a/b.html\n", "")
    text = page(folder / "a" / "b.html")
    assert re.search(r"<title>Sphere fits, put to the test: other-\w+, tiny-\w+</title>", text)
    assert not (folder / "other" / "report.html").exists()


def test_in_a_process_of_its_own(call, call_here, folder):
    """In a process of its own the output and the bytes are the same, with warnings as errors."""
    assert call(folder, "report", "out", "--out", "again.html") == (0, "again.html\n", "")
    assert call_here(folder, "report", "out", "--out", "again2.html")[0] == 0
    assert (folder / "again.html").read_bytes() == (folder / "again2.html").read_bytes()
    page(folder / "again.html")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none"], "none: not a run folder"),
        (["out", "."], ".: not a run folder"),
        (["half"], "half/errors.parquet: missing; finish the run with `study run half/config.toml --out half`"),
        (["out", "half"], "half/errors.parquet: missing"),
        (["out", "out"], "both are runs named 'tiny'"),
        (["out", "--out", "out"], "out: cannot be written: Is a directory"),
        (["out", "--out", "other.toml/page.html"], "other.toml/page.html: cannot be written"),
        (["out", "--cost", "none.parquet"], "none.parquet: no cost table"),
    ],
    ids=str,
)
def test_refusals(call_here, folder, arguments, words):
    """A folder that is no finished run, one given twice, an impossible target: code 1 and one line."""
    code, said, complained = call_here(folder, "report", *arguments)
    assert (code, said) == (1, "")
    assert words in complained
    assert complained.count("\n") == 1


def test_no_run(call_here, folder):
    """Without a run the usage is shown, as for every command."""
    code, said, complained = call_here(folder, "report")
    assert (code, said) == (2, "")
    assert "Usage: " in complained


def test_a_cost_table(call_here, folder, monkeypatch):
    """Claims are judged by the given runs and the path of the cost table."""
    given = []

    def judge_all(runs, cost, spreads):
        assert spreads is None
        given.append(([str(run.folder) for run in runs], str(cost)))
        return pd.DataFrame(columns=[column.name for column in schemas.CLAIMS])

    monkeypatch.setattr("study.simulation.claims.judge_all", judge_all)
    arguments = ["out", "--cost", "some.parquet", "--out", "cost.html"]
    assert call_here(folder, "report", *arguments) == (0, "cost.html\n", "")
    assert given == [(["out"], "some.parquet")]
    assert "No claim of the paper was judged" in page(folder / "cost.html")


HERE = __name__.rpartition(".")[2] + ".py"


class Drawable:
    """The half of a figure that does not fail."""

    def draw(self, frame):
        return Figure()


class Outside(Drawable):
    """A figure that fails in its own code, which is not the package's."""

    def prepare(self, tables):
        return tables.stamp


class Inside(Drawable):
    """A figure that fails in a function of the package, one call further in."""

    def prepare(self, tables):
        return figure.at_first(None, [])


class Whole(Drawable):
    """A figure that can be drawn."""

    def prepare(self, tables):
        return tables.name


def line_of(where, text):
    """Number of the line of a function or class that holds a text."""
    lines, first = inspect.getsourcelines(where)
    (found,) = [first + index for index, line in enumerate(lines) if text in line]
    return found


PLACES = {
    Outside: f"AttributeError(\"'Tables' object has no attribute 'stamp'\") at {HERE}, "
    f"line {line_of(Outside, 'tables.stamp')}, in prepare",
    Inside: "at study/simulation/figures/figure.py, "
    f"line {line_of(figure.at_first, 'condition.name in table and')}, in at_first",
}


@pytest.mark.parametrize("broken", PLACES, ids=lambda each: each.__name__)
def test_a_figure_that_fails(finished, call_here, tmp_path, monkeypatch, broken):
    """Exception, file and line are told in one line; the next figure is drawn, and the exit code is 1."""
    monkeypatch.setattr(figures, "FIGURES", {"broken": broken(), "whole": Whole()})
    code, said, complained = call_here(finished[0], "figures", "out", "--out", tmp_path / "drawn")
    assert code == 1
    assert [line.rpartition("/")[2] for line in said.splitlines()] == ["whole.png", "whole.svg"]
    (line,) = complained.splitlines()
    assert line.startswith("broken: failed: ")
    assert line.endswith(PLACES[broken])


def test_a_figure_that_does_not_apply_is_no_failure(finished, call_here, tmp_path):
    """A run that cannot feed a figure is code 0 and a reason."""
    code, _, complained = call_here(finished[0], "figures", "out", "fig2_error", "--out", tmp_path / "drawn")
    assert code == 0
    assert complained.startswith("fig2_error: not drawn: ")


def test_figures_of_several_runs(finished, call_here, tmp_path):
    """Runs and figures are told apart by the figures' names; a name that is neither, or no run, is refused."""
    code, said, complained = call_here(finished[0], "figures", "out", "out", "fig2_error", "--out", tmp_path / "drawn")
    assert (code, said) == (0, "")
    assert complained.startswith("fig2_error: not drawn: ")
    code, _, complained = call_here(finished[0], "figures", "out", "fig_eficiency")
    assert code == 2
    assert "fig_eficiency: unknown; did you mean 'fig_efficiency'?" in " ".join(complained.split())
    code, _, complained = call_here(finished[0], "figures", "fig_efficiency")
    assert code == 2
    assert "no run is given" in complained


def test_a_file_in_place_of_the_folder(finished, call_here, tmp_path):
    """A file, or a path below one, is refused in one line, and stays as it is."""
    (tmp_path / "mine").write_text("text")
    for path, words in [("mine", "is a file, not a folder; choose another with --out"), ("mine/below", "cannot be")]:
        code, said, complained = call_here(finished[0], "figures", "out", "fig2_error", "--out", tmp_path / path)
        assert (code, said, len(complained.splitlines())) == (1, "", 1)
        assert complained.startswith(f"{tmp_path / path}: {words}")
    assert (tmp_path / "mine").read_text() == "text"

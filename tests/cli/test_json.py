"""Option --json: one object on standard output, with keys that do not change, and null where there is no number."""

import csv
import json
import shutil

import numpy as np
import pytest

from study.analysis.worst import worst
from study.estimators import Status
from study.experiment.config import parse
from study.runs.storage import schemas
from study.runs.storage.run_folder import Run
from study.text.json_text import json_text


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

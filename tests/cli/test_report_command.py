"""The report command: a page beside the run or in the given file, and one line if it cannot be written."""

import re
import shutil

import pandas as pd
import pytest

from study.runs.storage import schemas


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

    monkeypatch.setattr("study.analysis.claims.judge_all", judge_all)
    arguments = ["out", "--cost", "some.parquet", "--out", "cost.html"]
    assert call_here(folder, "report", *arguments) == (0, "cost.html\n", "")
    assert given == [(["out"], "some.parquet")]
    assert "No claim of the paper was judged" in page(folder / "cost.html")

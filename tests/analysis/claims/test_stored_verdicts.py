"""Verdicts are judged once by the same tables, and again where anything that they rest on has changed."""

import shutil

import pandas as pd
import pyarrow.parquet as pq
import pytest

from study.analysis import claims
from study.report import commands
from study.runs import kept
from study.runs.storage.lock import holder, writing
from study.runs.storage.run_folder import Run, RunError


def fail(*_):
    """Stand-in for what judges claims."""
    raise AssertionError("judged again")


@pytest.fixture
def run(circles, copied):
    """A run of its own, whose files a test may change."""
    return copied(circles)


@pytest.fixture
def judged(run):
    """The run's verdicts, stored; each change after it shows in the key or in the digest."""
    table = claims.judge_all([run])
    claims.save(run, table, claims.key([run]))
    return table


def test_the_same_is_not_judged_again(run, judged):
    """With the same tables the stored verdicts are the ones that were judged, in another object of the run too."""
    again = Run.open(run.folder)
    found = claims.stored(again, claims.key([again]))
    pd.testing.assert_frame_equal(found, judged, check_dtype=False)
    assert list(claims.printed(found)) == list(claims.printed(judged))


def test_the_command_does_not_judge_again(run, monkeypatch, capsys):
    """A second call prints the same and judges nothing, nor does the page; with another table both do."""
    monkeypatch.setattr("study.report.pictures.FIGURES", {})
    commands.claims([run.folder])
    said = capsys.readouterr().out
    monkeypatch.setattr("study.analysis.claims.evaluate", fail)
    commands.claims([run.folder])
    assert capsys.readouterr().out == said
    commands.report([run.folder], jobs=1)
    run.save("timings", run.arrow("timings").slice(1))
    for command in (commands.claims, commands.report):
        with pytest.raises(AssertionError, match="judged again"):
            command([run.folder])


def test_edited_verdicts_are_not_believed(run, judged):
    """A claims table that is not as the manifest says is judged again; so is one that was noted there since."""
    known = claims.key([run])
    table = pq.read_table(run.path("claims"))
    verdicts = table.set_column(table.schema.get_field_index("verdict"), "verdict", [["reproduced"] * len(table)])
    pq.write_table(verdicts, run.path("claims"))
    assert claims.stored(run, known) is None
    run.record("claims")
    assert claims.stored(run, known) is None
    run.remove("claims")
    assert claims.stored(run, known) is None


def test_the_key_is_noted_under_the_lock(run, monkeypatch):
    """No other command can store its table between a table and the note of what that was judged by."""
    writers = []
    monkeypatch.setattr(kept, "keep", lambda run, *_: writers.append(holder(run.folder)))
    claims.save(run, claims.judge_all([run]), "key")
    assert len(writers) == 1
    assert writers[0] is not None


def test_another_cost_table(run, judged, tmp_path):
    """Another cost table, none, or other recordings have keys of their own; a missing file has none."""
    path = tmp_path / "cost.csv"
    spreads = pd.DataFrame({"recording": ["a"], "spread": [0.1]})
    keys = {claims.key([run]), claims.key([run], None, spreads), claims.key([run], None, spreads * 2)}
    for text in ("a\n1\n", "a\n2\n"):
        path.write_text(text)
        keys.add(claims.key([run], path))
    assert len(keys) == 5
    assert None not in keys
    path.unlink()
    assert claims.key([run], path) is None


def test_another_folder(run, judged, tmp_path):
    """A copy of the run elsewhere is judged again: reasons name the folder."""
    other = Run.open(shutil.copytree(run.folder, tmp_path / "other"))
    assert claims.stored(other, claims.key([other])) is None


def test_another_program(run, judged, monkeypatch):
    """Verdicts of other sources or libraries are judged again."""
    monkeypatch.setattr(kept, "_program", lambda: ("other",))
    assert claims.stored(run, claims.key([run])) is None


def test_verdicts_that_cannot_be_stored_are_printed(run, capsys, files_of):
    """While another process writes to the folder, or the disk does not let it, the work is not lost."""
    with writing(run.folder):
        before = files_of(run.folder)
        with pytest.raises(RunError, match="is writing to it"):
            commands.claims([run.folder])
        assert files_of(run.folder) == before
    said = capsys.readouterr().out
    commands.claims([run.folder])
    assert capsys.readouterr().out == said != ""


@pytest.mark.parametrize("change", ["missing", "damaged"])
def test_nothing_is_stored_that_no_manifest_vouches_for(run, judged, change, files_of):
    """Without a sound manifest neither the command nor the function writes a table."""
    path = run.folder / "manifest.json"
    path.write_text(path.read_text(encoding="utf-8").replace("circles", "circle"), encoding="utf-8")
    if change == "missing":
        path.unlink()
    before = files_of(run.folder)
    with pytest.raises(RunError, match=f"manifest.json: {change}[^\n]*$"):
        commands.claims([run.folder])
    if change == "damaged":
        with pytest.raises(RunError, match=r"manifest\.json: damaged[^\n]*$"):
            claims.save(run, judged)
    assert files_of(run.folder) == before


def test_a_cost_table_that_is_missing(run, tmp_path, files_of):
    """A table that cannot be read is one line, and nothing is written."""
    before = files_of(run.folder)
    for path in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(RunError, match=rf"{path}[^\n]*$"):
            commands.claims([run.folder], path)
    assert files_of(run.folder) == before

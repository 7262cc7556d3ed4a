"""What is made of a run's tables is used again while all that it was made of is the same, and no longer."""

import pytest

from study.simulation.runs import kept


@pytest.fixture
def run(circles, copied):
    """A run of its own, whose files a test may change."""
    return copied(circles)


def test_what_was_kept_is_found(run):
    """Under its key and name a result is found again, in place of an earlier one."""
    known = kept.key([run], "a picture")
    assert kept.find(run, "a", known) is None
    for content in (b"first\n\nlines", b""):
        kept.keep(run, "a", known, content)
        assert kept.find(run, "a", known) == content
    assert kept.find(run, "b", known) is None


@pytest.mark.parametrize("table", ["errors", "summary", "points", "timings"])
def test_a_changed_table(run, table):
    """A table that is gone, or not as its manifest says, gives no key; other tables give another."""
    known = kept.key([run])
    path = run.path(table)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + b"x")
    assert kept.key([run]) is None
    run.record(table)
    path.write_bytes(whole)
    assert kept.key([run]) is None
    run.record(table)
    assert kept.key([run]) == known
    run.forget(table)
    assert kept.key([run]) is None
    path.unlink()
    assert kept.key([run]) not in (known, None)


def test_another_program(run, monkeypatch, tmp_path):
    """The key is another where a source file of the package, a library, or what is asked differs."""
    known = kept.key([run], "a", 200)
    assert kept.key([run], "a", 200) == known
    assert len({kept.key([run], *asked) for asked in (("a", 160), ("b", 200), ("a",), ("a", 200, None))} - {known}) == 4
    (tmp_path / "package").mkdir()
    source = tmp_path / "package" / "a.py"
    found = set()
    for text in ("x = 1", "x = 2"):
        source.write_text(text)
        monkeypatch.setattr(kept, "_PACKAGE", source.parent)
        kept._program.cache_clear()
        found.add(kept.key([run], "a", 200))
    monkeypatch.setattr(kept, "packages", lambda: {"numpy": "0.1"})
    kept._program.cache_clear()
    found.add(kept.key([run], "a", 200))
    assert len(found | {known}) == 4
    monkeypatch.undo()
    kept._program.cache_clear()
    assert kept.key([run], "a", 200) == known


def test_changed_bytes(run):
    """A result whose file was edited, cut or emptied is not used."""
    known = kept.key([run])
    kept.keep(run, "a", known, b"content")
    path = run.folder / kept.FOLDER / "a"
    whole = path.read_bytes()
    for changed in (whole[:-1], whole + b"x", whole.replace(b"content", b"another"), b"", whole[1:]):
        path.write_bytes(changed)
        assert kept.find(run, "a", known) is None
    path.write_bytes(whole)
    assert kept.find(run, "a", known) == b"content"


def test_another_results_file(run):
    """A result that lies under the name of another one, of the same key, is not used."""
    known = kept.key([run])
    kept.keep(run, "a.png", known, b"a picture")
    (run.folder / kept.FOLDER / "a.png").rename(run.folder / kept.FOLDER / "b.png")
    assert kept.find(run, "b.png", known) is None


def test_without_a_key_nothing_is_kept(run):
    """Where tables are damaged nothing is written; where the folder cannot be made nothing fails."""
    kept.keep(run, "a", None, b"content")
    assert not (run.folder / kept.FOLDER).exists()
    (run.folder / kept.FOLDER).write_text("a file")
    kept.keep(run, "a", "key", b"content")
    assert kept.find(run, "a", "key") is None


def test_other_runs(run, circles, random):
    """The same tables in another folder have the same key; other runs, and another order of them, have others."""
    assert kept.key([run]) == kept.key([circles])
    assert len({kept.key(runs) for runs in ([run], [random], [run, random], [random, run])}) == 4

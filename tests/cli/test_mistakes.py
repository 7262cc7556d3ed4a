"""Commands that fail: exit code 1 or 2, a plain message on standard error, no traceback, and nothing written."""

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def folder(tmp_path, config):
    """A folder with a good config and a bad one."""
    (tmp_path / "tiny.toml").write_text(config)
    (tmp_path / "bad.toml").write_text(config.replace("trials = 5", "trials = 0").replace("= 90", "= 190"))
    return tmp_path


def names(folder):
    """All that is in a folder."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def refused(result, code, *words):
    """Assert a plain refusal with some words in it."""
    found, said, complained = result
    assert (found, said) == (code, "")
    assert "Traceback" not in complained
    assert "Warning" not in complained
    assert all(word in complained for word in words), complained
    return complained


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_bad_config(call_here, folder, verb):
    """A bad config is code 2 and a line per fault, and nothing is written."""
    before = names(folder)
    said = refused(
        call_here(folder, verb, "bad.toml"), 2, "bad.toml: 2 faults", "design.trials = 0", "design.angle = 190"
    )
    assert len(said.splitlines()) == 3
    assert names(folder) == before


def test_a_bad_config_in_a_process_of_its_own(call, folder):
    """In a process of its own the refusal is the same: code 2, a line per fault, no traceback, nothing written."""
    before = names(folder)
    said = refused(call(folder, "run", "bad.toml"), 2, "bad.toml: 2 faults")
    assert len(said.splitlines()) == 3
    assert names(folder) == before


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_config_that_is_not_there(call_here, folder, verb):
    """A missing config is code 2 and one line, and nothing is written."""
    before = names(folder)
    said = refused(call_here(folder, verb, "none.toml"), 2, "none.toml", "No such file or directory")
    assert len(said.splitlines()) == 1
    assert names(folder) == before


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_name_that_no_config_has(call_here, folder, verb):
    """A name without a suffix that is neither a file nor shipped is code 2, with the nearest name and the list."""
    words = "papre: neither a file nor a shipped config; did you mean 'paper'? Known are anisotropic, bias, "
    said = refused(call_here(folder, verb, "papre"), 2, words)
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments", [["rnu"], ["run"], ["run", "tiny.toml", "--jobs", "0"], ["plan", "-x", "a"]], ids=str
)
def test_wrong_usage(call_here, folder, arguments):
    """Wrong usage is code 2 and the usage."""
    refused(call_here(folder, *arguments), 2, "Usage: ")


def test_what_is_no_run(call_here, folder):
    """A folder that is no run, or none at all, is code 1 and one line that says how to make one."""
    for path, named in ((".", "."), ("none", "none"), ("tiny.toml", "results/tiny-")):
        said = refused(call_here(folder, "summary", path), 1, named, "not a run folder", "study run CONFIG")
        assert len(said.splitlines()) == 1


def test_a_run_that_did_not_finish(call_here, folder):
    """A run without a summary is code 1, one line, and the command that finishes it."""
    (folder / "half").mkdir()
    (folder / "half" / "config.toml").write_text((folder / "tiny.toml").read_text())
    said = refused(call_here(folder, "summary", "half"), 1, "summary.parquet: missing", "study run half/config.toml")
    assert len(said.splitlines()) == 1


def test_the_folder_of_another_config(call_here, folder, config, finished):
    """A folder of another config is code 1 and one line, and is left as it is."""
    (folder / "other.toml").write_text(config.replace("seed = 1", "seed = 2"))
    taken = finished[0] / "out"
    before = {path.name: path.read_bytes() for path in taken.iterdir()}
    said = refused(call_here(folder, "run", "other.toml", "--out", taken), 1, "holds a run of another config")
    assert len(said.splitlines()) == 1
    assert {path.name: path.read_bytes() for path in taken.iterdir()} == before


def test_a_folder_that_cannot_be_made(call_here, folder):
    """A folder below a file is code 1 and one line."""
    said = refused(
        call_here(folder, "run", "tiny.toml", "--out", "tiny.toml/out"), 1, "cannot be written: Not a directory"
    )
    assert len(said.splitlines()) == 1


def test_numbers_beyond_floating_point(call_here, folder, config):
    """A number that no double holds is a fault, not a crash."""
    (folder / "huge.toml").write_text(config.replace("= 90", "= 1" + 400 * "0"))
    refused(call_here(folder, "plan", "huge.toml"), 2, "huge.toml: 1 fault", "design.angle")


@pytest.mark.parametrize("words", ["summary {}", "status {}", "plan {}", "run {}", "summary {}/x"])
def test_a_name_that_the_disk_refuses(call_here, folder, words):
    """A name that is too long for the system is one line, like any other that is not there."""
    code, said, complained = call_here(folder, *words.format("a" * 300).split())
    assert (code in (1, 2), said, len(complained.splitlines())) == (True, "", 1)


def test_a_closed_folder(call_here, folder, finished, monkeypatch):
    """A folder that may not be entered is named, with what to do; so is a manifest that may not be read."""
    (folder / "closed").mkdir()

    def closed(path):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "is_file", closed)
        code, said, complained = call_here(folder, "status", "closed")
    assert (code, said) == (1, "")
    assert complained == "closed: cannot be read: Permission denied; make it readable, or give another folder\n"
    shutil.copytree(finished[0] / "out", folder / "odd")
    (folder / "odd" / "manifest.json").unlink()
    (folder / "odd" / "manifest.json").mkdir()
    code, said, _ = call_here(folder, "status", "odd")
    assert code == 0
    assert "odd/manifest.json: cannot be read: Is a directory; make it readable, or remove it" in said

"""Standard output that is full, closed or read by nobody ends a command quietly; so do names that are not UTF-8."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has neither /dev/full nor such names")


@pytest.fixture
def shell(command, config, tmp_path):
    """Run a command line in a shell, as a user does; exit code and standard error come back."""
    words, environment = command
    (tmp_path / "tiny.toml").write_text(config)

    def run(line):
        done = subprocess.run(
            ["bash", "-c", line.replace("study ", " ".join([*words, ""]))],
            cwd=tmp_path,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        return done.returncode, done.stderr.decode(errors="replace")

    return run


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no /dev/full")
def test_a_full_output(shell):
    """Code 1 and one line."""
    message = "standard output: cannot be written: No space left on device\n"
    assert shell("study configs > /dev/full") == (1, message)


def test_a_closed_output(shell):
    """There is nothing to say, and nobody to say it to."""
    assert shell("study configs >&-") == (0, "")


def test_a_reader_that_has_gone(shell):
    """The code is that of a program that the signal ended, 128 + 13."""
    assert shell("study configs | true; exit ${PIPESTATUS[0]}") == (141, "")


def test_a_folder_whose_name_is_not_utf_8(call_here, config, tmp_path):
    """Code 1 and one line, whether it is to be made or read."""
    (tmp_path / "tiny.toml").write_text(config)
    name = os.fsdecode(b"o\xff")
    try:
        (tmp_path / name).mkdir()
    except OSError:
        pytest.skip("this disk has no such names")
    for words in (["run", "tiny.toml", "--out", name], ["summary", name], ["verify", name]):
        code, said, complained = call_here(tmp_path, *words)
        assert (code, said) == (1, "")
        assert len(complained.splitlines()) == 1
        assert "not UTF-8" in complained
    assert sys.getfilesystemencoding() == "utf-8"

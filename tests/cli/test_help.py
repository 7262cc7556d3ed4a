"""Help of the whole command line: groups of commands, exit codes, version and shell completion."""

import re
import subprocess
import sys

import pytest

import study
from study import cli
from study.runs.commands import EXIT_CODES, ExitCode

TITLES = ["Studies", "Results", "Points and estimators", "Recordings"]


@pytest.fixture
def sections(call_here, tmp_path):
    """The sections of `study --help`: for each title the first words of its entries."""
    code, said, complained = call_here(tmp_path, "--help")
    assert (code, complained) == (0, "")
    found = {}
    for line in said.splitlines():
        if title := re.fullmatch(r"([A-Z][\w ]+):", line):
            found[title[1]] = []
        elif found and (entry := re.match(r"  (\S+)  +\S", line)):
            list(found.values())[-1].append(entry[1])
    return found


def test_every_command_is_in_one_group(sections):
    """The groups stand in the order of a study, and between them have every command once."""
    assert list(sections) == ["Options", *TITLES, "Exit codes"]
    names = [name for title in TITLES for name in sections[title]]
    registered = [entry.name or entry.callback.__name__.replace("_", "-") for entry in cli.app.registered_commands]
    assert sorted(names) == sorted(registered)
    assert sections["Studies"][:3] == ["configs", "plan", "run"]
    assert sections["Results"][:2] == ["summary", "claims"]
    assert {"fit", "estimators"} <= set(sections["Points and estimators"])
    assert {"recording", "joints", "case-study"} <= set(sections["Recordings"])


def test_no_first_line_is_cut(call_here, tmp_path):
    """The line of each command fits the width of a terminal of 80 columns."""
    _, said, _ = call_here(tmp_path, "--help")
    assert "..." not in said.partition("Studies:")[2].partition("Exit codes:")[0]


def test_exit_codes(sections):
    """Each exit code has a line, in their order."""
    assert set(EXIT_CODES) == set(ExitCode)
    assert sections["Exit codes"] == [str(int(code)) for code in ExitCode]


def test_version(call_here, tmp_path):
    """`study --version` prints the version of the package, and nothing else."""
    assert call_here(tmp_path, "--version") == (0, f"study {study.__version__}\n", "")


ENTRY = "import sys; from study.cli import main; sys.argv = ['study']; main()"


@pytest.mark.parametrize(
    ("typed", "offered"),
    [("study su", {"summary"}), ("study summary --est", {"--estimators"}), ("study c", {"claims", "configs", "check"})],
)
def test_completion(command, typed, offered):
    """A shell that asks for completions, as the installed script does, gets the names of commands and options."""
    place = str(len(typed.split()) - 1)
    asking = {"_STUDY_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": place}
    words = [sys.executable, "-W", "error", "-c", ENTRY]
    done = subprocess.run(words, env=command[1] | asking, capture_output=True, encoding="utf-8", check=False)
    assert done.stderr == ""
    assert offered <= set(done.stdout.split())
    assert all(name.startswith(typed.split()[-1]) for name in done.stdout.split())


def test_completion_can_be_installed(call_here, tmp_path):
    """The help names the options that install it."""
    _, said, _ = call_here(tmp_path, "--help")
    assert {"--install-completion", "--show-completion"} <= set(re.findall(r"--[\w-]+", said))

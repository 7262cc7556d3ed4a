"""Commands that succeed: exit code 0, the answer on standard output, nothing on standard error.

Help of the whole command line: groups of commands, exit codes, version and shell completion.

From a recording to the verdict on it: a synthetic body, its case study, and the claims that it is given to.
"""

import importlib.metadata
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pandas as pd
import pytest

import study
from study import cli
from study.options import EXIT_CODES, ExitCode
from study.recordings.recording import digest_of
from study.simulation.analysis.summary import chosen_rows, printed
from study.simulation.experiment.config import load, parse, shipped_config, shipped_configs, summary_line
from study.simulation.runs.plan import plan
from study.simulation.runs.run_folder import Run


def test_run(finished, config):
    """`study run` stores the tables and prints the folder, and nothing else where there is no terminal."""
    folder, said = finished
    assert said == (0, "out\n", "")
    tables = {"errors.parquet", "timings.parquet", "summary.parquet"}
    assert {path.name for path in (folder / "out").iterdir()} == {"config.toml", "manifest.json"} | tables
    assert (folder / "out" / "config.toml").read_text() == config  # comments and all


def test_summary(well, finished):
    """`study summary` prints what the library's function yields."""
    folder = finished[0]
    said, run = well(folder, "summary", "out"), Run.open(folder / "out")
    assert said.splitlines() == list(printed(run, chosen_rows(run)))


def test_plan(well, config, tmp_path):
    """`study plan` prints the run's name and the library's counts, and writes nothing."""
    (tmp_path / "tiny.toml").write_text(config)
    said = well(tmp_path, "plan", "tiny.toml")
    name, *lines = said.splitlines()
    assert name == parse(config).run_name()
    told = dict(re.match(r"\s+(\w+)\s+(.*)", line).groups() for line in lines)
    expected = dict(plan(parse(config), 2).lines())
    assert told == expected | {"time": told["time"]}
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


@pytest.mark.parametrize("as_json", [[], ["--json"]])
@pytest.mark.parametrize(("seconds", "words"), [(3e9, "95.1 years"), (8 * 86_400.0, "8.0 days")])
def test_plan_of_more_than_a_week(well, call_here, config, tmp_path, monkeypatch, seconds, words, as_json):
    """A study that takes years is planned, with a warning of one line and an exit code; one of a week has neither."""
    (tmp_path / "tiny.toml").write_text(config)
    study = parse(config)
    trials = sum(map(study.trials_of, study.groups()))
    pace = SimpleNamespace(of=lambda samples, levels: seconds / trials, summary=0.0)
    monkeypatch.setattr("study.simulation.runs.plan.measure", lambda *_: pace)
    code, said, complained = call_here(tmp_path, "plan", "tiny.toml", "--jobs", "1", *as_json)
    assert (code, complained.count("\n")) == (ExitCode.TOO_LONG, 1)
    assert as_json or f"time     {words} predicted" in said
    assert f"would take {words} with --jobs 1, which is more than a week; give fewer" in complained
    pace.of = lambda samples, levels: (7 * 86_400.0 - 1.0) / trials
    well(tmp_path, "plan", "tiny.toml", "--jobs", "1")


CODE = """
import sys
from study.cli import main
sys.argv = ["study", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    print("code", end.code)
print("loaded", *(set(sys.modules) & {"numpy", "numba", "scipy", "pandas", "pyarrow", "matplotlib", "joblib"}))
"""


@pytest.mark.parametrize("line", ["--help", "run --help", "plan --help", "joints --help", "synthetic --help"])
def test_help_is_light(command, line):
    """`study --help`, and that of a command, import none of the heavy libraries."""
    words = [sys.executable, "-W", "error", "-c", CODE, *line.split()]
    done = subprocess.run(words, env=command[1], capture_output=True, encoding="utf-8", check=True)
    assert (done.stderr, done.stdout.splitlines()[-2:]) == ("", ["code 0", "loaded"])
    assert "Usage: study" in done.stdout


def test_entry_point():
    """In an installed package `study` is the main function."""
    entries = [e for e in importlib.metadata.entry_points(group="console_scripts") if e.name == "study"]
    assert all(entry.value == "study.cli:main" for entry in entries)


def test_configs(well, tmp_path):
    """`study configs` lists every shipped config with its first line, from any folder."""
    said = well(tmp_path, "configs")
    told = dict(re.split(r" {2,}", line, maxsplit=1) for line in said.splitlines())
    assert told == {name: summary_line(path) for name, path in shipped_configs().items()}


def test_a_shipped_config_by_name(well, tmp_path):
    """`study plan smoke` works in a folder without configs, and says the same as with the file."""
    said = well(tmp_path, "plan", "smoke")
    assert said.splitlines()[0] == load(shipped_config("smoke")).run_name()


TITLES = ["Points", "Joints", "Studies", "More on studies", "More on results", "More on recordings"]


@pytest.fixture
def sections(well, tmp_path):
    """The sections of `study --help`: for each title the first words of its entries."""
    sections = {}
    for line in well(tmp_path, "--help").splitlines():
        if title := re.fullmatch(r"([A-Z][\w ]+):", line):
            sections[title[1]] = entries = []
        elif sections and (entry := re.match(r"  (\S+)  +\S", line)):
            entries.append(entry[1])
    return sections


def test_every_command_is_in_one_group(sections):
    """Points come first, ten commands before the others, and the groups have every command once."""
    assert list(sections) == ["Options", *TITLES, "Exit codes"]
    names = [name for title in TITLES for name in sections[title]]
    shown = [entry for entry in cli.app.registered_commands if not entry.hidden]
    registered = [entry.name or entry.callback.__name__.replace("_", "-") for entry in shown]
    assert sorted(names) == sorted(registered)
    assert sections["Points"][0] == "fit"
    assert sum(len(sections[title]) for title in TITLES if not title.startswith("More")) == 10


def test_help(well, tmp_path):
    """The line of each command fits a terminal of 80 columns; the options that install completion are named."""
    said = well(tmp_path, "--help")
    assert "..." not in said.partition("Points:")[2].partition("Exit codes:")[0]
    assert {"--install-completion", "--show-completion"} <= set(re.findall(r"--[\w-]+", said))


def test_exit_codes(sections):
    """Each exit code has a line, in their order."""
    assert set(EXIT_CODES) == set(ExitCode)
    assert sections["Exit codes"] == [str(int(code)) for code in ExitCode]


def test_version(well, tmp_path):
    """`study --version` prints the version of the package, and nothing else."""
    assert well(tmp_path, "--version") == f"study {study.__version__}\n"


ENTRY = "import sys; from study.cli import main; sys.argv = ['study']; main()"


@pytest.mark.parametrize(
    ("typed", "offered"),
    [("study su", {"summary"}), ("study summary --est", {"--estimators"}), ("study c", {"claims", "configs", "check"})],
)
def test_completion(command, typed, offered):
    """A shell that asks for completions, as the installed script does, gets the names of commands and options."""
    asking = {"_STUDY_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    words = [sys.executable, "-W", "error", "-c", ENTRY]
    done = subprocess.run(words, env=command[1] | asking, capture_output=True, encoding="utf-8", check=False)
    assert done.stderr == ""
    assert offered <= set(done.stdout.split())
    assert all(name.startswith(typed.split()[-1]) for name in done.stdout.split())


@pytest.fixture(scope="module")
def folder(finished, done_here, tmp_path_factory):
    """A folder with a finished run in ``out`` and the case study of a short synthetic body in ``body``."""
    place = tmp_path_factory.mktemp("recording")
    shutil.copytree(finished[0] / "out", place / "out")
    words = "synthetic --frames 2000 --noise 0.002 --gaps 0.05 --out body.c3d"
    done_here(place, *words.split())
    shutil.copy(place / "body.c3d", place / "copy.c3d")
    for file, seed, out in (("body.c3d", "1", "body"), ("copy.c3d", "2", "again")):
        words = f"case-study {file} --subsets 20 --seed {seed} --out {out}"
        done_here(place, *words.split())
    return place


def of_recordings(said):
    """The lines of the claim on recordings that `study claims` printed."""
    lines = said.splitlines()
    first, after = (next(i for i, line in enumerate(lines) if line.startswith(number)) for number in ("23 ", "24 "))
    return lines[first:after]


def test_claims(well, folder):
    """With the recording there is a verdict on its joints, all of which are near."""
    said = well(folder, "claims", "out", "--recording", "body")
    head, *numbers = of_recordings(said)
    assert "REPRODUCED" in head
    assert numbers[0].startswith("    share of its conditions in which it holds: 1")
    assert numbers[1].startswith("    share of 14 joints of 1 recording with a spread below 1 cm, ")
    assert "above 200 samples: 1 ± 0.07" in numbers[1]
    assert numbers[2].endswith("joint by joint: 0")


def test_one_recording_twice(well, refused, folder):
    """Two seeds on one recording, were it copied, are one recording; the tables say which. One folder is refused."""
    for verb in ("claims", "report"):
        refused(folder, 2, "body and body: the same case study", verb, "out", *["--recording", "body"] * 2)
    said = well(folder, "claims", "out", "--recording", "body", "--recording", "again")
    assert of_recordings(said)[2].startswith("    share of 14 joints of 1 recording with a spread below 1 cm, ")
    for name in ("scatter", "joints", "laws"):
        body, again = (pd.read_parquet(folder / out / f"case-study-{name}.parquet") for out in ("body", "again"))
        assert set(body["recording"]) == {"body"}
        assert set(again["recording"]) == {"copy"}
        assert set(body["digest"]) == set(again["digest"]) == {digest_of(folder / "body.c3d")}


def test_report(well, folder):
    """The page has the verdict, too, and says on how many joints it rests; without the recording what would give it."""
    for options, words in (
        (["--recording", "body"], ["share of 14 joints of 1 recording", "at least 14 behind each number"]),
        ([], ["<code>study case-study</code> writes, given by <code>--recording</code>"]),
    ):
        well(folder, "report", "out", *options, "--out", "page.html")
        page = (folder / "page.html").read_text(encoding="utf-8")
        assert all(word in page for word in words)


def test_report_counts_the_verdicts(well, folder):
    """With --claims they are stored, and one line says that the run judges none. The page comes last."""
    said = well(folder, "report", "out", "--claims", "--out", "page.html").splitlines()
    each = well(folder, "claims", "out").splitlines()
    assert len(each) == 1
    assert said[-2:] == [*each, "page.html"]


def test_a_command_that_is_gone(call_here, tmp_path):
    """The old word is answered with the new ones, whatever options follow it; the list of commands has it no more."""
    code, said, complained = call_here(tmp_path, "coverage", "configs/coverage.toml", "-j", "2", "--out", "here")
    assert (code, said) == (2, "")
    assert "study run coverage" in " ".join(complained.split())
    assert "measures = ['interval', 'own_errors']" in " ".join(complained.split())

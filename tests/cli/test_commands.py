"""Commands that succeed: exit code 0, the answer on standard output, nothing on standard error."""

import importlib.metadata
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from study.analysis.summary_text import printed
from study.experiment.config import load, parse
from study.experiment.shipped_configs import shipped_config, shipped_configs, summary_line
from study.runs.commands import ExitCode
from study.runs.plan import plan
from study.runs.storage.run_folder import Run


def test_run(finished):
    """`study run` stores the tables and prints the folder, and nothing else where there is no terminal."""
    folder, (code, said, complained) = finished
    assert (code, said, complained) == (0, "out\n", "")
    tables = {"errors.parquet", "timings.parquet", "summary.parquet"}
    assert {path.name for path in (folder / "out").iterdir()} == {"config.toml", "manifest.json"} | tables


def test_run_stores_the_config_as_it_was_given(finished, config):
    """The run's config is the user's file, comments and all."""
    assert (finished[0] / "out" / "config.toml").read_text() == config


def test_run_into_the_default_folder(call_here, config, tmp_path, finished):
    """Without --out, the folder is results/<name>-<digest>, and the numbers are the same."""
    (tmp_path / "tiny.toml").write_text(config)
    code, said, complained = call_here(tmp_path, "run", "tiny.toml", "--jobs", "1")
    name = parse(config).run_name()
    assert (code, said, complained) == (0, f"results/{name}\n", "")
    one, other = Run.open(tmp_path / "results" / name), Run.open(finished[0] / "out")
    assert one.table("errors").equals(other.table("errors"))
    assert one.table("summary").equals(other.table("summary"))


def test_summary(finished, call_here):
    """`study summary` prints what the library's function yields."""
    folder = finished[0]
    code, said, complained = call_here(folder, "summary", "out")
    assert (code, complained) == (0, "")
    assert said.splitlines() == list(printed(Run.open(folder / "out")))


def test_plan(call_here, config, tmp_path):
    """`study plan` prints the run's name and the library's counts, and writes nothing."""
    (tmp_path / "tiny.toml").write_text(config)
    code, said, complained = call_here(tmp_path, "plan", "tiny.toml")
    assert (code, complained) == (0, "")
    name, *lines = said.splitlines()
    assert name == parse(config).run_name()
    found = dict(re.match(r"\s+(\w+)\s+(.*)", line).groups() for line in lines)
    for label, value in plan(parse(config), 2).lines():
        assert label in found
        if label != "time":
            assert found[label] == value
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


@pytest.mark.parametrize("as_json", [[], ["--json"]])
@pytest.mark.parametrize(("seconds", "words"), [(3e9, "95.1 years"), (8 * 86_400.0, "8.0 days")])
def test_plan_of_more_than_a_week(call_here, config, tmp_path, monkeypatch, seconds, words, as_json):
    """A study that takes years is planned, with a warning of one line and an exit code; one of a week has neither."""
    (tmp_path / "tiny.toml").write_text(config)
    pace = SimpleNamespace(of=lambda work: seconds if len(work) else 0.0, summary=0.0)
    monkeypatch.setattr("study.runs.plan.measure", lambda *_: pace)
    code, said, complained = call_here(tmp_path, "plan", "tiny.toml", "--jobs", "1", *as_json)
    assert code == ExitCode.TOO_LONG
    assert as_json or f"time     {words} predicted" in said
    assert f"would take {words} with --jobs 1, which is more than a week; give fewer" in complained
    assert len(complained.splitlines()) == 1
    pace.of = lambda work: 7 * 86_400.0 - 1.0
    assert call_here(tmp_path, "plan", "tiny.toml", "--jobs", "1")[::2] == (0, "")


HEAVY = ["numpy", "numba", "scipy", "pandas", "pyarrow", "matplotlib", "joblib"]
CODE = """
import sys
from study.cli import main
sys.argv = ["study", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    print("code", end.code)
print("loaded", *(set(sys.modules) & {names}))
"""


def test_help_is_light(command):
    """`study --help`, and that of a command, import none of the heavy libraries."""
    for arguments in (["--help"], ["run", "--help"], ["plan", "--help"]):
        code = CODE.replace("{names}", repr(set(HEAVY)))
        words = [sys.executable, "-W", "error", "-c", code, *arguments]
        done = subprocess.run(words, env=command[1], capture_output=True, encoding="utf-8", check=True)
        assert done.stderr == ""
        assert done.stdout.splitlines()[-2:] == ["code 0", "loaded"]
        assert "Usage: study" in done.stdout


def test_help_names_every_command(call, tmp_path):
    """The help has a line for each command."""
    code, said, _ = call(tmp_path, "--help")
    assert code == 0
    assert all(re.search(rf"\b{name}\b", said) for name in ("plan", "run", "summary", "figures"))


def test_entry_point():
    """In an installed package `study` is the main function."""
    found = [e for e in importlib.metadata.entry_points(group="console_scripts") if e.name == "study"]
    assert all(entry.value == "study.cli:main" for entry in found)


def test_configs(call_here, tmp_path):
    """`study configs` lists every shipped config with its first line, from any folder."""
    code, said, complained = call_here(tmp_path, "configs")
    assert (code, complained) == (0, "")
    found = dict(re.split(r" {2,}", line, maxsplit=1) for line in said.splitlines())
    assert found == {name: summary_line(path) for name, path in shipped_configs().items()}


def test_a_shipped_config_by_name(call_here, tmp_path):
    """`study plan smoke` works in a folder without configs, and says the same as with the file."""
    code, said, complained = call_here(tmp_path, "plan", "smoke")
    assert (code, complained) == (0, "")
    assert said.splitlines()[0] == load(shipped_config("smoke")).run_name()


def test_a_config_names_its_run(finished, call_here, config, tmp_path):
    """A command that takes a run's folder also takes the config of a run in results/."""
    (tmp_path / "tiny.toml").write_text(config)
    name = parse(config).run_name()
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / name).symlink_to(finished[0] / "out", target_is_directory=True)
    by_config, by_folder = (call_here(tmp_path, "summary", word) for word in ("tiny.toml", f"results/{name}"))
    assert by_config == by_folder
    assert by_config[0] == 0
    code, said, complained = call_here(tmp_path, "summary", "none.toml")
    assert (code, said) == (2, "")
    assert "none.toml: cannot be read" in complained


def test_a_shipped_config_names_its_run(call_here, tmp_path):
    """The name of a shipped config stands for its run, too."""
    name = load(shipped_config("smoke")).run_name()
    code, said, complained = call_here(tmp_path, "summary", "smoke")
    assert (code, said) == (1, "")
    assert f"results/{name}: not a run folder" in complained

"""Adaptive runs on the command line: `run --budget`, its code 4, and the other commands on such a run."""

import pytest

from study.runs.storage.run_folder import Run

CONFIG = """name = "need"
seed = 1
estimators = ["lls", "ugdk"]
[design]
kind = "grid"
trials = 400
samples = [5, 20]
noise = [0.01, 0.1]
angle = 90
[precision]
relative_target = 0.08
first = 100
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with a config that has a [precision], and one that has not."""
    (tmp_path / "need.toml").write_text(CONFIG)
    (tmp_path / "fixed.toml").write_text(CONFIG[: CONFIG.index("[precision]")])
    return tmp_path


def test_a_budget_that_ends_at_once(call_here, folder):
    """Code 4 and one line, again and again; every command works on the run; the command in the line finishes it."""
    for _ in range(2):
        code, said, complained = call_here(folder, "run", "need.toml", "--out", "out", "--budget", "0")
        assert (code, said) == (4, "out\n")
        assert len(complained.splitlines()) == 1
        assert complained.startswith("out: stopped by its budget of 0 s: 0 of 4 cells reached the target; `study run ")
        assert complained.endswith(" resumes it\n")
    assert "stopped by its budget of 0 s" in call_here(folder, "status", "out")[1]
    assert "no cell has a trial yet" in call_here(folder, "summary", "out")[1]
    for verb in ("figures", "report"):
        code, _, complained = call_here(folder, verb, "out")
        assert (code, len(complained.splitlines())) == (1, 1)
        assert "its budget ended before any cell had a trial" in complained
    assert call_here(folder, "worst", "out")[0] == 0
    command = call_here(folder, "run", "need.toml", "--out", "out", "--budget", "0")[2].split("`")[1]
    assert call_here(folder, *command.split()[1:]) == (0, "out\n", "")
    assert "finished" in call_here(folder, "status", "out")[1]


def test_a_finished_run(call_here, folder):
    """Status and report count the cells that reached the target; `replay` draws a trial beyond them, with a warning."""
    assert call_here(folder, "run", "need.toml", "--out", "out")[0] == 0
    run = Run.open(folder / "out")
    trials = run.trials()
    assert len(set(trials.values())) > 1
    reached = int((run.table("precision")["reason"] == "target").sum())
    assert f"4, of which {reached} reached the target" in call_here(folder, "status", "out")[1]
    page = folder / "out" / "report.html"
    assert call_here(folder, "report", "out")[0] == 0
    text = page.read_text(encoding="utf-8")
    assert "Trials by need" in text
    assert "the target is reached" in text
    assert "up to 400 trials" in text.replace("\u202f", "").replace("\u00a0", " ")
    name, count = min(trials.items(), key=lambda item: item[1])
    assert count < 400
    code, said, complained = call_here(folder, "replay", "out", name, str(count - 1))
    assert (code, complained) == (0, "")
    code, said, complained = call_here(folder, "replay", "out", name, str(count))
    assert code == 0
    assert f"cell {name}, trial {count}" in said
    assert complained == f"out: cell {name} has {count} trials; trial {count} is not in its tables\n"
    assert call_here(folder, "replay", "out", name, "400")[0] == 2


def test_beside_a_fixed_run(call_here, folder):
    """The trials that both runs have are the same data sets: `diff` finds no difference."""
    assert call_here(folder, "run", "need.toml", "--out", "need")[0] == 0
    assert call_here(folder, "run", "fixed.toml", "--out", "fixed")[0] == 0
    code, said, _ = call_here(folder, "diff", "need", "fixed")
    assert code == 0
    assert said.splitlines()[0] == "need and fixed: identical in the trials that both have"
    assert "errors, trial by trial" in said


def test_plan(call_here, folder):
    """The plan has the least work, up to the first checkpoint, and the most, up to the cap."""
    code, said, complained = call_here(folder, "plan", "need.toml")
    assert (code, complained) == (0, "")
    least, most = said.split("at most")
    assert "up to the first checkpoint, 100 trials" in least
    assert "fits     800\n" in least
    assert "fits     3,200\n" in most


@pytest.mark.parametrize("value", ["-1", "soon"])
def test_budgets_that_are_none(call_here, folder, value):
    """A budget that is no time is wrong usage, and nothing is written."""
    assert call_here(folder, "run", "need.toml", "--out", "out", "--budget", value)[0] == 2
    assert not (folder / "out").exists()


def test_a_budget_for_a_fixed_study(call_here, folder):
    """A budget for a fixed number of trials is refused before anything is run."""
    code, said, complained = call_here(folder, "run", "need.toml", "fixed.toml", "--budget", "1")
    assert (code, said) == (2, "")
    assert "fixed.toml has no [precision]" in complained
    assert sorted(path.name for path in folder.iterdir()) == ["fixed.toml", "need.toml"]


def test_a_wrong_key(call_here, folder):
    """One line for the fault, with the nearest name, and code 2."""
    (folder / "bad.toml").write_text(CONFIG + 'measure = "ratio_medain"\n')
    code, said, complained = call_here(folder, "run", "bad.toml")
    assert (code, said) == (2, "")
    assert len(complained.splitlines()) == 2
    assert "precision.measure = 'ratio_medain'" in complained
    assert "did you mean 'ratio_median'" in complained

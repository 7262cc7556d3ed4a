"""Times of whole programs: short ones over the start of Python, long ones over NumPy's normal numbers.

The unit of a first answer is a program that calls a compiled function of one line, from its cache: nothing compiled
starts sooner.

`make smoke` and `make paper` run in a folder of their own, with the compiled code of this installation.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
SHORT = {
    "start of Python": ["-c", "pass"],
    "study --help": ["-m", "study.cli", "--help"],
    "study run --help": ["-m", "study.cli", "run", "--help"],
    "study fit --help": ["-m", "study.cli", "fit", "--help"],
}
LINE = """
import numpy, numba
@numba.njit(cache=True)
def total(x):
    s = 0.0
    for value in x:
        s += value
    return s
total(numpy.ones(4))
"""
POINTS = (
    "import numpy as np; u = np.random.default_rng(0).normal(size=(40, 3)); u /= np.linalg.norm(u, axis=1)[:, None]"
)
FIRST = f"{POINTS}; import study; study.fit(u + 0.01 * u[::-1]).ok"
PROGRAMS = {
    "one compiled line": ["line.py"],
    "a first study.fit, and its status": ["-c", FIRST],
    "study fit FILE": ["-m", "study.cli", "fit", "points.csv"],
}
NORMALS = 10**8
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "MAKE"))}
USED = ("Makefile", "configs", "results/paper", "results/bench.csv")


def start(arguments, folder, environment=None):
    """Run a program to its end."""
    command = [sys.executable, *arguments]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, env=environment)


@pytest.mark.parametrize("what", SHORT)
def test_short_commands(timed, what):
    """A help text takes little more than the start of Python."""
    unit = what == "start of Python"
    timed("short commands", what, start, SHORT[what], ROOT, ENVIRONMENT, unit=unit, aim="" if unit else "0.25 s")


@pytest.mark.parametrize("what", PROGRAMS)
def test_first_answer(timed, tmp_path, what):
    """A first fit takes little more than the first call of anything compiled, from its cache."""
    (tmp_path / "line.py").write_text(LINE)
    exec(POINTS, names := {})  # the points of the other programs
    names["np"].savetxt(tmp_path / "points.csv", names["u"] + 0.01 * names["u"][::-1], delimiter=",")
    unit, aim = what == "one compiled line", "≤ 1.3" if "study" in what else ""
    timed("first answer of a program", what, start, PROGRAMS[what], tmp_path, unit=unit, aim=aim, rounds=5)


def test_normal_numbers(timed):
    """The unit: NumPy's normal numbers, one thread."""
    numbers, random = np.empty(10**6), np.random.default_rng(1)

    def fill():
        for _ in range(NORMALS // len(numbers)):
            random.standard_normal(out=numbers)

    timed("whole studies", "NumPy's normal numbers, 1e8", fill, unit=True, rounds=3, warmup=0)


@pytest.mark.parametrize(("target", "aim", "rounds"), [("smoke", "8 s", 3), ("paper", "45 s", 1)])
def test_whole_studies(timed, tmp_path_factory, target, aim, rounds):
    """A study with its figures, after the set-up: `make paper` with the cost table, verdicts and the page."""

    def folder():
        place = tmp_path_factory.mktemp(target)
        for name in USED:
            (place / name).parent.mkdir(exist_ok=True)
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy2
            copy(ROOT / name, place / name)
        (place / ".venv").symlink_to(sys.prefix)
        return (place,), {}

    def make(place):
        done = ["-o", ".venv/.run", "-o", ".venv/.compiled"]  # the set-up is not made again
        subprocess.run(["make", *done, target], cwd=place, check=True, capture_output=True, env=ENVIRONMENT)

    timed("whole studies", f"make {target}", make, setup=folder, aim=aim, rounds=rounds, warmup=0)

"""Times of whole programs: short ones over the start of Python, long ones over NumPy's normal numbers.

The unit of a first answer is a program that calls a compiled function of one line, from its cache: nothing compiled
starts sooner.

`make smoke` and `make paper` run in a folder of their own, with the compiled code of this installation.
"""

import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
FIRST = 'import numpy, study; study.fit(numpy.loadtxt("points.csv", delimiter=",")).ok'
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
PROGRAMS = {
    "short commands": {
        "start of Python": ["-c", "pass"],
        "study --help": ["-m", "study.cli", "--help"],
        "study run --help": ["-m", "study.cli", "run", "--help"],
        "study fit --help": ["-m", "study.cli", "fit", "--help"],
    },
    "first answer of a program": {
        "one compiled line": ["line.py"],
        "a first study.fit, and its status": ["-c", FIRST],
        "study fit FILE": ["-m", "study.cli", "fit", "points.csv"],
    },
}
"""Arguments of Python; the first program of a group is its unit."""
AIMS = {"short commands": "0.25 s", "first answer of a program": "≤ 1.3"}
NORMALS = 10**8
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "MAKE"))}
USED = ("Makefile", "configs", "figures", "results/paper", "docs/assets/tables")


@pytest.mark.parametrize(("group", "what"), [(group, what) for group, rows in PROGRAMS.items() for what in rows])
def test_programs(timed, tmp_path, group, what):
    """A help text takes little more than the start of Python, a first fit little more than anything compiled."""
    (tmp_path / "line.py").write_text(LINE)
    u = np.random.default_rng(0).normal(size=(40, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    np.savetxt(tmp_path / "points.csv", u + 0.01 * u[::-1], delimiter=",")
    command, unit = [sys.executable, *PROGRAMS[group][what]], what == next(iter(PROGRAMS[group]))
    start = partial(subprocess.run, command, cwd=tmp_path, check=True, capture_output=True, env=ENVIRONMENT)
    timed(group, what, start, unit=unit, aim="" if unit else AIMS[group], rounds=15 if "short" in group else 5)


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
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy2
            copy(ROOT / name, place / name)
        (place / ".venv").symlink_to(sys.prefix)
        return (place,), {}

    def make(place):
        done = ["-o", ".venv/.run", "-o", ".venv/.compiled"]  # the set-up is not made again
        subprocess.run(["make", *done, target], cwd=place, check=True, capture_output=True, env=ENVIRONMENT)

    timed("whole studies", f"make {target}", make, setup=folder, aim=aim, rounds=rounds, warmup=0)

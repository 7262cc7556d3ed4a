"""Times of whole commands: short ones over the start of Python, long ones over NumPy's normal numbers.

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
    "import study.cli": ["-c", "import study.cli"],
    "study --help": ["-m", "study.cli", "--help"],
    "study run --help": ["-m", "study.cli", "run", "--help"],
    "study fit --help": ["-m", "study.cli", "fit", "--help"],
}
NORMALS = 10**8
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "MAKE"))}
USED = ("Makefile", "configs", "results/paper", "results/bench.csv")


@pytest.mark.parametrize("what", SHORT)
def test_short_commands(timed, what):
    """A help text takes little more than the start of Python."""
    command = [sys.executable, *SHORT[what]]
    unit = what == "start of Python"
    run = {"check": True, "capture_output": True, "env": ENVIRONMENT}
    aim = "" if unit else "0.25 s"
    timed("short commands", what, lambda: subprocess.run(command, **run), unit=unit, aim=aim)


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

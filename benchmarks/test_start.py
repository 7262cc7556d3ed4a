"""Time from the start of a program to its first answer, over that of importing what it stands on.

The unit is a program that calls a compiled function of one line, from its cache: nothing compiled starts
sooner.
"""

import subprocess
import sys

import pytest

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
FIRST = f"{POINTS}; import study; fit = study.fit(u + 0.01 * u[::-1])"
PROGRAMS = {
    "import numba, numpy": ["-c", "import numba, numpy"],
    "import numba, pandas": ["-c", "import numba, pandas"],
    "a first study.fit": ["-c", FIRST],
    "a first study.fit, and its status": ["-c", f"{FIRST}; fit.ok"],
    "study fit FILE": ["-m", "study.cli", "fit"],
}


def start(arguments, folder):
    subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True)


@pytest.mark.parametrize("what", ["one compiled line", *PROGRAMS])
def test_first_answer(timed, tmp_path, what):
    """A first fit takes little more than the first call of anything compiled."""
    (tmp_path / "line.py").write_text(LINE)
    arguments = ["line.py"] if what == "one compiled line" else PROGRAMS[what]
    if arguments[-1] == "fit":
        exec(POINTS, names := {})  # the points of the other programs
        names["np"].savetxt(tmp_path / "points.csv", names["u"] + 0.01 * names["u"][::-1], delimiter=",")
        arguments = [*arguments, "points.csv"]
    aim = "≤ 1.3" if "study" in what else ""
    timed(
        "first answer of a program",
        what,
        start,
        arguments,
        tmp_path,
        unit=what == "one compiled line",
        aim=aim,
        rounds=5,
    )

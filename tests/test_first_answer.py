"""A first answer loads nothing heavy that it does not need, so that nobody waits for it."""

import os
import subprocess
import sys
from pathlib import Path

import study

HEAVY = {"scipy.stats", "scipy.optimize", "pandas", "pyarrow", "pydantic", "matplotlib"}


def loaded(folder, code):
    """Heavy libraries that a program has loaded at its end, and the words that it prints."""
    code = f"import logging\nlogging.disable()\n{code}\n"  # whether loops are compiled or come from the cache
    code += f"import sys\nprint(*({HEAVY!r} & set(sys.modules)), file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(study.__file__).parents[1])},
        capture_output=True,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stderr
    return set(done.stderr.split()), done.stdout


def test_in_python(tmp_path):
    """`study.fit` with its errors, residuals and text needs NumPy, the compiler and Student's quantile alone."""
    code = "import study\nprint(study.fit([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, -1.0], [0.1, -1, 0]]))"
    found, said = loaded(tmp_path, code)
    assert found == set()
    assert said.startswith("Fit(corrected: center (")


def test_on_the_command_line(tmp_path):
    """`study fit` of a table of text needs no more; the parser of the command line brings pydantic."""
    (tmp_path / "points.csv").write_text("x,y\n0,1\n1,0\n-1,0\n0,-1.01\n0.7,0.72\n")
    code = "import sys\nsys.argv = ['study', 'fit', 'points.csv']\nfrom study import cli\n"
    code += "try:\n    cli.main()\nexcept SystemExit as end:\n    assert end.code == 0, end.code"
    found, said = loaded(tmp_path, code)
    assert found <= {"pydantic"}
    assert "radius" in said


def test_commands_that_fit_nothing(tmp_path):
    """To judge claims, or to open a run, neither scipy's distributions nor a figure's library."""
    code = "import study.simulation.claims, study.simulation.analysis.summary, study.simulation.analysis.summary_text"
    found, _ = loaded(tmp_path, code)
    assert found <= {"pandas", "pyarrow", "pydantic"}

"""The wheel: it holds what the commands need, and they find it from any folder. What is loaded for a first answer."""

import math
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import study

ROOT = Path(study.__file__).parents[1]
CODE = """
from study.simulation.experiment.config import load
from study.simulation.experiment.config import shipped_configs
from study.recordings.markersets import load_markerset, shipped
import study
print(study.__file__)
print(*(path for path in shipped_configs().values()), sep="\\n")
studies = [load(path) for name, path in shipped_configs().items() if name != "readings"]
print(len(studies), len([load_markerset(name) for name in shipped()]))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the unpacked wheel, as pip would install it."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_the_wheel_has_all_files(installed):
    """Every file of the package and every shipped config is in the wheel."""
    listed = subprocess.run(["git", "ls-files", "study", "configs"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode != 0:
        pytest.skip("not a git checkout: nothing lists its files")
    names = listed.stdout.split()
    expected = {f"study/{name}" if name.startswith("configs/") else name for name in names if (ROOT / name).exists()}
    found = {str(path.relative_to(installed)) for path in installed.rglob("*") if path.is_file()}
    assert expected <= found


def test_configs_and_marker_sets_are_found_from_elsewhere(installed, tmp_path):
    """From another folder, an installed package finds its own configs and marker sets, and all of them load."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, "-c", CODE]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8")
    assert done.stderr == ""
    module, *configs, counts = done.stdout.splitlines()
    assert module.startswith(str(installed))
    assert {Path(path).stem for path in configs} == {path.stem for path in (ROOT / "configs").glob("*.toml")}
    assert all(path.startswith(str(installed)) for path in configs)
    sets = len(list((ROOT / "study" / "recordings" / "markersets").glob("*.toml")))
    assert counts == f"{len(configs) - 1} {sets}"  # readings have their own reader


def test_versions_agree():
    """The package, the citation and the changelog name one version."""
    assert f"\nversion: {study.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    headings = [line for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines() if line[:3] == "## "]
    assert headings[:2] == ["## Unreleased", f"## {study.__version__}"]


HEAVY = {"scipy.stats", "scipy.optimize", "pandas", "pyarrow", "pydantic", "matplotlib"}
JUDGE = "import study.simulation.claims, study.simulation.analysis.summary"
COMMAND = """import sys
sys.argv = ["study", "fit", "points.csv"]
from study import cli
try:
    cli.main()
except SystemExit as end:
    assert end.code == 0, end.code
"""


@pytest.mark.parametrize(
    ("code", "loaded", "said"),
    [
        (
            "import study\nprint(study.fit([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, -1.0], [0.1, -1, 0]]))",
            set(),
            "Fit(",
        ),
        (COMMAND, {"pydantic"}, "radius"),  # the parser of the command line brings it
        (JUDGE, {"pandas", "pyarrow", "pydantic"}, ""),
    ],
    ids=["fit", "command", "claims"],
)
def test_a_first_answer_loads_nothing_heavy_that_it_does_not_need(tmp_path, code, loaded, said):
    """A fit with errors and text needs NumPy, the compiler and Student's quantile alone, in Python or as a command.

    To judge claims, or to open a run, neither scipy's distributions nor a figure's library is loaded.
    """
    turns = [math.radians(22.5 * k) for k in range(16)]
    noise = (0.4, -0.1, -1.2, 0.7, 0.3, -0.5, 1.1, -0.9, 0.2, 0.9, -0.3, -0.7, 1.3, 0.1, -1.0, 0.6)  # for an ok fit
    sizes = [1.0 + 0.01 * part for part in noise]
    rows = [f"{r * math.cos(turn):.4f},{r * math.sin(turn):.4f}\n" for turn, r in zip(turns, sizes, strict=True)]
    (tmp_path / "points.csv").write_text("x,y\n" + "".join(rows))
    code = f"import logging\nlogging.disable()\n{code}\n"  # whether loops are compiled or come from the cache
    code += f"import sys\nprint(*({HEAVY!r} & set(sys.modules)), file=sys.stderr)"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert set(done.stderr.split()) <= loaded
    assert said in done.stdout


def test_the_package_is_light():
    """`import study` loads none of the heavy libraries; a function brings what it needs."""
    code = "import sys, study\nheavy = {'numpy', 'numba', 'scipy', 'matplotlib', 'pandas', 'pyarrow'}\n"
    code += "assert not heavy & set(sys.modules), heavy & set(sys.modules)\nassert callable(study.crlb)\n"
    code += "assert 'numpy' in sys.modules"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, encoding="utf-8")
    assert (done.returncode, done.stderr) == (0, "")

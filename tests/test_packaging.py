"""The wheel: it holds what the commands need, and they find it from any folder."""

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
studies = [load(path) for name, path in shipped_configs().items() if name not in ("coverage", "readings")]
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
    assert counts == f"{len(configs) - 2} {sets}"  # coverage and readings have their own readers


def test_versions_agree():
    """The package, the citation and the changelog name one version."""
    assert f"\nversion: {study.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    headings = [line for line in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines() if line[:3] == "## "]
    assert headings[:2] == ["## Unreleased", f"## {study.__version__}"]

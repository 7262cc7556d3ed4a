"""The page on continuous integration is tried in an empty repository."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import study
from tests.configs import config

yaml = pytest.importorskip("yaml", reason="PyYAML reads the workflow")
ROOT = Path(__file__).parents[1]


def test_the_workflow_runs_in_a_repository_of_ones_own(tmp_path):
    """Its commands, as they stand, in a folder that has only a config and a stored run; the package is this one.

    The wheel that it installs has the name that setuptools gives this version.
    """
    text = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```yaml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    job = yaml.safe_load(block)["jobs"]["study"]
    name = re.search(r'^name = "(.*)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.M)[1]
    wheel = f"vendor/{name.replace('-', '_')}-{study.__version__}-py3-none-any.whl"
    assert job["env"] == {"PACKAGE": wheel, "CONSTRAINTS": "vendor/constraints.txt"}
    install, *commands = [step["run"] for step in job["steps"] if "run" in step]
    assert install == 'pip install -c "$CONSTRAINTS" "$PACKAGE"'
    (tmp_path / "smoke.toml").write_text(config({"name": "smoke", "estimators": ["gdke"]}, trials=30), encoding="utf-8")
    command = tmp_path / "bin" / "study"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m study.cli "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    environment = os.environ | {"PATH": f"{command.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    for line in ["study run smoke.toml --out reference/smoke", *commands]:
        done = subprocess.run(
            ["sh", "-c", line], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{line}: {done.stderr}"

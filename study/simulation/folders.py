"""Folders of runs: found by a path, by a config or by the name of one, and opened."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from study.simulation.runs.run_folder import Run

RUNS = Path("results")
"""Folder of the runs, below the current one."""


def run_folder(argument: str) -> Path:
    """The folder of a run, given itself, as the config of a run in `RUNS`, or as the name of a shipped config."""
    path = Path(argument)
    if os.path.isdir(path) or path.suffix not in ("", ".toml"):
        return path
    from study.simulation.experiment.config import load, shipped_configs

    config = path if path.suffix else shipped_configs().get(argument)
    return path if config is None else RUNS / load(config).run_name()


def opened(folder: Path) -> "Run":
    """The run in a folder."""
    from study.simulation.runs.run_folder import Run

    return Run.open(folder)

"""Commands about runs, for `study.cli`: their exit codes, and the worker of a cluster."""

from enum import IntEnum
from pathlib import Path
from typing import Annotated

import typer

RUNS = Path("results")
"""Folder of the runs, below the current one."""


def run_folder(argument: str) -> Path:
    """The folder of a run, given itself, as the config of a run in `RUNS`, or as the name of a shipped config."""
    path = Path(argument)
    if path.is_dir() or path.suffix not in ("", ".toml"):
        return path
    from study.experiment.config import load
    from study.experiment.shipped_configs import shipped_configs

    config = path if path.suffix else shipped_configs().get(argument)
    return path if config is None else RUNS / load(config).run_name()


_FOLDER = "folder of a run, or the config of a run in results/, such as configs/paper.toml, or paper if it is shipped"
Folder = Annotated[Path, typer.Argument(metavar="RUN", parser=run_folder, help=_FOLDER)]


class ExitCode(IntEnum):
    """Exit code of a command."""

    COMPLETE = 0
    FAILURE = 1
    USAGE = 2
    TOO_MANY_FAILURES = 3  # complete, with more failed fits than the config tolerates, or fits that are not ok
    BUDGET = 4  # stopped by its time budget before every cell had enough trials
    INTERRUPTED = 130  # by Ctrl-C or SIGTERM


def worker(
    scheduler: Annotated[str, typer.Argument(metavar="ADDRESS", help="address of a Dask scheduler: tcp://host:8786")],
    options: Annotated[list[str] | None, typer.Argument(metavar="-- OPTION…", help="see `dask worker --help`")] = None,
) -> None:
    """Start a Dask worker whose results are those of this machine, to the last bit."""
    from study.runs.workers.dask_cluster import serve

    serve(scheduler, options or [])

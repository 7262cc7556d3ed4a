"""Commands about runs, for `study.cli`: their exit codes, and the worker of a cluster."""

from enum import IntEnum
from pathlib import Path
from typing import Annotated

import typer

RUNS = Path("results")
"""Folder of the runs, below the current one."""


def run_folder(argument: str) -> Path:
    """The folder of a run, given itself or as the config of a run in `RUNS`."""
    path = Path(argument)
    if path.suffix != ".toml" or path.is_dir():
        return path
    from study.experiment.config import load

    return RUNS / load(path).run_name()


Folder = Annotated[
    Path,
    typer.Argument(
        metavar="RUN",
        parser=run_folder,
        help=f"a run's folder, such as results/paper-0123456789, or the config of a run in {RUNS}/",
    ),
]


class ExitCode(IntEnum):
    """Exit code of a command."""

    COMPLETE = 0
    FAILURE = 1
    USAGE = 2
    TOO_MANY_FAILURES = 3  # complete, with more failed fits than the config tolerates
    BUDGET = 4  # stopped by its time budget before every cell had enough trials
    INTERRUPTED = 130  # by Ctrl-C or SIGTERM


def worker(
    scheduler: Annotated[str, typer.Argument(metavar="ADDRESS", help="address of a Dask scheduler: tcp://host:8786")],
    options: Annotated[list[str] | None, typer.Argument(metavar="-- OPTION…", help="see `dask worker --help`")] = None,
) -> None:
    """Start a Dask worker whose results are those of this machine, to the last bit."""
    from study.runs.workers.dask_cluster import serve

    serve(scheduler, options or [])

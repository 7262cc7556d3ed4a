"""Commands about runs, for `study.cli`: their exit codes, and the worker of a cluster."""

from enum import IntEnum
from pathlib import Path
from typing import Annotated

import typer

Folder = Annotated[Path, typer.Argument(metavar="RUN", help="a run's folder, such as results/paper-0123456789")]


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

"""Commands about runs, for `study.cli`: how they end, and a worker of a cluster."""

from enum import IntEnum
from pathlib import Path
from typing import Annotated

import typer

Folder = Annotated[Path, typer.Argument(metavar="RUN", help="a run's folder, such as results/paper-0123456789")]


class Code(IntEnum):
    """How a command ended."""

    COMPLETE = 0
    FAILURE = 1
    USAGE = 2
    FAILURES = 3  # complete, with more failed fits than the config tolerates
    BUDGET = 4  # stopped by its budget of time, before every cell had trials enough
    INTERRUPTED = 130  # by Ctrl-C or SIGTERM


def worker(
    scheduler: Annotated[str, typer.Argument(metavar="ADDRESS", help="of a Dask scheduler: tcp://host:8786")],
    options: Annotated[list[str] | None, typer.Argument(metavar="-- OPTION…", help="see `dask worker --help`")] = None,
) -> None:
    """Start a Dask worker that computes as `study run --backend dask` does, to the last bit."""
    from study.runs.workers.dask_cluster import serve

    serve(scheduler, options or [])

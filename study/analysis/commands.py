"""Commands that look into runs, for `study.cli`: how far one is, two compared, and the worst trials of one."""

from pathlib import Path
from typing import Annotated

import typer

from study.runs.commands import ExitCode, Folder


def status(folder: Folder) -> None:
    """Say how far a run is: units, parts, failures, tables, who made it and who writes to it."""
    from study.runs.status import printed

    for line in printed(folder):
        typer.echo(line)


def diff(
    one: Annotated[Path, typer.Argument(metavar="RUN_A", help="a run's folder")],
    other: Annotated[Path, typer.Argument(metavar="RUN_B", help="another's")],
) -> None:
    """Compare two runs: identical, the same within Monte-Carlo error, or different, and where. Different is code 1."""
    from study.analysis.compare import compare, printed
    from study.runs.storage.run_folder import Run

    found = compare(Run.open(one), Run.open(other))
    for line in printed(found):
        typer.echo(line)
    if found.different:
        raise typer.Exit(ExitCode.FAILURE)


def worst(
    folder: Folder,
    count: Annotated[int, typer.Option("--count", "-n", min=1, help="how many trials")] = 10,
    estimator: Annotated[str | None, typer.Option("--estimator", "-e", help="look at its fits alone")] = None,
) -> None:
    """List the trials where an estimator said ok and was farthest from the truth, in units of the bound."""
    from study.analysis.worst import printed
    from study.runs.storage.run_folder import Run

    for line in printed(Run.open(folder), count, estimator):
        typer.echo(line)

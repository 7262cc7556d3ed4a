"""Commands on the tables of runs and on estimators, for `study.cli`."""

from pathlib import Path
from typing import Annotated

import typer

from study.runs.commands import ExitCode, Folder, run_folder


def status(folder: Folder) -> None:
    """Print the state of a run.

    These are its units, parts, failures, tables, and the software that made it.
    """
    from study.runs.status import printed

    for line in printed(folder):
        typer.echo(line)


def summary(folder: Folder) -> None:
    """Print a run's median errors over the bound."""
    from study.analysis.summary_text import printed
    from study.runs.storage.run_folder import Run

    for line in printed(Run.open(folder)):
        typer.echo(line)


def diff(
    one: Annotated[Path, typer.Argument(metavar="RUN_A", parser=run_folder, help="folder of a run, or its config")],
    other: Annotated[Path, typer.Argument(metavar="RUN_B", parser=run_folder, help="folder of another run")],
) -> None:
    """Compare two runs.

    They are identical, the same within Monte-Carlo error, or different (exit code 1).
    """
    from study.analysis.compare import compare, printed
    from study.runs.storage.run_folder import Run

    found = compare(Run.open(one), Run.open(other))
    for line in printed(found):
        typer.echo(line)
    if found.different:
        raise typer.Exit(ExitCode.FAILURE)


def verify(
    folder: Folder,
    share: Annotated[
        float, typer.Option("--share", min=0.0, max=1.0, help="share of the units that are computed again")
    ] = 0.01,
) -> None:
    """Verify a run before it is quoted.

    All tables are checked by their digests, and a share of the units is computed again and compared to the bit. The
    exit code is 1 if anything differs.
    """
    from study.analysis.verification.verify import printed
    from study.analysis.verification.verify import verify as check
    from study.runs.storage.run_folder import Run

    found = check(Run.open(folder), share)
    for line in printed(found):
        typer.echo(line)
    if found.faults:
        raise typer.Exit(ExitCode.FAILURE)


def worst(
    folder: Folder,
    count: Annotated[int, typer.Option("--count", "-n", min=1, help="number of trials")] = 10,
    estimator: Annotated[str | None, typer.Option("--estimator", "-e", help="one estimator [default: all]")] = None,
) -> None:
    """List the trials with the largest errors.

    Errors are in units of the bound; only fits whose status is ok count.
    """
    from study.analysis.worst import printed
    from study.runs.storage.run_folder import Run

    for line in printed(Run.open(folder), count, estimator):
        typer.echo(line)


def estimators() -> None:
    """List the estimators, their cost and their sources."""
    from study.analysis.estimator_list import printed

    for line in printed():
        typer.echo(line)


def cost(
    out: Annotated[Path, typer.Option("--out", help="file of the table, .csv or .parquet")] = Path(
        "results/cost.parquet"
    ),
) -> None:
    """Measure the cost of a fit beside the paper's figures.

    Operations are counted and fits are timed; the table is stored.
    """
    from study.analysis.cost_table import cost_table, printed
    from study.runs.storage.atomic_write import save_frame

    table = cost_table()
    save_frame(table, out)
    for line in printed(table):
        typer.echo(line)

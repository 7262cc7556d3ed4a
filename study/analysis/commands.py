"""Commands on the tables of runs and on estimators, for `study.cli`."""

from pathlib import Path
from typing import Annotated

import typer

from study.runs.commands import ExitCode, Folder, Json, run_folder


def status(folder: Folder, as_json: Json = False) -> None:
    """Print the state of a run.

    These are its units, parts, failures, tables, and the software that made it.

    With --json: run, folder, state, finished, writer, units (total, done, missing), cells (total, target, cap, open;
    null without [precision]), parts (whole, damaged, set_aside), failures (fits, failed, lost; null until the run is
    finished), tables, damaged, and made_by.
    """
    from study.runs.status import printed
    from study.runs.status import status as status_of
    from study.text.json_text import json_text

    found = status_of(folder)
    for line in [json_text(vars(found))] if as_json else printed(found):
        typer.echo(line)


Where = Annotated[
    list[str] | None,
    typer.Option("--where", metavar="CONDITION=VALUE,…", help="cells with these values, such as angle=45,samples=1000"),
]
Some = Annotated[
    str | None, typer.Option("--estimators", "-e", metavar="NAME,…", help="such as als,mle [default: all]")
]
All = Annotated[bool, typer.Option("--all", help="print every row; by default some that are evenly spread")]
OnlyOk = Annotated[
    bool, typer.Option("--ok", help="medians of each estimator's own ok fits: of other trials in each column")
]
Csv = Annotated[bool, typer.Option("--csv", help="print all columns of the summary table as CSV")]


def summary(
    folder: Folder,
    where: Where = None,
    estimators: Some = None,
    every: All = False,
    only_ok: OnlyOk = False,
    as_json: Json = False,
    as_csv: Csv = False,
) -> None:
    """Print a run's median errors over the bound.

    Medians are of all trials, whatever the fit's status, so that estimators are compared on the same trials. A fit
    without a number counts as infinitely far; a median that falls on such fits is inf. Brackets give the share of fits
    that are not ok.

    The table fits a screen: of many cells it has some that are evenly spread over the conditions, and cells that differ
    by scaling alone are printed once. If --where gives a condition several times, cells with any of the values count.

    --csv and --json have every cell that --where and --estimators choose. With --json: run, bound, conditions (their
    names), and rows, each with the columns of the summary table (ratio_median is the median of all trials) and, where
    they are known, noise_over_radius and the medians at the bounds, median_cramer_rao and median_attainable.
    """
    from study.analysis.summary_choice import RowChoice
    from study.analysis.summary_text import as_csv as csv_text
    from study.analysis.summary_text import as_data, printed
    from study.runs.storage.run_folder import Run
    from study.text.json_text import json_text

    if as_json + as_csv + only_ok > 1:
        raise typer.BadParameter("give one of --json, --csv and --ok; the first two have ok fits in columns …_ok")
    run = Run.open(folder)
    try:
        choice = RowChoice.of(run, where or [], estimators)
        if as_json:
            lines = [json_text(as_data(run, choice))]
        else:
            lines = csv_text(run, choice).splitlines() if as_csv else list(printed(run, choice, every, only_ok))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    for line in lines:
        typer.echo(line)


def diff(
    one: Annotated[Path, typer.Argument(metavar="RUN_A", parser=run_folder, help="folder of a run, or its config")],
    other: Annotated[Path, typer.Argument(metavar="RUN_B", parser=run_folder, help="folder of another run")],
    as_json: Json = False,
) -> None:
    """Compare two runs.

    The verdict is identical, identical in the trials that both have, the same within Monte-Carlo error, or different
    (exit code 1).

    With --json: verdict, runs (folder, run, made_by, only_here), test, threshold of the chance, and comparisons, each
    with group, estimator, conditions, measure, first, second, deviation in standard errors, chance, trials, equal,
    same_trials and different.
    """
    from study.analysis.compare import as_data, compare, printed
    from study.runs.storage.run_folder import Run
    from study.text.json_text import json_text

    found = compare(Run.open(one), Run.open(other))
    for line in [json_text(as_data(found))] if as_json else printed(found):
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


def archive(
    folders: Annotated[
        list[Path], typer.Argument(metavar="RUN", parser=run_folder, help="folders of runs, or their configs")
    ],
    out: Annotated[Path, typer.Option("--out", help="file of the archive, which ends in .zip")] = Path("archive.zip"),
) -> None:
    """Write runs into one file to deposit.

    The zip file has the tables, their schemas, the configs, how to rerun them, the studies by ADEMP, how to cite, and
    metadata as RO-Crate and CodeMeta. A run with a damaged table, or one that its budget stopped, is refused with
    the command that mends it.
    """
    from study.analysis.archive.archive import archive as write
    from study.analysis.archive.archive import printed
    from study.runs.storage.run_folder import Run

    runs = [Run.open(folder) for folder in folders]
    for line in printed(runs, write(runs, out)):
        typer.echo(line)


def worst(
    folder: Folder,
    count: Annotated[int, typer.Option("--count", "-n", min=1, help="number of trials")] = 10,
    estimator: Annotated[str | None, typer.Option("--estimator", "-e", help="one estimator [default: all]")] = None,
    as_json: Json = False,
) -> None:
    """List the trials with the largest errors.

    Errors are in units of the bound; only fits whose status is ok count.

    With --json: run, bound, and trials, each with the name that `study replay` takes, cell, trial, estimator, ratio
    (error over bound), error, bound, and the conditions.
    """
    from study.analysis.worst import as_data, of_run, printed
    from study.runs.storage.run_folder import Run
    from study.text.json_text import json_text

    run = Run.open(folder)
    found = of_run(run, count, estimator)
    for line in [json_text(as_data(run, found))] if as_json else printed(run, found):
        typer.echo(line)


def regret(
    folder: Folder,
    csv: Annotated[Path | None, typer.Option("--csv", help="file to write the table to")] = None,
) -> None:
    """Compare each estimator with the best in every cell.

    The numbers are geometric means, over the cells of a grid, of the median error and of its 95 % quantile.
    """
    from study.analysis.regret import of_run, printed
    from study.analysis.regret import regret as means
    from study.runs.storage.atomic_write import save_frame
    from study.runs.storage.run_folder import Run

    run = Run.open(folder)
    table = means(of_run(run))
    if csv is not None:
        save_frame(table, csv)
    for line in printed(run, table):
        typer.echo(line)


def estimators() -> None:
    """List the estimators, their cost and their sources."""
    from study.analysis.estimator_list import printed

    for line in printed():
        typer.echo(line)


def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Python file with estimators of your own")],
    limit: Annotated[
        float, typer.Option("--limit", metavar="SECONDS", min=0.1, help="time in which a single fit should be done")
    ] = 60.0,
) -> None:
    """Check the properties that an estimator should have.

    These are equivariance, exactness without noise and the like. Each violation is described (exit code 1); a fit that
    does not return in time is one. What the file prints goes to standard error.
    """
    from study.estimators.own.check import check_file, printed

    found = check_file(file, limit=limit)
    for line in printed(found):
        typer.echo(line)
    if any(report.violations for report in found):
        raise typer.Exit(ExitCode.FAILURE)


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

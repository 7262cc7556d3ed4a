"""The command line: one command per library call, no logic. Heavy imports wait inside the commands."""

import contextlib
import io
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from study.analysis.commands import diff, status, worst
from study.mocap import commands
from study.runs.commands import Code, Folder, worker
from study.runs.workers import instruction_set

app = typer.Typer(
    help="Monte-Carlo study of closed-form sphere fits (Knight & Semwal 2009).",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Config = Annotated[Path, typer.Argument(metavar="CONFIG", help="a study's config, such as configs/sweep.toml")]
Folders = Annotated[list[Path], typer.Argument(metavar="RUN", help="folders of runs of different configs")]
Cost = Annotated[Path | None, typer.Option("--cost", help="the table that `study cost` stores, for claims of cost")]
Recordings = Annotated[
    list[Path] | None,
    typer.Option("--recording", metavar="DIR", help="folder that `study case-study` wrote; can be given repeatedly"),
]
Figures = Annotated[list[str] | None, typer.Argument(metavar="FIGURE…", help="such as fig2_error [default: all]")]
Out = Annotated[Path | None, typer.Option("--out", help="the run's folder [default: results/<name>-<digest>]")]
Jobs = Annotated[int, typer.Option("--jobs", "-j", min=1, max=1024, help="number of workers")]
Backend = Annotated[
    str | None,
    typer.Option(
        "--backend",
        help="who computes: threads, loky (processes) or dask (a cluster) [default: threads; loky for long studies]",
    ),
]
Seconds = Annotated[
    float | None, typer.Option("--budget", min=0.0, help="seconds that work is begun, where [precision] asks for it")
]
Scheduler = Annotated[str | None, typer.Option("--scheduler", help="address of a Dask scheduler: tcp://host:8786")]


@app.command()
def plan(config: Config, jobs: Jobs = 2) -> None:
    """Say what a study will cost, without running it."""
    from study.analysis.summary import of_errors
    from study.experiment.config import load
    from study.runs.plan import extremes
    from study.runs.plan import plan as make_plan

    study = load(config)
    typer.echo(f"{study.run_name()}")
    for title, part in extremes(study).items():
        if title:
            typer.echo(f"  {title}")
        for label, value in make_plan(part, jobs, of_errors).lines():
            typer.echo(f"  {label:<10} {value}")


@app.command()
def run(
    configs: Annotated[list[Path], typer.Argument(metavar="CONFIG…", help="studies' configs")],
    jobs: Jobs = 2,
    out: Out = None,
    backend: Backend = None,
    scheduler: Scheduler = None,
    budget: Seconds = None,
) -> None:
    """Run studies, as far as they have not been run, and store their tables; print the folder of each."""
    from study.analysis.summary import of_errors, summarise
    from study.experiment.config import read
    from study.posterior.run import compute
    from study.runs import runner
    from study.runs.adaptive.time_budget import Budget
    from study.runs.finish import complaint, stopped
    from study.runs.jobs import long
    from study.runs.workers.dispatch import Workers
    from study.statistics.performance import measured

    if (backend == "dask") != (scheduler is not None) or backend not in (None, "threads", "loky", "dask"):
        raise typer.BadParameter("--backend is threads, loky, or dask, which alone takes a --scheduler, and needs it")
    if out is not None and len(configs) > 1:
        raise typer.BadParameter(f"--out {out} is one folder, for one config; leave it out")
    complaints, code = [], Code.FAILURES
    studies = [read(config) for config in configs]  # all are read before any is run
    for config, (study, _) in zip(configs, studies, strict=True):
        if budget is not None and study.precision is None:
            raise typer.BadParameter(f"--budget {budget:g}: {config} has no [precision], and is computed whole")
    for study, text in studies:
        workers = Workers(backend or ("loky" if jobs > 1 and long(study) else "threads"), jobs, scheduler)
        with _progress(study.run_name()) as advance:
            folder = out or Path("results") / study.run_name()
            end = None if budget is None else Budget(budget)
            done = runner.run(study, text, folder, workers, advance, reduce=of_errors, judge=measured, budget=end)
        if not done.has("summary"):
            summarise(done)
        if (words := stopped(done)) is not None:
            complaints.append(words)
            code = Code.BUDGET
        elif study.posterior is not None:
            with _progress("posteriors") as advance:
                compute(done, workers, advance)
        typer.echo(str(done.folder))
        complaints += [said for said in [complaint(done)] if said]
    if complaints:
        raise typer.Exit(_said("\n".join(complaints), code))


@app.command()
def posterior(folder: Folder, jobs: Jobs = 2) -> None:
    """Sample the posteriors that a run's config asks for in [posterior], with emcee."""
    from study.posterior.run import compute, printed
    from study.runs.storage.run_folder import Run

    run = Run.open(folder)
    with _progress("posteriors") as advance:
        compute(run, jobs, advance)
    for line in printed(run):
        typer.echo(line)


@app.command()
def summary(folder: Folder) -> None:
    """Print a run's medians of error over bound, with their Monte-Carlo errors."""
    from study.analysis.summary import printed
    from study.runs.storage.run_folder import Run

    for line in printed(Run.open(folder)):
        typer.echo(line)


@app.command()
def figures(
    folder: Folder,
    names: Figures = None,
    out: Annotated[Path | None, typer.Option("--out", help="folder for the pictures [default: RUN/figures]")] = None,
) -> None:
    """Draw a run's figures from its stored tables, as PNG and SVG."""
    from study.figures import FIGURES, draw_all
    from study.runs.storage.run_folder import Run

    unknown = [name for name in names or [] if name not in FIGURES]
    if unknown:
        raise typer.BadParameter(f"{', '.join(unknown)} unknown: known are {', '.join(FIGURES)}")
    run = Run.open(folder)
    drawn, skipped = draw_all(run, out or run.folder / "figures", names or [])
    for path in drawn:
        typer.echo(str(path))
    for name, reason in skipped.items():
        typer.echo(f"{name}: not drawn: {reason}", err=True)


@app.command()
def claims(folders: Folders, cost: Cost = None, recording: Recordings = None) -> None:
    """Judge the paper's claims by runs; store the table in the first one's folder, and print it."""
    from study.analysis.claims import judge_all, printed, save
    from study.mocap.case_study.stored_tables import read_case_studies
    from study.runs.storage.run_folder import Run

    runs = [Run.open(folder) for folder in folders]
    judged = judge_all(runs, cost, read_case_studies(recording) if recording else None)
    save(runs[0], judged)
    for line in printed(judged):
        typer.echo(line)


@app.command()
def report(
    folders: Folders,
    out: Annotated[Path | None, typer.Option("--out", help="the page's file [default: RUN/report.html]")] = None,
    cost: Cost = None,
    recording: Recordings = None,
    bench: Annotated[Path | None, typer.Option("--bench", help="the table that `make bench` stores")] = None,
) -> None:
    """Write one HTML page about runs: claims, figures, tables, provenance; it needs no other file."""
    from study.analysis.claims import judge_all
    from study.mocap.case_study.stored_tables import read_case_studies
    from study.report import read_bench, render, save
    from study.runs.storage.run_folder import Run

    runs = [Run.open(folder) for folder in folders]
    measured = read_bench(bench) if bench else None
    judged = judge_all(runs, cost, read_case_studies(recording) if recording else None)
    typer.echo(str(save(render(runs, judged, measured), out or runs[0].folder / "report.html")))


@app.command()
def fit(
    file: Annotated[Path, typer.Argument(metavar="POINTS", help="CSV, TSV or other text, .npy, or .parquet")],
    estimator: Annotated[str, typer.Option("--estimator", "-e", help="an estimator's name, or all")] = "als",
    noise: Annotated[float | None, typer.Option("--noise", help="standard deviation of a coordinate, if known")] = None,
    columns: Annotated[str | None, typer.Option("--columns", help="coordinates, by name or number: x,y,z")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="draw points, fits and error ellipses here")] = None,
) -> None:
    """Fit a sphere, or a circle, to points in a file."""
    from study.analysis.fitting import answers, choose, fit_all, printed
    from study.analysis.pointfile import read_points

    chosen = choose(estimator, noise)
    points, names = read_points(file, columns.split(",") if columns else None)
    fits = fit_all(points, chosen, noise)
    for line in printed(answers(fits, names), names):
        typer.echo(line)
    if plot is not None:
        from study.figures.fit_plot import draw, prepare
        from study.figures.style import save_picture

        save_picture(draw(prepare(points, fits, names)), plot)


@app.command()
def replay(
    folder: Folder,
    cell: Annotated[str, typer.Argument(metavar="CELL", help="the cell's name, or its beginning; or CELL/TRIAL")],
    trial: Annotated[int | None, typer.Argument(metavar="[TRIAL]", min=0, help="number of the data set")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="write the points here, as CSV or parquet")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="draw points, fits and truth here")] = None,
) -> None:
    """Draw one trial of a run again, and show the truth and every estimator's answer."""
    from study.analysis.trial_report import fits, points, printed
    from study.experiment.replay import find, parse_name, replay
    from study.runs.provenance import other_version
    from study.runs.storage.atomic_write import save_frame
    from study.runs.storage.run_folder import Run

    run = Run.open(folder)
    drawn = replay(run.study, find(run.study, *parse_name(cell, trial)))
    if drawn.trial >= (count := run.trials().get(drawn.cell.name, drawn.trial + 1)):
        _said(f"{folder}: cell {drawn.cell.name} has {count:,} trials; trial {drawn.trial} is not in its tables", 0)
    if (warning := other_version(run.maker())) is not None:
        _said(f"{folder}: {warning}", 0)
    for line in printed(run.study, drawn):
        typer.echo(line)
    if out is not None:
        save_frame(points(drawn), out)
    if plot is not None:
        from study.figures.fit_plot import draw, prepare
        from study.figures.style import save_picture

        frame = points(drawn)
        axes = [str(name) for name in frame.columns]
        save_picture(draw(prepare(frame.to_numpy(), fits(run.study, drawn), axes)), plot)


@app.command()
def estimators() -> None:
    """List the estimators: where each comes from, what it costs per sample, what it must be told."""
    from study.analysis.fitting import described

    for line in described():
        typer.echo(line)


@app.command()
def cost(
    out: Annotated[Path, typer.Option("--out", help="the table's file, .csv or .parquet")] = Path(
        "results/cost.parquet"
    ),
) -> None:
    """Count the operations of a fit and time it, beside the paper's figures; store the table."""
    from study.analysis.cost import cost_table, printed
    from study.runs.storage.atomic_write import save_frame

    table = cost_table()
    save_frame(table, out)
    for line in printed(table):
        typer.echo(line)


app.command()(status)
app.command()(diff)
app.command()(worst)
app.command()(worker)
app.command()(commands.recording)
app.command()(commands.joints)
app.command()(commands.skeleton)
app.command()(commands.case_study)
app.command()(commands.synthetic)
app.command()(commands.fetch)


@contextlib.contextmanager
def _progress(words: str) -> Iterator[Callable[[float], None]]:
    """A bar on a terminal's standard error; what it gives is told each share of the work that is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, disable=not sys.stderr.isatty(), console=Console(stderr=True)) as bar:
        task = bar.add_task(words, total=1.0)
        yield lambda share: bar.advance(task, share)


def main(command: Callable[..., Any] = app) -> None:
    """Entry point; see `Code`."""
    instruction_set.fix()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _interrupt)  # what a batch system sends when time is up: as Ctrl-C
    for stream in (sys.stdout, sys.stderr):  # a terminal without Greek shows a question mark
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        command()
    except SystemExit as end:
        if end.code == Code.INTERRUPTED:
            _said("interrupted; what was finished is kept, and running again goes on from there", Code.INTERRUPTED)
        raise
    except Exception as error:
        from study.analysis.pointfile import PointFileError
        from study.experiment.config_faults import ConfigError
        from study.experiment.replay import ReplayError
        from study.mocap.io.recording import RecordingError
        from study.runs.storage.run_folder import RunError

        if isinstance(error, ConfigError | PointFileError | RecordingError | ReplayError):
            raise SystemExit(_said(str(error), Code.USAGE)) from None
        if isinstance(error, RunError):
            raise SystemExit(_said(str(error), Code.FAILURE)) from None
        raise


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _said(message: str, code: int) -> int:
    print(message, file=sys.stderr)
    return code


if __name__ == "__main__":
    main()

"""The command line: one command per library call, no logic. Heavy imports wait inside the commands."""

import contextlib
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from study import __version__, instruction_set
from study.options import ExitCode, GroupedHelp, echo, shown, unchanged
from study.recordings.commands import (
    case_study,
    fetch,
    gait,
    joint,
    joints,
    markersets,
    recording,
    skeleton,
    synthetic,
)
from study.recordings.live_commands import live
from study.simulation import commands
from study.simulation.commands import CONFIG_HELP, Folder, Jobs, with_plugins
from study.simulation.folders import opened, run_folder
from study.text import did_you_mean, json_text

if TYPE_CHECKING:
    from study.simulation.runs.run_folder import Run

app = typer.Typer(
    cls=GroupedHelp,
    help="Fit spheres and circles, find joints, and study the fits (Knight & Semwal 2009).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(asked: bool) -> None:
    """Print the version, if it is asked for, and end."""
    if asked:
        typer.echo(f"study {__version__}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")
]
Configs = Annotated[list[Path], typer.Argument(metavar="CONFIG", help=CONFIG_HELP)]
_DRAWN = "folders of runs, or their configs; then names of figures, such as fig2_error [default: all figures]"
Drawn = Annotated[list[str], typer.Argument(metavar="RUN|FIGURE", help=_DRAWN)]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the run [default: results/<name>-<digest>]")]
Pictures = Annotated[Path | None, typer.Option("--out", help="folder for the pictures [default: RUN/figures]")]
_BACKEND = "threads, loky (processes) or dask (a cluster) [default: threads; loky for long studies]"
Backend = Annotated[str | None, typer.Option("--backend", help=_BACKEND)]
_TASK = "with dask: seconds of work in a task; give more for many workers [default: 0.2]"
Task = Annotated[float | None, typer.Option("--task", metavar="SECONDS", help=_TASK)]
Scheduler = Annotated[str | None, typer.Option("--scheduler", help="address of a Dask scheduler: tcp://host:8786")]
_BUDGET = "start no new work after this many seconds; for configs with [precision]"
_PART = "compute the K-th of N shares of the units alone; `study merge` puts shares together"
Part = Annotated[str | None, typer.Option("--part", metavar="K/N", help=_PART)]
_SHARES = "folders of the shares [default: results/<name>-<digest>-part-*]"
Shares = Annotated[list[Path] | None, typer.Argument(metavar="[FOLDER]…", help=_SHARES)]
PlanToo = Annotated[bool, typer.Option("--plan", help="print the plan before the run, as `study plan` does")]
FiguresToo = Annotated[bool, typer.Option("--figures", help="draw the run's figures, as PNG, into its folder")]
SummaryToo = Annotated[bool, typer.Option("--summary", help="print the summary, as `study summary` does")]
Seconds = Annotated[float | None, typer.Option("--budget", min=0.0, help=_BUDGET)]
_POINTS = "text such as CSV, .npy, .parquet, .ply, .pcd, .stl, .xlsx, .las and others; - for standard input"
Points = Annotated[list[Path], typer.Argument(metavar="POINTS", help=_POINTS, allow_dash=True)]
FitsAsJson = Annotated[bool, typer.Option("--json", help="print the fits as JSON")]
Csv = Annotated[bool, typer.Option("--csv", help="print the fits as CSV")]
_LONGEST_NAME = 1000


def _one_name(name: str | None) -> str | None:
    """Refuse a list of names, which a message would repeat."""
    if name and len(name) > _LONGEST_NAME:
        raise typer.BadParameter(f"{len(name):,} characters; give the name of one estimator, or all")
    return name


_ESTIMATOR = "name of an estimator, or all, which leaves out lls_single and mle_mirror"
Estimator = Annotated[str, typer.Option("--estimator", "-e", callback=_one_name, help=_ESTIMATOR)]
Noise = Annotated[float | None, typer.Option("--noise", help="standard deviation of a coordinate, if known")]
_ORDERED = "the rows are in order of time: errors allow for noise that neighbours share"
Ordered = Annotated[bool, typer.Option("--ordered", help=_ORDERED)]
_ASSUME = "sphere, if the points are known to lie on one: their shape is then not tested"
Assume = Annotated[str | None, typer.Option("--assume", help=_ASSUME)]
_LAW = "isotropic, or radial, if the noise is along the radius alone, as of a probe or a scanner at the centre"
NoiseLaw = Annotated[str, typer.Option("--law", help=_LAW)]


def _radius(text: str) -> float | tuple[float, float]:
    """A radius, or its least and greatest with a colon between them."""
    try:
        values = tuple(float(part) for part in text.split(":"))
    except ValueError:
        values = ()
    if len(values) not in (1, 2):
        raise typer.BadParameter(f"{text!r}: give a number, such as 25, or limits for --spheres, such as 24:26")
    return values[0] if len(values) == 1 else (values[0], values[1])


_RADIUS = "the radius, if it is known; with --spheres the least and the greatest, such as 24:26"
KnownRadius = Annotated[Any, typer.Option("--radius", metavar="RADIUS", parser=_radius, help=_RADIUS)]
RadiusError = Annotated[float | None, typer.Option("--radius-error", help="standard uncertainty of that radius")]
_SENSITIVITY = "print how large a form error of low degree moves each number by its ±"
Sensitivity = Annotated[bool, typer.Option("--sensitivity", help=_SENSITIVITY)]
_SCALE = "given, if the noise in columns sigma, or sx, sy, sz, is as large as that; estimated, if only ratios are known"
NoiseScale = Annotated[str, typer.Option("--scale", help=_SCALE)]
_COLUMNS = "coordinates by name or number of column [default: x,y,z if there are such names, else all of two or three]"
Columns = Annotated[str | None, typer.Option("--columns", help=_COLUMNS)]
_DIMENSION = "number of coordinates, if all of more than three columns are coordinates"
Dimension = Annotated[int | None, typer.Option("--dimension", min=2, help=_DIMENSION)]
_SPHERES = "number of spheres in each file, each with its points; with -e, --radius, --columns, --dimension, --json"
InSpace = Annotated[bool, typer.Option("--circle", help="Fit a circle in space: centre, radius and axis.")]
SphereCount = Annotated[int | None, typer.Option("--spheres", min=1, help=_SPHERES)]
Cell = Annotated[str, typer.Argument(metavar="CELL", help="name of the cell, or its beginning; or CELL/TRIAL")]
Trial = Annotated[int | None, typer.Argument(metavar="[TRIAL]", min=0, help="number of the trial, from 0")]
PointsOut = Annotated[Path | None, typer.Option("--out", help="file for the points, .csv or .parquet")]
Plot = Annotated[Path | None, typer.Option("--plot", help="file for a picture of the points and the fits")]
Sigma = Annotated[float, typer.Option("--noise", help="standard deviation of each coordinate")]
Nominal = Annotated[float, typer.Option("--radius", help="radius of the sphere, in the unit of the noise")]
Wanted = Annotated[float | None, typer.Option("--error", help="standard error that is wanted, in that unit")]
HalfAngle = Annotated[float | None, typer.Option("--angle", help="half-angle of the cap that is measured, in degrees")]
Count = Annotated[int | None, typer.Option("--points", min=1, help="number of points that are measured")]
ErrorOf = Annotated[str, typer.Option("--of", help="the error is that of the center, along the cap's axis, or radius")]
OnArc = Annotated[bool, typer.Option("--circle", help="a circle in space; --angle is half of the arc")]
PlanAsJson = Annotated[bool, typer.Option("--json", help="print the plan as a JSON object")]
_PAIRS = "folders of pairs NAME.ds (a point a line) and NAME.fit (centre and diameter) [default: the package's own]"
Pairs = Annotated[list[Path] | None, typer.Argument(metavar="FOLDER", help=_PAIRS)]
_CERTIFIED = "name of an estimator, or minimum_zone [default: mle; without folders also gdke and minimum_zone]"
Certified = Annotated[str | None, typer.Option("--estimator", "-e", callback=_one_name, help=_CERTIFIED)]
Limit = Annotated[float, typer.Option("--limit", help="largest error that passes, as a share of the radius")]
PairsOut = Annotated[Path | None, typer.Option("--out", help="folder for the package's own pairs, as files")]
ToXarray = Annotated[Path | None, typer.Option("--xarray", metavar="FILE", help="NetCDF file for the errors")]
ToDuckdb = Annotated[Path | None, typer.Option("--duckdb", metavar="FILE", help="database for all tables")]
Errors = Annotated[Path | None, typer.Option("--table", help="file for the errors of every set, .csv or .parquet")]


def run(
    configs: Configs,
    jobs: Jobs = 2,
    out: Out = None,
    backend: Backend = None,
    scheduler: Scheduler = None,
    budget: Seconds = None,
    task: Task = None,
    part: Part = None,
    plan: PlanToo = False,
    figures: FiguresToo = False,
    summary: SummaryToo = False,
) -> None:
    """Run studies; resume unfinished ones.

    The tables are stored, and the folder of each run is printed. With --part there are no tables yet. With --plan,
    --figures and --summary one command does the work of four.
    """
    from study.simulation.experiment.config import config_file, read
    from study.simulation.library import complete, complete_share, workers_of
    from study.simulation.runs.parts import Share
    from study.simulation.runs.plan import plans
    from study.simulation.runs.plan import printed as printed_plan

    if (backend == "dask") != (scheduler is not None) or backend not in (None, "threads", "loky", "dask"):
        raise typer.BadParameter("--backend is threads, loky or dask; --scheduler goes with dask, and only with it")
    if task is not None and (backend != "dask" or not task > 0.0):
        raise typer.BadParameter(f"--task {task:g}: seconds above 0 go with --backend dask, and only with it")
    if part is not None and (figures or summary):
        raise typer.BadParameter(f"--part {part}: has no tables yet; leave --figures and --summary out")
    if out is not None and len(configs) > 1:
        raise typer.BadParameter(f"--out {out} is a folder for one config, but {len(configs)} are given; leave it out")
    try:
        share = None if part is None else Share.parse(part)
    except ValueError as error:
        raise typer.BadParameter(f"--part {error}") from None
    complaints, code = list[str](), ExitCode.TOO_MANY_FAILURES
    studies = [read(config_file(config)) for config in configs]  # a fault in the last one shows before the first runs
    for config, (study, _) in zip(configs, studies, strict=True):
        if budget is not None and study.precision is None:
            reason = f"{config} has no [precision] and cannot stop early; leave --budget out"
            raise typer.BadParameter(f"--budget {budget:g}: {reason}")
    for made in studies:
        if plan:
            echo(printed_plan(made[0], plans(made[0], jobs)))
        workers = workers_of(made[0], jobs, backend, scheduler, task)
        if share is not None:
            typer.echo(str(complete_share(made, share, out, workers, _progress).folder))
            continue
        done, words = complete(made, out, workers, budget, _progress)
        typer.echo(str(done.folder))
        if figures:
            _draw([done], jobs, kinds=("png",))
        if summary:
            commands.summary(done.folder)
        complaints += words
        code = ExitCode.BUDGET if done.stopped() is not None else code
    if complaints:
        raise typer.Exit(_complain("\n".join(complaints), code))


def merge(config: commands.Config, shares: Shares = None, out: Out = None, jobs: Jobs = 2) -> None:
    """Put the shares of a run together.

    These are the folders that `study run CONFIG --part K/N` made. The tables equal those of a run on one machine, and
    the run's folder is printed. The folders of the shares stay; remove them when you want.
    """
    from study.simulation.experiment.config import config_file, read
    from study.simulation.library import merge, workers_of

    made = read(config_file(config))
    done, complaints = merge(made, shares or [], out, workers_of(made[0], jobs, None), _progress)
    typer.echo(str(done.folder))
    if complaints:
        raise typer.Exit(_complain("\n".join(complaints), ExitCode.TOO_MANY_FAILURES))


def posterior(folder: Folder, jobs: Jobs = 2) -> None:
    """Sample posteriors of a run's trials.

    The config chooses the trials in [posterior]. The tables are stored, and their calibration is printed. If a chain
    has no answer, a line says why, and the exit code is 3.
    """
    from study.simulation.posterior.run import compute, printed, without_answer

    run = opened(folder)
    with _progress("posteriors") as advance:
        compute(run, jobs, advance)
    echo(printed(run))
    _end([], without_answer(run.table("posterior")).empty, ExitCode.TOO_MANY_FAILURES)


def figures(words: Drawn, out: Pictures = None, jobs: Jobs = 2) -> None:
    """Draw figures of runs from their tables, as PNG, SVG and PDF.

    Each figure comes from the first run that has the tables for it. A figure that fails does not cost the others; its
    place in the code is printed, and the exit code is 1.
    """
    from study.simulation.figures import FIGURES

    names = [word for word in words if word in FIGURES]
    unknown = [word for word in words if word.startswith("fig") and word not in names and not Path(word).exists()]
    if unknown:
        raise typer.BadParameter(f"{', '.join(unknown)}: unknown; {did_you_mean(unknown, FIGURES)}")
    runs = [opened(run_folder(word)) for word in words if word not in names]
    if not runs:
        raise typer.BadParameter(f"{' '.join(names)}: no run is given; give one before the figures")
    _draw(runs, jobs, out, names)


def _draw(
    runs: "Sequence[Run]", jobs: int, out: Path | None = None, names: Sequence[str] = (), kinds: Sequence[str] = ()
) -> None:
    """Draw figures, in all formats unless some are given; print the pictures, and the reasons of those without one."""
    from study.simulation.figures import FAILED, draw_all

    drawn, undrawn = draw_all(runs, out, names, kinds, jobs)
    echo(map(str, drawn))
    for name, reason in undrawn.items():
        typer.echo(f"{name}: {'' if reason.startswith(FAILED) else 'not drawn: '}{reason}", err=True)
    if any(reason.startswith(FAILED) for reason in undrawn.values()):
        raise typer.Exit(ExitCode.FAILURE)


def fit(
    files: Points,
    estimator: Estimator = "corrected",
    noise: Noise = None,
    radius: KnownRadius = None,
    radius_error: RadiusError = None,
    scale: NoiseScale = "given",
    spheres: SphereCount = None,
    circle: InSpace = False,
    ordered: Ordered = False,
    assume: Assume = None,
    law: NoiseLaw = "isotropic",
    columns: Columns = None,
    dimension: Dimension = None,
    sensitivity: Sensitivity = False,
    plot: Plot = None,
    as_json: FitsAsJson = False,
    as_csv: Csv = False,
) -> None:
    """Fit a sphere, or a circle, to the points in each file.

    With --circle it is a circle in space. Columns sigma, or sx, sy and sz, are the noise of each point. Several files
    make a table, a line each. A file that cannot be read costs the others nothing; the exit code is then 2. It is 3 if
    a fit is not ok.
    """
    from study.fits import fitting
    from study.fits.evidence.judge import Assumptions
    from study.fits.fitting import choose, fit_all
    from study.fits.points.point_files import read_points
    from study.fits.points.point_formats import PointFileError

    if as_json and as_csv:
        raise typer.BadParameter("give --json or --csv, not both")
    if assume not in (None, "sphere"):
        raise typer.BadParameter(f"--assume {assume}: only a sphere can be assumed: --assume sphere")
    if law not in ("isotropic", "radial"):
        raise typer.BadParameter(f"--law {law}: isotropic, or radial for noise along the radius alone")
    assumed = Assumptions(ordered, assume is not None, law == "radial")
    if plot is not None and len(files) > 1:
        raise typer.BadParameter("--plot: give one file")
    if sensitivity and (len(files) > 1 or as_json or as_csv):
        raise typer.BadParameter("--sensitivity prints lines about one file; in Python they are fit.sensitivity()")
    if radius_error is not None and radius is None:
        raise typer.BadParameter(f"--radius-error {radius_error:g}: give the radius too, as --radius")
    if isinstance(radius, tuple) != (spheres is not None) and radius is not None:
        remedy = "limits such as 24:26" if spheres is not None else "one number; limits go with --spheres"
        raise typer.BadParameter(f"--radius {radius}: give {remedy}")
    if spheres is not None:
        if noise is not None or radius_error is not None or plot is not None or as_csv or sensitivity or any(assumed):
            raise typer.BadParameter(
                "--spheres goes with --estimator, --radius, --columns, --dimension and --json alone"
            )
        _fit_spheres(files, (spheres, radius), estimator, columns, dimension, as_json)
        return
    if circle:
        if noise is not None or radius is not None or as_csv or sensitivity or assume or law != "isotropic":
            raise typer.BadParameter("--circle goes with --ordered, --columns, --plot and --json alone")
        _fit_circles(files, columns, ordered, plot, as_json)
        return
    chosen = choose(estimator, noise)
    results, complaints = [], []
    for file in files:
        try:
            table = read_points(file, columns or None, dimension)
            known = radius if radius_error is None or radius is None else (radius, radius_error)
            fits = fit_all(table.points, chosen, table.noise_or(noise), assumed, known, scale)
            results.append(fitting.FileFits(file, table, fits))
        except PointFileError as error:
            complaints.append(str(error))
    if not results:
        _end(complaints, True, ExitCode.USAGE)
    if as_json or as_csv:
        typer.echo(fitting.as_json(results) if as_json else fitting.as_csv(results))
    else:
        echo(fitting.as_text(results, noise, sensitivity))
    if plot is not None:
        (only,) = results
        _plot(only.table.points, only.fits, only.table.names, ordered, plot)
    _end(complaints, all(result.ok() for result in results), ExitCode.TOO_MANY_FAILURES)


def _fit_circles(files: list[Path], columns: str | None, ordered: bool, plot: Path | None, as_json: bool) -> None:
    """Fit a circle in space to each file, and print it."""
    from study.fits.points.point_files import read_points
    from study.fits.points.point_formats import PointFileError
    from study.fits.space_circle import fit_circle
    from study.style import save_picture

    rows, complaints, good = [], [], True
    for file in files:
        try:
            table = read_points(file, columns or None, 3)
            circle = fit_circle(table.points, ordered=ordered)
        except (PointFileError, ValueError) as error:
            complaints.append(str(error))
            continue
        good &= bool(circle.ok)
        rows.append({"file": str(file)} | circle.to_dict())
        if not as_json:
            echo([*[f"{file}:"] * (len(files) > 1), *circle.lines(table.names)])
        if plot is not None:
            save_picture(circle.plot(), plot)
    if not rows:
        _end(complaints, True, ExitCode.USAGE)
    if as_json:
        typer.echo(json_text(rows))
    _end(complaints, good, ExitCode.TOO_MANY_FAILURES)


def _fit_spheres(
    files: list[Path],
    wanted: tuple[int, tuple[float, float] | None],
    estimator: str,
    columns: str | None,
    dimension: int | None,
    as_json: bool,
) -> None:
    """Find spheres in each file, so many of radii within limits, and print them."""
    from study.fits.points.point_files import read_points
    from study.fits.spheres import as_rows, fit_spheres, printed

    complaints, objects, complete = list[str](), list[dict[str, object]](), True
    count, limits = wanted
    for file in files:
        try:
            table = read_points(file, columns or None, dimension)
            spheres = fit_spheres(table.points, count, estimator=estimator, radius=limits)
        except ValueError as error:
            complaints.append(str(error))
            continue
        complete = complete and int(spheres.ok.sum()) == count
        objects += [{"file": str(file)} | row for row in as_rows(spheres)]
        for line in () if as_json else printed(spheres, table.names, count):
            typer.echo(line if len(files) == 1 else f"{file}: {line}")
    if as_json:
        typer.echo(json_text(objects))
    _end(complaints, complete, ExitCode.TOO_MANY_FAILURES)


def certify(
    folders: Pairs = None, estimator: Certified = None, limit: Limit = 1e-9, out: PairsOut = None, table: Errors = None
) -> None:
    """Compare fits with certified spheres.

    They are the package's own, solved with 60 digits, or pairs in folders. The largest error of centre and radius is
    printed. The exit code is 1 if an error is above the limit on a set that double precision can tell. A pair that
    cannot be read costs the others nothing; the exit code is then 2.
    """
    from study.files import save_frame
    from study.fits import certify

    if not 0.0 < limit < 1.0:
        raise typer.BadParameter(f"--limit {limit:g}: give a share of the radius between 0 and 1, such as 1e-9")
    names = certify.chosen(estimator, own=not folders)
    complaints: list[str] = []
    results: dict[str, list[certify.Certificate]] = {}
    for name in names:
        pairs = list(certify.read_pairs(folders, complaints)) if folders else list(certify.reference_pairs(name))
        if pairs:
            results[name] = [certify.certificate(pair, name) for pair in pairs]
        if out is not None:
            certify.write_pairs(pairs, out / name)
    echo(certify.printed(results, limit))
    if table is not None:
        save_frame(certify.frame(results, limit), table)
    _end(complaints, all(one.passes(limit) for sets in results.values() for one in sets), ExitCode.FAILURE)


def plan_fit(
    noise: Sigma,
    radius: Nominal,
    error: Wanted = None,
    angle: HalfAngle = None,
    points: Count = None,
    of: ErrorOf = "center",
    circle: OnArc = False,
    as_json: PlanAsJson = False,
) -> None:
    """Plan a measurement: points, cap or error.

    Of --error, --angle and --points two are given. A simulation of such measurements says how often their fit is ok.

    With --json: points, angle, center_error, across_error, radius_error, ok_share and its Monte-Carlo error ok_error,
    the errors of the simulated fits; with --circle axis_error, in radians.
    """
    from study.fits import plan as plans

    try:
        plan = plans.plan_fit(noise, radius, error, angle=angle, points=points, of=of, dimension=2 if circle else 3)
    except ValueError as fault:
        raise typer.BadParameter(str(fault)) from None
    plan = plan._replace(in_space=circle)
    if as_json:
        found = plan.simulated()._asdict()
        shares = {name: found.pop(name) for name in ("ok_share", "ok_error")}
        axis = {"axis_error": plan.axis_error} if circle else {}
        typer.echo(json_text(plan._asdict() | axis | shares | {"simulated": found}))
    else:
        echo(plans.plan_in_words(plan, error, of))


def export(folder: Folder, xarray: ToXarray = None, duckdb: ToDuckdb = None) -> None:
    """Write a run's tables for other programs.

    The errors become arrays in NetCDF, with an axis for each condition that varies; all tables become those of a DuckDB
    database. Parquet, which most programs read, is what the run's folder has.
    """
    from study.simulation.library import read_run, write_duckdb, write_netcdf

    if xarray is None and duckdb is None:
        raise typer.BadParameter("give --xarray FILE or --duckdb FILE; the run's folder has the tables as Parquet")
    run = read_run(folder)
    for path, write in ((xarray, write_netcdf), (duckdb, write_duckdb)):
        if path is not None:
            write(run, path)
            typer.echo(str(path))


def replay(folder: Folder, cell: Cell, trial: Trial = None, out: PointsOut = None, plot: Plot = None) -> None:
    """Draw one trial of a run again.

    The truth and every estimator's fit are printed. With --out points.csv, the true sphere and σ are in
    points.truth.csv.
    """
    from study.files import save_frame
    from study.simulation.experiment.replay import find, fits, parse_name, points, printed, truth
    from study.simulation.runs.provenance import other_version

    run = opened(folder)
    drawn = find(run.study, *parse_name(cell, trial))
    if drawn.trial >= (count := run.trials().get(drawn.cell.name, drawn.trial + 1)):
        _complain(f"{folder}: cell {drawn.cell.name} has {count:,} trials; trial {drawn.trial} is not in its tables")
    if (warning := other_version(run.maker())) is not None:
        _complain(f"{folder}: {warning}")
    echo(printed(run.study, drawn))
    if out is not None:
        save_frame(points(drawn), out)
        save_frame(truth(drawn), out.with_suffix(f".truth{out.suffix}"))
    if plot is not None:
        frame = points(drawn)
        _plot(frame.to_numpy(), fits(run.study, drawn), [*frame.columns], False, plot)


_GROUPS: dict[str, tuple[Callable[..., None], ...]] = {
    "Points": (fit, plan_fit, commands.estimators),
    "Joints": (joints, skeleton),
    "Studies": (run, commands.summary, commands.report, commands.claims, commands.check),
    "More on studies": (
        *(commands.configs, commands.plan, merge, commands.status, posterior, commands.ask, commands.laws),
        *(commands.measures, commands.worker, commands.compile_loops),
    ),
    "More on results": (
        *(figures, commands.rank, commands.regret, commands.worst, replay, commands.diff, commands.verify),
        *(commands.archive, export, commands.readings, certify, commands.cost),
    ),
    "More on recordings": (recording, joint, gait, live, case_study, synthetic, fetch, markersets),
}
_NEEDS_NO_ESTIMATOR: set[Callable[..., None]] = {
    *(commands.configs, commands.check, certify, commands.cost, plan_fit, commands.worker, commands.ask),
    commands.compile_loops,
    *_GROUPS["Joints"],
    *_GROUPS["More on recordings"],
}
_NAMES: dict[Callable[..., None], str] = {commands.compile_loops: "compile"}
"""Names of commands whose functions cannot have them: `compile` is Python's."""
_RESUMED = {"run", "merge", "posterior"}
"""Commands that go on where an interruption stopped them."""
for _title, _group in _GROUPS.items():
    for _command in _group:  # those that read configs, runs or names of estimators take --plugin
        _entry = _command if _command in _NEEDS_NO_ESTIMATOR else with_plugins(_command)
        app.command(_NAMES.get(_command), rich_help_panel=_title)(_entry)
app.command(hidden=True)(commands.coverage)


@app.callback()
def options(version: Version = False) -> None:
    """Take the options that stand before a command."""


@contextlib.contextmanager
def _progress(title: str) -> Iterator[Callable[..., None]]:
    """Show a bar if standard error is a terminal, else a line a minute; it gives `Headway.add`, or one like it."""
    from study.simulation.library import Headway

    if not sys.stderr.isatty():
        yield Headway(lambda words: print(f"{title}: {words}", file=sys.stderr, flush=True)).add
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
    from rich.text import Text

    class Words(ProgressColumn):
        """Units done, the time that has passed and the time that is left."""

        def render(self, task: Task) -> Text:
            return Text(headway.words())

    headway = Headway()
    columns = (TextColumn("{task.description}"), BarColumn(), Words())
    with Progress(*columns, console=Console(file=unchanged(sys.stderr))) as bar:
        task = bar.add_task(title, total=1.0)

        def add(share: float, done: int = 0, total: int = 0) -> None:
            headway.add(share, done, total)
            bar.update(task, completed=headway.share)

        yield add


def main(command: Callable[..., object] = app) -> None:
    """Entry point; see `ExitCode`."""
    instruction_set.fix()
    threads = os.environ.get("NUMBA_NUM_THREADS", "1")
    if not threads.strip().lstrip("0").isdecimal():
        message = f"NUMBA_NUM_THREADS = {threads!r:.40}: must be a whole number above 0; unset it, or give --jobs"
        raise SystemExit(_complain(message, ExitCode.USAGE))
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # a batch system sends it when time is up
    if sys.stderr is None:  # closed: what would be said is lost, and no file that is opened takes its number
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.set_inheritable(nowhere, True)
        sys.stderr = os.fdopen(nowhere, "w")
    for stream in (sys.stdout, sys.stderr):  # a terminal without Greek letters gets question marks
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    sys.stdout, sys.stderr = shown(sys.stdout), shown(sys.stderr)
    try:
        command()
    except SystemExit as end:
        if type(sys.stdout).__name__ == "PacifyFlushWrapper":  # set where a reader such as `head` has gone
            raise SystemExit(ExitCode.NO_READER) from None
        if end.code == ExitCode.INTERRUPTED:
            resumed = bool(_RESUMED.intersection(sys.argv[1:2]))
            _complain(f"interrupted{'; run the same command again to resume' if resumed else ''}")
        raise
    except Exception as error:
        from study.files import InputError, RunError
        from study.fits.points.point_formats import PointFileError
        from study.fits.registry import PluginError
        from study.simulation.experiment.replay import ReplayError
        from study.toml import ConfigError

        if isinstance(error, ConfigError | PluginError | PointFileError | InputError | ReplayError | RunError):
            code = ExitCode.FAILURE if isinstance(error, RunError) else ExitCode.USAGE
            raise SystemExit(_complain(str(error), code)) from None
        if isinstance(error, OSError) and _output_is_lost():
            message = f"standard output: cannot be written: {error.strerror}"
            raise SystemExit(_complain(message, ExitCode.FAILURE)) from None
        raise


def _output_is_lost() -> bool:
    """Tell whether standard output cannot be written; what is left of it is thrown away."""
    try:
        print(flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return True
    return False


def _end(complaints: Sequence[str], fine: bool, code: ExitCode) -> None:
    """End with exit code 2 if there are complaints, which are printed, or with another code if not all is fine."""
    if complaints:
        raise typer.Exit(_complain("\n".join(complaints), ExitCode.USAGE))
    if not fine:
        raise typer.Exit(code)


def _plot(points: Any, fits: Any, names: list[str], ordered: bool, path: Path) -> None:
    """Draw points and fits."""
    from study.fits.answers.fit_plot import draw, prepare
    from study.style import save_picture

    save_picture(draw(prepare(points, fits, names, ordered)), path)


def _complain(message: str, code: int = ExitCode.COMPLETE) -> int:
    """Print a message to standard error; returns the exit code."""
    print(message, file=sys.stderr)
    return code


if __name__ == "__main__":
    main()

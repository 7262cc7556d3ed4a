"""Commands about configs, runs, estimators and claims, for `study.cli`, and the option ``--plugin``."""

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from study.options import ExitCode, Json, echo
from study.simulation.folders import RUNS, opened, run_folder
from study.text import columns, inert_frame, json_text

_FOLDER = "folder of a run, or the config of a run in results/, such as configs/paper.toml, or paper if it is shipped"
Folder = Annotated[Path, typer.Argument(metavar="RUN", parser=run_folder, help=_FOLDER)]
CONFIG_HELP = "config file, or name of a shipped config (see `study configs`)"
Config = Annotated[Path, typer.Argument(metavar="CONFIG", help=CONFIG_HELP)]
Jobs = Annotated[int, typer.Option("--jobs", "-j", min=1, max=1024, help="number of workers")]


def configs() -> None:
    """List the shipped configs. `study plan` and `study run` take them by name."""
    from study.simulation.experiment.config import shipped_configs, summary_line

    echo(columns([name, summary_line(path)] for name, path in shipped_configs().items()))


def plan(config: Config, jobs: Jobs = 2, as_json: Json = False) -> None:
    """Predict a study's size and time without running it.

    The exit code is 5 if the run would take more than a week.

    With --json: run, jobs, and parts, a list of title, cells, units, trials, draws, samples, fits, bytes and seconds;
    one part, or two if the config has [precision].
    """
    from study.simulation.experiment.config import config_file, load
    from study.simulation.runs.plan import plans, printed, warning

    study = load(config_file(config))
    parts = plans(study, jobs)
    if as_json:
        rows = [{"title": title, **vars(result)} for title, result in parts.items()]
        typer.echo(json_text({"run": study.run_name(), "jobs": jobs, "parts": rows}))
    else:
        echo(printed(study, parts))
    if (words := warning(study, next(iter(parts.values())), jobs)) is not None:  # the first is the least work
        typer.echo(words, err=True)
        raise typer.Exit(ExitCode.TOO_LONG)


def worker(
    scheduler: Annotated[str, typer.Argument(metavar="ADDRESS", help="address of a Dask scheduler: tcp://host:8786")],
    options: Annotated[list[str] | None, typer.Argument(metavar="-- OPTION…", help="see `dask worker --help`")] = None,
) -> None:
    """Start a Dask worker whose results equal those of this machine.

    They are equal to the last bit.
    """
    from study.simulation.runs.workers import serve

    serve(scheduler, options or [])


def status(folder: Folder, as_json: Json = False) -> None:
    """Print the state of a run.

    These are its units, parts, failures, tables, and the software that made it.

    With --json: run, folder, state, finished, writer, units (total, done, missing), cells (total, target, cap, open;
    null without [precision]), parts (whole, damaged, set_aside), failures (fits, failed, lost; null until the run is
    finished), tables, damaged, and made_by.
    """
    from study.simulation.runs.status import RunStatus, printed

    result = RunStatus(folder)
    echo([json_text(vars(result))] if as_json else printed(result))


_WHERE = "cells with these values, such as angle=45,samples=20,200"
Where = Annotated[list[str] | None, typer.Option("--where", metavar="CONDITION=VALUE,…", help=_WHERE)]
_ESTIMATORS = "such as als,mle [default: all]"
EstimatorChoice = Annotated[str | None, typer.Option("--estimators", "-e", metavar="NAME,…", help=_ESTIMATORS)]
All = Annotated[bool, typer.Option("--all", help="print every row; by default some that are evenly spread")]
_OK = "medians of each estimator's own ok fits: of other trials in each column"
OnlyOk = Annotated[bool, typer.Option("--ok", help=_OK)]
_MEASURE = "a measure of the summary instead, such as far or interval_radius"
MeasureChoice = Annotated[str | None, typer.Option("--measure", "-m", metavar="NAME", help=_MEASURE)]
Csv = Annotated[bool, typer.Option("--csv", help="print all columns of the summary table as CSV")]


def summary(
    folder: Folder,
    where: Where = None,
    estimators: EstimatorChoice = None,
    every: All = False,
    only_ok: OnlyOk = False,
    measure: MeasureChoice = None,
    as_json: Json = False,
    as_csv: Csv = False,
) -> None:
    """Print a run's median errors over the bound.

    Medians are of all trials, whatever the fit's status, so that estimators are compared on the same trials. A fit
    without a number counts as infinitely far; a median that falls on such fits is inf. Brackets give the share of fits
    that are not ok.

    The table fits a screen: of many cells it has some that are evenly spread over the conditions, and cells that differ
    by scaling alone are printed once. If --where gives a condition several values, cells with any of them count.

    With --measure the table has another measure of the summary, of all fits unless its name ends in _ok.

    --csv and --json have every cell that --where and --estimators choose. With --json: run, bound, conditions (their
    names), and rows, each with the columns of the summary table (ratio_median is the median of all trials) and, where
    they are known, noise_over_radius and the medians at the bounds, median_cramer_rao and median_attainable.
    """
    from study.simulation.analysis.summary import as_data, chosen_rows, measure_shown, printed

    if as_json + as_csv + only_ok + (measure is not None) > 1:
        words = "give one of --json, --csv, --ok and --measure; the first two have all measures"
        raise typer.BadParameter(words)
    run = opened(folder)
    try:
        rows = chosen_rows(run, where or [], estimators)
        shown = measure_shown(run, measure or ("ratio_median_ok" if only_ok else "ratio_median"))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    if as_json:
        echo([json_text(as_data(run, rows))])
    elif as_csv:  # all columns; an empty field is not a number
        echo(inert_frame(rows).to_csv(index=False, lineterminator="\n").splitlines())
    else:
        echo(printed(run, rows, every, shown))


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
    from study.simulation.analysis.compare import Difference, as_data, printed

    result = Difference(opened(one), opened(other))
    echo([json_text(as_data(result))] if as_json else printed(result))
    if result.different:
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
    from study.simulation.analysis.verify import Verification, printed

    result = Verification(opened(folder), share)
    echo(printed(result))
    if result.faults:
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
    from study.simulation.analysis.archive import archive as write
    from study.simulation.analysis.archive import printed

    runs = [opened(folder) for folder in folders]
    echo(printed(runs, write(runs, out)))


def worst(
    folder: Folder,
    count: Annotated[int, typer.Option("--count", "-n", min=1, help="number of trials")] = 10,
    estimator: Annotated[str | None, typer.Option("--estimator", "-e", help="one estimator [default: all]")] = None,
    as_json: Json = False,
) -> None:
    """List the trials with the largest errors.

    Errors are in units of the bound; only fits that their estimator calls ok count, by its own status.

    With --json: run, bound, and trials, each with the name that `study replay` takes, cell, trial, estimator, ratio
    (error over bound), error, bound, and the conditions.
    """
    from study.simulation.analysis.summary import printed_worst, worst_as_data, worst_of_run

    run = opened(folder)
    result, _ = worst_of_run(run, count, estimator)
    echo([json_text(worst_as_data(run, result))] if as_json else printed_worst(run, result))


def regret(
    folder: Folder,
    where: Where = None,
    csv: Annotated[Path | None, typer.Option("--csv", help="file to write the table to")] = None,
) -> None:
    """Compare each estimator with the best in every cell.

    The numbers are geometric means, over the cells of a grid, of the median error and of its 95 % quantile.
    """
    from study.files import save_frame
    from study.simulation.analysis.regret import of_run, printed
    from study.simulation.analysis.regret import regret as means

    run = opened(folder)
    try:
        table = means(of_run(run, where or ()))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    if csv is not None:
        save_frame(table, csv)
    echo(printed(run, table))


_RANKED = "folders of runs, or their configs, each a mechanism; tables of errors; with --against, .py files of methods"
Ranked = Annotated[list[Path], typer.Argument(metavar="RUN", parser=run_folder, help=_RANKED)]
_BY = (
    "error that estimators are ranked by: center, radius, disc (of circles: 1 - Jaccard index), or a column of numbers "
    "of a measure whose least is best, such as own_errors_width"
)
RankBy = Annotated[str, typer.Option("--by", help=_BY)]
_LEVEL = "level at which the others are told from the best"
RankLevel = Annotated[float, typer.Option("--level", min=0.5, max=0.999, help=_LEVEL)]
RankTable = Annotated[Path | None, typer.Option("--table", metavar="FILE", help="file of the table, .csv or .parquet")]
_AGAINST = "archive of other methods' errors on the same points: archive, or a folder or file"
Against = Annotated[Path | None, typer.Option("--against", metavar="ARCHIVE", help=_AGAINST)]
RankPage = Annotated[Path | None, typer.Option("--out", metavar="PAGE", help="file of a page of all rankings, .html")]


def rank(
    entries: Ranked,
    by: RankBy = "center",
    level: RankLevel = 0.95,
    table: RankTable = None,
    against: Against = None,
    out: RankPage = None,
) -> None:
    """Rank estimators, with all that may be the best.

    Those are marked that cannot be told from the best. Estimators are compared on the same trials: by the median and
    the root mean square of their errors, in each cell, over the cells of a run, and over all runs. A fit without a
    number counts as infinitely far.

    A table of errors, .csv or .parquet, has the columns mechanism, cell, trial, method and error. With --against the
    methods that are new are ranked among those of an archive. Those of a .py file, as `study run --plugin` takes it,
    are run in each mechanism of the archive first.
    """
    from study.files import save_frame
    from study.simulation.analysis import losses as source
    from study.simulation.analysis.rank import compared, printed, printed_places, ranked

    theirs = [] if against is None else source.read_tables(against)
    found: list[source.Losses] = []
    for entry in entries:
        if entry.suffix == ".py":
            if against is None:
                raise typer.BadParameter(f"{entry}: a method is ranked among others: give --against archive")
            runs = source.entered(entry, theirs, RUNS, functools.partial(typer.echo, err=True))
            found += [mechanism.losses(by, run) for mechanism, run in runs]
        elif entry.suffix in (".csv", ".parquet"):
            found += [one.losses(by) for one in source.read_tables(entry)]
        else:
            run = opened(entry)
            if by not in (known := source.rankings(run)):
                raise typer.BadParameter(f"--by {by}: must be {', '.join(known)} for {run.folder}")
            found.append(source.of_run(run, by) if against is None else source.beside(run, theirs, by))
    result = ranked([compared(one, level) for one in found], level)
    if table is not None:
        save_frame(result, table)
    kept = {name for one in theirs for name in one.methods}
    new = [name for name in dict.fromkeys(result["estimator"]) if name not in kept] if theirs else []
    if out is not None:
        from study.simulation.report.page import save
        from study.simulation.report.ranking import page

        save(page(result, by, level, new), out)
    echo(printed_places(result, by, level, new) if new else printed(result, by, level))


_CAP = "half-angle of the cap that the directions are confined to, in degrees"
AskedSamples = Annotated[int, typer.Option("--samples", help="number of samples")]
AskedNoise = Annotated[float, typer.Option("--noise-over-radius", help="standard deviation of a coordinate over r")]
AskedAngle = Annotated[float, typer.Option("--angle", help=_CAP)]
AskedDimension = Annotated[int, typer.Option("--dimension", help="number of coordinates; 3 alone is known")]


def ask(
    samples: AskedSamples,
    noise_over_radius: AskedNoise,
    angle: AskedAngle,
    dimension: AskedDimension = 3,
    as_json: Json = False,
) -> None:
    """Predict each estimator's error without a run.

    The median error of the centre over the bound, of all trials, is predicted from a table that comes along, with an
    interval that holds it in 95 % of conditions. The noise is normal, and the directions are uniform by area. Beyond
    the table's range the command refuses.

    With --json: samples, noise_over_radius, angle, level, at_bound (the median of an estimator at the bound), answers,
    each with estimator, ratio_median, low and high, and made_by (version, seed, trials, cells and even).
    """
    from study.simulation.analysis.ask import Emulator, as_data, printed

    emulator, conditions = Emulator.load(), (samples, noise_over_radius, angle)
    try:
        answers = emulator.ask(conditions, dimension)
    except ValueError as fault:
        raise typer.BadParameter(str(fault)) from None
    if as_json:
        echo([json_text(as_data(conditions, answers, emulator.origin))])
    else:
        echo(printed(conditions, answers, emulator.origin))


def estimators() -> None:
    """List the estimators, their cost and their sources."""
    from study.fits import ESTIMATORS

    rows = []
    for name, entry in ESTIMATORS.items():
        cost = f"{entry.flops(3):g} {entry.flops_of}".strip() if entry.flops else "-"
        rows.append([name, cost, entry.needs or "-", entry.reference])
    echo(columns(rows, ["estimator", "FLOPs per sample (3-D)", "needs", "from"]))


def laws() -> None:
    """List the laws of noise and directions that a config may name.

    Laws of outliers and of coordinates are among them.
    """
    from study.simulation.experiment.laws import LAWS, PLAIN, written

    rows = [[word, kind, "where no other is named"] for kind, word in PLAIN.items() if word not in LAWS]
    rows += [[written(name, law.example), law.kind, law.sentence] for name, law in LAWS.items()]
    echo(columns(sorted(rows, key=lambda row: [*PLAIN].index(row[1])), ["law", "of", ""]))


def measures() -> None:
    """List the measures of fits that a config may name.

    Below each stand the columns that it adds to the tables, in three dimensions.
    """
    from study.simulation.experiment.measures import MEASURES, stored

    rows = []
    for name, measure in MEASURES.items():
        rows.append([name, "", measure.sentence])
        rows += [[f"  {c.name}", c.kind.__name__, c.meaning.removeprefix(f"{name}: ")] for c in stored([name], 3)]
    echo(columns(rows, ["measure", "type", ""]))


_FILE = "Python file with estimators, laws or measures of your own"


def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help=_FILE)],
    limit: Annotated[
        float, typer.Option("--limit", metavar="SECONDS", min=0.1, help="time in which a single fit should be done")
    ] = 60.0,
) -> None:
    """Check the estimators, the laws and the measures of a file.

    Of estimators these are equivariance, exactness without noise and the like; of laws, that a trial has the same
    numbers again, and alone; of measures the same, and that they do not depend on the unit. Each violation is described
    (exit code 1); a fit that does not return in time is one. What the file prints goes to standard error.
    """
    from study.fits.check import check_file, printed
    from study.simulation.experiment.laws import check as check_law
    from study.simulation.experiment.laws import laws_of
    from study.simulation.experiment.measures import check as check_measures

    if file.suffix == ".toml":
        raise typer.BadParameter(f"{file} is a config, which study plan checks")
    result = check_file(file, limit=limit)
    echo(printed(result))
    checked = [*map(check_law, laws_of(file.name)), check_measures(file.name)]
    echo(line for violations, lines in checked for line in (*violations, *lines))
    if any(report.violations for report in result) or any(violations for violations, _ in checked):
        raise typer.Exit(ExitCode.FAILURE)


def compile_loops(
    configs: Annotated[list[Path] | None, typer.Argument(metavar="[CONFIG]…", help="studies that will be run")] = None,
    circles: Annotated[bool, typer.Option("--circles", help="also fits, in two and three dimensions")] = False,
    costs: Annotated[bool, typer.Option("--costs", help="also what `study cost` times")] = False,
) -> None:
    """Compile loops before they are used.

    Without CONFIG they are those of fits in three dimensions. One fit of up to some thousand points needs no compiled
    loops. Many fits, large ones and studies compile what they need when they need it, which takes up to a minute, once
    after an installation.
    """
    from study.simulation.compile_loops import compile_loops

    compile_loops(configs or [], circles, costs)


def cost(
    out: Annotated[Path, typer.Option("--out", help="file of the table, .csv or .parquet")] = Path(
        "results/cost.parquet"
    ),
) -> None:
    """Measure the cost of a fit beside the paper's figures.

    Fits are timed; the table, with operations beside the seconds, is stored.
    """
    from study.files import save_frame
    from study.simulation.analysis.cost import cost_table, printed

    table = cost_table()
    save_frame(table, out)
    echo(printed(table))


NoJobs = Annotated[int | None, typer.Option("--jobs", "-j", min=1, hidden=True, help="has no effect any more")]
Former = Annotated[Path | None, typer.Argument(metavar="[CONFIG]")]
FormerOut = Annotated[Path | None, typer.Option("--out", help="has no effect any more")]


def coverage(config: Former = None, jobs: NoJobs = None, out: FormerOut = None) -> None:
    """Name the commands that have taken its place."""
    words = "coverage is a study like others: `study run coverage`, and `study figures coverage fig_coverage`"
    raise typer.BadParameter(f"{words}; your own config lists measures = ['interval', 'own_errors']")


ReadingsConfig = Annotated[Path, typer.Argument(metavar="CONFIG", help="config of readings, or readings if shipped")]
ReadingsOut = Annotated[Path, typer.Option("--out", help="file of the table; the runs go beside it, in readings/")]
CostTable = Annotated[Path | None, typer.Option("--cost", help="table that `study cost` stores")]


def readings(
    config: ReadingsConfig = Path("readings"),
    out: ReadingsOut = RUNS / "readings.csv",
    cost: CostTable = None,
    jobs: Jobs = 2,
) -> None:
    """Judge the claims under other readings of the paper.

    What the paper leaves open is read otherwise, one choice at a time: the studies that it changes are run, and the
    claims that it may change are judged again. The table is stored; verdicts that change are printed.
    """
    from study.files import save_frame
    from study.simulation.claims.readings import Readings, judge, own_configs, read
    from study.simulation.experiment.config import config_file, shipped_config
    from study.simulation.experiment.config import read as read_config
    from study.simulation.runs.runner import run

    choices, own = read(config_file(config)), []
    for name in own_configs():
        study, text = read_config(shipped_config(name))
        own.append(run(study, text, RUNS / study.run_name(), jobs))
    table = judge(choices, own, out.parent / "readings", jobs, cost, lambda line: typer.echo(line, err=True))
    save_frame(table, out)
    echo(Readings(choices, table).printed())


_FOLDERS = "folders of runs, or their configs, each of another config"
Folders = Annotated[list[Path], typer.Argument(metavar="RUN", parser=run_folder, help=_FOLDERS)]
Cost = Annotated[Path | None, typer.Option("--cost", help="table that `study cost` stores, for the claims on cost")]
_RECORDING = "folder that `study case-study` wrote; may be given several times"
Recordings = Annotated[list[Path] | None, typer.Option("--recording", metavar="DIR", help=_RECORDING)]
Page = Annotated[Path | None, typer.Option("--out", help="file of the page [default: RUN/report.html]")]
Bench = Annotated[Path | None, typer.Option("--bench", help="table that `make bench` stores")]
_FIGURES = "write the figures there too, as PNG and SVG"
FiguresToo = Annotated[Path | None, typer.Option("--figures", metavar="DIR", help=_FIGURES)]
ReadingsToo = Annotated[Path | None, typer.Option("--readings", help="table that `study readings` stores")]
ClaimsToo = Annotated[bool, typer.Option("--claims", help="store the verdicts too, as `study claims` does")]


def claims(folders: Folders, cost: Cost = None, recording: Recordings = None, as_json: Json = False) -> None:
    """Judge the paper's claims by runs.

    The verdicts and the numbers behind them are printed, and stored in the first run's folder, where that run must be
    finished. If no claim can be judged, earlier verdicts stay. If the folder cannot be written, the exit code is 1.

    With --json: runs, a list of names; verdicts, the count of each; claims, a list of the columns of the stored table:
    number, name, section, statement, quantity, value, error, trials, verdict, finding, criterion, remark, reads, runs
    and figure.
    """
    from study.simulation.claims import as_data, judge_all, printed, save
    from study.simulation.claims.recordings import read_case_studies

    runs = [opened(folder) for folder in folders]
    runs[0].manifest()  # without a sound one, no verdict could be stored
    verdicts = judge_all(runs, cost, read_case_studies(recording) if recording else None)
    try:
        save(runs[0], verdicts)
    finally:  # verdicts that cannot be stored are printed all the same
        echo([json_text(as_data(runs, verdicts))] if as_json else printed(verdicts))


def report(
    folders: Folders,
    out: Page = None,
    cost: Cost = None,
    recording: Recordings = None,
    bench: Bench = None,
    figures: FiguresToo = None,
    claims: ClaimsToo = False,
    readings: ReadingsToo = None,
    jobs: Jobs = 2,
) -> None:
    """Write one HTML page about runs, and print its findings.

    It has the claims, figures, tables and provenance, and needs no other file. With --figures and --claims the command
    does the work of `study figures` and `study claims` too, and nothing is made twice.
    """
    from study.simulation.claims import judge_all, judged, tally
    from study.simulation.claims import printed as printed_claims
    from study.simulation.claims import save as save_claims
    from study.simulation.claims.readings import Readings
    from study.simulation.claims.recordings import read_case_studies
    from study.simulation.figures import Tables, gallery, make_folder
    from study.simulation.report.material import Material
    from study.simulation.report.page import printed, read_bench, render, save
    from study.style import KINDS

    runs = [opened(folder) for folder in folders]
    measured = read_bench(bench) if bench else None
    otherwise = Readings.load(readings) if readings else None
    spreads = read_case_studies(recording) if recording else None
    if figures is not None:
        make_folder(figures)
    if claims:
        runs[0].manifest()  # without a sound one, no verdict could be stored
    drawn = gallery(kinds=["png"] if figures is None else KINDS, jobs=jobs)
    with drawn.ahead([Tables(run) for run in runs]):
        verdicts = judge_all(runs, cost, spreads)
        material = Material(runs, verdicts, measured, drawn, otherwise)
    path = save(render(material), out or runs[0].folder / "report.html")
    echo(map(str, drawn.save(figures) if figures is not None else []))
    echo(printed(material))
    if claims:
        echo([f"{tally(verdicts)}; `study claims` prints each"] if judged(verdicts) else printed_claims(verdicts))
    typer.echo(str(path))
    if claims:  # in the end, since another process may be writing to the run
        save_claims(runs[0], verdicts)
    if figures is not None and (failures := drawn.failures()):
        for name, reason in failures.items():
            typer.echo(f"{name}: {reason}", err=True)
        raise typer.Exit(ExitCode.FAILURE)


def _load(paths: list[Path] | None) -> list[Path] | None:
    """Load the files before anything else of a command is read, because configs name what they register."""
    if paths:
        from study.fits.registry import load

        for path in paths:
            load(path)
    return paths


_HELP = f"{_FILE}; may be given several times"
Plugins = Annotated[
    list[Path] | None, typer.Option("--plugin", metavar="FILE", help=_HELP, is_eager=True, callback=_load)
]


def with_plugins(command: Callable[..., None]) -> Callable[..., None]:
    """The same command with the option ``--plugin``, whose files are loaded when the option is read."""

    @functools.wraps(command)
    def called(*arguments: object, plugin: object = None, **named: object) -> None:
        command(*arguments, **named)

    option = inspect.Parameter("plugin", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Plugins)
    signature = inspect.signature(command)
    vars(called)["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), option])
    called.__annotations__ = {**command.__annotations__, "plugin": Plugins}
    return called

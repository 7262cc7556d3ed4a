"""Studies in Python, as the commands treat them: a config is run, and its run is read, drawn and exported."""

import contextlib
import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from study.files import RunError, explained, named_path, replacing
from study.fits.registry import load
from study.simulation.analysis import losses, rank, regret
from study.simulation.analysis.summary import chosen_rows, summarise, up_to_date
from study.simulation.experiment.conditions import NOISE_OVER_RADIUS, Value
from study.simulation.experiment.config import Study, config_file, read
from study.simulation.experiment.designs import as_list
from study.simulation.folders import RUNS, opened, run_folder
from study.simulation.posterior import run as posterior
from study.simulation.runs import runner, schemas
from study.simulation.runs.adaptive import TimeBudget
from study.simulation.runs.parts import Share, takes_long
from study.simulation.runs.run_folder import Run
from study.simulation.runs.workers import Workers
from study.text import did_you_mean
from study.words import Hinting

if TYPE_CHECKING:
    import pandas as pd
    import xarray
    from matplotlib.figure import Figure

Progress = Callable[[str], AbstractContextManager[Callable[..., None]]]
"""Begins to show the progress of something; what it gives is called as `Headway.add`."""
EXTRA = "pip install 'sphere-fit-study[export]'"


@contextlib.contextmanager
def _silent(words: str) -> Iterator[Callable[..., None]]:
    """Show no progress."""
    yield lambda *numbers: None


_LINES = 60.0
"""Seconds between two lines about progress."""


class Headway:
    """Progress in words.

    Args:
        say: called with the words when a minute has passed since they were said; None to say nothing.
        clock: gives the time in seconds.

    Attributes:
        share: share of the work that is done.
    """

    def __init__(self, say: Callable[[str], None] | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._say, self._clock, self.share = say, clock, 0.0
        self._began = self._said = clock()
        self._counts, self._whole = "begun", math.nan

    def add(self, share: float, done: int = 0, total: int = 0) -> None:
        """Note what is done.

        Args:
            share: share of the work that was done since the last call.
            done: number of units that are done.
            total: number of all units; 0 where they are not counted.
        """
        self.share = min(1.0, self.share + share)
        self._counts = f"{done:,}/{total:,} units" if total else f"{self.share:.0%}"
        now = self._clock()
        self._whole = (now - self._began) / self.share if self.share else math.nan
        if self._say is not None and now - self._said >= _LINES:
            self._said = now
            self._say(self.words())

    def words(self) -> str:
        """Units done, the time that has passed, and the time that is left if the rest takes as long as the work did."""
        passed = self._clock() - self._began
        words = f"{self._counts}, {_minutes(passed)} passed"
        return words if math.isnan(self._whole) else f"{words}, about {_minutes(max(0.0, self._whole - passed))} left"


def _minutes(seconds: float) -> str:
    """A time in minutes and seconds, with hours where there are any: 1:05, 12:00:00."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def workers_of(
    study: Study, jobs: int, backend: str | None, scheduler: str | None = None, task: float | None = None
) -> Workers:
    """The workers of a study: those asked for, else threads, or processes where the study takes long."""
    return Workers(backend or ("loky" if jobs > 1 and takes_long(study) else "threads"), jobs, scheduler, task)


def complete(
    config: tuple[Study, str],
    folder: Path | None,
    workers: Workers,
    budget: float | None = None,
    progress: Progress = _silent,
) -> tuple[Run, list[str]]:
    """Run a study with all tables that its config asks for; what is finished already is not computed again.

    Args:
        config: the study, and its text.
        folder: the run's folder; by its name in `RUNS`, if None.
        workers: who computes it.
        budget: seconds after which no new work is started, for a study with [precision].
        progress: shows how far it is.

    Returns:
        The run, and complaints, a line each: it stopped at its budget, or too many fits failed.
    """
    study, text = config
    end = None if budget is None else TimeBudget(budget)
    with progress(study.run_name()) as advance:
        done = runner.run(study, text, folder or RUNS / study.run_name(), workers, advance, budget=end)
    if not up_to_date(done):
        summarise(done)
    if done.stopped() is None and study.posterior is not None:
        with progress("posteriors") as advance:
            posterior.compute(done, workers, advance)
    return done, [words for words in (runner.budget_message(done), runner.failure_message(done)) if words]


def complete_share(
    config: tuple[Study, str], share: Share, folder: Path | None, workers: Workers, progress: Progress = _silent
) -> Run:
    """Compute a share of a study.

    Args:
        config: the study, and its text.
        share: the share.
        folder: the share's folder; by the run's name and the share in `RUNS`, if None.
        workers: who computes it.
        progress: shows how far it is.

    Returns:
        The folder as a run without tables, which `merge` puts together with those of the other shares.
    """
    study, text = config
    name = f"{study.run_name()}-part-{share.number}-of-{share.of}"
    with progress(name) as advance:
        return runner.run_share(study, text, folder or RUNS / name, share, workers, advance)


def merge(
    config: tuple[Study, str],
    shares: Sequence[Path],
    folder: Path | None,
    workers: Workers,
    progress: Progress = _silent,
) -> tuple[Run, list[str]]:
    """Put shares together to the run that one machine would have made; see `complete`.

    Args:
        config: the study, and its text.
        shares: folders of the shares; all beside the run's folder, if none is given.
        folder: the run's folder; by its name in `RUNS`, if None.
        workers: who computes posteriors, if the config has them.
        progress: shows how far it is.
    """
    study, text = config
    folder = folder or RUNS / study.run_name()
    found = shares or sorted(folder.parent.glob(f"{study.run_name()}-part-*-of-*"))
    runner.gather(study, text, folder, found)
    return complete(config, folder, workers, progress=progress)


def _texts(where: Mapping[str, Value | Sequence[Value]]) -> list[str]:
    """Conditions with their values, as a command takes them."""
    return [f"{name}={value}" for name, values in where.items() for value in as_list(values)]


class StudyRun(Hinting):
    """A run, whose tables are read when they are first asked for.

    `study.run` and `study.read_run` make it.

    Attributes:
        folder: its folder.
        name: its name: that of the config, and the config's digest.

    Examples:
        >>> import study
        >>> run = study.run("smoke", folder="smoke")
        >>> run
        <StudyRun smoke-90473f897c in smoke: 96 cells; mle, lls, gdke, ugdk>
        >>> run.summary(["mle"], samples=300, angle=180, noise_over_radius=1e-6)["planned"].item()
        100
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self.folder, self.name = run.folder, run.study.run_name()

    def __repr__(self) -> str:
        study = self._run.study
        cells, names = study.cells(), ", ".join(study.estimators)
        return f"<StudyRun {self.name} in {self.folder}: {cells:,} cell{'s' * (cells != 1)}; {names}>"

    @cached_property
    def errors(self) -> "pd.DataFrame":
        """The error table: a row per cell, trial and estimator.

        Raises:
            RunError: if the study keeps its summary alone, or the table is damaged.
        """
        return self.table("errors")

    def table(self, name: str) -> "pd.DataFrame":
        """A table of the run, such as ``"timings"``, ``"failures"`` or ``"points"``.

        Args:
            name: the table's, as its file has it before ``.parquet``.

        Raises:
            ValueError: if there is no such table.
            RunError: if the run has it not, or it is damaged.
        """
        known = schemas.declared(*self._run.study.columns())
        if name not in known:
            raise ValueError(f"table {name!r}: unknown; {did_you_mean(name, known)}")
        return self._run.table(name)

    def summary(self, estimators: Sequence[str] | None = None, **where: Value | Sequence[Value]) -> "pd.DataFrame":
        """Performance measures with their Monte-Carlo errors: a row per cell, or decade of σ/r, and estimator.

        Args:
            estimators: names of estimators; all if None.
            where: conditions that choose cells, each with a value or several: ``angle=45, samples=[20, 200]``.

        Raises:
            ValueError: if the run has no such condition, value or estimator.
        """
        return chosen_rows(self._run, _texts(where), None if estimators is None else ",".join(as_list(estimators)))

    def regret(self, **where: Value | Sequence[Value]) -> "pd.DataFrame":
        """Errors over those of the best estimator in each cell: geometric means over the cells, as `study regret`.

        Args:
            where: conditions that choose cells, as in `summary`.

        Returns:
            A row per number of samples (0 for all cells together) and estimator: ``median`` and ``q95``, each with its
            Monte-Carlo error (``…_error``) and the largest (``…_worst``).

        Raises:
            RunError: unless the run is a grid of several estimators with its errors.
            ValueError: if the run has no such condition or value.
        """
        return regret.regret(regret.of_run(self._run, _texts(where)))

    def rank(self, by: str = "center", level: float = 0.95, against: str | Path | None = None) -> "pd.DataFrame":
        """Estimators from the best to the worst, with all marked that cannot be told from the best, as `study rank`.

        Args:
            by: the error that counts: ``"center"``, ``"radius"``, of circles ``"disc"`` (1 - Jaccard index), or a
                number of the study's measures that is least where a fit is best, such as ``"own_errors_width"``.
            level: of the comparisons with the best.
            against: an archive of the errors of other methods on the same sets of points: a folder or a file, or
                ``"archive"`` for that of the benchmark. The estimators that it has not are ranked among its methods.

        Returns:
            A row per estimator: ``median`` and ``rms`` of its errors, as geometric means over the cells divided by
            that of the first estimator, each with its Monte-Carlo error (``…_error``), the mark (``…_best``), the
            number of cells in which it cannot be told from the best (``…_cells``) and in which it alone cannot
            (``…_alone``); the share of ``failures``, ``seconds`` per fit, and what it is ``given``: against an archive
            those that are given points alone stand first, and each kind has its own best.

        Raises:
            RunError: unless the run is a grid of several estimators with its errors, of circles for discs, and no
                number of the measure is negative; or if the archive has other sets of points.

        Source: Hsu, Annals of Statistics 12 (1984) 1136-1144.
        """
        if against is None:
            return rank.ranked([rank.compared(losses.of_run(self._run, by), level)], level)
        tables = losses.read_tables(named_path(against, "against"))
        return rank.ranked([rank.compared(losses.beside(self._run, tables, by), level)], level)

    def plot(self, figure: str) -> "Figure":
        """Draw one of the figures, such as ``"fig_map"``, as `study figures` does.

        Raises:
            ValueError: if there is no such figure, or the run cannot feed it; the message says what it needs.
        """
        from study.simulation.figures import FIGURES, NotApplicable, Tables  # imported here, since they load matplotlib

        if figure not in FIGURES:
            raise ValueError(f"figure {figure!r}: unknown; {did_you_mean(figure, FIGURES)}")
        try:
            return FIGURES[figure].draw(FIGURES[figure].prepare(Tables(self._run)))
        except NotApplicable as reason:
            raise ValueError(f"{figure} of {self.name}: {reason}") from None

    def to_xarray(self) -> "xarray.Dataset":
        """The error table as arrays, for xarray: an axis for each condition that varies, estimators and trials.

        Trials that a cell has not are not a number. In a random design, whose trials are cells of their own, the
        conditions are arrays along the trials. Arrays have their unit and meaning as attributes.

        Raises:
            ImportError: if xarray is not installed.
        """
        try:
            import xarray  # noqa: F401  pandas needs it
        except ImportError:
            raise ImportError(f"xarray is not installed; {EXTRA}", name="xarray") from None
        study, errors = self._run.study, self.errors
        axes = list[str]()
        if not study.design.one_trial_a_cell:
            axes = [name for name, values in study.design.given().items() if len(values) > 1]
            if NOISE_OVER_RADIUS.name in axes:  # twelve digits: it may differ in its last bit from radius to radius
                values = [float(f"{value:.12g}") for value in NOISE_OVER_RADIUS.of(errors)]
                errors = errors.assign(**{NOISE_OVER_RADIUS.name: values})
            errors = errors.drop(columns="cell")  # its conditions say the same
        words = dict.fromkeys(errors.select_dtypes("category"), object)
        result = errors.astype(words).set_index([*axes, "estimator", "trial"]).to_xarray()
        for column in schemas.errors(*study.columns()):
            if column.name in result.variables:
                result[column.name].attrs = {"units": column.unit, "long_name": column.meaning}
        return result.assign_attrs(run=self.name)


def write_netcdf(run: StudyRun, path: Path) -> None:
    """Write the error table as arrays into a NetCDF-3 file; see `StudyRun.to_xarray`.

    Raises:
        RunError: if a package is not installed, or the file cannot be written.
    """
    with _exporting(path) as temporary:
        run.to_xarray().to_netcdf(temporary, engine="scipy")


def write_duckdb(run: StudyRun, path: Path) -> None:
    """Write all tables of a run into a DuckDB database, with units and meanings as comments of their columns.

    Raises:
        RunError: if DuckDB is not installed, or the file cannot be written.
    """
    with _exporting(path) as temporary:
        import duckdb

        stored = run._run
        declared = schemas.declared(*stored.study.columns())
        with duckdb.connect(str(temporary)) as database:
            for name in sorted(stored.manifest()["tables"]):
                database.read_parquet(str(stored.require(name))).create(name)
                for column in declared[name]:
                    words = "; unit: ".join(filter(None, [column.meaning, column.unit])).replace("'", "''")
                    database.execute(f"""comment on column "{name}"."{column.name}" is '{words}'""")


@contextlib.contextmanager
def _exporting(path: Path) -> Iterator[Path]:
    """Give a temporary name for a file to write; a `RunError` if a package is missing or it cannot be written."""
    try:
        with explained(path, of_run=False):
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as temporary:
                yield temporary
    except ImportError as error:
        raise RunError(f"{path}: {error.name or error} is not installed; {EXTRA}") from None


def run(
    config: str | Path,
    *,
    folder: str | Path | None = None,
    jobs: int = 2,
    backend: str | None = None,
    scheduler: str | None = None,
    budget: float | None = None,
    plugins: str | Path | Sequence[str | Path] = (),
) -> StudyRun:
    """Run a study, as `study run` does; resume it, or only read it, as far as it has been run.

    Args:
        config: a config file, or the name of a shipped config.
        folder: the run's folder; ``results/<name>-<digest>`` if None.
        jobs: number of workers.
        backend: ``"threads"``, ``"loky"`` (processes) or ``"dask"`` (a cluster); threads if None, processes where the
            study takes long.
        scheduler: address of a Dask scheduler, with ``backend="dask"``.
        budget: seconds after which no new work is started, for a config with [precision].
        plugins: files with estimators, laws or measures of your own that the config names.

    Returns:
        The run. A run that its budget stopped, and too many fits that failed, are warned of.

    Raises:
        ConfigError: if the config has a fault; the message has all of them.
        RunError: if the run cannot be computed or written.

    Examples:
        >>> import study
        >>> run = study.run("smoke", folder="smoke")
        >>> run.name, len(run.errors)
        ('smoke-90473f897c', 38400)
    """
    _load(plugins)
    made = read(config_file(named_path(config, "config")))
    workers = workers_of(made[0], jobs, backend, scheduler)
    done, complaints = complete(made, None if folder is None else Path(folder), workers, budget)
    for words in complaints:
        warnings.warn(words, stacklevel=2)
    return StudyRun(done)


def read_run(run: str | Path, plugins: str | Path | Sequence[str | Path] = ()) -> StudyRun:
    """Read a run that is stored, whoever ran it.

    Args:
        run: its folder; or its config, or the name of a shipped one, whose run is in ``results``.
        plugins: files with estimators, laws or measures of your own that its config names.

    Returns:
        The run, whose tables are read when they are asked for.

    Raises:
        RunError: if there is no run.

    Examples:
        >>> import study
        >>> folder = study.run("smoke", folder="smoke").folder
        >>> study.read_run(folder).regret().columns[:4].tolist()
        ['samples', 'estimator', 'cells', 'median']
    """
    _load(plugins)
    return StudyRun(opened(run_folder(str(named_path(run, "run")))))


def _load(plugins: str | Path | Sequence[str | Path]) -> None:
    """Load files of a user's own before a config is read, which names what they register."""
    for path in [plugins] if isinstance(plugins, str | Path) else plugins:
        load(named_path(path, "plugins"))

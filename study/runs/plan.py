"""Cost of a study before it runs: counts, bytes, and seconds predicted from a short calibration."""

from collections import Counter
from dataclasses import dataclass
from itertools import chain, islice

from study.experiment.config import Study
from study.experiment.designs.cells import Cell
from study.experiment.designs.groups import Span
from study.experiment.units import groups, sizes_of, trials_of
from study.runs.jobs import takes_long
from study.runs.speed_probe import Kind, measure
from study.runs.storage.atomic_write import RunError
from study.text.numbers import DAY, duration, size

_ROW_BYTES = 51.0
"""Typical measured size of a row of a compressed error table, whose doubles hardly compress."""
_POINT_BYTES = 25.0
_ROW_SECONDS = 1e-6
"""Typical time to write a row and to summarise it: five seconds for five million."""
_START_SECONDS = 2.0
"""Typical time in which worker processes start."""
_MOST_COUNTED = 300_000
"""Number of cells that are counted one by one, in some seconds."""
_MOST_CELLS = 5000
"""Number of cells from which the calibration takes its conditions."""
_LONG = 7.0 * DAY
"""Seconds above which a plan comes with a warning."""


@dataclass(frozen=True)
class Plan:
    """The size of a study.

    Attributes:
        cells: conditions; in a random design, one per trial.
        units: pieces of work.
        trials: data sets, over all cells.
        draws: samples drawn from the generator.
        samples: samples fitted, per estimator: the draws, times the cells that share them.
        fits: data sets times estimators.
        bytes: predicted size of the tables.
        seconds: predicted time on so many workers, with compiled code ready.
    """

    cells: int
    units: int
    trials: int
    draws: int
    samples: int
    fits: int
    bytes: float
    seconds: float

    def lines(self) -> list[tuple[str, str]]:
        """Labels and values for the terminal."""
        return [
            ("cells", f"{self.cells:,}"),
            ("trials", f"{self.trials:,}"),
            ("draws", f"{self.draws:,} samples"),
            ("samples", f"{self.samples:,} for each estimator"),
            ("fits", f"{self.fits:,}"),
            ("storage", size(self.bytes)),
            ("time", f"{duration(self.seconds)} predicted"),
        ]


def plan(study: Study, jobs: int) -> Plan:
    """Count a study's work and predict its time, without running it.

    Args:
        study: the config.
        jobs: number of workers.

    Raises:
        RunError: if a grid has too many cells to be counted.
    """
    if study.cells() > _MOST_COUNTED:
        return _extrapolated(study, jobs)
    portions: Counter[frozenset[tuple[Kind, int]]] = Counter()
    for group in groups(study):
        for span, units in sizes_of(study, group):
            portions[frozenset(_portion(span).items())] += units
    work: Counter[Kind] = Counter()
    for portion, units in portions.items():
        work.update({kind: units * trials for kind, trials in portion})
    trials = sum(count * kind.cells for kind, count in work.items())
    samples = sum(count * kind.cells * kind.samples for kind, count in work.items())
    n_units = portions.total()
    processes = jobs > 1 and takes_long(study)  # they do not wait for one interpreter, but take a while to start
    pace = measure(study, _some_cells(study), 1 if processes else jobs)
    longest = max(pace.of(dict(portion)) for portion in portions)
    fits = trials * len(study.estimators)
    rows = study.cells() * len(study.estimators) if study.keep == "summary" else fits
    kept = min(study.keep_points, study.design.trials) * samples / study.design.trials
    seconds = pace.of(work)
    seconds += pace.summary * study.cells() if study.keep == "summary" else 0.0
    return Plan(
        cells=study.cells(),
        units=n_units,
        trials=trials,
        draws=sum(count * kind.samples for kind, count in work.items()),
        samples=samples,
        fits=fits,
        bytes=_ROW_BYTES * rows + _POINT_BYTES * kept,
        seconds=max(seconds / min(jobs, n_units), longest) + _ROW_SECONDS * rows + _START_SECONDS * processes,
    )


def warning(study: Study, least: Plan, jobs: int) -> str | None:
    """Warning for a study that would take more than a week; None for another.

    Args:
        study: the config.
        least: the plan of the least work that it can take.
        jobs: number of workers.
    """
    if least.seconds <= _LONG:
        return None
    words = f"would take {duration(least.seconds)} with --jobs {jobs}, which is more than a week"
    remedy = "give fewer trials, samples or cells, or more workers (--jobs, or a cluster with --backend dask)"
    return f"{study.run_name()}: {words}; {remedy}"


def extremes(study: Study) -> dict[str, Study]:
    """Studies of the least and the most work that a config can take, by title; itself alone if its work is fixed."""
    if study.precision is None:
        return {"": study}
    first = min(study.precision.first, study.design.trials)
    least = study.model_copy(update={"design": study.design.model_copy(update={"trials": first})})
    return {f"up to the first checkpoint, {first:,} trials": least, "at most, with every cell at the cap": study}


def _extrapolated(study: Study, jobs: int) -> Plan:
    """Plan a random design by its first trials, which are like the others; RunError for a grid."""
    if not study.design.one_trial_a_cell:
        words = f"{study.cells():,} cells are too many to plan; at most {_MOST_COUNTED:,} are counted"
        hint = "plan it with fewer values of a condition: size and time grow with their number"
        raise RunError(f"{study.run_name()}: {words}; {hint}")
    few = _MOST_COUNTED // 10
    design = study.design.model_copy(update={"trials": few})
    found, times = plan(study.model_copy(update={"design": design}), jobs), study.design.trials / few
    counts = {name: round(getattr(found, name) * times) for name in ("cells", "units", "trials", "draws", "samples")}
    return Plan(**counts, fits=round(found.fits * times), bytes=found.bytes * times, seconds=found.seconds * times)


def _portion(span: Span) -> Counter[Kind]:
    """Numbers of trials of a unit by their kind."""
    group, found = span.group, Counter[Kind]()
    for samples, trials in group.sizes(span.first, span.last):
        found[Kind(samples, group.levels, group.width)] += trials
    return found


def _some_cells(study: Study) -> list[Cell]:
    """Some thousands of the study's cells, evenly spread."""
    places = (group.places(0, trials_of(study, group)) for group in groups(study))
    cells = (cell for cell, _, _ in chain.from_iterable(places))
    return list(islice(cells, 0, None, max(1, study.cells() // _MOST_CELLS)))

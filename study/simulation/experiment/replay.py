"""One trial of a study, drawn again from its name, with the truth and every estimator's fit.

The points are the same to the last bit on whatever machine its run was computed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
import pandas as pd

from study.arrays import Floats
from study.fits import Fit, Samples
from study.fits.loops.jit import always_compiled
from study.fits.points.samples import Status, blank
from study.fits.registry import as_fit
from study.simulation.experiment.compute import Draws, attempt, draw
from study.simulation.experiment.conditions import CONDITIONS, bound_law
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch, Cell, Group
from study.text import columns, nearest

_MOST_COMPARED = 20_000


class ReplayError(Exception):
    """A trial that a study does not have; the message says which ones it has."""


@dataclass(frozen=True)
class Trial:
    """One data set of a study, with the truth. Its points are drawn when they are asked for, always the same ones.

    Attributes:
        study: the config.
        group: the cells that share its draw.
        cell: its condition, one of them.
        trial: its number.
    """

    study: Study
    group: Group
    cell: Cell
    trial: int

    @cached_property
    @always_compiled()
    def level(self) -> Samples:
        """The points (1, d, n) and the noise in units of the cell's scale, as the estimators take them."""
        return self._draws.place(self.cell.level)

    @cached_property
    def samples(self) -> Samples:
        """The points (1, d, n) and the noise."""
        return Samples(self.cell.scale * self.level.x, self._draws.law.given(self.cell.stated_noise))

    @cached_property
    @always_compiled()
    def unit_bound(self) -> Floats:
        """Cramér-Rao bound of (c, r) at σ = 1, for the realised directions (d+1, d+1)."""
        bound: Floats = self._draws.unit_bound()[0]
        return bound

    @cached_property
    def _draws(self) -> Draws:
        return draw(self.study, Batch(self.group, self.trial, self.trial + 1))


def all_trials(study: Study, below: int | None = None) -> Iterator[Trial]:
    """The trials of a study, cell by cell in the order of its tables.

    Args:
        study: the config.
        below: only trials with a number below this one are listed, if it is given.
    """
    for unit in chain.from_iterable(study.units_of(group, below) for group in study.groups()):
        for batch in unit.parts(0):
            last = batch.last if below is None else min(below, batch.last)
            for cell in batch.cells:
                yield from (Trial(study, batch.group, cell, trial) for trial in range(batch.first, last))


def locate(study: Study, cell: str) -> tuple[Cell, list[Batch]]:
    """Find a cell of a study by its name.

    Args:
        study: the config.
        cell: the cell's name, or enough of its beginning to tell it from all others.

    Returns:
        The cell, and the units of its trials: in a random design, one for each trial.

    Raises:
        ReplayError: if there is no such cell, or more than one.
    """
    matches: dict[str, tuple[Cell, list[Batch]]] = {}
    names: list[str] = []
    for group in study.groups():
        for known, first, last in group.places(0, study.trials_of(group)):
            names += [known.name] * (len(names) < _MOST_COMPARED)
            if known.name.startswith(cell):
                matches.setdefault(known.name, (known, []))[1].append(Batch(group, first, last))
    if not matches:
        close = nearest(cell, names)
        hint = "the" if close is None else f"did you mean {close}? The"
        raise ReplayError(
            f"cell {cell!r}: no such cell in {study.run_name()}; {hint} error table's first column has them"
        )
    if len(matches) > 1:
        raise ReplayError(f"cell {cell!r}: not one cell but {len(matches)}: {', '.join(sorted(matches)[:5])} …")
    return next(iter(matches.values()))


def parse_name(cell: str, trial: int | None) -> tuple[str, int]:
    """Read a cell's name and a trial's number, which a user gives one by one or as ``CELL/TRIAL``.

    Raises:
        ReplayError: if the two are given in neither way.
    """
    name, _, number = cell.partition("/")
    if trial is None and number.isascii() and number.isdigit():
        return name, int(number)
    if trial is None or number:
        raise ReplayError(f"trial {cell!r}: give a cell and the number of a trial, or both as CELL/TRIAL")
    return cell, trial


def find(study: Study, cell: str, trial: int) -> Trial:
    """Find a trial of a study.

    Args:
        study: the config.
        cell: the cell's name, or enough of its beginning to tell it from all others.
        trial: number of the trial.

    Raises:
        ReplayError: if there is no such cell, more than one, or no such trial in it.
    """
    place, where = locate(study, cell)
    for unit in where:
        if unit.first <= trial < unit.last:
            return Trial(study, next(Batch(unit.group, trial, trial + 1).parts(0)).group, place, trial)
    first, last = where[0].first, where[-1].last - 1
    whole = 1 < sum(unit.last - unit.first for unit in where) == last - first + 1
    numbers = f"{first} to {last}" if whole else ", ".join(str(i) for s in where for i in range(s.first, s.last))
    raise ReplayError(f"trial {trial}: cell {place.name} has trial {numbers}")


def points(trial: Trial) -> pd.DataFrame:
    """The points, a row per sample: columns x_1 … x_d."""
    return pd.DataFrame({f"x_{i + 1}": row for i, row in enumerate(trial.samples.x[0])})


def truth(trial: Trial) -> pd.DataFrame:
    """The true sphere and σ, one row: columns center_1 … center_d, radius, noise."""
    cell = trial.cell
    centers = {f"center_{i + 1}": [value] for i, value in enumerate(cell.center)}
    return pd.DataFrame(centers | {"radius": [cell.radius], "noise": [cell.noise]})


@always_compiled()
def fits(study: Study, trial: Trial) -> dict[str, Fit]:
    """The true sphere under the name "truth", and every estimator's fit, each of shape ()."""
    cell = trial.cell
    truth = blank(1, study.dimension)
    truth.center[:], truth.radius[:] = cell.center, cell.radius
    results = {"truth": Fit(truth.reshape(), trial.samples, "truth")}
    for name in study.estimators:
        results[name] = as_fit(attempt(name, trial.samples)[0].reshape(), trial.samples, name)
    return results


@always_compiled()
def fit_table(study: Study, trial: Trial) -> pd.DataFrame:
    """Every estimator's fit as a row, with the same numbers as in the run's error table.

    Returns:
        Columns: estimator, error (distance of the centre from the truth), over_bound (in units of √tr CRLB of the
        realised directions), axis (error along the cap's axis), radius_error, noise (σ̂, or the σ that was given),
        condition (ρ), iterations, status in words.
    """
    d, scale, level = study.dimension, trial.cell.scale, trial.cell.level
    bound = trial.cell.noise * float(np.sqrt(np.trace(trial.unit_bound[:d, :d])))
    rows = []
    for name in study.estimators:
        fit, raised = attempt(name, trial.level)
        vector = (fit.center[0] - np.array(level.center)) * scale
        error = float(np.linalg.norm(vector))
        noise = np.sqrt(fit.noise_variance[0]) * scale
        numbers = error, error / bound, vector[0], (fit.radius[0] - level.radius) * scale, noise, fit.condition[0]
        status = raised.get(0, Status(int(fit.status[0])).text)
        rows.append((name, *map(float, numbers), int(fit.iterations[0]), status))
    names = ["error", "over_bound", "axis", "radius_error", "noise", "condition", "iterations"]
    return pd.DataFrame(rows, columns=["estimator", *names, "status"])


def printed(study: Study, trial: Trial) -> Iterator[str]:
    """The trial for a terminal: its conditions, the bound, and a line per estimator."""
    cell, d = trial.cell, study.dimension
    errors = cell.noise * np.sqrt(np.diag(trial.unit_bound))
    center = ", ".join(f"{value:.9g}" for value in cell.center)
    yield f"{study.run_name()}, cell {cell.name}, trial {trial.trial}"
    further = "".join(f", {CONDITIONS[name].label(cell.values)}" for name, _ in cell.further)
    yield f"  N = {cell.samples:,}, σ = {cell.noise:g} ({cell.noise / cell.radius:.3g} r), φ = {cell.angle:g}°{further}"
    yield f"  true centre ({center}), radius {cell.radius:g}"
    law = bound_law(dict(cell.further))
    yield (
        f"  {law or 'bound'}: {np.sqrt(np.sum(errors[:d] ** 2)):.3g} for the centre ({errors[0]:.3g} along the axis), "
        f"{errors[d]:.3g} for the radius"
    )
    rows = []
    for row in fit_table(study, trial).to_dict("records"):
        numbers = [row[name] for name in ("error", "over_bound", "axis", "radius_error", "noise", "condition")]
        texts = [f"{value:.3g}" if np.isfinite(value) else "-" for value in numbers]
        rows.append([row["estimator"], *texts, str(row["iterations"] or "-"), row["status"]])
    titles = [
        "estimator",
        "error",
        "over bound",
        "along axis",
        "radius error",
        "noise",
        "ρ",
        "iterations",
        "own status",
    ]
    yield from columns(rows, titles)

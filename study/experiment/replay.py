"""One trial again, from its name: the same points to the last bit, wherever its run was made."""

from collections.abc import Iterator
from dataclasses import dataclass

from study.estimators import Samples
from study.experiment.config import Study
from study.experiment.design import Batch, Cell, units
from study.experiment.sampling import Floats, draw


class ReplayError(Exception):
    """There is no such trial; the message says what there is."""


@dataclass(frozen=True)
class Address:
    """Where a trial is drawn.

    Attributes:
        batch: the trials that share its streams.
        cell: its condition, one of the batch's.
        trial: its number.
    """

    batch: Batch
    cell: Cell
    trial: int


@dataclass(frozen=True)
class Trial:
    """One data set, with the truth.

    Attributes:
        cell: its condition.
        trial: its number.
        samples: the points (1, d, n) and the noise.
        level: the same in units of the cell's scale, as the estimators saw them.
        unit_bound: Cramér-Rao bound of (c, r) at σ = 1, for the realised directions (d+1, d+1).
    """

    cell: Cell
    trial: int
    samples: Samples
    level: Samples
    unit_bound: Floats


def addresses(study: Study) -> Iterator[Address]:
    """Every trial of a study, in the order in which its cells come and its trials count up."""
    for unit in units(study):
        for batch in unit.batches:
            for cell in batch.cells:
                for trial in range(batch.first, batch.first + batch.trials):
                    yield Address(batch, cell, trial)


def find(study: Study, cell: str, trial: int) -> Address:
    """Where a trial of a cell is drawn.

    Args:
        study: the config.
        cell: the cell's name, or its beginning, as far as no other begins so.
        trial: number of the trial.

    Raises:
        ReplayError: if there is no such cell, more than one, or no such trial in it.
    """
    trials: dict[str, set[int]] = {}
    found: Address | None = None
    for unit in units(study):
        for batch in unit.batches:
            for each in (c for c in batch.cells if c.name.startswith(cell)):
                trials.setdefault(each.name, set()).update(range(batch.first, batch.first + batch.trials))
                if batch.first <= trial < batch.first + batch.trials:
                    found = Address(batch, each, trial)
    if not trials:
        raise ReplayError(f"cell {cell!r}: no such cell in {study.run_name()}; the error table's first column has them")
    if len(trials) > 1:
        raise ReplayError(f"cell {cell!r}: not one cell but {len(trials)}: {', '.join(sorted(trials)[:5])} …")
    if found is None:
        ((name, numbers),) = trials.items()
        first, last = min(numbers), max(numbers)
        span = f"{first} to {last}" if 1 < len(numbers) == last - first + 1 else ", ".join(map(str, sorted(numbers)))
        raise ReplayError(f"trial {trial}: cell {name} has trial {span}")
    return found


def replay(study: Study, address: Address) -> Trial:
    """Draw a trial again."""
    batch, cell = address.batch, address.cell
    draws = draw(study, [batch]).only(address.trial - batch.first)
    level = draws.place(cell.level)
    samples = Samples(cell.scale * level.x, draws.told(cell.noise))
    return Trial(cell, address.trial, samples, level, draws.unit_bound()[0])

"""A random design: each trial draws its own conditions from declared laws, as in the paper's §4.1."""

import hashlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import create_model

from study.experiment.conditions import CENTER, CONDITIONS, SAMPLES, Condition, Value
from study.experiment.designs.cells import Batch, Cell, rounded
from study.experiment.designs.design import Design
from study.experiment.designs.fields import laws
from study.experiment.designs.groups import Group
from study.experiment.distributions import Distribution
from study.experiment.streams import Name, stream

_BLOCK = 1024
"""Number of trials whose values are drawn from one stream."""
_TRIALS_PER_UNIT = 25


class Random(Design):
    """A random design, of which `RandomDesign` adds the laws."""

    kind: Literal["random"]
    """Every trial draws its own conditions from the laws."""
    one_trial_a_cell = True

    def cells(self) -> int:
        """Number of trials."""
        return self.trials

    def trials_of(self, samples: int) -> int:
        """Number of trials of the whole design, whatever number of samples they draw."""
        return self.trials

    def least_samples(self) -> int:
        """The smallest number of samples that can be drawn."""
        law: Distribution = self.given()[SAMPLES.name]
        return round(min(law.possible()))

    def values(self, condition: Condition) -> tuple[Value, ...] | None:
        """The values that a condition takes; None where a law leaves them open."""
        law: Distribution | None = self.given().get(condition.name)
        if law is not None:
            return None if law.continuous else law.possible()
        return None if condition.default is None else (condition.default,)

    def independent(self) -> bool:
        """True: every trial has draws of its own."""
        return True

    def same_draws(self, other: Design) -> bool:
        """True if the other is a random design of the same laws."""
        return self.model_dump(exclude={"trials"}) == other.model_dump(exclude={"trials"})

    def groups(self, seed: int, dimension: int) -> Iterator["RandomGroup"]:
        """One group of all trials."""
        yield RandomGroup(seed, dimension, self)


Laws: Any = create_model("Laws", __base__=Design, __module__=__name__, **laws())
RandomDesign: type[Random] = create_model("RandomDesign", __base__=(Random, Laws), __module__=__name__)
"""A random design with all of its entries: kind and trials, then the laws."""


@dataclass(frozen=True)
class RandomGroup:
    """The trials of a random design, each of which is a cell of its own.

    Attributes:
        seed: the study's.
        dimension: the study's.
        design: the laws; the number of trials has no effect.
    """

    seed: int
    dimension: int
    design: Random

    stream: ClassVar[Name] = ("trial",)
    cells: ClassVar[tuple[Cell, ...]] = ()
    samples = 0
    width = size = levels = 1

    @cached_property
    def digest(self) -> bytes:
        """Digest of the laws, without the study's seed."""
        content = (_BLOCK, self.design.model_dump_json(exclude={"trials"}))
        return hashlib.blake2b(repr(content).encode(), digest_size=16).digest()

    def trials_per_unit(self, levels: int) -> int:
        """A few: their numbers of samples are not known before they are drawn."""
        return _TRIALS_PER_UNIT

    def batches(self, first: int, last: int) -> Iterator[Batch]:
        """A batch for each of the trials from first to before last."""
        for i in range(first, last):
            yield Batch((*self.stream, i), i, 1, (self.cell(i),))

    def places(self, first: int, last: int) -> Iterator[tuple[Cell, int, int]]:
        """The cell of each trial, with that trial alone."""
        return ((self.cell(i), i, i + 1) for i in range(first, last))

    def sizes(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """Number of samples of each of the trials from first to before last."""
        return ((int(self._drawn(SAMPLES, i)), 1) for i in range(first, last))

    def load(self, first: int, last: int) -> tuple[int, int]:
        """Numbers of samples and of batches that are drawn for the trials from first to before last."""
        return sum(samples for samples, _ in self.sizes(first, last)), last - first

    def only(self, cells: Collection[Cell]) -> "RandomGroup":
        """The group itself: its cells are drawn."""
        return self

    def shared(self, other: Group) -> tuple["RandomGroup", None]:
        """The group itself and nothing besides: a trial draws the same cell wherever the laws are the same."""
        return self, None

    def cell(self, trial: int) -> Cell:
        """Draw the cell of a trial. Every condition is drawn from a stream of its own."""
        values: dict[str, Value] = {name: self._drawn(CONDITIONS[name], trial) for name in self.design.given()}
        heading = stream(self.seed, "design", "heading", trial).standard_normal(self.dimension)
        center = float(values[CENTER.name]) * heading / np.linalg.norm(heading)
        return Cell.of(values, tuple(rounded(v) for v in center))

    def _drawn(self, condition: Condition, trial: int) -> float:
        """Draw the value of a condition for a trial; rounded, if it is a whole number."""
        law: Distribution = getattr(self.design, condition.name)
        block, index = divmod(trial, _BLOCK)
        number = law.at(_uniforms(self.seed, condition.name, block)[index])
        number = rounded(number) if law.continuous else number
        return round(number) if condition.kind is int else number


@lru_cache(maxsize=64)
def _uniforms(seed: int, name: str, block: int) -> tuple[float, ...]:
    """Draw uniform numbers of a condition for a block of trials."""
    return tuple(stream(seed, "design", name, block).random(_BLOCK).tolist())

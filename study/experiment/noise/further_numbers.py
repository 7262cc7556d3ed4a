"""Random numbers beside the directions and normals of a batch, each kind from streams of its own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from study.experiment.streams import Name, stream
from study.sphere.types import Floats


class Source(NamedTuple):
    """Trials drawn together from one named stream; `skip` of them, before the first, are left out."""

    name: Name
    skip: int
    trials: int


@dataclass(frozen=True)
class FurtherNumbers:
    """Further random numbers of a batch of trials. Drawing them changes no other numbers.

    Attributes:
        seed: the study's.
        sources: the draws of the batch, in the order of its trials.
        trials: the trials that are wanted, of those of all sources; all, if None.
    """

    seed: int
    sources: Sequence[Source]
    trials: slice | None = None

    def draw(self, kind: Name, numbers: Callable[[np.random.Generator, int], Floats]) -> Floats:
        """Draw numbers of one kind for each trial (b, …): always the same ones.

        Args:
            kind: last part of the names of the streams, which distinguishes these numbers from others.
            numbers: gives numbers of so many trials (trials, …) from a generator.
        """
        parts = [numbers(stream(self.seed, *s.name, *kind), s.skip + s.trials)[s.skip :] for s in self.sources]
        whole = np.concatenate(parts)
        return whole if self.trials is None else whole[self.trials]

    def only(self, trials: slice) -> "FurtherNumbers":
        """The numbers of some trials alone."""
        return FurtherNumbers(self.seed, self.sources, trials)

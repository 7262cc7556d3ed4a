"""What both designs have in common: what the rest of the program may ask of a design without knowing which it is."""

from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from study.experiment.conditions import CONDITIONS, SILENT, Condition, Value
from study.experiment.designs.fields import MAX_CELLS
from study.experiment.designs.groups import Group
from study.experiment.distributions import Frozen


class Design(Frozen):
    """Conditions of a study, and the number of trials."""

    kind: str
    trials: Annotated[int, Field(ge=1, le=MAX_CELLS)]
    one_trial_a_cell: ClassVar[bool]
    """Every trial is a cell of its own: measures of performance are of many cells."""

    @abstractmethod
    def cells(self) -> int:
        """Number of cells."""

    @abstractmethod
    def trials_of(self, samples: int) -> int:
        """Number of trials of the cells with so many samples."""

    @abstractmethod
    def least_samples(self) -> int:
        """The smallest number of samples that a cell can have."""

    @abstractmethod
    def values(self, condition: Condition) -> tuple[Value, ...] | None:
        """The values that a condition takes; None where a law leaves them open."""

    @abstractmethod
    def independent(self) -> bool:
        """Whether no two cells share their directions and noise."""

    @abstractmethod
    def same_draws(self, other: "Design") -> bool:
        """Whether the same trial of the same cell is the same data set in both designs, if their studies are alike."""

    @abstractmethod
    def groups(self, seed: int, dimension: int) -> Iterator[Group]:
        """The groups of cells that share their draws, in the order of the tables."""

    def given(self) -> dict[str, Any]:
        """The entries of conditions by name, axes or laws, without alternatives not chosen and silent defaults."""
        entries = {name: getattr(self, name, None) for name in CONDITIONS}
        silent = {c.name: type(self).model_fields[c.name].default for c in SILENT if c.name in type(self).model_fields}
        return {k: v for k, v in entries.items() if v is not None and not (k in silent and v == silent[k])}

    def _unwritten(self) -> set[str]:
        """Names of the entries that leave no trace, because they do nothing."""
        return {condition.name for condition in SILENT} - set(self.given())

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The entries that determine something: configs from before the others existed are what they were."""
        left_out = self._unwritten()
        return {key: value for key, value in handler(self).items() if key not in left_out}

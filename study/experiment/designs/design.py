"""The interface of a design, which a grid and a random design have in common."""

from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from study.experiment.conditions import CONDITIONS, SILENT, Condition, Value
from study.experiment.designs.fields import MAX_CELLS
from study.experiment.designs.groups import Group
from study.experiment.toml_model import Frozen


class Design(Frozen):
    """Conditions of a study, and the number of trials."""

    kind: str
    trials: Annotated[int, Field(ge=1, le=MAX_CELLS)]
    """Number of data sets: in each cell of a grid, or in all cells of a random design together."""
    one_trial_a_cell: ClassVar[bool]
    """Every trial is a cell of its own, so that measures of performance combine many cells."""

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
        """True if no two cells share their directions and noise."""

    @abstractmethod
    def same_draws(self, other: "Design") -> bool:
        """True if a trial of a cell that both designs have is the same data set, where all else is equal."""

    @abstractmethod
    def groups(self, seed: int, dimension: int) -> Iterator[Group]:
        """The groups of cells that share draws, in the order of the tables."""

    def given(self) -> dict[str, Any]:
        """The axes, or the laws, by the condition's name; silent conditions only if they are not at their default."""
        found = {}
        for name, condition in CONDITIONS.items():
            entry = getattr(self, name, None)
            if entry is not None and not (condition.silent and entry == type(self).model_fields[name].default):
                found[name] = entry
        return found

    def _unwritten(self) -> set[str]:
        """Names of the entries that have no effect."""
        return {condition.name for condition in SILENT} - set(self.given())

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out entries without effect, so that a config keeps its digest when new entries are invented."""
        left_out = self._unwritten()
        return {key: value for key, value in handler(self).items() if key not in left_out}

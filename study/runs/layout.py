"""The units of a run, and the pieces of each that are computed by themselves."""

from collections.abc import Iterator

from study.experiment.config import Study
from study.experiment.designs.groups import Span
from study.experiment.units import spans
from study.runs.storage.parts import Parts


class Layout:
    """A run whose units are all known, and computed whole.

    Args:
        study: the config.
    """

    def __init__(self, study: Study) -> None:
        self.study = study

    def units(self) -> Iterator[Span]:
        """The units, in the order of the tables."""
        return spans(self.study)

    def cut(self, span: Span) -> Iterator[Span]:
        """Cut a unit into pieces."""
        yield span

    def pieces(self) -> Iterator[Span]:
        """All pieces of all units."""
        return (piece for span in self.units() for piece in self.cut(span))

    def pending(self) -> Iterator[Span]:
        """The pieces that may have to be computed."""
        return self.pieces()

    def advance(self, parts: Parts) -> bool:
        """Find further units, once the parts hold all that was pending; false if there are none."""
        return False

    def restart(self) -> None:
        """Forget what was concluded from the parts, because some of them are lost."""

    def ahead(self) -> float:
        """Share of the pending pieces in all that may still have to be computed."""
        return 1.0

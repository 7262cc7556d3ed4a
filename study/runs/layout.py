"""What a run consists of: its units, and the pieces of each that were, or are to be, computed by themselves."""

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

    def __call__(self, span: Span) -> Iterator[Span]:
        """The pieces of a unit."""
        yield span

    def pieces(self) -> Iterator[Span]:
        """All pieces of all units."""
        return (piece for span in self.units() for piece in self(span))

    def pending(self) -> Iterator[Span]:
        """The pieces that may have to be computed."""
        return self.pieces()

    def advance(self, parts: Parts) -> bool:
        """Whether there are more units, now that parts have all that were pending."""
        return False

    def restart(self) -> None:
        """Forget what was learnt from parts, some of which are lost."""

    def ahead(self) -> float:
        """Share of what is pending in all that may still come."""
        return 1.0

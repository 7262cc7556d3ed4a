"""Pictures of a run's figures, kept beside its tables: `study figures` and the page draw each of them once."""

from collections.abc import Collection, Mapping

from study.runs import kept
from study.runs.storage.run_folder import Run

KINDS = ("png", "svg")
"""Formats that a figure is written in."""


class KeptPictures:
    """The pictures of a run that were drawn from the same tables by the same program.

    Args:
        run: a finished run.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._key = kept.key([run], "pictures")

    def find(self, name: str, figure: object, kinds: Collection[str] = KINDS) -> dict[str, bytes] | None:
        """Find a figure's pictures.

        Args:
            name: the figure's.
            figure: its module; pictures of a module outside this package are not kept, as the key lacks its source.
            kinds: the formats that are needed.

        Returns:
            The pictures by format; None if one of them was not kept.
        """
        if not _shipped(figure):
            return None
        found = {kind: kept.find(self._run, f"{name}.{kind}", self._key) for kind in kinds}
        known = {kind: picture for kind, picture in found.items() if picture is not None}
        return known if len(known) == len(found) else None

    def keep(self, name: str, figure: object, pictures: Mapping[str, bytes]) -> None:
        """Keep a figure's pictures, given by format; for the other arguments see `find`."""
        if _shipped(figure):
            for kind, picture in pictures.items():
                kept.keep(self._run, f"{name}.{kind}", self._key, picture)


def _shipped(figure: object) -> bool:
    """True if a figure is a module of this package."""
    return str(getattr(figure, "__name__", "")).startswith("study.")

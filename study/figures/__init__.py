"""Registry of the figures, each a module of ``prepare(tables) -> frame`` and ``draw(frame) -> Figure``.

To add one, write such a module and a line in `FIGURES`. All computing is in ``prepare``; ``draw`` reads no files.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from matplotlib.figure import Figure

from study.figures import style
from study.figures.failure import FAILED, failure, gathered
from study.figures.inputs import NotApplicable, Tables
from study.figures.kept_pictures import KeptPictures
from study.runs.storage.atomic_write import RunError, explained
from study.runs.storage.run_folder import Run


class FigureModule(Protocol):
    """Protocol of a figure's module."""

    def prepare(self, tables: Tables) -> Any:
        """Compute the frame; raise `NotApplicable` if the run lacks what it needs."""

    def draw(self, frame: Any) -> Figure:
        """Draw the frame."""


class FigureModules(Mapping[str, FigureModule]):
    """Modules of figures by the figures' names, each loaded when it is first asked for.

    Args:
        rooms: folders of the modules, relative to this one, by the figures' names.
    """

    def __init__(self, rooms: Mapping[str, str]) -> None:
        self._rooms = rooms

    def __getitem__(self, name: str) -> FigureModule:
        """The module of a figure."""
        return import_module(f"{__name__}{self._rooms[name]}.{name}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._rooms)

    def __len__(self) -> int:
        return len(self._rooms)

    def __contains__(self, name: object) -> bool:
        """True if there is such a figure; nothing is loaded."""
        return name in self._rooms


FIGURES: Mapping[str, FigureModule] = FigureModules(
    {
        "fig2_error": ".paper",
        "fig3_gdke_ellipse": ".paper",
        "fig4_ugdk_ellipse": ".paper",
        "fig5_methods": ".paper",
        "fig6_mgdk": ".paper",
        "fig7_power_law": ".paper",
        "fig_efficiency": "",
        "fig_regret": "",
        "fig_map": "",
        "fig_robustness": "",
        "fig_posterior": "",
        "fig_calibration": "",
    }
)


class Drawn(NamedTuple):
    """The result of drawing figures.

    Attributes:
        paths: the files written.
        undrawn: for each figure that was not drawn the reason.
    """

    paths: list[Path]
    undrawn: dict[str, str]


__all__ = ["FAILED", "FIGURES", "Drawn", "FigureModule", "KeptPictures", "NotApplicable", "Tables", "draw_all"]


def draw_all(runs: Sequence[Run], folder: Path | None = None, names: Collection[str] = ()) -> Drawn:
    """Draw figures, each from the first run that has the tables for it; pictures kept of the same tables are copied.

    Args:
        runs: finished runs.
        folder: where the pictures go, as PNG and SVG; made if it is not there. The run's own, if None.
        names: figures to draw; all, if none is named.

    Returns:
        The paths written, and for each figure that was not drawn the reason. A figure that fails does not cost the
        others; its reason starts with `FAILED`, and says where in the code it failed.

    Raises:
        RunError: if a run did not finish, or the folder is a file or cannot be made.
    """
    sources = [(run, Tables.of(run), KeptPictures(run)) for run in runs]
    for place in {folder} if folder is not None else {_own(run) for run in runs}:
        with explained(place, of_run=False):
            if place.exists() and not place.is_dir():
                raise RunError(f"{place}: is a file, not a folder; choose another with --out")
            place.mkdir(parents=True, exist_ok=True)
    found = Drawn([], {})
    for name in names or FIGURES:
        lacking: dict[str, str] = {}
        for run, tables, pictures in sources:
            try:
                drawn = _draw(name, tables, pictures, folder or _own(run))
            except NotApplicable as reason:
                lacking[tables.name] = str(reason)
                continue
            if isinstance(drawn, str):
                found.undrawn[name] = gathered({tables.name: drawn}, len(runs))
            else:
                found.paths.extend(drawn)
            break
        else:
            found.undrawn[name] = gathered(lacking, len(runs))
    return found


def _own(run: Run) -> Path:
    """A run's own folder of pictures."""
    return run.folder / "figures"


def _draw(name: str, tables: Tables, pictures: KeptPictures, folder: Path) -> list[Path] | str:
    """Write a figure's pictures, drawn unless they were kept; its failure in words if it fails."""
    figure = FIGURES[name]
    try:
        found = pictures.find(name, figure)
        if found is None:
            found = style.encoded(figure.draw(figure.prepare(tables)))
            pictures.keep(name, figure, found)
        return [style.save_bytes(folder / f"{name}.{kind}", data) for kind, data in found.items()]
    except NotApplicable:
        raise
    except Exception as error:  # a figure that fails must not cost the others
        return failure(error)

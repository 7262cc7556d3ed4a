"""Registry of the figures, and the pictures that runs can feed.

To add a figure, write a module as `study.simulation.figures.figure` describes it, and its name in `_MODULES`.
"""

from collections.abc import Collection, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from study import style
from study.files import RunError, explained
from study.simulation.figures import arc
from study.simulation.figures.figure import FAILED, FigureModule, NotApplicable, Tables, failure, gathered
from study.simulation.runs.run_folder import Run

_MODULES = ("fig6_mgdk", "fig7_power_law", "fig_efficiency", "fig_regret", "fig_map", "fig_robustness", "fig_misfit")
_POSTERIORS = ("fig_posterior", "fig_calibration")
FIGURES: dict[str, FigureModule] = {
    "fig2_error": import_module(f"{__name__}.fig2_error"),
    **arc.FIGURES,
    **{name: import_module(f"{__name__}.{name}") for name in (*_MODULES, *_POSTERIORS)},
}

__all__ = ["FAILED", "FIGURES", "Drawing", "FigureModule", "Gallery", "NotApplicable", "Tables", "draw_all", "gathered"]


class Drawing(NamedTuple):
    """A figure that was drawn from a run.

    Attributes:
        tables: the run's; their summary alone is in memory.
        frame: what ``prepare`` computed.
        pictures: the encoded pictures by format.
    """

    tables: Tables
    frame: Any
    pictures: dict[str, bytes]


class Gallery:
    """Figures of runs, each drawn from the first run that has the tables for it.

    A figure that fails does not cost the others; its reason starts with `FAILED`, and says where in the code it failed.

    Args:
        names: the figures; all, if none is named.
        kinds: formats of the pictures.

    Attributes:
        undrawn: for each figure that was not drawn so far the reasons, by the run's name.
    """

    def __init__(self, names: Collection[str] = (), kinds: Collection[str] = style.KINDS) -> None:
        self._kinds = kinds
        self._drawings: dict[str, Drawing | None] = dict.fromkeys(names or FIGURES)
        self._open = list(self._drawings)
        self.undrawn: dict[str, dict[str, str]] = {name: {} for name in self._open}

    @property
    def drawings(self) -> dict[str, Drawing]:
        """The figures that were drawn, by name, in the order in which they were named."""
        return {name: drawing for name, drawing in self._drawings.items() if drawing is not None}

    def add(self, tables: Tables) -> None:
        """Draw the figures that a run can feed and no earlier run could; of its tables the summary stays in memory."""
        for name in list(self._open):
            figure = FIGURES[name]
            try:
                frame = figure.prepare(tables)
                pictures = style.encoded(figure.draw(frame), self._kinds)
            except NotApplicable as reason:
                self.undrawn[name][tables.name] = str(reason)
                continue
            except Exception as error:  # a figure that fails must not cost the others
                self.undrawn[name] = {tables.name: failure(error)}
            else:
                self._drawings[name] = Drawing(tables, frame, pictures)
                del self.undrawn[name]
            self._open.remove(name)
        tables.release()

    def save(self, folder: Path | None = None) -> list[Path]:
        """Write the pictures into a folder, by default the run's own, and return their paths.

        Raises:
            RunError: if one cannot be written.
        """
        return [
            style.save_bytes((folder or own_folder(drawing.tables.run)) / f"{name}.{kind}", picture)
            for name, drawing in self.drawings.items()
            for kind, picture in drawing.pictures.items()
        ]

    def failures(self) -> dict[str, str]:
        """For each figure that failed its name and the place in the code."""
        reasons = {name: next(iter(reasons.values()), "") for name, reasons in self.undrawn.items()}
        return {name: reason for name, reason in reasons.items() if reason.startswith(FAILED)}


def own_folder(run: Run) -> Path:
    """A run's own folder of pictures."""
    return run.folder / "figures"


def make_folder(folder: Path) -> None:
    """Make a folder for pictures, before any is drawn.

    Raises:
        RunError: if it is a file or cannot be made.
    """
    with explained(folder, of_run=False):
        if folder.exists() and not folder.is_dir():
            raise RunError(f"{folder}: is a file, not a folder; choose another with --out")
        folder.mkdir(parents=True, exist_ok=True)


def draw_all(
    runs: Sequence[Run], folder: Path | None = None, names: Collection[str] = ()
) -> tuple[list[Path], dict[str, str]]:
    """Draw figures, each from the first run that has the tables for it.

    Args:
        runs: finished runs.
        folder: where the pictures go, as PNG and SVG; made if it is not there. The run's own, if None.
        names: figures to draw; all, if none is named.

    Returns:
        The paths written, and for each figure that was not drawn the reason; see `Gallery`.

    Raises:
        RunError: if a run did not finish, or the folder is a file or cannot be made.
    """
    of_runs = [Tables(run) for run in runs]
    for place in {folder or own_folder(run) for run in runs}:
        make_folder(place)
    gallery = Gallery(names)
    for tables in of_runs:
        gallery.add(tables)
    reasons = {name: gathered(reasons, len(runs)) for name, reasons in gallery.undrawn.items()}
    return gallery.save(folder), reasons

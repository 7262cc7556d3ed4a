"""Registry of the figures, each a module of ``prepare(tables) -> frame`` and ``draw(frame) -> Figure``.

To add one, write such a module and a line in `FIGURES`. All computing is in ``prepare``; ``draw`` reads no files.
"""

from collections.abc import Collection, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from matplotlib.figure import Figure

from study.figures import style
from study.figures.failure import FAILED, failure
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

__all__ = ["FAILED", "FIGURES", "FigureModule", "KeptPictures", "NotApplicable", "Tables", "draw_all"]


def draw_all(run: Run, folder: Path, names: Collection[str] = ()) -> tuple[list[Path], dict[str, str]]:
    """Draw every figure that a run has the tables for; one that was drawn from the same tables before is copied.

    Args:
        run: a finished run.
        folder: where the pictures go, as PNG and SVG; made if it is not there.
        names: figures to draw; all, if none is named.

    Returns:
        The paths written, and for each figure that was not drawn the reason. A figure that fails does not cost the
        others; its reason starts with `FAILED`, and says where in the code it failed.

    Raises:
        RunError: if the run did not finish, or the folder is a file or cannot be made.
    """
    tables, pictures = Tables.of(run), KeptPictures(run)
    with explained(folder, of_run=False):
        if folder.exists() and not folder.is_dir():
            raise RunError(f"{folder}: is a file, not a folder; choose another with --out")
        folder.mkdir(parents=True, exist_ok=True)
    drawn: list[Path] = []
    skipped: dict[str, str] = {}
    for name in names or FIGURES:
        figure = FIGURES[name]
        try:
            found = pictures.find(name, figure)
            if found is None:
                found = style.encoded(figure.draw(figure.prepare(tables)))
                pictures.keep(name, figure, found)
            drawn += [style.save_bytes(folder / f"{name}.{kind}", data) for kind, data in found.items()]
        except NotApplicable as reason:
            skipped[name] = str(reason)
        except Exception as error:  # a figure that fails must not cost the others
            skipped[name] = failure(error)
    return drawn, skipped

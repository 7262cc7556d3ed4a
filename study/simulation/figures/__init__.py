"""Registry of the figures.

To add a figure, write a module as `study.simulation.figures.figure` describes it, and its name in `_MODULES`.
"""

from collections.abc import Collection, Sequence
from importlib import import_module
from pathlib import Path

from study import style
from study.files import RunError, explained
from study.simulation.figures import fig3_5_ellipses
from study.simulation.figures.figure import FAILED, FigureModule, Gallery, NotApplicable, Tables, gathered, own_folder
from study.simulation.runs.run_folder import Run

_MODULES = (
    "fig6_mgdk",
    "fig7_power_law",
    "fig_efficiency",
    "fig_regret",
    "fig_map",
    "fig_robustness",
    "fig_misfit",
    "fig_coverage",
)
_POSTERIORS = ("fig_posterior", "fig_calibration")
_OF_ANY = ("fig_nested", "fig_bias", "fig_zip")
"""Figures of any grid, which are drawn where they are named."""
FIGURES: dict[str, FigureModule] = {
    "fig2_error": import_module(f"{__name__}.fig2_error"),
    **fig3_5_ellipses.FIGURES,
    **{name: import_module(f"{__name__}.{name}") for name in (*_MODULES, *_POSTERIORS, *_OF_ANY)},
}

__all__ = ["FAILED", "FIGURES", "FigureModule", "Gallery", "NotApplicable", "Tables", "draw_all", "gallery", "gathered"]


def gallery(names: Collection[str] = (), kinds: Collection[str] = style.KINDS) -> Gallery:
    """A gallery of figures by name, in some formats; if none is named, of all but those of any grid."""
    return Gallery({name: FIGURES[name] for name in names or FIGURES if names or name not in _OF_ANY}, kinds)


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
    runs: Sequence[Run],
    folder: Path | None = None,
    names: Collection[str] = (),
    kinds: Collection[str] = (),
) -> tuple[list[Path], dict[str, str]]:
    """Draw figures, each from the first run that has the tables for it.

    Args:
        runs: finished runs.
        folder: where the pictures go; made if it is not there. The run's own, if None.
        names: figures to draw; see `gallery`.
        kinds: formats of the pictures; PNG, SVG and PDF if none is given.

    Returns:
        The paths written, and for each figure that was not drawn the reason; see `Gallery`.

    Raises:
        RunError: if a run did not finish, or the folder is a file or cannot be made.
    """
    of_runs = [Tables(run) for run in runs]
    for place in {folder or own_folder(run) for run in runs}:
        make_folder(place)
    drawn = gallery(names, kinds or (*style.KINDS, "pdf"))
    for tables in of_runs:
        drawn.add(tables)
    reasons = {name: gathered(reasons, len(runs)) for name, reasons in drawn.undrawn.items()}
    return drawn.save(folder), reasons

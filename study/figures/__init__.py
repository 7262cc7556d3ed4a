"""Registry of the figures, each a module of ``prepare(tables) -> frame`` and ``draw(frame) -> Figure``.

To add one, write such a module and a line in `FIGURES`. All computing is in ``prepare``; ``draw`` reads no files.
"""

from collections.abc import Collection
from pathlib import Path
from typing import Any, Protocol

from matplotlib.figure import Figure

from study.figures import fig_calibration, fig_efficiency, fig_map, fig_posterior, fig_regret, fig_robustness, style
from study.figures.failure import FAILED, failure
from study.figures.inputs import NotApplicable, Tables
from study.figures.paper import (
    fig2_error,
    fig3_gdke_ellipse,
    fig4_ugdk_ellipse,
    fig5_methods,
    fig6_mgdk,
    fig7_power_law,
)
from study.runs.storage.atomic_write import RunError, explained
from study.runs.storage.run_folder import Run


class FigureModule(Protocol):
    """Protocol of a figure's module."""

    def prepare(self, tables: Tables) -> Any:
        """Compute the frame; raise `NotApplicable` if the run lacks what it needs."""

    def draw(self, frame: Any) -> Figure:
        """Draw the frame."""


FIGURES: dict[str, FigureModule] = {
    "fig2_error": fig2_error,
    "fig3_gdke_ellipse": fig3_gdke_ellipse,
    "fig4_ugdk_ellipse": fig4_ugdk_ellipse,
    "fig5_methods": fig5_methods,
    "fig6_mgdk": fig6_mgdk,
    "fig7_power_law": fig7_power_law,
    "fig_efficiency": fig_efficiency,
    "fig_regret": fig_regret,
    "fig_map": fig_map,
    "fig_robustness": fig_robustness,
    "fig_posterior": fig_posterior,
    "fig_calibration": fig_calibration,
}

__all__ = ["FAILED", "FIGURES", "FigureModule", "NotApplicable", "Tables", "draw_all"]


def draw_all(run: Run, folder: Path, names: Collection[str] = ()) -> tuple[list[Path], dict[str, str]]:
    """Draw every figure that a run has the tables for.

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
    tables = Tables.of(run)
    with explained(folder, of_run=False):
        if folder.exists() and not folder.is_dir():
            raise RunError(f"{folder}: is a file, not a folder; choose another with --out")
        folder.mkdir(parents=True, exist_ok=True)
    drawn: list[Path] = []
    skipped: dict[str, str] = {}
    for name in names or FIGURES:
        figure = FIGURES[name]
        try:
            drawn += style.save(figure.draw(figure.prepare(tables)), folder / name)
        except NotApplicable as reason:
            skipped[name] = str(reason)
        except Exception as error:  # a figure that fails must not cost the others
            skipped[name] = failure(error)
    return drawn, skipped

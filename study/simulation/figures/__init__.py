"""Registry of the figures.

To add a figure, write a module as `study.simulation.figures.figure` describes it, and its name in `_MODULES`.
"""

import contextlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from study import style
from study.files import RunError, explained
from study.simulation.figures import fig3_5_ellipses
from study.simulation.figures.figure import FAILED, FigureModule, NotApplicable, Tables, failure, gathered, own_folder
from study.simulation.runs.run_folder import Run
from study.simulation.runs.workers import DisagreementError, Processes

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


class Drawing(NamedTuple):
    """A figure that was drawn from a run.

    Attributes:
        place: number of the run.
        frame: what ``prepare`` computed.
        pictures: the encoded pictures by format.
    """

    place: int
    frame: Any
    pictures: dict[str, bytes]


def _drawn(
    figure: FigureModule, of_runs: Sequence[Tables], kinds: Collection[str]
) -> tuple[Drawing | None, dict[str, str]]:
    """A figure drawn from the first run that can feed it; else None, and the reasons by the runs' names."""
    reasons = dict[str, str]()
    for place, tables in enumerate(of_runs):
        try:
            frame = figure.prepare(tables)
            return Drawing(place, frame, style.encoded(figure.draw(frame), kinds)), {}
        except NotApplicable as reason:
            reasons[tables.name] = str(reason)
        except Exception as error:  # a figure that fails must not cost the others
            return None, {tables.name: failure(error)}
        finally:
            tables.release()
    return None, reasons


def _drawn_by_name(
    name: str, of_runs: Sequence[Tables], kinds: Collection[str]
) -> tuple[Drawing | None, dict[str, str]]:
    """A figure drawn in a worker process, which cannot be sent a module."""
    return _drawn(FIGURES[name], of_runs, kinds)


_SHARE = 10
"""Pictures that are worth a process, which takes two seconds to start: a third of them can be drawn, in 0.4 s each."""


class Gallery:
    """Figures of runs, each drawn from the first run that has the tables for it.

    A figure that fails does not cost the others; its reason starts with `FAILED`, and says where in the code it failed.

    Args:
        figures: the figures by name.
        kinds: formats of the pictures.
        jobs: number of processes that draw, this one among them; the others draw those of `FIGURES` alone.

    Attributes:
        figures: as given.
        drawings: the figures that were drawn, by name, in the order in which they were given.
        undrawn: for each other figure the reasons, by the run's name.
    """

    def __init__(
        self, figures: Mapping[str, FigureModule], kinds: Collection[str] = style.KINDS, jobs: int = 1
    ) -> None:
        self.figures, self._kinds, self._workers = figures, kinds, min(jobs, len(figures) * len(kinds) // _SHARE) - 1
        self._sent: dict[str, Future[Any]] = {}
        self.runs: Sequence[Tables] = ()
        self.drawings: dict[str, Drawing] = {}
        self.undrawn: dict[str, dict[str, str]] = {name: {} for name in figures}

    @contextlib.contextmanager
    def ahead(self, of_runs: Sequence[Tables]) -> Iterator[None]:
        """Let worker processes, if there are any, draw figures of runs while this one does other things; see `draw`."""
        if self._workers < 1:
            yield
            return
        backend = Processes(self._workers)
        try:
            for name in self.figures:
                self._sent[name] = backend.submit(_drawn_by_name, name, of_runs, self._kinds)
            yield
        except BaseException:
            backend.stop()
            raise

    def draw(self, of_runs: Sequence[Tables]) -> None:
        """Draw the figures; those that workers have begun are waited for.

        Args:
            of_runs: the runs' tables, of which the summaries stay in memory.
        """
        self.runs, results = of_runs, dict[str, Any]()
        for name, figure in reversed([*self.figures.items()]):  # workers take them from the beginning
            if name not in self._sent or self._sent[name].cancel():
                results[name] = _drawn(figure, of_runs, self._kinds)
        for name, figure in self.figures.items():
            try:
                drawing, reasons = results[name] if name in results else self._sent[name].result()
            except (BrokenExecutor, DisagreementError):  # the worker died, or would draw other bytes
                drawing, reasons = _drawn(figure, of_runs, self._kinds)
            if drawing is None:
                self.undrawn[name] = reasons
            else:
                self.drawings[name] = drawing
                del self.undrawn[name]

    def save(self, folder: Path | None = None) -> list[Path]:
        """Write the pictures into a folder, by default the run's own, and return their paths.

        Raises:
            RunError: if one cannot be written.
        """
        return [
            style.save_bytes((folder or own_folder(self.runs[drawing.place].run)) / f"{name}.{kind}", picture)
            for name, drawing in self.drawings.items()
            for kind, picture in drawing.pictures.items()
        ]

    def failures(self) -> dict[str, str]:
        """For each figure that failed its name and the place in the code."""
        reasons = {name: next(iter(reasons.values()), "") for name, reasons in self.undrawn.items()}
        return {name: reason for name, reason in reasons.items() if reason.startswith(FAILED)}


def gallery(names: Collection[str] = (), kinds: Collection[str] = style.KINDS, jobs: int = 1) -> Gallery:
    """A gallery of figures by name, in some formats; if none is named, of all but those of any grid."""
    return Gallery({name: FIGURES[name] for name in names or FIGURES if names or name not in _OF_ANY}, kinds, jobs)


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
    jobs: int = 1,
) -> tuple[list[Path], dict[str, str]]:
    """Draw figures, each from the first run that has the tables for it.

    Args:
        runs: finished runs.
        folder: where the pictures go; made if it is not there. The run's own, if None.
        names: figures to draw; see `gallery`.
        kinds: formats of the pictures; PNG, SVG and PDF if none is given.
        jobs: number of processes that draw.

    Returns:
        The paths written, and for each figure that was not drawn the reason; see `Gallery`.

    Raises:
        RunError: if a run did not finish, or the folder is a file or cannot be made.
    """
    of_runs = [Tables(run) for run in runs]
    for place in {folder or own_folder(run) for run in runs}:
        make_folder(place)
    drawn = gallery(names, kinds or (*style.KINDS, "pdf"), jobs)
    with drawn.ahead(of_runs):
        drawn.draw(of_runs)
    reasons = {name: gathered(reasons, len(runs)) for name, reasons in drawn.undrawn.items()}
    return drawn.save(folder), reasons

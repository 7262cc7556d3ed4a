"""Registry of the figures, each a module of ``prepare(tables) -> frame`` and ``draw(frame) -> Figure``.

To add one, write such a module and a line in `FIGURES`. All computing is in ``prepare``; ``draw`` reads no files.

Reasons why figures were not drawn: the place of a failure in this package, and what runs lack.

Input of a figure: a run's tables; `NotApplicable` says why a run cannot feed a figure.

Pictures of a run's figures, kept beside its tables: `study figures` and the page draw each of them once.
"""

import traceback
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import pandas as pd
from matplotlib.figure import Figure

from study import style
from study.files import RunError, explained
from study.simulation.analysis.summary import TableReader, stored_summary
from study.simulation.experiment.conditions import STORED, bound_law
from study.simulation.experiment.noise import NoiseLaw
from study.simulation.runs import kept
from study.simulation.runs.run_folder import Run

PACKAGE = Path(__file__).parents[2]
FAILED = "failed: "
"""Beginning of the reason why a figure that failed was not drawn; other reasons say that a run cannot feed it."""


def failure(error: Exception) -> str:
    """A figure's failure in one line.

    Args:
        error: the exception, in the function that caught it.

    Returns:
        "failed: KeyError('noise') at study/simulation/figures/fig_map.py, line 31, in prepare": the innermost line of
        this package, whatever library it called; the innermost line of all, if the figure is not of this package.
    """
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first caught it
    own = [frame for frame in frames if PACKAGE in Path(frame.filename).parents]
    words = FAILED + " ".join(repr(error).split())
    if not frames:
        return words
    place = (own or frames)[-1]
    path = Path(place.filename)
    name = path.relative_to(PACKAGE.parent).as_posix() if own else path.name
    return f"{words} at {name}, line {place.lineno}, in {place.name}"


def gathered(reasons: Mapping[str, str], runs: int) -> str:
    """Reasons by the runs' names in words, each once, with its runs unless it holds for all of so many."""
    found: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        found.setdefault(reason, []).append(name)
    each = (reason if len(names) == runs else f"{reason} ({', '.join(names)})" for reason, names in found.items())
    return "; ".join(each)


class NotApplicable(Exception):  # noqa: N818  not an error: most runs cannot feed some figure
    """A figure that cannot be drawn from a run; the message is the reason, in words for a user."""


@dataclass(frozen=True)
class Tables:
    """Tables of a run, each read when it is first asked for, and once.

    Attributes:
        name: the run's name, which is printed on every figure, and the law that the bound is of, if that is in doubt.
        dimension: d of the spheres.
        design: "grid" or "random".
        noise_law: the law of the noise of a sample.
        reader: the run.
        stored: names of its tables.
        used: columns of the error table that `errors` has; all if None.
        independent: True if no two cells share their directions and noise.
    """

    name: str
    dimension: int
    design: str
    noise_law: NoiseLaw
    reader: TableReader
    stored: frozenset[str]
    used: tuple[str, ...] | None = None
    independent: bool = True

    @classmethod
    def of(cls, run: Run) -> Self:
        """Find the tables of a finished run, and check all of them.

        Raises:
            RunError: if a table is missing, because the run did not finish, or its budget ended before any trial.
        """
        study = run.study
        # figures of single trials read every column; the others these, which are a third of a large table
        every = study.keep_points or study.posterior is not None
        used = ("cell", "trial", *(c.name for c in study.conditions()), "estimator", "error", "bound", "status")
        names = ["errors"] if study.keep == "errors" else []
        names += ["summary", *(["points"] if study.keep_points else [])]
        names += ["posterior", "answers", "draws"] if run.has("posterior") else []
        for name in names:
            run.require(name)
        tables = cls(
            name=" · ".join(filter(None, [study.run_name(), bound_law(study.design.given())])),
            dimension=study.dimension,
            design=study.design.kind,
            independent=study.independent(),
            noise_law=study.noise_law,
            reader=run,
            stored=frozenset(names),
            used=None if every else used,
        )
        if tables.summary.empty:
            raise RunError(
                f"{run.folder}: its budget ended before any cell had a trial; run `study run` again to resume"
            )
        return tables

    @cached_property
    def errors(self) -> pd.DataFrame:
        """The error table; see `study.simulation.runs.schemas.errors`.

        Of a run without points or posteriors it has no columns of parameters other than the centre.

        Raises:
            NotApplicable: if the study kept its summary alone.
        """
        return self.some_errors(self.used)

    def some_errors(self, columns: Collection[str] | None, estimators: Collection[str] | None = None) -> pd.DataFrame:
        """Read some columns of the error table, and some estimators' rows: a part is read sooner.

        Raises:
            NotApplicable: if the study kept its summary alone.
        """
        self.require_errors()
        return self.reader.table("errors", columns, estimators)

    def require_errors(self) -> None:
        """Raise `NotApplicable` if the study kept its summary alone."""
        if "errors" not in self.stored:
            raise NotApplicable('needs every error: keep = "errors" in the config')

    @cached_property
    def summary(self) -> pd.DataFrame:
        """The summary table; see `study.simulation.runs.schemas.summary`."""
        return stored_summary(self.reader, "errors" in self.stored, self.design == "random")

    def require_all_trials(self, name: str) -> None:
        """Raise `NotApplicable` if a measure of all trials is not known in some cell."""
        if self.summary[name].isna().any():
            words = "the run is of an earlier version, which kept no medians of all trials"
            raise NotApplicable(f"{words}: run its config again, in another folder (--out)")

    @cached_property
    def points(self) -> pd.DataFrame | None:
        """The points of the trials that were kept; None if none were."""
        return self._if_stored("points")

    @cached_property
    def posterior(self) -> pd.DataFrame | None:
        """A row per chain; None if none was run. See `study.simulation.runs.schemas.posterior`."""
        return self._if_stored("posterior")

    @cached_property
    def answers(self) -> pd.DataFrame | None:
        """The estimators' answers beside the chains, likewise."""
        return self._if_stored("answers")

    @cached_property
    def draws(self) -> pd.DataFrame | None:
        """Draws of the chains that were kept, likewise."""
        return self._if_stored("draws")

    def _if_stored(self, name: str) -> pd.DataFrame | None:
        return self.reader.table(name) if name in self.stored else None

    @property
    def estimators(self) -> list[str]:
        """Names of the estimators, in the order of the config."""
        return [str(name) for name in self.summary["estimator"].unique()]


def at_first(table: pd.DataFrame, besides: Collection[str]) -> pd.DataFrame:
    """Rows in which every condition has the value of the first row.

    Args:
        table: errors or their summary.
        besides: names of conditions that may have any value.
    """
    for condition in STORED:
        if condition.name in table and condition.name not in besides:
            chosen = table[condition.name] == table[condition.name].iloc[0]
            table = table if chosen.all() else table[chosen]  # a copy of millions of rows takes seconds
    return table


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
        "fig2_error": "",
        "fig3_gdke_ellipse": "",
        "fig4_ugdk_ellipse": "",
        "fig5_methods": "",
        "fig6_mgdk": "",
        "fig7_power_law": "",
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

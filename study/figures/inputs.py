"""Input of a figure: a run's tables in memory; `NotApplicable` says why a run cannot feed a figure."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Self

import pandas as pd

from study.experiment.conditions import STORED, bound_law
from study.experiment.noise.gaussian import NoiseLaw
from study.runs.storage.run_folder import Run, RunError


class NotApplicable(Exception):  # noqa: N818  not an error: most runs cannot feed some figure
    """A figure that cannot be drawn from a run; the message is the reason, in words for a user."""


@dataclass(frozen=True)
class Tables:
    """Tables of a run in memory.

    Attributes:
        name: the run's name, which is printed on every figure, and the law that the bound is of, if that is in doubt.
        dimension: d of the spheres.
        design: "grid" or "random".
        noise_law: the law of the noise of a sample.
        rows: the error table, `errors` to the figures, of a run without points or posteriors without the columns of
            parameters other than the centre; None if the study kept its summary alone.
        summary: the summary table; see `study.runs.storage.schemas.summary`.
        points: the points of the trials that were kept; None if none were.
        posterior: a row per chain; None if none was run. See `study.runs.storage.schemas.posterior`.
        answers: the estimators' answers beside the chains, likewise.
        draws: draws of the chains that were kept, likewise.
        independent: True if no two cells share their directions and noise.
    """

    name: str
    dimension: int
    design: str
    noise_law: NoiseLaw
    rows: pd.DataFrame | None
    summary: pd.DataFrame
    points: pd.DataFrame | None = None
    posterior: pd.DataFrame | None = None
    answers: pd.DataFrame | None = None
    draws: pd.DataFrame | None = None
    independent: bool = True

    @classmethod
    def of(cls, run: Run) -> Self:
        """Load a finished run.

        Raises:
            RunError: if a table is missing, because the run did not finish, or its budget ended before any trial.
        """
        study = run.study
        # figures of single trials read every column; the others these, which are a third of a large table
        every = study.keep_points or study.posterior is not None
        used = ["cell", "trial", *(c.name for c in study.conditions()), "estimator", "error", "bound", "status"]
        tables = cls(
            name=" · ".join(filter(None, [study.run_name(), bound_law(study.design.given())])),
            dimension=study.dimension,
            design=study.design.kind,
            independent=study.independent(),
            noise_law=study.noise_law,
            rows=run.table("errors", None if every else used) if study.keep == "errors" else None,
            summary=run.table("summary"),
            points=run.table("points") if study.keep_points else None,
            **{name: run.table(name) for name in ("posterior", "answers", "draws") if run.has("posterior")},
        )
        if tables.summary.empty:
            raise RunError(
                f"{run.folder}: its budget ended before any cell had a trial; run `study run` again to resume"
            )
        return tables

    @property
    def errors(self) -> pd.DataFrame:
        """The error table; see `study.runs.storage.schemas.errors`.

        Raises:
            NotApplicable: if the study kept its summary alone.
        """
        if self.rows is None:
            raise NotApplicable('needs every error: keep = "errors" in the config')
        return self.rows

    @property
    def estimators(self) -> list[str]:
        """Names of the estimators, in the order of the config."""
        table = self.summary if self.rows is None else self.rows
        return [str(name) for name in table["estimator"].unique()]


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

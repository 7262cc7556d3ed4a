"""The stored tables that claims are judged by."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from study.runs.storage import schemas
from study.runs.storage.run_folder import Run, RunError

_NAMED = frozenset(
    (
        "gdke",
        "ugdk",
        "ugdk_cov",
        "als",
        "mle",
        "mle_centroid",
        "mle_mirror",
        "lls",
        "lls_nr",
        "lls_nr_raw",
        "lls_single",
    )
)
"""Estimators that a claim names. Rows of the others are not read: they are half of the largest table."""


class TableMissing(Exception):  # noqa: N818  no error: most sets of runs lack some claim's tables
    """A table that a claim reads is missing; the message names it and the command that makes it."""


@dataclass(frozen=True)
class Evidence:
    """The runs that claims are judged by.

    Attributes:
        runs: runs by the name of their config: ``paper`` of configs/paper.toml.
        cost: the table of `study cost`, or None.
        recordings: spreads of joints from case studies, or None; columns as in
            `study.mocap.case_study.stored_tables`.
    """

    runs: Mapping[str, Run]
    cost: pd.DataFrame | None = None
    recordings: pd.DataFrame | None = None
    _read: dict[tuple[str, str], pd.DataFrame] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def of(cls, runs: Iterable[Run], cost: Path | None = None, recordings: pd.DataFrame | None = None) -> "Evidence":
        """Collect runs of different configs, the file of a cost table, and spreads of joints.

        Raises:
            RunError: if two runs are of one config's name, or a file cannot be read.
        """
        named: dict[str, Run] = {}
        for run in runs:
            name = run.study.name
            if name in named:
                raise RunError(f"{named[name].folder} and {run.folder}: both are runs named {name!r}; give one of them")
            named[name] = run
        return cls(named, None if cost is None else _read_cost(cost), recordings)

    def table(self, config: str, name: str) -> pd.DataFrame:
        """A table of the run of a config, read once; of an error table, the estimators that claims name.

        Raises:
            TableMissing: if there is no such run, or it did not finish.
        """
        if config not in self.runs:
            raise TableMissing(f"needs a run of configs/{config}.toml")
        if (config, name) not in self._read:
            try:
                self._read[config, name] = self.runs[config].table(
                    name, estimators=_NAMED if name == "errors" else None
                )
            except RunError as error:
                raise TableMissing(str(error)) from None
        return self._read[config, name]

    def costs(self) -> pd.DataFrame:
        """The cost table.

        Raises:
            TableMissing: if none was given.
        """
        if self.cost is None:
            raise TableMissing("needs the cost table: `study cost` makes it")
        return self.cost

    def spreads(self) -> pd.DataFrame:
        """Spreads of joints of recordings.

        Raises:
            TableMissing: if none were given.
        """
        if self.recordings is None:
            raise TableMissing("needs a recording: `study case-study FILE --out DIR`, then `--recording DIR` here")
        return self.recordings


def _read_cost(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise RunError(f"{path}: no cost table; `study cost --out {path}` makes one")
    try:
        table: pd.DataFrame = schemas.read(path)
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read: {error}") from None
    missing = {"estimator", "flops_per_sample", "paper_flops", "scalar_seconds", "vector_seconds"} - set(table.columns)
    if missing:
        raise RunError(f"{path}: not a cost table, without {', '.join(sorted(missing))}; `study cost` makes one")
    return table

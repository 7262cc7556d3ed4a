"""The stored tables that claims are judged by."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
import pyarrow as pa
from pandas.api import types

from study.analysis.joint_markers import JointMarkers, joint_markers
from study.experiment.conditions import STORED
from study.runs.storage import schemas
from study.runs.storage.run_folder import Run, RunError
from study.sphere.types import Ints

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
_ALWAYS = ("cell", "trial", *(condition.name for condition in STORED), "estimator", "status")
"""Columns of an error table that every claim may use."""

_COSTS = ("flops_per_sample", "paper_flops", "scalar_seconds", "vector_seconds")
"""Columns of a cost table that hold numbers."""


class TableMissing(Exception):  # noqa: N818  no error: most sets of runs lack some claim's tables
    """A table that a claim reads is missing; the message names it and the command that makes it."""


@dataclass(frozen=True)
class Evidence:
    """The runs that claims are judged by.

    Attributes:
        runs: runs by the name of their config: ``paper`` of configs/paper.toml.
        cost: the table of `study cost`, or None.
        recordings: spreads of joints from case studies, or None; columns as in
            `study.mocap.case_study.stored_case_studies`.
    """

    runs: Mapping[str, Run]
    cost: pd.DataFrame | None = None
    recordings: pd.DataFrame | None = None
    _read: dict[tuple[str, str], pd.DataFrame] = field(default_factory=dict, init=False, repr=False, compare=False)
    _order: dict[str, Ints] = field(default_factory=dict, init=False, repr=False, compare=False)
    _joints: dict[str, list[JointMarkers]] = field(default_factory=dict, init=False, repr=False, compare=False)

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
        """A table of the run of a config, read once.

        Raises:
            TableMissing: if there is no such run, or it did not finish.
        """
        if (config, name) not in self._read:
            self._read[config, name] = self._stored(config, name)
        return self._read[config, name]

    def errors(self, config: str, *columns: str) -> pd.DataFrame:
        """The error table of the run of a config: cell by cell for each of the estimators that claims name.

        Args:
            config: its name.
            columns: columns beside the conditions, the estimator and the status. Each is read once, and the order of
                the rows is the same for all: a table of millions of rows is not read whole.

        Raises:
            TableMissing: as `table`.
        """
        known = self._read.get((config, "errors"), pd.DataFrame())
        missing = [name for name in (columns if len(known.columns) else [*_ALWAYS, *columns]) if name not in known]
        if missing:
            found = self._stored(config, "errors", missing, _NAMED)
            if config not in self._order:
                keys = found[["estimator", "cell"]].reset_index(drop=True)
                self._order[config] = keys.sort_values(["estimator", "cell"], kind="stable").index.to_numpy()
            found = found.take(self._order[config]).reset_index(drop=True)
            known = found if known.empty else known.assign(**{name: found[name] for name in missing})
            self._read[config, "errors"] = known
        return known

    def _stored(self, config: str, name: str, *selection: Collection[str]) -> pd.DataFrame:
        if config not in self.runs:
            raise TableMissing(f"needs a run of configs/{config}.toml")
        try:
            return self.runs[config].table(name, *selection)
        except RunError as error:
            raise TableMissing(str(error)) from None

    def joints(self, config: str) -> list[JointMarkers]:
        """The joints of a run with several radii, from its errors and points.

        Raises:
            TableMissing: as `table`.
        """
        if config not in self._joints:
            self._joints[config] = list(joint_markers(self.errors(config), self.table(config, "points")))
        return self._joints[config]

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
    remedy = "`study cost --out FILE.parquet` makes one"
    if not path.is_file():
        raise RunError(f"{path}: no cost table; {remedy}")
    try:
        table: pd.DataFrame = schemas.read(path)
    except (
        OSError,
        pa.ArrowException,
        ValueError,
        KeyError,
        TypeError,
    ):  # the last two if the text about the columns is garbled
        raise RunError(f"{path}: not a cost table: damaged, or not parquet; {remedy}") from None
    odd = [name for name in _COSTS if name not in table or not types.is_numeric_dtype(table[name])]
    if "estimator" not in table or odd:
        words = ", ".join(odd or ["estimator"])
        raise RunError(f"{path}: not a cost table: {words} missing or not numbers; {remedy}")
    return table

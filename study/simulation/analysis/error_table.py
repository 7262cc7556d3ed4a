"""Stored error tables by group and estimator, a part at a time, so that long tables need little memory.

The least part is the rows of one estimator in one group. A group is a cell, or, in a random design, a decade of σ/r.
Cells that share their draws are computed together, so that the rows of one cell may lie all over the table: of each row
group only the wanted rows stay in memory.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike

from study.arrays import Floats
from study.files import RunError
from study.simulation.experiment.compute import Columns
from study.simulation.runs.run_folder import NO_TRIAL, Run

if TYPE_CHECKING:
    from pandas.core.groupby import DataFrameGroupBy

Key = tuple[str, str]
"""Names of a group and an estimator."""
_MEMORY = 1 << 27
"""Bytes of rows in memory at a time, or those of one group and estimator if they have more."""
_VALUE = 8
"""Bytes of a value."""


def label(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """An error table with columns ``group``, whose words are coded, and ``decade``.

    Args:
        errors: the table, or some of its rows.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).
    """
    if not by_decade:
        return errors.assign(group=errors["cell"].astype("category"), decade=np.nan)
    lower = decade(errors["noise"] / errors["radius"]).astype(int)
    powers, codes = np.unique(lower, return_inverse=True)
    names = pd.Index([f"1e{power:+03d}" for power in powers])
    return errors.assign(group=pd.Categorical.from_codes(codes, categories=names), decade=lower)


def decade(values: ArrayLike) -> Floats:
    """Exponent of ten at the lower end of each value's decade; a value just below it by rounding counts as in it."""
    return np.asarray(np.floor(np.log10(values) + 1e-9))


class Grouped:
    """A stored error table, by group and estimator.

    Args:
        run: the finished run.

    Attributes:
        by_decade: true if a group is a decade of σ/r, false if it is a cell.
        counts: rows of each group and estimator, in the order of a summary.

    Raises:
        RunError: if the table is missing or cannot be read.
    """

    def __init__(self, run: Run) -> None:
        self._file: pq.ParquetFile = run.read("errors", pq.ParquetFile)
        self._folder = run.folder
        self.by_decade = run.study.design.one_trial_a_cell
        self._keys = ["noise", "radius", "estimator"] if self.by_decade else ["cell", "estimator"]
        self.counts: dict[Key, int] = {}
        self._where: dict[Key, tuple[int, int]] = {}
        for index in range(self._file.num_row_groups):
            sizes = _grouped(self._labels(self._row_group(index, []))).size()
            for key, rows in cast("Iterable[tuple[Key, int]]", sizes.items()):
                self.counts[key] = self.counts.get(key, 0) + rows
                self._where[key] = self._where.get(key, (index, index))[0], index
        if self.by_decade:
            self.counts = dict(sorted(self.counts.items(), key=lambda item: int(item[0][0][2:])))

    def batches(self, columns: Collection[str], keys: Collection[Key] | None = None) -> Iterator[list[Key]]:
        """Keys in batches that can be read together.

        Args:
            columns: the columns that will be read.
            keys: the keys to go through; all if None.
        """
        return _batches(self.counts if keys is None else {key: self.counts[key] for key in keys}, len(columns))

    def read(self, keys: Collection[Key], columns: Collection[str]) -> dict[Key, Columns]:
        """Rows of some groups and estimators, in the order of the table.

        Args:
            keys: names of groups and estimators; one that is not in the table has no entry in the result.
            columns: columns of the error table; ``decade`` is added.

        Returns:
            The columns of each group and estimator, words as objects.
        """
        wanted = [key for key in keys if key in self.counts]
        if not wanted:
            return {}
        rows = self._of(wanted, columns)
        values, groups = {name: rows[name].to_numpy() for name in (*columns, "decade")}, _grouped(rows).indices
        return {key: {name: column[groups[key]] for name, column in values.items()} for key in wanted}

    def cells(self, columns: Collection[str], only: Collection[str] | None = None) -> Iterator[pd.DataFrame]:
        """All rows of some cells of a grid at a time, in the order of the table.

        Args:
            columns: columns of the error table; ``cell`` and ``estimator`` are added.
            only: names of the cells; all if None.

        Raises:
            RunError: if the table has no rows.
        """
        if not self.counts:
            raise RunError(f"{self._folder}: {NO_TRIAL}")
        keys: dict[str, list[Key]] = {}
        for key in self.counts:
            if only is None or key[0] in only:
                keys.setdefault(key[0], []).append(key)
        sizes = {cell: sum(self.counts[key] for key in keys[cell]) for cell in keys}
        for cells in _batches(sizes, len(columns)):
            yield self._of([key for cell in cells for key in keys[cell]], columns)

    def _of(self, keys: Collection[Key], columns: Collection[str]) -> pd.DataFrame:
        """Rows of some groups and estimators; where these do not combine in full, also rows of other combinations."""
        groups, estimators = ({key[place] for key in keys} for place in (0, 1))
        first, last = min(self._where[key][0] for key in keys), max(self._where[key][1] for key in keys)
        parts = []
        for index in range(first, last + 1):
            table = self._row_group(index, columns)
            labels = self._labels(table)
            use = labels["group"].isin(groups) & labels["estimator"].isin(estimators)
            parts.append(table if use.all() else table.filter(pa.array(use)))
        rows = pa.concat_tables(parts).unify_dictionaries()
        return label(rows.to_pandas(split_blocks=True, self_destruct=True), self.by_decade)

    def _row_group(self, index: int, columns: Collection[str]) -> pa.Table:
        """Columns of a row group, with those that say its group and estimator."""
        return self._file.read_row_group(index, columns=list(dict.fromkeys([*columns, *self._keys])))

    def _labels(self, table: pa.Table) -> pd.DataFrame:
        """Group, decade and estimator of the rows of a table."""
        return label(table.select(self._keys).to_pandas(), self.by_decade)


def _grouped(rows: pd.DataFrame) -> "DataFrameGroupBy[Any, Any]":
    return rows.groupby(["group", "estimator"], sort=False, observed=True)


T = TypeVar("T")


def _batches(sizes: Mapping[T, int], columns: int) -> Iterator[list[T]]:
    """Things in batches that fit in memory, given the number of rows of each."""
    most = _MEMORY // (_VALUE * (columns + 1))
    batch: list[T] = []
    rows = 0
    for thing, size in sizes.items():
        if batch and rows + size > most:
            yield batch
            batch, rows = [], 0
        batch.append(thing)
        rows += size
    if batch:
        yield batch

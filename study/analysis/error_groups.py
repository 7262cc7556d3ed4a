"""An error table read by group and estimator, a part at a time, so that any length fits in memory."""

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike, NDArray

from study.experiment.errors import Columns
from study.runs.storage.run_folder import Run
from study.sphere.types import Floats, Ints

Key = tuple[str, str]
"""Names of a group and an estimator."""
ROWS = 1 << 20
"""Rows in memory at a time, or those of one group if it has more."""


def label(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """An error table with columns ``group``, whose words are coded, and ``decade``.

    Args:
        errors: the table, or some of its rows.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).
    """
    if not by_decade:
        return errors.assign(group=errors["cell"].astype("category"), decade=np.nan)
    names, codes, lower = _decades(errors["noise"] / errors["radius"])
    return errors.assign(group=pd.Categorical.from_codes(codes, categories=pd.Index(names)), decade=lower)


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
        self._run = run
        self._file: pq.ParquetFile = run.read("errors", pq.ParquetFile)
        self.by_decade = run.study.design.one_trial_a_cell
        self.counts: dict[Key, int] = {}
        self._where: dict[Key, tuple[int, int]] = {}
        for index in range(self._file.num_row_groups):
            keys, key_of_row, _ = self._chunk(index, [])
            for key, rows in zip(keys, np.bincount(key_of_row).tolist(), strict=True):
                self.counts[key] = self.counts.get(key, 0) + rows
                self._where[key] = self._where.get(key, (index, index))[0], index
        if self.by_decade:
            self.counts = dict(sorted(self.counts.items(), key=lambda item: int(item[0][0][2:])))

    def batches(self, keys: Collection[Key] | None = None) -> Iterator[list[Key]]:
        """Keys in batches that can be read together.

        Args:
            keys: the keys to go through; all if None.
        """
        batch: list[Key] = []
        rows = 0
        for key in self.counts if keys is None else keys:
            if batch and rows + self.counts[key] > ROWS:
                yield batch
                batch, rows = [], 0
            batch.append(key)
            rows += self.counts[key]
        if batch:
            yield batch

    def read(self, keys: Collection[Key], columns: list[str]) -> dict[Key, Columns]:
        """Rows of some groups and estimators, in the order of the table.

        Args:
            keys: names of groups and estimators; one that is not in the table has no entry in the result.
            columns: columns of the error table; ``decade`` is added.

        Returns:
            The columns of each group and estimator, words as objects.
        """
        places = {key: place for place, key in enumerate(key for key in dict.fromkeys(keys) if key in self.counts)}
        if not places:
            return {}
        span = [self._where[key] for key in places]
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in columns}
        place_of_row = []
        for index in range(min(first for first, _ in span), max(last for _, last in span) + 1):
            here, key_of_row, table = self._chunk(index, columns)
            place = np.array([places.get(key, -1) for key in here])[key_of_row]
            wanted = np.flatnonzero(place >= 0)
            place_of_row.append(place[wanted])
            for name, found in parts.items():
                found.append(_values(table[name])[wanted])
        order = np.argsort(np.concatenate(place_of_row), kind="stable")
        whole = {name: np.concatenate(found)[order] for name, found in parts.items()}
        ends = np.cumsum([self.counts[key] for key in places])
        result = {}
        for key, end in zip(places, ends, strict=True):
            rows = slice(end - self.counts[key], end)
            lower = float(key[0][2:]) if self.by_decade else np.nan
            decades = np.full(self.counts[key], lower)
            result[key] = {name: values[rows] for name, values in whole.items()} | {"decade": decades}
        return result

    def _chunk(self, index: int, columns: list[str]) -> tuple[list[Key], Ints, pa.Table]:
        """A row group: its keys in the order in which they appear, the place of each row's key among them, its rows."""
        conditions = ["noise", "radius"] if self.by_decade else ["cell"]
        table = self._file.read_row_group(index, columns=list(dict.fromkeys([*columns, *conditions, "estimator"])))
        estimators, estimator_of_row = _coded(table["estimator"])
        if self.by_decade:
            groups, group_of_row, _ = _decades(_values(table["noise"]) / _values(table["radius"]))
        else:
            groups, group_of_row = _coded(table["cell"])
        code = group_of_row.astype(np.int64) * len(estimators) + estimator_of_row
        found = pd.unique(code)
        place = np.zeros(len(groups) * len(estimators), dtype=np.int64)
        place[found] = np.arange(len(found))
        keys = [divmod(int(each), len(estimators)) for each in found]
        return [(groups[g], estimators[e]) for g, e in keys], place[code], table


def _decades(ratio: ArrayLike) -> tuple[list[str], Ints, Ints]:
    """Names of the decades that occur, the place of each value's among them, and its exponent."""
    lower = decade(ratio).astype(int)
    powers, codes = np.unique(lower, return_inverse=True)
    return [f"1e{power:+03d}" for power in powers], codes, lower


def _coded(column: pa.ChunkedArray) -> tuple[list[str], Ints]:
    """The words of a column, and the place of each row's word among them."""
    coded = column.combine_chunks()
    return coded.dictionary.to_pylist(), coded.indices.to_numpy()


def _values(column: pa.ChunkedArray) -> NDArray[Any]:
    """A column as an array, words as objects."""
    if pa.types.is_dictionary(column.type):
        words, codes = _coded(column)
        return np.array(words, dtype=object)[codes]
    values: NDArray[Any] = column.to_numpy()
    return values

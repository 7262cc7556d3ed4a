"""An error table read by group and estimator, a part at a time, so that any length fits in memory."""

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from numpy.typing import ArrayLike

from study.runs.storage.run_folder import Run
from study.sphere.types import Floats, Ints

Key = tuple[str, str]
"""Names of a group and an estimator."""
ROWS = 1 << 19
"""Rows in memory at a time, or those of one group if it has more."""
_CONDITIONS = ["cell", "noise", "radius", "estimator"]


def label(errors: pd.DataFrame, by_decade: bool) -> pd.DataFrame:
    """An error table with columns ``group``, whose words are coded, and ``decade``.

    Args:
        errors: the table, or some of its rows.
        by_decade: group by decade of σ/r (a random design) instead of by cell (a grid).
    """
    if not by_decade:
        return errors.assign(group=errors["cell"].astype("category"), decade=np.nan)
    lower = decade(errors["noise"] / errors["radius"]).astype(int)
    words = {power: f"1e{power:+03d}" for power in np.unique(lower)}
    return errors.assign(group=pd.Series(lower, index=errors.index).map(words).astype("category"), decade=lower)


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
        self._file: Any = run.read("errors", pq.ParquetFile)
        self.by_decade = run.study.design.one_trial_a_cell
        self.counts: dict[Key, int] = {}
        self._where: dict[Key, tuple[int, int]] = {}
        for index in range(self._file.num_row_groups):
            keys, key_of_row = self._keys(self._chunk(index, []))
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

    def read(self, keys: Collection[Key], columns: list[str]) -> dict[Key, pd.DataFrame]:
        """Rows of some groups and estimators, in the order of the table.

        Args:
            keys: names of groups and estimators; one that is not in the table has no entry in the result.
            columns: columns of the error table; ``decade`` is added.
        """
        places = {key: place for place, key in enumerate(key for key in dict.fromkeys(keys) if key in self.counts)}
        if not places:
            return {}
        span, parts, place_of_row = [self._where[key] for key in places], [], []
        for index in range(min(first for first, _ in span), max(last for _, last in span) + 1):
            chunk = self._chunk(index, columns)
            here, key_of_row = self._keys(chunk)
            place = np.array([places.get(key, -1) for key in here])[key_of_row]
            parts.append(chunk.loc[place >= 0, [*columns, "decade"]])
            place_of_row.append(place[place >= 0])
        words = {name: str for name in columns if isinstance(parts[0][name].dtype, pd.CategoricalDtype)}
        whole = pd.concat([part.astype(words) for part in parts], ignore_index=True)  # the parts have other codes
        whole = whole.iloc[np.argsort(np.concatenate(place_of_row), kind="stable")]
        ends = np.cumsum([self.counts[key] for key in places])
        return {key: whole.iloc[end - self.counts[key] : end] for key, end in zip(places, ends, strict=True)}

    def _chunk(self, index: int, columns: list[str]) -> pd.DataFrame:
        wanted = list(dict.fromkeys([*columns, *_CONDITIONS]))
        return label(self._file.read_row_group(index, columns=wanted).to_pandas(), self.by_decade)

    @staticmethod
    def _keys(rows: pd.DataFrame) -> tuple[list[Key], Ints]:
        """Keys in the order in which they first appear, and the place of each row's key among them (rows,)."""
        groups, estimators = (rows[name].cat for name in ("group", "estimator"))
        code = groups.codes.to_numpy(dtype=np.int64) * len(estimators.categories) + estimators.codes.to_numpy()
        found = pd.unique(code)
        place = np.zeros(len(groups.categories) * len(estimators.categories), dtype=np.int64)
        place[found] = np.arange(len(found))
        keys = [divmod(int(each), len(estimators.categories)) for each in found]
        return [(str(groups.categories[g]), str(estimators.categories[e])) for g, e in keys], place[code]

"""An error table read by group and estimator, a part at a time, so that any length fits in memory."""

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from numpy.typing import ArrayLike

from study.runs.storage.run_folder import Run
from study.sphere.types import Floats

Key = tuple[str, str]
"""Names of a group and an estimator."""
ROWS = 1 << 18
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
            for key, rows in self._places(self._chunk(index, [])).items():
                self.counts[key] = self.counts.get(key, 0) + len(rows)
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
        known = {key for key in keys if key in self.counts}
        if not known:
            return {}
        places = [self._where[key] for key in known]
        found = []
        for index in range(min(first for first, _ in places), max(last for _, last in places) + 1):
            chunk = self._chunk(index, columns)
            use = np.zeros(len(chunk), dtype=bool)
            for key, rows in self._places(chunk).items():
                use[rows] = key in known
            found.append(chunk[use])
        words = {"group": str, "estimator": str}  # the parts have other codes
        whole = pd.concat([part.astype(words) for part in found], ignore_index=True)
        of_key = self._places(whole)
        whole = whole[[*columns, "decade"]]  # rows of words take far longer to choose than rows of numbers
        return {key: whole.iloc[rows] for key, rows in of_key.items()}

    def _chunk(self, index: int, columns: list[str]) -> pd.DataFrame:
        wanted = list(dict.fromkeys([*columns, *_CONDITIONS]))
        return label(self._file.read_row_group(index, columns=wanted).to_pandas(), self.by_decade)

    @staticmethod
    def _places(rows: pd.DataFrame) -> dict[Key, Any]:
        """Positions of the rows of each key, in the order in which the keys first appear."""
        groups = rows.groupby(["group", "estimator"], sort=False, observed=True)
        places: Any = groups.indices
        return {key: places[key] for key in groups.size().index}

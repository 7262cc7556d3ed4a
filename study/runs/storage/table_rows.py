"""Rows of a parquet file by their numbers, read a row group at a time, so that any length fits in memory."""

from functools import lru_cache
from itertools import accumulate
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq


class TableRows:
    """A parquet file whose rows are read by their numbers.

    Args:
        path: the file.

    Attributes:
        count: number of rows.
    """

    def __init__(self, path: Path) -> None:
        self._file = pq.ParquetFile(path)
        self._group = lru_cache(maxsize=2)(self._file.read_row_group)  # the instance's, so that the file is closed
        groups = range(self._file.num_row_groups)
        self._ends = list(accumulate(self._file.metadata.row_group(i).num_rows for i in groups))
        self.count: int = self._file.metadata.num_rows

    def rows(self, begin: int, end: int) -> pa.Table:
        """Rows ``begin`` to ``end`` - 1, as far as the file has them."""
        groups = [i for i, last in enumerate(self._ends) if last > begin and (self._ends[i - 1] if i else 0) < end]
        if not groups:
            return self._file.schema_arrow.empty_table()
        start = self._ends[groups[0] - 1] if groups[0] else 0
        return pa.concat_tables([self._group(i) for i in groups]).slice(begin - start, end - begin)

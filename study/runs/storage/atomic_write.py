"""Atomic writing: a file gets a temporary name, is synced, and is renamed, so that it is there whole or not at all."""

import contextlib
import os
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from study.text.spreadsheet_cell import inert_frame

if TYPE_CHECKING:
    import pandas as pd  # not loaded by a command that reads no table into a data frame

_ROWS_PER_GROUP = 1 << 17


class RunError(Exception):
    """A run that cannot be used, written or computed; the message says why and what to do."""


@contextlib.contextmanager
def explained(place: Path, of_run: bool = True) -> Iterator[None]:
    """Turn a failure to write into a `RunError` of one clear line.

    Args:
        place: the file or folder.
        of_run: true for the files of a run, which keeps what was finished before.
    """
    try:
        yield
    except OSError as error:
        kept = "; what was finished is kept" if of_run else ""
        raise RunError(f"{place}: cannot be written: {error.strerror or error}{kept}") from None
    except UnicodeEncodeError:
        raise RunError(f"{place}: cannot be written: its name is not UTF-8; choose another") from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name in the same folder; the file is synced and renamed at the end, or removed on failure."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        with open(temporary, "r+b") as file:  # Windows syncs no file that is open for reading alone
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _sync_folder(folder: Path) -> None:
    """Make a renaming survive a loss of power, on systems that let folders be synced."""
    if os.name != "nt":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write(path: Path, data: bytes) -> None:
    """Write a file."""
    with replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(data)


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table as parquet."""
    with replacing(path) as temporary:
        pq.write_table(table, temporary, **_encoding(table.schema))


def join(path: Path, schema: pa.Schema, tables: Iterable[pa.Table]) -> None:
    """Stream tables into one parquet file, in row groups of equal size whatever the tables' sizes.

    The dictionary of a row group has the words of the tables that reach into it, in the order of their rows.
    """
    plain = schema.remove_metadata()
    with replacing(path) as temporary, pq.ParquetWriter(temporary, schema, **_encoding(schema)) as writer:
        waiting: deque[pa.Table] = deque()
        rows = written = 0  # rows of the waiting tables, and those of the first one that are written

        def write_group(size: int) -> int:
            group = _encoded(pa.concat_tables(waiting), plain).slice(written, size)
            writer.write_table(group.combine_chunks())
            end = written + size
            while waiting and end >= waiting[0].num_rows:
                end -= waiting.popleft().num_rows
            return end

        for table in tables:
            waiting.append(table)
            rows += table.num_rows
            while rows >= _ROWS_PER_GROUP:
                rows -= _ROWS_PER_GROUP
                written = write_group(_ROWS_PER_GROUP)
        if rows:
            write_group(rows)


def _encoding(schema: pa.Schema) -> dict[str, object]:
    """Parquet's settings for a table: words get a dictionary.

    Measured numbers hardly repeat: with dictionaries, which Parquet would try, they take four times as long to write,
    and a quarter more space.
    """
    words = [field.name for field in schema if pa.types.is_dictionary(field.type)]
    return {"compression": "zstd", "use_dictionary": words or False}


def _encoded(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Encode a table's words, so that its dictionaries have the words of its rows in order, and no others."""
    for index, field in enumerate(schema):
        if pa.types.is_dictionary(field.type):
            words = table[field.name].cast(pa.string()).combine_chunks()
            table = table.set_column(index, field.name, pc.dictionary_encode(words))
    return table.cast(schema)


def save_frame(frame: "pd.DataFrame", path: Path) -> None:
    """Write a data frame to a file of the user's choice, whole or not at all, as CSV or parquet by its suffix.

    Raises:
        RunError: if the suffix is another, or the file cannot be written.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise RunError(f"{path}: give a name that ends in .csv or .parquet")
    with explained(path, of_run=False):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            if path.suffix == ".csv":
                inert_frame(frame).to_csv(temporary, index=False)
            else:
                frame.to_parquet(temporary, index=False)

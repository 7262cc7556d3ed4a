"""Files that are there whole or not at all, their digests, the lock of a run's folder, and rows of a table by number.

A file is written under a temporary name, synced, and renamed. A digest is the SHA-256 of a file's bytes: of the tables
of five million fits it takes a fifth of a second. A folder has one writer at a time, named in its lock; the system
releases the lock when the writer dies.
Pipes and devices are refused, since to read one may take for ever.
"""

import contextlib
import errno
import hashlib
import json
import os
import socket
import stat
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from study.text import inert_frame

if TYPE_CHECKING:
    import pandas as pd


_ROWS_PER_GROUP = 1 << 17


class InputError(Exception):
    """A file that was given and cannot be used; the message says why and what to do."""


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
        rest = "; what was finished is kept" if of_run else ""
        raise RunError(f"{place}: cannot be written: {error.strerror or error}{rest}") from None
    except UnicodeEncodeError:
        raise RunError(f"{place}: cannot be written: its name is not UTF-8; choose another") from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name in the same folder; the file is synced and renamed at the end, or removed on failure.

    Raises:
        OSError: if a device or a pipe has the name: renaming would put a file in its place.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):  # a folder is not replaced, in the system's words
        raise OSError(errno.EINVAL, "a device or a pipe has this name, and is not replaced; give another")
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


def named_path(path: object, what: str) -> Path:
    """The path that a caller gives for something; a TypeError names what is none."""
    if not isinstance(path, str | Path):
        shown = " ".join(f"{path!r:.60}".split())
        raise TypeError(f"{what} = {shown}: expected the name of a file or folder")
    return Path(path)


def regular(path: Path) -> Path:
    """The path of a table, which is not opened.

    Raises:
        OSError: if it is a pipe or a device, or not there.
    """
    kind = os.stat(path).st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):  # to open a folder fails by itself, with the system's words
        raise OSError(errno.EINVAL, "not a regular file; store what the pipe or device gives in one")
    return path


def stored_csv(path: Path, columns: Sequence[str], what: str, as_text: bool = False) -> "pd.DataFrame":
    """Read a CSV table of some columns.

    Args:
        path: the file.
        columns: all of its columns.
        what: the table in words, and the command that makes it: "table of readings; `study readings` makes it".
        as_text: leave every cell a text.

    Raises:
        RunError: if it cannot be read, has other columns, or has no rows.
    """
    import pandas as pd

    name, _, remedy = what.partition("; ")
    try:
        table: pd.DataFrame = pd.read_csv(regular(path), dtype=str if as_text else None, keep_default_na=not as_text)
    except (OSError, UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        raise RunError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}; {remedy}") from None
    if list(table.columns) != list(columns) or table.empty:
        raise RunError(f"{path}: no {name}: needs the columns {', '.join(columns)}; {remedy}")
    return table


def of_file(path: Path) -> str | None:
    """SHA-256 of a file's bytes, hexadecimal; None if there is no such file.

    Raises:
        RunError: if it cannot be read.
    """
    try:
        with open(regular(path), "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror or error}; make it readable, or remove it") from None


def of_json(content: Mapping[str, object]) -> str:
    """SHA-256 of a JSON object, hexadecimal; the order of its keys counts."""
    return hashlib.sha256(json.dumps(content, ensure_ascii=False).encode(errors="surrogatepass")).hexdigest()


_NAME = ".lock"
_PATIENCE = 0.5
"""Seconds to wait, because `holder` holds the lock for a moment."""
_NO_NAME: tuple[type[OSError], ...] = (PermissionError,) if os.name == "nt" else ()
"""Windows lets nobody write to a locked file, so that its writer stays without a name."""


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Hold the lock of a run's folder, which must be there.

    Raises:
        RunError: if another process holds it; the message names the process and its host.
    """
    path = folder / _NAME
    lock = FileLock(path, thread_local=False)
    try:
        lock.acquire(timeout=_PATIENCE)
    except Timeout:  # which is an OSError, too
        raise RunError(f"{folder}: {_writer(path)} is writing to it; wait for it to end, or stop it") from None
    except OSError as error:
        with explained(folder):
            raise error
    try:
        with explained(folder), contextlib.suppress(*_NO_NAME):
            path.write_text(json.dumps({"process": os.getpid(), "host": socket.gethostname()}), encoding="utf-8")
        yield
    finally:
        # removed while it is held: another process that opened it meanwhile finds another file under the name, or none
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()


def holder(folder: Path) -> str | None:
    """Name the process that writes to a run at this moment; None if there is none, or the disk is read-only."""
    path = folder / _NAME
    if not path.is_file():
        return None
    try:
        with FileLock(path, blocking=False):
            return None
    except Timeout:
        return _writer(path)
    except OSError:  # a read-only disk has no writers
        return None


def _writer(path: Path) -> str:
    try:
        writer = json.loads(path.read_text(encoding="utf-8"))
        return f"process {writer['process']} on {writer['host']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"


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

"""Part files: the finished rows of a run that is not finished. A part has a header, and is named by its own digest.

    parts/units-<SHA-256 of the file's bytes>.part
        one line of JSON: the format, the software, seconds since the part before, and the packets with their keys;
            where rows were taken from another run, the software that computed them
        the packets, one after the other: each a stream of Arrow's IPC format for each of its tables

A *key* is a digest of all that determines some rows, except their place in the grid, so that a part means the same to
every config that needs its rows. The *outputs* of a key are what was computed under it, such as an estimator with its
version. So a new estimator, or a new version of one, is computed beside the others. A *packet* holds the tables of a
few keys, encoded by a worker; the parent writes it as it is. Many packets share a file. One is written when enough
bytes have come together, or when time has passed: a second, or a hundredth of the time that the run has taken. So the
number of files grows with the logarithm of time, and a kill costs no more than that time.
"""

import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
from pydantic import BaseModel, ValidationError

from study.files import RunError, explained, write

FORMAT = 5
"""Format of parts and tables. Raise it when rows of the same key would change, or files would be read wrongly."""
DAMAGED = "damaged"
_BYTES = 32 << 20
_SECONDS = 1.0
_SHARE = 0.01
_SMALL = 1 << 16


class Packet(NamedTuple):
    """Tables of several keys.

    Attributes:
        keys: the keys, each with its outputs.
        rows: for each table, the number of rows of each key, in order.
        tables: each table, encoded.
    """

    keys: Sequence[tuple[str, Sequence[str]]]
    rows: Mapping[str, Sequence[int]]
    tables: Mapping[str, bytes]

    @classmethod
    def of(cls, keys: Sequence[tuple[str, Sequence[str]]], of_keys: Sequence[Mapping[str, pa.Table]]) -> "Packet":
        """Encode the tables of each key; a table without rows may be left out."""
        names = dict.fromkeys(name for tables in of_keys for name in tables)
        rows = {name: [tables[name].num_rows if name in tables else 0 for tables in of_keys] for name in names}
        whole = {name: pa.concat_tables([t[name] for t in of_keys if name in t]) for name in names}
        return cls(keys, rows, {name: encode(table) for name, table in whole.items()})


def encode(table: pa.Table) -> bytes:
    """Encode a table as one stream of Arrow's IPC format."""
    table = table.replace_schema_metadata(None).unify_dictionaries().combine_chunks()
    options = pa.ipc.IpcWriteOptions(compression="zstd" if table.nbytes > _SMALL else None)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema, options=options) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue())


class PacketHeader(BaseModel):
    """Description of a packet in a file: keys with outputs, rows of each key by table, bytes of each table."""

    keys: list[tuple[str, tuple[str, ...]]]
    rows: dict[str, list[int]]
    sizes: dict[str, int]


class Header(BaseModel):
    """First line of a file. An older format may have less than this one."""

    format: int
    software: dict[str, Any]
    seconds: float = 0.0
    note: str = ""
    sources: list[dict[str, Any]] = []
    packets: list[PacketHeader] = []


_Rows = tuple[Path, int, int, list[int]]
"""Place of a table of a packet: its file, first byte and size, and the first row of each key."""


@lru_cache(maxsize=2)
def _decoded(path: Path, begin: int, size: int) -> pa.Table:
    with open(path, "rb") as file:
        file.seek(begin)
        return pa.ipc.open_stream(file.read(size)).read_all()


class Parts:
    """The part files of one kind in a run's folder.

    Args:
        folder: the run's.
        kind: the beginning of their names.
        software: the software that computes, stored beside the rows.

    Attributes:
        damaged: names of files that were torn or changed.
        seconds: time in which the stored rows were computed.
        made_by: other software that computed some of them.
        note: a text stored in each file; read from the files if one has it.
        sources: software that computed the rows that are added now, if they are taken from another run.
        count: number of files of this format; others are not used.
    """

    def __init__(self, folder: Path, kind: str, software: Mapping[str, object] | None = None) -> None:
        self.folder = folder / "parts"
        self.kind = kind
        self.software = dict(software or {})
        self.damaged: list[str] = []
        self.note = ""
        self.sources: list[dict[str, object]] = []
        self._forget()
        self._waiting: list[Packet] = []
        self._since = self._began = time.monotonic()

    def load(self, set_aside: bool = True) -> list[str]:
        """Read the headers of all files.

        Args:
            set_aside: move damaged files to ``parts/damaged``, so that their rows are computed again.

        Returns:
            Names of the files that were torn or changed.

        Raises:
            RunError: if a part is of a newer version, or cannot be read at all.
        """
        self._forget()
        before = len(self.damaged)
        for path in self._files():
            try:
                data = path.read_bytes()
            except FileNotFoundError:  # a run that finishes removes its parts
                continue
            except OSError as error:
                remedy = "make it readable, or remove it: its rows are computed again"
                raise RunError(f"{path}: cannot be read: {error.strerror or error}; {remedy}") from None
            line, end, _ = data.partition(b"\n")
            if path == self._path(data):
                try:
                    self._index(path, len(line + end), Header.model_validate_json(line))
                    continue
                except ValidationError:
                    pass
            self.damaged.append(path.name)
            if set_aside:
                with explained(path):
                    (self.folder / DAMAGED).mkdir(exist_ok=True)
                    path.rename(self.folder / DAMAGED / path.name)
        return self.damaged[before:]

    def _path(self, data: bytes) -> Path:
        """Path of a file, which its bytes give."""
        return self.folder / f"{self.kind}-{hashlib.sha256(data).hexdigest()}.part"

    def _files(self) -> list[Path]:
        return sorted(path for path in self.folder.glob(f"{self.kind}-*.part") if path.is_file())

    def _forget(self) -> None:
        self.seconds = 0.0
        self.made_by: list[dict[str, object]] = []
        self.count = 0
        self._where: dict[str, list[tuple[dict[str, _Rows], int, tuple[str, ...]]]] = {}
        self._kinds: dict[tuple[str, ...], tuple[str, ...]] = {}
        self._names: set[str] = set()

    def outputs(self, key: str) -> set[str]:
        """The stored outputs of a key."""
        return {output for *_, outputs in self._where.get(key, ()) for output in outputs}

    def tables(self, key: str, name: str) -> Iterator[tuple[tuple[str, ...], tuple[str, ...], pa.Table]]:
        """Read a table's rows of a key, in the order in which they were written.

        Yields:
            The outputs of a packet, those of them that no packet before had, and its rows.
        """
        before: set[str] = set()
        for stored, place, outputs in self._where.get(key, ()):
            fresh = tuple(output for output in outputs if output not in before)
            before.update(fresh)
            if fresh and name in stored:
                path, begin, size, starts = stored[name]
                if count := starts[place + 1] - starts[place]:
                    yield outputs, fresh, _decoded(path, begin, size).slice(starts[place], count)

    def holds(self, name: str) -> bool:
        """True if there are rows of a table."""
        return name in self._names

    def add(self, packet: Packet) -> None:
        """Take a packet; write it with the waiting ones when it is time."""
        self._waiting.append(packet)
        if self.patience() == 0.0 or sum(len(t) for p in self._waiting for t in p.tables.values()) >= _BYTES:
            self.commit()

    def patience(self) -> float | None:
        """Seconds until the waiting packets should be written; None if none waits."""
        if not self._waiting:
            return None
        now = time.monotonic()
        return max(0.0, self._since + max(_SECONDS, _SHARE * (now - self._began)) - now)

    def commit(self) -> None:
        """Write the waiting packets."""
        if not self._waiting:
            return
        packets, self._waiting = self._waiting, []
        now = time.monotonic()
        described = [
            {"keys": packet.keys, "rows": packet.rows, "sizes": {name: len(t) for name, t in packet.tables.items()}}
            for packet in packets
        ]
        seconds, sources = round(now - self._since, 3), self.sources
        known = {"format": FORMAT, "software": self.software, "seconds": seconds, "note": self.note}
        header = Header.model_validate(known | {"sources": sources, "packets": described})
        line = header.model_dump_json().encode() + b"\n"
        data = b"".join([line, *(table for packet in packets for table in packet.tables.values())])
        path = self._path(data)
        with explained(self.folder.parent):
            self.folder.mkdir(exist_ok=True)
            write(path, data)
        self._since = now
        self._index(path, len(line), header)

    def remove(self) -> None:
        """Remove the files, since their rows are in tables now."""
        with explained(self.folder.parent):
            for path in self._files():
                path.unlink()
            if self.folder.is_dir() and not any(self.folder.iterdir()):
                self.folder.rmdir()
        self._forget()

    def _index(self, path: Path, begin: int, header: Header) -> None:
        """Note the place of each key's rows in a file, whose tables begin after the header."""
        if header.format > FORMAT:
            words = f"made by a newer version of this program ({header.software.get('study', 'unknown')})"
            raise RunError(f"{path}: {words}; update it, or choose another folder with --out")
        if header.format < FORMAT:  # its rows are not used, so it does not count
            return
        self.count += 1
        self.note = self.note or header.note
        self.seconds += header.seconds
        for software in (header.software, *header.sources):
            if software != self.software and software not in self.made_by:
                self.made_by.append(software)
        for packet in header.packets:
            stored: dict[str, _Rows] = {}
            for name, size in packet.sizes.items():
                stored[name] = path, begin, size, [0, *accumulate(packet.rows[name])]
                begin += size
            self._names.update(stored)
            for place, (key, outputs) in enumerate(packet.keys):
                kind = self._kinds.setdefault(outputs, outputs)  # equal tuples are one in memory
                self._where.setdefault(key, []).append((stored, place, kind))

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
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import pyarrow as pa

from study.files import RunError, explained, write

FORMAT = 5
"""Format of parts and tables. Raise it when rows of the same key would change, or files would be read wrongly."""
DAMAGED = "damaged"
Json = dict[str, Any]
"""An object as JSON has it."""
_SUFFIX = ".part"
_BYTES = 32 << 20
_SECONDS = 1.0
_SHARE = 0.01
_SMALL = 1 << 16


@dataclass(frozen=True)
class Packet:
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
    data: bytes = sink.getvalue().to_pybytes()
    return data


Stored = dict[str, tuple[int, int, list[int]]]
"""A packet in a file: for each table the place of its first byte, its size, and the first row of each key."""


@lru_cache(maxsize=2)
def _decoded(path: str, begin: int, size: int) -> pa.Table:
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

    def load(self, set_aside: bool = True) -> None:
        """Read the headers of all files.

        Args:
            set_aside: move damaged files to ``parts/damaged``, so that their rows are computed again.

        Raises:
            RunError: if a part is of a newer version, or cannot be read at all.
        """
        self._forget()
        for name in self._files():
            path = os.path.join(self.folder, name)
            try:
                with open(path, "rb", buffering=0) as file:
                    data = file.readall()
            except FileNotFoundError:  # a run that finishes removes its parts
                continue
            except OSError as error:
                remedy = "make it readable, or remove it: its rows are computed again"
                raise RunError(f"{path}: cannot be read: {error.strerror or error}; {remedy}") from None
            whole = hashlib.sha256(data).hexdigest() == name.removeprefix(f"{self.kind}-").removesuffix(_SUFFIX)
            if whole and (header := _header(data)):
                self._index(path, data, header)
                continue
            self.damaged.append(name)
            if set_aside:
                with explained(Path(path)):
                    (self.folder / DAMAGED).mkdir(exist_ok=True)
                    os.rename(path, self.folder / DAMAGED / name)

    def _files(self) -> list[str]:
        """Names of the files; as strings, since making a `Path` takes as long as reading a small file."""
        if not self.folder.is_dir():
            return []
        with os.scandir(self.folder) as there:
            names = [entry.name for entry in there if entry.is_file()]
        return sorted(name for name in names if name.startswith(f"{self.kind}-") and name.endswith(_SUFFIX))

    def whole(self) -> bool:
        """Read all files again, and set aside those that changed; false if some did."""
        before = len(self.damaged)
        self.load()
        return len(self.damaged) == before

    def _forget(self) -> None:
        self.seconds = 0.0
        self.made_by: list[dict[str, object]] = []
        self.count = 0
        self._where: dict[str, list[tuple[str, Stored, int, tuple[str, ...]]]] = {}
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
        for path, stored, place, outputs in self._where.get(key, ()):
            fresh = tuple(output for output in outputs if output not in before)
            before.update(fresh)
            begin, size, starts = stored.get(name, (0, 0, [0] * (place + 2)))
            if fresh and starts[place + 1] > starts[place]:
                whole = _decoded(path, begin, size)
                yield outputs, fresh, whole.slice(starts[place], starts[place + 1] - starts[place])

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
        header = {
            "format": FORMAT,
            "software": self.software,
            "seconds": round(now - self._since, 3),
            "note": self.note,
            **({"sources": self.sources} if self.sources else {}),
            "packets": [
                {
                    "keys": [[key, list(outputs)] for key, outputs in packet.keys],
                    "rows": {name: list(rows) for name, rows in packet.rows.items()},
                    "sizes": {name: len(table) for name, table in packet.tables.items()},
                }
                for packet in packets
            ],
        }
        line = json.dumps(header, separators=(",", ":")).encode() + b"\n"
        data = b"".join([line, *(table for packet in packets for table in packet.tables.values())])
        path = self.folder / f"{self.kind}-{hashlib.sha256(data).hexdigest()}{_SUFFIX}"
        with explained(self.folder.parent):
            self.folder.mkdir(exist_ok=True)
            write(path, data)
        self._since = now
        self._index(str(path), data, header)

    def remove(self) -> None:
        """Remove the files, since their rows are in tables now."""
        with explained(self.folder.parent):
            for name in self._files():
                os.unlink(self.folder / name)
            if self.folder.is_dir() and not any(self.folder.iterdir()):
                self.folder.rmdir()
        self._forget()

    def _index(self, path: str, data: bytes, header: Json) -> None:
        """Note the place of each key's rows."""
        length = data.index(b"\n") + 1
        if header["format"] > FORMAT:
            words = f"made by a newer version of this program ({header['software'].get('study', 'unknown')})"
            raise RunError(f"{path}: {words}; update it, or choose another folder with --out")
        if header["format"] < FORMAT:  # its rows are not used, so it does not count
            return
        self.count += 1
        self.note = self.note or header["note"]
        self.seconds += header["seconds"]
        for software in (header["software"], *header.get("sources", ())):
            if software != self.software and software not in self.made_by:
                self.made_by.append(software)
        begin = length
        for packet in header["packets"]:
            stored: Stored = {}
            for name, size in packet["sizes"].items():
                stored[name] = (begin, size, [0, *accumulate(packet["rows"][name])])
                begin += size
            self._names.update(stored)
            for place, (key, outputs) in enumerate(packet["keys"]):
                kind = self._kinds.setdefault(tuple(outputs), tuple(outputs))  # equal tuples are one in memory
                self._where.setdefault(key, []).append((path, stored, place, kind))


def _header(data: bytes) -> Json:
    """The first line of a file; empty if no version of this program writes such a line."""
    try:
        header = json.loads(data[: data.index(b"\n")])
    except (ValueError, RecursionError):
        return {}
    kinds: dict[str, type | tuple[type, ...]] = {"format": int, "software": dict}
    if isinstance(header, dict) and header.get("format") == FORMAT:
        kinds |= {"seconds": (int, float), "note": str, "packets": list}
    fine = isinstance(header, dict) and all(isinstance(header.get(name), kind) for name, kind in kinds.items())
    return header if fine else {}

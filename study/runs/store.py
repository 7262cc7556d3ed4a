"""The run folder: the only code that writes a run's files, each under a temporary name, synced, then renamed.

    results/<name>-<digest>/
        config.toml        the config, as it was given
        manifest.json      what was run, on what, how long it took
        parts/             rows of one unit of work each, named by content
        errors.parquet     a row per cell, trial and estimator
        timings.parquet    apart, so that error tables can be compared byte by byte
        points.parquet     points of the trials that the config keeps
        summary.parquet    performance measures with their Monte-Carlo error
        posterior.parquet, answers.parquet, draws.parquet   ensemble posteriors, where the config asks for them

Workers compute and write nothing; the parent commits each unit as it comes back.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from study.experiment.config import Study, load
from study.experiment.design import Unit
from study.experiment.faults import ConfigError
from study.experiment.work import Result
from study.runs import tables

FORMAT = 1
_ROWS_PER_GROUP = 1 << 17


class RunError(Exception):
    """A run folder that cannot be used, or cannot be written; the message says why and what to do."""


class Run:
    """A run's folder on disk.

    Args:
        folder: its path.
        study: the config that it belongs to.
    """

    def __init__(self, folder: Path, study: Study) -> None:
        self.folder = folder
        self.study = study

    @classmethod
    def create(cls, folder: Path, study: Study, config: str) -> "Run":
        """Make a folder for a study, or take the one that is there, if it is of the same config.

        Raises:
            RunError: if it belongs to another config, is a file, or cannot be written.
        """
        with _explained(folder):
            found_folder = folder.exists()
        if found_folder:
            if not folder.is_dir():
                raise RunError(f"{folder}: is a file, not a run folder; choose another with --out")
            if (folder / "config.toml").exists():
                found = cls.open(folder).study
                if found.digest() != study.digest():
                    raise RunError(
                        f"{folder}: holds a run of another config ({found.run_name()}, not {study.run_name()}); "
                        "choose another folder with --out, or remove this one"
                    )
            elif any(folder.iterdir()):
                raise RunError(f"{folder}: is not empty and no run folder; choose another with --out")
        with _explained(folder):
            (folder / "parts").mkdir(parents=True, exist_ok=True)
            write(folder / "config.toml", config.encode())
        return cls(folder, study)

    @classmethod
    def open(cls, folder: Path) -> "Run":
        """Open an existing run.

        Raises:
            RunError: if there is none, or its config cannot be read.
        """
        if not (folder / "config.toml").is_file():
            raise RunError(f"{folder}: not a run folder (no config.toml in it); `study run CONFIG` makes one")
        try:
            return cls(folder, load(folder / "config.toml"))
        except ConfigError as error:
            raise RunError(f"{folder}: its config cannot be read any more: {error}") from None

    def table(self, name: str, columns: list[str] | None = None) -> Any:
        """A stored table as a data frame.

        Raises:
            RunError: if it is not there, because the run did not finish.
        """
        return self._read(name, lambda path: tables.read(path, columns))

    def _read(self, name: str, read: Callable[[Path], Any]) -> Any:
        path = self.folder / f"{name}.parquet"
        if not path.is_file():
            raise RunError(f"{path}: missing; finish the run with `study run {self.folder / 'config.toml'}`")
        try:
            return read(path)
        except (OSError, pa.ArrowInvalid) as error:
            raise RunError(f"{path}: cannot be read: {error}") from None

    def part_path(self, unit: Unit) -> Path:
        """File of a unit's rows, named by all that determines them."""
        shape, estimators = self.study.noise_shape, self.study.estimators
        content = repr((FORMAT, self.study.seed, self.study.dimension, shape, estimators, self.study.keep_points, unit))
        return self.folder / "parts" / f"{hashlib.sha256(content.encode()).hexdigest()[:20]}.parquet"

    def commit(self, unit: Unit, result: Result) -> None:
        """Write a unit's rows."""
        with _explained(self.folder):
            _write_table(self.part_path(unit), tables.table(tables.errors(self.study.dimension), result.errors))

    def finish(self, units: Iterable[Unit], results: Callable[[], Iterator[Result]], software: dict[str, Any]) -> None:
        """Join the parts, in the order of the units, into the run's tables, and remove them.

        The error table's metadata hold the config and the software, but nothing of time, machine or workers, so
        that equal runs are equal to the byte.
        """
        dimension = self.study.dimension
        metadata = {"study.config": self.study.canonical(), "study.software": json.dumps(software)}
        with _explained(self.folder):
            paths = [self.part_path(unit) for unit in units]
            parts = (pq.read_table(path) for path in paths)
            _join(self.folder / "errors.parquet", tables.schema(tables.errors(dimension), metadata), parts)
            timings = (tables.table(tables.TIMINGS, result.timings) for result in results())
            _join(self.folder / "timings.parquet", tables.schema(tables.TIMINGS, metadata), timings)
            if self.study.keep_points:
                columns = tables.points(dimension)
                kept = (tables.table(columns, result.points) for result in results() if result.points)
                _join(self.folder / "points.parquet", tables.schema(columns, metadata), kept)
            for path in paths:
                path.unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                (self.folder / "parts").rmdir()

    def has(self, name: str) -> bool:
        """Whether a table is stored."""
        return (self.folder / f"{name}.parquet").is_file()

    def arrow(self, name: str) -> pa.Table:
        """A stored table as it is on disk; see `table`."""
        return self._read(name, pq.read_table)

    def metadata(self, name: str) -> dict[str, str]:
        """What a stored table says of itself; empty if it is not there or cannot be read."""
        try:
            found = pq.read_schema(self.folder / f"{name}.parquet").metadata
        except (OSError, pa.ArrowInvalid):
            return {}
        return {key.decode(): value.decode() for key, value in (found or {}).items()}

    def has_parts(self, part: str) -> bool:
        """Whether a chain's rows are there."""
        return self._part(part, "posterior").is_file()

    def commit_parts(self, part: str, found: Mapping[str, pa.Table]) -> None:
        """Write a chain's rows, ``posterior`` last: where it is, the others are."""
        with _explained(self.folder):
            (self.folder / "parts").mkdir(exist_ok=True)
            for name in sorted(found, key="posterior".__eq__):
                _write_table(self._part(part, name), found[name])

    def join_parts(
        self, parts: list[str], schemas: Mapping[str, list[tables.Column]], metadata: Mapping[str, str]
    ) -> None:
        """Join the rows of chains, in order, into their tables, and remove them."""
        with _explained(self.folder):
            for name in sorted(schemas, key="posterior".__eq__):
                found = (pq.read_table(self._part(part, name)) for part in parts)
                _join(self.folder / f"{name}.parquet", tables.schema(schemas[name], metadata), found)
            for part in parts:
                for name in schemas:
                    self._part(part, name).unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                (self.folder / "parts").rmdir()

    def _part(self, part: str, name: str) -> Path:
        return self.folder / "parts" / f"{part}.{name}.parquet"

    def save(self, name: str, table: pa.Table) -> None:
        """Write a whole table."""
        with _explained(self.folder):
            _write_table(self.folder / f"{name}.parquet", table)

    def save_manifest(self, manifest: dict[str, Any]) -> None:
        """Write the manifest."""
        with _explained(self.folder):
            write(self.folder / "manifest.json", (json.dumps(manifest, indent=2, ensure_ascii=False) + "\n").encode())

    def manifest(self) -> dict[str, Any]:
        """The manifest.

        Raises:
            RunError: if it is not there, because the run did not finish.
        """
        try:
            found: dict[str, Any] = json.loads((self.folder / "manifest.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            hint = f"finish the run with `study run {self.folder / 'config.toml'}`"
            raise RunError(f"{self.folder / 'manifest.json'}: missing or not readable; {hint}") from None
        return found

    def amend_manifest(self, entries: dict[str, Any]) -> None:
        """Add entries to the manifest, of a run that has one."""
        if (self.folder / "manifest.json").is_file():
            self.save_manifest(self.manifest() | entries)


def write(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    with _replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(data)


def save_frame(frame: pd.DataFrame, path: Path) -> None:
    """Write a data frame to a file of a user's choice, as CSV or parquet by its suffix, whole or not at all.

    Raises:
        RunError: if the suffix is another, or the file cannot be written.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise RunError(f"{path}: give a name that ends in .csv or .parquet")
    with _explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with _replacing(path) as temporary:
            if path.suffix == ".csv":
                frame.to_csv(temporary, index=False)
            else:
                frame.to_parquet(temporary, index=False)


@contextlib.contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """A temporary name in the same folder; synced and renamed at the end, removed on failure."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _write_table(path: Path, table: pa.Table) -> None:
    with _replacing(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")


def _join(path: Path, schema: pa.Schema, parts: Iterable[pa.Table]) -> None:
    """Stream tables into one file, in row groups of equal size whatever the parts' sizes."""
    with _replacing(path) as temporary, pq.ParquetWriter(temporary, schema, compression="zstd") as writer:
        waiting: list[pa.Table] = []
        rows = 0
        for part in parts:
            waiting.append(part.cast(schema.remove_metadata()))
            rows += part.num_rows
            while rows >= _ROWS_PER_GROUP:
                whole = pa.concat_tables(waiting)
                writer.write_table(whole.slice(0, _ROWS_PER_GROUP).combine_chunks())
                waiting = [whole.slice(_ROWS_PER_GROUP)]
                rows -= _ROWS_PER_GROUP
        if rows:
            writer.write_table(pa.concat_tables(waiting).combine_chunks())


@contextlib.contextmanager
def _explained(place: Path) -> Iterator[None]:
    """Turn a failure to write into one clear line."""
    try:
        yield
    except OSError as error:
        raise RunError(f"{place}: cannot be written: {error.strerror or error}; what was finished is kept") from None

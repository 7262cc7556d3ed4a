"""The run folder, and the tables in it.

    results/<name>-<digest>/
        config.toml        the config, as it was given
        manifest.json      config, software, machine, seconds, digests of the tables; written last: it ends a run
        parts/             finished rows of a run that is not finished; see `study.runs.storage.parts`
        errors.parquet     a row per cell, trial and estimator
        failures.parquet   fits that raised an exception or whose worker died, if there are any
        timings.parquet    seconds; a table of its own, so that error tables can be compared byte by byte
        points.parquet     points of the trials that the config keeps
        precision.parquet  number of trials of each cell, and why it has no more, where the config has a [precision]
        summary.parquet    performance measures with their Monte-Carlo error
        posterior.parquet, answers.parquet, draws.parquet   ensemble posteriors, where the config has a [posterior]

Workers compute and write nothing; the parent alone writes, and only while it holds the folder's lock.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from study.experiment.config import Study, load
from study.experiment.config_faults import ConfigError
from study.experiment.replay import locate
from study.runs.storage import schemas
from study.runs.storage.atomic_write import RunError, explained, join, write, write_table
from study.runs.storage.parts import DAMAGED, FORMAT

__all__ = ["Run", "RunError"]

T = TypeVar("T")
Manifest = dict[str, Any]
"""A manifest as JSON has it."""


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
    def create(cls, folder: Path, study: Study) -> "Run":
        """Make a folder for a study, or use the one that is there if it belongs to the same config.

        Raises:
            RunError: if it belongs to another config or a newer version, is a file, or cannot be written.
        """
        with explained(folder):
            found_folder = folder.exists()
        if found_folder:
            if not folder.is_dir():
                raise RunError(f"{folder}: is a file, not a run folder; choose another with --out")
            if (folder / "config.toml").exists():
                found = cls.open(folder)
                found.refuse_newer()
                if found.study.digest() != study.digest():
                    raise RunError(
                        f"{folder}: holds a run of another config ({found.study.run_name()}, not {study.run_name()}); "
                        "choose another folder with --out, or remove this one"
                    )
            elif any(path.name != ".lock" for path in folder.iterdir()):
                raise RunError(f"{folder}: is not empty and no run folder; choose another with --out")
        with explained(folder):
            folder.mkdir(parents=True, exist_ok=True)
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
            own = cls._own_estimators(folder)
            hint = f"\n  it was made with estimators of {own}: give --plugin FILE" if own else ""
            raise RunError(f"{folder}: its config cannot be read any more: {error}{hint}") from None

    @staticmethod
    def _own_estimators(folder: Path) -> str:
        """Names of the files or packages whose estimators a run has, by its manifest; empty if all were shipped."""
        try:
            manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
            return ", ".join(str(entry["from"]) for entry in manifest["own_estimators"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""

    def begin(self, config: str) -> "Run":
        """Store the config's text, remove the temporary files of a killed writer, and return the run."""
        with explained(self.folder):
            for place in (self.folder, self.folder / "parts"):
                for path in place.glob(".*.tmp"):
                    path.unlink()
            path = self.folder / "config.toml"
            if not path.is_file() or path.read_bytes() != config.encode():
                write(path, config.encode())
        return self

    def path(self, name: str) -> Path:
        """File of a table."""
        return self.folder / f"{name}.parquet"

    def has(self, name: str) -> bool:
        """True if a table is stored."""
        return self.path(name).is_file()

    def table(self, name: str, columns: list[str] | None = None) -> pd.DataFrame:
        """Read a stored table into a data frame.

        Raises:
            RunError: if it is not there, because the run did not finish.
        """
        return self.read(name, lambda path: schemas.read(path, columns))

    def cell(self, name: str) -> pd.DataFrame:
        """Read the error table's rows of one cell into a data frame, without the others.

        Args:
            name: the cell's name, or its beginning, as far as no other begins so.

        Raises:
            ReplayError: if there is no such cell.
            RunError: if the run did not finish.
        """
        cell, where = locate(self.study, name)
        # a row group has the range of each column, so that groups without the cell are not read
        rows = [("cell", "==", cell.name), ("trial", ">=", where[0].first), ("trial", "<", where[-1].last)]
        rows += [(c.name, "==", cell.values[c.name]) for c in self.study.conditions()]
        frame: pd.DataFrame = self.read("errors", lambda path: pq.read_table(path, filters=rows)).to_pandas()
        return frame

    def arrow(self, name: str) -> pa.Table:
        """Read a stored table into Arrow's memory; see `table`."""
        table: pa.Table = self.read(name, pq.read_table)
        return table

    def read(self, name: str, read: Callable[[Path], T]) -> T:
        """Read a table's file with a function; see `table`."""
        path = self.path(name)
        if name == "errors" and self.study.keep == "summary":
            raise RunError(
                f'{path}: not stored: the study keeps its summary alone; keep = "errors" in the config stores it'
            )
        if not path.is_file():
            raise RunError(f"{path}: missing; finish the run with `study run {self.folder / 'config.toml'}`")
        try:
            return read(path)
        except (OSError, pa.ArrowInvalid) as error:
            raise RunError(f"{path}: cannot be read: {error}") from None

    def metadata(self, name: str) -> dict[str, str]:
        """Metadata of a stored table; empty if it is not there or cannot be read."""
        try:
            found = pq.read_schema(self.path(name)).metadata
        except (OSError, pa.ArrowInvalid):
            return {}
        return {key.decode(): value.decode() for key, value in (found or {}).items()}

    def fingerprint(self, name: str) -> str | None:
        """SHA-256 of a table's file; None if it is not there."""
        try:
            with open(self.path(name), "rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise RunError(f"{self.path(name)}: cannot be read: {error.strerror or error}") from None

    def save(self, name: str, table: pa.Table) -> None:
        """Write a whole table."""
        with explained(self.folder):
            write_table(self.path(name), table)

    def join(
        self, name: str, columns: list[schemas.Column], parts: Iterable[pa.Table], metadata: Mapping[str, str]
    ) -> None:
        """Write a table from parts, without holding all of them in memory."""
        with explained(self.folder):
            join(self.path(name), schemas.schema(columns, metadata), parts)

    def remove(self, name: str) -> None:
        """Remove a table, if it is there."""
        with explained(self.folder):
            self.path(name).unlink(missing_ok=True)

    def set_aside(self, name: str) -> None:
        """Move a damaged table to ``parts/damaged``."""
        with explained(self.folder):
            if self.has(name):
                (self.folder / "parts" / DAMAGED).mkdir(parents=True, exist_ok=True)
                self.path(name).rename(self.folder / "parts" / DAMAGED / self.path(name).name)

    def save_manifest(self, manifest: Manifest) -> None:
        """Write the manifest."""
        with explained(self.folder):
            write(self.folder / "manifest.json", (json.dumps(manifest, indent=2, ensure_ascii=False) + "\n").encode())

    def manifest(self) -> Manifest:
        """The manifest.

        Raises:
            RunError: if it is not there, because the run did not finish.
        """
        try:
            found = json.loads((self.folder / "manifest.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            found = None
        if not isinstance(found, dict):
            hint = f"finish the run with `study run {self.folder / 'config.toml'}`"
            raise RunError(f"{self.folder / 'manifest.json'}: missing or not readable; {hint}") from None
        return found

    def amend_manifest(self, entries: Manifest) -> None:
        """Add entries to the manifest of a run that has one."""
        if (self.folder / "manifest.json").is_file():
            self.save_manifest(self.manifest() | entries)

    def stopped(self) -> float | None:
        """Seconds of the budget that stopped the run before its end; None if none did."""
        try:
            found = self.manifest().get("stopped_after")
        except RunError:
            return None
        return float(found) if isinstance(found, int | float) else None

    def trials(self) -> dict[str, int]:
        """Number of trials of each cell of an adaptive run, by name; empty while there is no precision table."""
        if not self.has("precision"):
            return {}
        found = self.table("precision", ["cell", "trials"])
        return dict(zip(found["cell"].astype(str), found["trials"].astype(int), strict=True))

    def maker(self) -> dict[str, Any]:
        """The software that finished the run, as `study.runs.provenance.software` has it; empty if it is not known."""
        try:
            found = self.manifest().get("software", {})
        except RunError:
            return {}
        return found if isinstance(found, dict) else {}

    def refuse_newer(self) -> None:
        """Raise a RunError if a newer program finished the run, whose files this one might read wrongly."""
        try:
            found = self.manifest().get("format", 1)
        except RunError:
            return
        if not isinstance(found, int) or found > FORMAT:
            words = f"made by a newer version of this program ({self.maker().get('study', 'unknown')})"
            raise RunError(f"{self.folder}: {words}; update it, or choose another folder with --out")

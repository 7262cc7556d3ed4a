"""The run folder, and the tables in it.

    results/<name>-<digest>/
        config.toml        the config, as it was given
        manifest.json      config, software, machine, seconds, digests of the tables and of itself; ends a run
        parts/             finished rows of a run that is not finished; see `study.simulation.runs.parts`
        own.json           files whose estimators, laws or measures the run has, if any; written when a run begins
        share.json         number of the share, and the software that computes it, if the folder is for a share alone
        errors.parquet     a row per cell, trial and estimator
        failures.parquet   fits that raised an exception or whose worker died, if there are any
        timings.parquet    seconds; a table of its own, so that error tables can be compared byte by byte
        points.parquet     points of the trials that the config keeps
        precision.parquet  number of trials of each cell, and why it has no more, where the config has a [precision]
        summary.parquet    performance measures with their Monte-Carlo error
        posterior.parquet, answers.parquet, draws.parquet   ensemble posteriors, where the config has a [posterior]
        claims.parquet     verdicts on the paper's claims, where `study claims` was given the run first

Workers compute and write nothing; the parent alone writes, and only while it holds the folder's lock. A table is read
only if its digest is the one in the manifest, and its columns are those declared.

The manifest says what was computed, by what, and the digests of the tables and of itself. One that has not its
own digest, or whose fields are not as declared, is damaged: nothing in it is used.
"""

import json
import math
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ValidationError, ValidationInfo, field_validator

from study import files
from study.files import RunError, explained, join, write
from study.fits import ESTIMATORS
from study.fits.registry import origins
from study.simulation.experiment import laws, measures
from study.simulation.experiment.config import Study, load
from study.simulation.runs import schemas
from study.simulation.runs.parts import DAMAGED, FORMAT, Share
from study.toml import ConfigError

if TYPE_CHECKING:
    import pandas as pd


Manifest = dict[str, Any]
"""A manifest as JSON has it."""
NAME = "manifest.json"
SHARE = "share.json"
OWN = "own.json"
DIGEST = "digest"
NO_TRIAL = "its budget ended before any cell had a trial; run `study run` again to resume"
"""Fault of a run that has no rows."""
DERIVED = ("posterior", "answers", "draws", "claims")
"""Tables that are not made from units, and so stay when units are computed again."""


class Maker(BaseModel, strict=True):
    """Software that computed rows, of any version."""

    study: str | None = None
    commit: str | None = None


class Software(Maker):
    """Software of this version; see `study.simulation.runs.provenance.software`."""

    study: str
    commit: str | None
    dirty: bool
    revision: str | None = None
    directory: str | None = None
    python: str
    packages: dict[str, str | None]
    code_generated_for: str


class Machine(BaseModel, strict=True):
    """Machine; see `study.simulation.runs.provenance.machine`."""

    system: str
    processor: str
    cores: int | None
    threads: dict[str, int]


class Begun(BaseModel, strict=True):
    """Fields of every manifest: chains may be stored before the run is finished."""

    format: int
    run: str
    tables: dict[str, str]
    own_estimators: list[dict[str, Any]] | None = None
    own_laws: list[dict[str, object]] | None = None
    own_measures: list[dict[str, object]] | None = None
    measures: dict[str, int | str] = {}
    posterior: dict[str, Any] = {}
    precision: dict[str, int] = {}
    stopped_after: float = math.nan


class Finished(Begun):
    """Fields of the manifest of a finished run."""

    config: dict[str, Any]
    cells: int
    fits: int
    failures: int
    lost: int
    estimators: dict[str, int | str]
    started: str
    seconds_computing: float
    seconds: float
    jobs: int
    backend: str
    software: Software
    also_computed_by: list[Maker]
    machine: Machine

    @field_validator("estimators")
    @classmethod
    def _numbered(cls, versions: dict[str, int | str], info: ValidationInfo) -> dict[str, int | str]:
        """Refuse a version that is no number, unless estimators are a user's own: theirs is a digest of the code."""
        if info.data.get("own_estimators") is None and not all(isinstance(v, int) for v in versions.values()):
            raise ValueError("a shipped estimator's version is a number")
        return versions


class ShareMade(BaseModel, strict=True):
    """Content of a share's file: the share, and the fingerprint of the software that computes its rows."""

    share: str
    fingerprint: dict[str, str | None]


class ManifestMissingError(RunError):
    """A run without a manifest, because it is not finished."""


class ManifestDamagedError(RunError):
    """A manifest that was changed since it was written, or is not as this program writes it."""


class ManifestNewerError(RunError):
    """A manifest that a newer version of this program wrote."""


def _without_digest(content: Manifest) -> Manifest:
    return {key: value for key, value in content.items() if key != DIGEST}


def _own_files(folder: Path) -> list[str]:
    """Files or packages whose estimators, laws or measures a run has, whatever else is wrong in its folder.

    Returns:
        Their names; none if all were shipped, or the folder does not say.
    """
    for place in (OWN, NAME):  # a manifest ends a run; older runs have no other file
        try:
            noted = json.loads((folder / place).read_text(encoding="utf-8"))
            entries = [each for kind in ("estimators", "laws", "measures") for each in noted.get(f"own_{kind}", ())]
            return list(dict.fromkeys(str(entry["from"]) for entry in entries))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
    return []


def _digest_fault(content: object) -> str | None:
    """Compare a manifest with its own digest."""
    if not isinstance(content, dict):
        return "not JSON, or no object"
    if DIGEST not in content:
        return f"no field '{DIGEST}', so that nothing vouches for the tables"
    same = content[DIGEST] == files.of_json(_without_digest(content))
    return None if same else f"its {DIGEST} is not that of its content"


def _field_fault(content: Manifest, keep: str) -> str | None:
    """Find the first field that is missing or of another type; a finished run has its table ``keep``."""
    try:
        tables = Begun.model_validate(content).tables
        if keep in tables or "estimators" in content:
            Finished.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        name, value = ".".join(map(str, first["loc"])), json.dumps(first["input"], default=str)[:40]
        missing, other = f"no field '{name}'", f"{name} = {value} is not as this program writes it"
        return missing if first["type"] == "missing" else other
    return None


T = TypeVar("T")
_TEMPORARY = ".*.tmp"
"""Pattern of the temporary files that a killed writer leaves."""


class Run:
    """A run's folder on disk.

    Args:
        folder: its path.
        study: the config that it belongs to.
    """

    def __init__(self, folder: Path, study: Study) -> None:
        self.folder = folder
        self.study = study
        self._sound: dict[str, tuple[str | None, int]] = {}  # tables that are sound: a page reads a large one often

    @classmethod
    def create(cls, folder: Path, study: Study) -> "Run":
        """Make a folder for a study, or use the one that is there if it belongs to the same config.

        Raises:
            RunError: if it belongs to another config or a newer version, is a file, or cannot be written.
        """
        _refuse_other_names(folder)
        run = cls(folder, study)
        with explained(folder):
            exists = folder.exists()
        if exists and not folder.is_dir():
            raise RunError(f"{folder}: is a file, not a run folder; choose another with --out")
        if exists and (folder / "config.toml").exists():
            run._refuse_another()
        elif exists and any(path.name != ".lock" and not path.match(_TEMPORARY) for path in folder.iterdir()):
            raise RunError(f"{folder}: is not empty and no run folder; choose another with --out")
        with explained(folder):
            folder.mkdir(parents=True, exist_ok=True)
        return run

    def _refuse_another(self) -> None:
        """Raise a RunError if neither the config in the folder nor its manifest is the study's, or that is newer."""
        self.refuse_newer()
        if self.known():
            return  # the config may be damaged; it is written again
        other = self.open(self.folder).study
        if other.digest() != self.study.digest():
            words = f"holds a run of another config ({other.run_name()}, not {self.study.run_name()})"
            raise RunError(f"{self.folder}: {words}; choose another folder with --out, or remove this one")

    @classmethod
    def open(cls, folder: Path) -> "Run":
        """Open an existing run.

        Raises:
            RunError: if there is none, or its config cannot be read.
        """
        _refuse_other_names(folder)
        try:
            is_run = (folder / "config.toml").is_file()
        except OSError as error:
            words = f"cannot be read: {error.strerror or error}; make it readable, or give another folder"
            raise RunError(f"{folder}: {words}") from None
        if not is_run:
            raise RunError(f"{folder}: not a run folder (no config.toml in it); `study run CONFIG` makes one")
        try:
            return cls(folder, load(folder / "config.toml"))
        except ConfigError as error:
            words = "; ".join(line.strip() for line in str(error).splitlines())
            if own := _own_files(folder):
                options = " ".join(f"--plugin {name}" for name in own if name.endswith(".py")) or "--plugin FILE"
                names = f"estimators, laws or measures of {', '.join(own)}"
                raise RunError(f"{folder}: was made with {names}: give {options}") from None
            if "unknown; " in words:
                words = f"{words.partition('unknown; ')[0]}unknown"
                remedy = "give --plugin FILE with the file of your own that registers it"
                raise RunError(f"{folder}: its config cannot be read: {words:.200}; {remedy}") from None
            again = f"`study run CONFIG --out {folder}`, with the config that it was made of, writes it again"
            raise RunError(f"{folder}: its config cannot be read any more: {words}; {again}") from None

    def begin(self, config: str) -> "Run":
        """Store the config's text and what is not shipped, remove a killed writer's temporary files, return the run."""
        with explained(self.folder):
            for place in (self.folder, self.folder / "parts"):
                for path in place.glob(_TEMPORARY):
                    path.unlink()
            path = self.folder / "config.toml"
            if not path.is_file() or path.read_bytes() != config.encode():
                write(path, config.encode())
            if own := self.own_code():
                write(self.folder / OWN, (json.dumps(own, indent=2) + "\n").encode())
        return self

    def share(self) -> tuple[Share, dict[str, str | None]] | None:
        """The share that the folder is for, and the software that computes it; None if it is for a whole run.

        Raises:
            RunError: if its file cannot be read.
        """
        path = self.folder / SHARE
        try:
            made = ShareMade.model_validate_json(path.read_bytes())
            return Share.parse(made.share), made.fingerprint
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            raise RunError(f"{path}: cannot be read; remove the folder, and run the share again") from None

    def save_share(self, share: Share, fingerprint: dict[str, str | None]) -> None:
        """Note that the folder is for a share alone."""
        with explained(self.folder):
            text = ShareMade(share=str(share), fingerprint=fingerprint).model_dump_json(indent=2) + "\n"
            write(self.folder / SHARE, text.encode())

    def path(self, name: str) -> Path:
        """File of a table."""
        return self.folder / f"{name}.parquet"

    def has(self, name: str) -> bool:
        """True if a table is stored."""
        return self.path(name).is_file()

    def table(
        self,
        name: str,
        columns: Collection[str] | None = None,
        estimators: Collection[str] | None = None,
        cells: Collection[str] | None = None,
    ) -> "pd.DataFrame":
        """Read a stored table into a data frame.

        Args:
            name: the table's.
            columns: names of columns, of which those that the table has are read; all if None.
            estimators: names of estimators, whose rows are read; all if None.
            cells: names of cells, likewise.

        Raises:
            RunError: if it is not there, because the run did not finish.
        """
        wanted_rows = {"estimator": estimators, "cell": cells}
        part = [(column, "in", list(names)) for column, names in wanted_rows.items() if names is not None] or None

        def read(path: Path) -> "pd.DataFrame":
            wanted = None if columns is None else [each for each in pq.read_schema(path).names if each in columns]
            # read ahead of a large table into buffers, which are new memory, the columns take twice the time
            table = pq.read_table(path, columns=wanted, filters=part, pre_buffer=False)
            frame: pd.DataFrame = table.to_pandas(split_blocks=True, self_destruct=True)
            return frame

        return self.read(name, read)

    def arrow(self, name: str) -> pa.Table:
        """Read a stored table into Arrow's memory; see `table`."""
        table: pa.Table = self.read(name, pq.read_table)
        return table

    def read(self, name: str, read: Callable[[Path], T]) -> T:
        """Read a table's file with a function; see `table`."""
        path = self.require(name)
        try:
            return read(path)
        except (OSError, pa.ArrowException, ValueError, KeyError) as error:
            words = " ".join(str(error).split())
            raise RunError(f"{path}: cannot be read: {words}; {self.again(name)} makes it again") from None

    def require(self, name: str) -> Path:
        """Give the path of a table that is there and as its manifest says; see `table`."""
        path = self.path(name)
        if name == "errors" and self.study.keep == "summary":
            words = 'the study keeps its summary alone; keep = "errors" in the config stores it'
            raise RunError(f"{path}: not stored: {words}")
        if not path.is_file():
            raise RunError(f"{path}: missing; finish the run with {self.again()}")
        self.check(name)
        return path

    def check(self, name: str) -> None:
        """Raise a RunError unless a stored table has the digest that its manifest says, and the columns declared."""
        path, known = self.path(name), self.manifest()["tables"]
        if name not in known:
            raise RunError(f"{path}: not in {NAME}, so not of this run; {self.again(name)} makes it")
        if fault := self.fault(name, known[name]):
            raise RunError(f"{path}: {fault}; {self.again(name)} makes it again")

    def fault(self, name: str, digest: str | None) -> str | None:
        """The fault of a stored table that should have a digest, and the columns declared; None if it has both.

        A sound table is read once, and again when its file was written or another digest is asked for.
        """
        path = self.path(name)
        stamp = digest, path.stat().st_mtime_ns if path.exists() else 0
        if self._sound.get(name) == stamp:
            return None
        if self.fingerprint(name) != digest:
            return f"damaged: its SHA-256 is not the one in {NAME}"
        declared = schemas.declared(*self.study.columns()).get(name, [])
        try:
            fault = schemas.fault(pq.read_schema(path), declared)
        except (OSError, pa.ArrowException, ValueError) as error:
            return f"cannot be read: {' '.join(str(error).split())}"
        if fault is None:
            self._sound[name] = stamp
        return fault

    def again(self, name: str = "") -> str:
        """The command that makes a table again, or resumes the run."""
        command = ["run", f"{self.folder / 'config.toml'}", "--out"] if name != "claims" else ["claims"]
        return f"`{' '.join(['study', *command, str(self.folder), *self.plugins()])}`"

    def plugins(self) -> list[str]:
        """The options that give the files whose estimators, laws or measures the run has; packages are found anyway."""
        names = dict.fromkeys(str(origin["from"]) for origin in chain(*self.own_code().values()))
        return [word for name in names if name.endswith(".py") for word in ("--plugin", name)]

    def own_code(self) -> dict[str, list[dict[str, object]]]:
        """Origins of the estimators, laws and measures that are not shipped, as a manifest has them."""
        made, own_laws = origins(self.study.estimators), laws.origins(self.study.own_laws())
        own = {"estimators": made, "laws": own_laws, "measures": measures.origins(self.study.measures)}
        return {f"own_{kind}": found for kind, found in own.items() if found}

    def changed_code(self) -> list[str]:
        """Files or packages of a user's own whose code is not that which made the finished run."""
        digests = self._made_by("estimators") | self._made_by("laws") | self._made_by("measures")
        own = chain(*self.own_code().values())
        return list(dict.fromkeys(str(origin["from"]) for origin in own if origin["sha256"] not in digests))

    def _made_by(self, kind: str) -> set[str]:
        """Digests of a user's own code, of a kind, that made the finished run."""
        return {str(origin["sha256"]) for origin in self.known().get(f"own_{kind}") or ()}

    def valid(self, name: str) -> bool:
        """True if a table is stored, and has the digest that its manifest says, and the columns declared."""
        try:
            return self.has(name) and not self.fault(name, self.manifest()["tables"].get(name))
        except RunError:
            return False

    def metadata(self, name: str) -> dict[str, str]:
        """Metadata of a stored table; empty if it is not there or cannot be read."""
        try:
            metadata = pq.read_schema(self.path(name)).metadata or {}
        except (OSError, pa.ArrowInvalid):
            return {}
        return {key.decode(): value.decode() for key, value in metadata.items()}

    def fingerprint(self, name: str) -> str | None:
        """SHA-256 of a table's file; None if it is not there."""
        return files.of_file(self.path(name))

    def _manifest_or_new(self) -> Manifest:
        """The manifest, or the beginning of one if there is none."""
        try:
            return self.manifest()
        except ManifestMissingError:
            return {"format": FORMAT, "run": self.study.run_name(), "tables": {}}

    def record(self, *names: str, **entries: object) -> None:
        """Note the digests of tables, and other entries, in the manifest; one is begun if there is none."""
        known = self._manifest_or_new()
        tables = known["tables"] | {name: self.fingerprint(name) for name in names}
        self.save_manifest(known | entries | {"tables": tables})

    def forget(self, *names: str) -> None:
        """Take tables that are about to be replaced out of the manifest, if there is one."""
        known = self._manifest_or_new()
        if set(names) & set(known["tables"]):
            tables = {name: digest for name, digest in known["tables"].items() if name not in names}
            self.save_manifest(known | {"tables": tables})

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

    def set_aside(self, path: Path) -> None:
        """Move a damaged file to ``parts/damaged``; the manifest still has a table, until it is made again."""
        with explained(self.folder):
            if path.is_file():
                (self.folder / "parts" / DAMAGED).mkdir(parents=True, exist_ok=True)
                path.replace(self.folder / "parts" / DAMAGED / path.name)

    def set_damaged_aside(self, warn: Callable[[str], None]) -> None:
        """Move a damaged manifest and damaged tables to ``parts/damaged``, so that they are made again.

        Args:
            warn: callback for warnings, a line for each file.
        """
        config = self.folder / "config.toml"
        try:
            changed = config.exists() and self.open(self.folder).study.digest() != self.study.digest()
        except RunError:
            changed = True
        if changed:
            warn(f"{config}: not the config that the run was made of; written again")
        try:
            self._manifest_or_new()
        except ManifestDamagedError as error:
            self.set_aside(self.folder / NAME)
            fault = str(error).rsplit("; ", 1)[0]
            warn(f"{fault}; set aside in parts/damaged, and its tables are made again")
        made = ("posterior", "answers", "draws") if self.study.posterior is not None else ()
        for name in DERIVED:  # tables that no manifest vouches for, and that the run will not make again
            if name not in made and name not in self.known().get("tables", {}) and self.has(name):
                words = f"not in {NAME}; set aside in parts/damaged; {self.again(name)} makes it again"
                warn(f"{self.path(name)}: {words}")
                self.set_aside(self.path(name))
        for name in self.damaged():
            ours = name != "claims"  # which may need other runs
            words = "damaged; set aside in parts/damaged" if self.has(name) else "missing"
            warn(f"{self.path(name)}: {words}{', and made again' if ours else f'; {self.again(name)} makes it again'}")
            self.set_aside(self.path(name))
            if not ours:
                self.forget(name)

    def save_manifest(self, content: Manifest) -> None:
        """Write the manifest, with its digest."""
        rest = _without_digest(content)
        text = json.dumps(rest | {DIGEST: files.of_json(rest)}, indent=2, ensure_ascii=False) + "\n"
        with explained(self.folder):
            write(self.folder / NAME, text.encode())

    def manifest(self) -> Manifest:
        """The manifest.

        Raises:
            ManifestMissingError: if it is not there, because the run did not finish.
            ManifestDamagedError: if its digest is not that of its content, it is of another run, or a field is missing
                or of another type.
            ManifestNewerError: if a newer version of this program wrote it.
        """
        path = self.folder / NAME
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise ManifestMissingError(f"{path}: missing; finish the run with {self.again()}") from None
        except OSError as error:
            words = f"cannot be read: {error.strerror or error}; make it readable, or remove it"
            raise RunError(f"{path}: {words}") from None
        except (ValueError, RecursionError):
            content = None
        fault = _digest_fault(content)
        if not fault and isinstance(made := content.get("format"), int) and made > FORMAT:
            software = content.get("software")
            version = software.get("study", "unknown") if isinstance(software, dict) else "unknown"
            words = f"made by a newer version of this program ({version})"
            raise ManifestNewerError(f"{self.folder}: {words}; update it, or choose another folder with --out")
        if fault := fault or _field_fault(content, self.study.keep):
            raise ManifestDamagedError(f"{path}: damaged: {fault}; {self.again()} makes it again")
        if content["run"] != self.study.run_name():
            words = f"damaged: of {content['run']}, where config.toml is of {self.study.run_name()}"
            again = f"`study run CONFIG --out {self.folder}`, with the config that it was made of, mends it"
            raise ManifestDamagedError(f"{path}: {words}; {again}")
        checked: Manifest = content
        return checked

    def known(self) -> Manifest:
        """The manifest; empty if it is missing, damaged, newer or cannot be read."""
        try:
            return self.manifest()
        except RunError:
            return {}

    def facts(self) -> Finished:
        """The manifest of a finished run, field by field; a RunError as `manifest` if the run is not finished."""
        try:
            return Finished.model_validate(self.manifest())
        except ValidationError:  # chains alone are stored
            raise ManifestMissingError(f"{self.folder}: not finished; finish it with {self.again()}") from None

    def damaged(self) -> list[str]:
        """Names of the tables in the manifest that have changed since, are gone, or have other columns."""
        tables = self.known().get("tables", {}).items()
        return [name for name, digest in tables if self.fault(name, digest)]

    def digests(self) -> dict[str, str]:
        """Digests of the tables in the manifest, by name; none of a run that is not finished."""
        manifest = self.known()
        same = set(manifest.get("estimators", ())) == set(self.study.estimators)
        return dict(manifest["tables"]) if manifest.get("format") == FORMAT and same else {}

    def finished(self) -> bool:
        """Tell whether the run is finished and the tables of its units have the digests of its manifest."""
        if self.study.keep not in self.digests() or self.stopped() is not None:
            return False
        return not set(self.damaged()) - {*DERIVED, *({"summary"} - {self.study.keep})}

    def up_to_date(self) -> bool:
        """Tell whether a finished run has nothing left to compute.

        No estimator, no measure and no law of a user's own is newer, and no unit is lost.
        """
        manifest = self.manifest()
        made = manifest["estimators"]
        newest = all(str(made[n]) == str(ESTIMATORS[n].version) for n in made)
        return not manifest["lost"] and newest and self.same_code()

    def same_code(self) -> bool:
        """Tell whether the measures, and the laws of a user's own, are those that a finished run was made by."""
        same = self.known().get("measures", {}) == self.study.measure_versions()
        return same and self._made_by("laws") == {
            str(origin["sha256"]) for origin in laws.origins(self.study.own_laws())
        }

    def stopped(self) -> float | None:
        """Seconds of the budget that stopped the run before its end; None if none did."""
        return self.known().get("stopped_after")

    def trials(self) -> dict[str, int]:
        """Number of trials of each cell of an adaptive run, by name; empty while there is no precision table."""
        if not self.has("precision"):
            return {}
        precision = self.table("precision", ["cell", "trials"])
        return dict(zip(precision["cell"].astype(str), precision["trials"].astype(int), strict=True))

    def maker(self) -> dict[str, object]:
        """The software that finished the run, as `provenance.software` has it; empty if it is not known."""
        return next(iter(self.makers()), {})

    def makers(self) -> list[dict[str, object]]:
        """The software that finished the run, and any other that computed some of its rows; none if it is not known."""
        manifest = self.known()
        return [made for made in (manifest.get("software"), *manifest.get("also_computed_by", [])) if made]

    def refuse_newer(self) -> None:
        """Raise a RunError if a newer program finished the run, whose files this one might read wrongly."""
        try:
            self.manifest()
        except ManifestNewerError:
            raise
        except RunError:
            return


def _refuse_other_names(folder: Path) -> None:
    """Raise a RunError if a folder's path is not UTF-8, since Arrow opens no other files."""
    try:
        os.fspath(folder.absolute()).encode()
    except UnicodeEncodeError:
        raise RunError(f"{folder.absolute()}: this name is not UTF-8, as Arrow needs it; choose another") from None

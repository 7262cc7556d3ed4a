"""Archive of runs: one zip file with tables, schemas, configs, how to rerun, and metadata that machines read."""

import json
import zipfile
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path

from study.analysis.archive import pages
from study.analysis.archive.crate import ArchivedRun, metadata
from study.analysis.verification.verify import verify
from study.runs.finish import budget_message
from study.runs.storage import schemas
from study.runs.storage.atomic_write import RunError, explained, replacing
from study.runs.storage.run_folder import Run

_WHEN = (1980, 1, 1, 0, 0, 0)
"""Time stamp of every file in the archive, so that equal runs make equal archives."""


def archive(runs: Sequence[Run], out: Path) -> Path:
    """Write runs and what is needed to read and repeat them into one zip file.

    Args:
        runs: finished runs, each of another config.
        out: the file, which ends in .zip.

    Returns:
        The file.

    Raises:
        RunError: if a run is not finished, or its budget stopped it, or a table is missing or damaged (the message has
            the command that mends it); if two runs have one name; or if the file cannot be written.
    """
    if out.suffix != ".zip":
        raise RunError(f"{out}: give a name that ends in .zip")
    names = [run.study.run_name() for run in runs]
    for name in names:
        if names.count(name) > 1:
            raise RunError(f"{name}: given twice; an archive has a run once")
    found = [_archived(run) for run in runs]
    texts = {
        "README.md": pages.readme(found),
        "ADEMP.md": pages.ademp(found),
        "CITATION.cff": citation(),
        "codemeta.json": _json(pages.codemeta(found)),
        **{f"configs/{run.name}.toml": run.config for run in found},
        **{f"schemas/{run.name}.json": _json(_schemas(run)) for run in found},
    }
    sizes = {name: len(text.encode()) for name, text in texts.items()}
    texts = {"ro-crate-metadata.json": _json(metadata(found, sizes)), **texts}
    with explained(out, of_run=False):
        out.parent.mkdir(parents=True, exist_ok=True)
        with replacing(out) as temporary, zipfile.ZipFile(temporary, "w") as file:
            for name, text in texts.items():
                file.writestr(_entry(name), text, zipfile.ZIP_DEFLATED)
            for run in found:
                for path in run.files:
                    _copy(file, path, f"runs/{run.name}/{path.name}")
    return out


def _archived(run: Run) -> ArchivedRun:
    """Check that a run's tables are as they were written, and return it for the archive."""
    if (stopped := budget_message(run)) is not None:  # the config alone would compute other tables
        raise RunError(stopped)
    checked = verify(run, share=0.0)
    if checked.faults:
        raise RunError(checked.faults[0])
    stored = sorted(run.manifest()["tables"])
    for name in stored:
        run.check(name)
    files = [run.folder / "config.toml", run.folder / "manifest.json", *(run.path(name) for name in stored)]
    text = (run.folder / "config.toml").read_text(encoding="utf-8")
    return ArchivedRun(run.study.run_name(), run.study, run.manifest(), text, stored, files)


def _copy(file: zipfile.ZipFile, path: Path, name: str) -> None:
    """Copy a file into the archive in pieces; tables are compressed already."""
    kind = zipfile.ZIP_STORED if path.suffix == ".parquet" else zipfile.ZIP_DEFLATED
    entry = _entry(name)
    entry.compress_type, entry.file_size = kind, path.stat().st_size
    with open(path, "rb") as source, file.open(entry, "w") as target:
        while piece := source.read(1 << 20):
            target.write(piece)


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _WHEN)
    entry.external_attr = 0o644 << 16
    return entry


def _schemas(run: ArchivedRun) -> dict[str, list[dict[str, str]]]:
    """Columns of each table: name, type, unit and meaning."""
    declared = schemas.declared(run.study.dimension, run.study.conditions())
    return {
        name: [
            {"name": column.name, "type": str(column.type), "unit": column.unit, "meaning": column.meaning}
            for column in declared.get(name, [])
        ]
        for name in run.tables
    }


def citation() -> str:
    """Text of CITATION.cff, which stands in the package, or in a checkout beside it."""
    package = Path(str(resources.files("study")))
    path = next(each / "CITATION.cff" for each in (package, package.parent) if (each / "CITATION.cff").is_file())
    return path.read_text(encoding="utf-8")


def _json(content: object) -> str:
    return json.dumps(content, ensure_ascii=False, indent=2) + "\n"


def printed(runs: Sequence[Run], out: Path) -> Iterator[str]:
    """The archive in words."""
    with zipfile.ZipFile(out) as file:
        entries = file.infolist()
    size = sum(entry.file_size for entry in entries) / 1e6
    count = "1 run" if len(runs) == 1 else f"{len(runs)} runs"
    yield f"{out}: {count}, {len(entries)} files, {size:.1f} MB unpacked"

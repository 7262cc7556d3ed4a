"""Metadata of an archive: RO-Crate 1.1 with the profile of process runs, one action for each run."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from study.experiment.config import Study
from study.runs.storage.manifest import Manifest

Entity = dict[str, Any]

LICENCE = "https://spdx.org/licenses/BSD-3-Clause"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
CRATE = "https://w3id.org/ro/crate/1.1"
PARQUET = "application/vnd.apache.parquet"
_KINDS = {".md": "text/markdown", ".cff": "text/yaml", ".json": "application/json", ".toml": "application/toml"}
_WORDS = {
    "README.md": "How to read the tables, and how to compute them again",
    "ADEMP.md": "The studies by aims, data, estimands, methods and performance measures",
    "CITATION.cff": "How to cite the software and the paper",
    "codemeta.json": "Metadata of the software",
}


class ArchivedRun(NamedTuple):
    """A run that is archived.

    Attributes:
        name: of the run.
        study: its config.
        manifest: its manifest.
        config: the config's text.
        tables: names of its tables.
        files: their files, with those of the config and the manifest.
    """

    name: str
    study: Study
    manifest: Manifest
    config: str
    tables: list[str]
    files: list[Path]


def metadata(runs: Sequence[ArchivedRun], texts: Mapping[str, int]) -> Entity:
    """The content of ro-crate-metadata.json.

    Args:
        runs: the runs.
        texts: names of the other files that the archive has, with their sizes in bytes.

    Returns:
        A JSON-LD object.
    """
    files = [_text(name, size) for name, size in texts.items()]
    actions: list[Entity] = []
    software: dict[str, Entity] = {}
    for run in runs:
        tool = _software(run)
        software[tool["@id"]] = tool
        files += _run_files(run)
        actions.append(_action(run, tool["@id"]))
    names = ", ".join(run.name for run in runs)
    root = {
        "@id": "./",
        "@type": "Dataset",
        "conformsTo": {"@id": PROFILE},
        "name": f"Monte-Carlo study of sphere fits: {names}",
        "description": "Runs of sphere-fit-study: tables, their schemas, configs, provenance, and how to rerun them.",
        "datePublished": max(str(run.manifest["started"]) for run in runs)[:10],
        "license": {"@id": LICENCE},
        "hasPart": [{"@id": each["@id"]} for each in files],
        "mentions": [{"@id": each["@id"]} for each in actions],
    }
    about = {
        "@id": "ro-crate-metadata.json",
        "@type": "CreativeWork",
        "conformsTo": {"@id": CRATE},
        "about": {"@id": "./"},
    }
    profile = {"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
    licence = {"@id": LICENCE, "@type": "CreativeWork", "name": "BSD 3-Clause", "url": LICENCE}
    graph = [about, root, profile, licence, *software.values(), *actions, *files]
    return {"@context": [f"{CRATE}/context", "https://w3id.org/ro/terms/workflow-run/context"], "@graph": graph}


def _text(name: str, size: int) -> Entity:
    words = _WORDS.get(name, "Config of a study" if name.startswith("configs/") else "Columns of a run's tables")
    kind = _KINDS[Path(name).suffix]
    return {"@id": name, "@type": "File", "name": words, "encodingFormat": kind, "contentSize": str(size)}


def _run_files(run: ArchivedRun) -> list[Entity]:
    """An entity for each file of a run; tables have their digests."""
    found = []
    for path in run.files:
        entity = {
            "@id": f"runs/{run.name}/{path.name}",
            "@type": "File",
            "name": f"{path.stem} of {run.name}",
            "encodingFormat": PARQUET if path.suffix == ".parquet" else _KINDS[path.suffix],
            "contentSize": str(path.stat().st_size),
        }
        if path.stem in run.tables:
            entity["sha256"] = run.manifest["tables"][path.stem]
        found.append(entity)
    return found


def _action(run: ArchivedRun, software: str) -> Entity:
    """The computation of a run."""
    start = datetime.fromisoformat(str(run.manifest["started"]))
    end = start + timedelta(seconds=float(run.manifest["seconds"]))
    return {
        "@id": f"#run-{run.name}",
        "@type": "CreateAction",
        "name": f"study run {run.name}",
        "description": f"{run.manifest['fits']} fits in {run.manifest['cells']} cells",
        "startTime": start.isoformat(timespec="seconds"),
        "endTime": end.isoformat(timespec="seconds"),
        "actionStatus": "http://schema.org/CompletedActionStatus",
        "instrument": {"@id": software},
        "object": {"@id": f"configs/{run.name}.toml"},
        "result": [{"@id": f"runs/{run.name}/{name}.parquet"} for name in run.tables],
    }


def _software(run: ArchivedRun) -> Entity:
    """The program that computed a run, in its version."""
    made_by = run.manifest["software"]
    version = str(made_by["study"])
    commit = str(made_by.get("commit") or "")
    packages = {"python": made_by["python"], **made_by["packages"]}
    return {
        "@id": f"#sphere-fit-study-{version}-{commit[:10] or 'unknown'}",
        "@type": "SoftwareApplication",
        "name": "sphere-fit-study",
        "description": f"Commit {commit or 'unknown'}; with " + ", ".join(f"{k} {v}" for k, v in packages.items()),
        "softwareVersion": version,
        "license": {"@id": LICENCE},
    }

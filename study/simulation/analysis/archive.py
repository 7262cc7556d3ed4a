"""Archive of runs: one zip file with tables, schemas, configs, how to rerun, and metadata that machines read.

People read how to rerun and the studies by ADEMP. Machines read CodeMeta, and RO-Crate 1.1 with the profile of process
runs, one action for each run.
"""

import json
import math
import shutil
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from study.files import RunError, explained, replacing
from study.fits.registry import ESTIMATORS
from study.simulation.analysis.verify import Verification
from study.simulation.experiment.conditions import CONDITIONS, DIRECTIONS, LAW, OUTLIER_SHARE
from study.simulation.experiment.config import Study
from study.simulation.runs import schemas
from study.simulation.runs.run_folder import Run
from study.simulation.runs.runner import budget_message
from study.simulation.statistics import PERFORMANCE

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


def name_of(run: Run) -> str:
    """Name of a run within the archive."""
    return run.study.run_name()


def tables_of(run: Run) -> list[str]:
    """Names of a run's tables."""
    return sorted(run.manifest()["tables"])


def files_of(run: Run) -> list[Path]:
    """A run's files that are archived: config, manifest, tables."""
    return [run.folder / "config.toml", run.folder / "manifest.json", *map(run.path, tables_of(run))]


def config_of(run: Run) -> str:
    """Text of a run's config."""
    return (run.folder / "config.toml").read_text(encoding="utf-8")


def metadata(runs: Sequence[Run], texts: Mapping[str, int]) -> Entity:
    """The content of ro-crate-metadata.json.

    Args:
        runs: the runs.
        texts: names of the other files that the archive has, with their sizes in bytes.

    Returns:
        A JSON-LD object.
    """
    files = []
    for name, size in texts.items():
        what = _WORDS.get(name, "Config of a study" if name.startswith("configs/") else "Columns of a run's tables")
        files.append(_file(name, what, _KINDS[Path(name).suffix], size))
    tools = [_software(run) for run in runs]
    software = {tool["@id"]: tool for tool in tools}
    actions = [_action(run, tool["@id"]) for run, tool in zip(runs, tools, strict=True)]
    for run in runs:
        files += _run_files(run)
    names = ", ".join(map(name_of, runs))
    root = {
        "@id": "./",
        "@type": "Dataset",
        "conformsTo": {"@id": PROFILE},
        "name": f"Monte-Carlo study of sphere fits: {names}",
        "description": "Runs of sphere-fit-study: tables, their schemas, configs, provenance, and how to rerun them.",
        "datePublished": max(str(run.manifest()["started"]) for run in runs)[:10],
        "license": {"@id": LICENCE},
        "hasPart": [{"@id": entity["@id"]} for entity in files],
        "mentions": [{"@id": entity["@id"]} for entity in actions],
    }
    about = {"@id": "ro-crate-metadata.json", "@type": "CreativeWork", "conformsTo": {"@id": CRATE}}
    about["about"] = {"@id": "./"}
    profile = {"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
    licence = {"@id": LICENCE, "@type": "CreativeWork", "name": "BSD 3-Clause", "url": LICENCE}
    graph = [about, root, profile, licence, *software.values(), *actions, *files]
    return {"@context": [f"{CRATE}/context", "https://w3id.org/ro/terms/workflow-run/context"], "@graph": graph}


def _file(name: str, what: str, kind: str, size: int) -> Entity:
    return {"@id": name, "@type": "File", "name": what, "encodingFormat": kind, "contentSize": str(size)}


def _run_files(run: Run) -> list[Entity]:
    """An entity for each file of a run; tables have their digests."""
    digests, result = run.manifest()["tables"], []
    for path in files_of(run):
        kind = PARQUET if path.suffix == ".parquet" else _KINDS[path.suffix]
        name, what = f"runs/{name_of(run)}/{path.name}", f"{path.stem} of {name_of(run)}"
        digest = {"sha256": digests[path.stem]} if path.stem in digests else {}
        result.append(_file(name, what, kind, path.stat().st_size) | digest)
    return result


def _action(run: Run, software: str) -> Entity:
    """The computation of a run."""
    name, manifest = name_of(run), run.manifest()
    start = datetime.fromisoformat(str(manifest["started"]))
    end = start + timedelta(seconds=float(manifest["seconds"]))
    return {
        "@id": f"#run-{name}",
        "@type": "CreateAction",
        "name": f"study run {name}",
        "description": f"{manifest['fits']} fits in {manifest['cells']} cells",
        "startTime": start.isoformat(timespec="seconds"),
        "endTime": end.isoformat(timespec="seconds"),
        "actionStatus": "http://schema.org/CompletedActionStatus",
        "instrument": {"@id": software},
        "object": {"@id": f"configs/{name}.toml"},
        "result": [{"@id": f"runs/{name}/{table}.parquet"} for table in tables_of(run)],
    }


def _software(run: Run) -> Entity:
    """The program that computed a run, in its version."""
    made_by = run.manifest()["software"]
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
        **_identified(made_by),
    }


def _identified(software: Mapping[str, Any]) -> Entity:
    """Software Heritage identifiers of the commit and its tree, if the run knows them and no change was uncommitted."""
    known = [software[key] for key in ("revision", "directory") if software.get(key) and not software["dirty"]]
    return {"identifier": known} if known else {}


_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent, encoding="utf-8"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def readme(runs: Sequence[Run]) -> str:
    """Instructions to read the tables, and to compute them again."""
    software = runs[0].manifest()["software"]
    identifiers = _identified(software).get("identifier", [])
    return _TEMPLATES.get_template("archive-readme.md").render(runs=runs, software=software, identifiers=identifiers)


def ademp(runs: Sequence[Run]) -> str:
    """The studies by aims, data-generating mechanisms, estimands, methods and performance measures."""
    studies = [(run, _words(run)) for run in runs]
    return _TEMPLATES.get_template("archive-ademp.md").render(studies=studies, measures=PERFORMANCE)


_MEDIAN_VARIANCES = (0.316, 1.36)
"""n times the squared relative error of a median of n trials, for |z| of a normal z in three dimensions and in one."""


def _words(run: Run) -> dict[str, object]:
    """Words of the page by ADEMP about a run, besides numbers of its config and manifest."""
    study = run.study
    comments = [line.lstrip("# ") for line in config_of(run).splitlines() if line.startswith("#")]
    low, high = (math.sqrt(variance / study.design.trials) for variance in _MEDIAN_VARIANCES)  # n = v/e²
    return {
        "aims": comments[0] if comments else "As the config says.",
        "directions": "by its law" if DIRECTIONS.name in study.design.given() else "uniform",
        "noise": _noise(study),
        "conditions": _conditions(run),
        "precision": f"{low:.1%} to {high:.1%}",
        "methods": [f"`{name}` ({ESTIMATORS[name].reference})" for name in study.estimators],
    }


def _noise(study: Study) -> str:
    """The law of the noise z."""
    given = study.design.given()
    if study.noise_shape is not None:
        rows = ", ".join(f"[{_values(list(row))}]" for row in study.noise_shape)
        words = f"z normal with the covariance [{rows}]"
    else:
        words = "z of covariance I, by the law of the noise" if LAW.name in given else "z normal"
        words += " (radial: along u alone)" if "radial" in str(given.get(LAW.name)) else ""
    outliers = "; some samples are outliers, displaced in a random direction" if OUTLIER_SHARE.name in given else ""
    return words + outliers


def _conditions(run: Run) -> str:
    """The conditions of a design as its manifest has them."""
    design = run.manifest()["config"]["design"]
    given = {name: value for name, value in design.items() if name in CONDITIONS and value is not None}
    words = "; ".join(f"{CONDITIONS[name].symbol}: {_values(value)}" for name, value in given.items())
    return f"{'Every combination' if design['kind'] == 'grid' else 'Each trial draws its own conditions'}: {words}."


def _values(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {entry}" for key, entry in value.items())
    values = value if isinstance(value, list) else [value]
    return ", ".join(f"{v:g}" if isinstance(v, float) and values is value else str(v) for v in values)


def codemeta(runs: Sequence[Run]) -> dict[str, object]:
    """CodeMeta 3.0 of the software that computed the runs."""
    software = runs[0].manifest()["software"]
    return {
        "@context": "https://w3id.org/codemeta/3.0",
        "@type": "SoftwareSourceCode",
        "name": "sphere-fit-study",
        "description": "Monte-Carlo study of closed-form sphere fits (Knight & Semwal 2009), and the fits as a library",
        "version": software["study"],
        "license": LICENCE,
        "programmingLanguage": {"@type": "ComputerLanguage", "name": "Python", "version": software["python"]},
        "softwareRequirements": [f"{name}=={version}" for name, version in software["packages"].items()],
        "author": [{"@type": "Organization", "name": "The sphere-fit-study authors"}],
        **_identified(software),
    }


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
    names = list(map(name_of, runs))
    for name, run in zip(names, runs, strict=True):
        if names.count(name) > 1:
            raise RunError(f"{name}: given twice; an archive has a run once")
        if (stopped := budget_message(run)) is not None:  # the config alone would compute other tables
            raise RunError(stopped)
        if faults := Verification(run, share=0.0).faults:
            raise RunError(faults[0])
        for table in run.manifest()["tables"]:  # one that this version does not know, too
            run.check(table)
    texts = {
        "README.md": readme(runs),
        "ADEMP.md": ademp(runs),
        "CITATION.cff": citation(),
        "codemeta.json": _json(codemeta(runs)),
        **{f"configs/{name_of(run)}.toml": config_of(run) for run in runs},
        **{f"schemas/{name_of(run)}.json": _json(_schemas(run)) for run in runs},
    }
    sizes = {name: len(text.encode()) for name, text in texts.items()}
    texts = {"ro-crate-metadata.json": _json(metadata(runs, sizes)), **texts}
    with explained(out, of_run=False):
        out.parent.mkdir(parents=True, exist_ok=True)
        with replacing(out) as temporary, zipfile.ZipFile(temporary, "w") as file:
            for name, text in texts.items():
                file.writestr(_entry(name), text, zipfile.ZIP_DEFLATED)
            for run in runs:
                for path in files_of(run):
                    _copy(file, path, f"runs/{name_of(run)}/{path.name}")
    return out


def _copy(file: zipfile.ZipFile, path: Path, name: str) -> None:
    """Copy a file into the archive in pieces; tables are compressed already."""
    kind = zipfile.ZIP_STORED if path.suffix == ".parquet" else zipfile.ZIP_DEFLATED
    entry = _entry(name)
    entry.compress_type, entry.file_size = kind, path.stat().st_size
    with open(path, "rb") as source, file.open(entry, "w") as target:
        shutil.copyfileobj(source, target)


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _WHEN)
    entry.external_attr = 0o644 << 16
    return entry


def _schemas(run: Run) -> dict[str, list[dict[str, str]]]:
    """Columns of each table: name, type, unit and meaning."""
    declared = schemas.declared(*run.study.columns())
    return {
        name: [{field: str(value) for field, value in column._asdict().items()} for column in declared.get(name, [])]
        for name in tables_of(run)
    }


def citation() -> str:
    """Text of CITATION.cff, which stands in the package, or in a checkout beside it."""
    package = Path(str(resources.files("study")))
    path = next(p / "CITATION.cff" for p in (package, package.parent) if (p / "CITATION.cff").is_file())
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

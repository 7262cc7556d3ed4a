"""Pages of an archive for people: how to rerun, the studies by ADEMP; and CodeMeta for machines."""

from collections.abc import Sequence

from study.analysis.archive.crate import LICENCE, ArchivedRun
from study.estimators.registry import ESTIMATORS
from study.experiment.conditions import CONDITIONS, LAW, OUTLIER_SHARE
from study.experiment.config import Study
from study.statistics.performance import MEASURES

_PERFORMANCE = (
    "; ".join(
        f"`{name}`: {measure.meaning}" for name, measure in MEASURES.items() if not name.endswith(("_ok", "_all"))
    )
    + ". A name with `_ok` is of the estimator's own ok fits alone, which are other trials for each estimator; one with"
    " `_all` counts fits that are not ok as infinitely wrong. Each measure has its Monte-Carlo standard"
    " error in the column `…_error`. No data set is drawn again."
)


def readme(runs: Sequence[ArchivedRun]) -> str:
    """Instructions to read the tables, and to compute them again."""
    first = runs[0]
    packages = first.manifest["software"]["packages"]
    pinned = "\n".join(f"    {name}=={version}" for name, version in packages.items())
    rows = "\n".join(
        f"| `runs/{run.name}` | `configs/{run.name}.toml` | {run.manifest['fits']:,} | {', '.join(run.tables)} |"
        for run in runs
    )
    python = first.manifest["software"]["python"]
    version, commit = first.manifest["software"]["study"], first.manifest["software"].get("commit") or "unknown"
    return f"""# Runs of sphere-fit-study

| run | config | fits | tables |
| --- | --- | --- | --- |
{rows}

Tables are Apache Parquet; `schemas/` says what each column is, in which unit. `manifest.json` of each run has the
SHA-256 of its tables, the software, the machine and the times. `ADEMP.md` describes the studies, `CITATION.cff` says
what to cite, and `ro-crate-metadata.json` has all of this for machines (RO-Crate 1.1, Process Run Crate).

## Compute them again

Install sphere-fit-study {version} (commit {commit}) with Python {python} and these packages:

{pinned}

Then, in this folder,

    study verify runs/{first.name}                                          # digests, and a share computed again
    study run configs/{first.name}.toml --out again/{first.name}
    study diff runs/{first.name} again/{first.name}

compute the run again. The tables `errors` and `summary` have the same digests, on any number of workers. (A
table names the commit that made it: another commit gives another digest, and `study diff` says if the numbers are equal
to the bit.) `timings` has the seconds of another time. A run with estimators of one's own needs
`--plugin FILE`; its manifest names the file.
"""


def ademp(runs: Sequence[ArchivedRun]) -> str:
    """The studies by aims, data-generating mechanisms, estimands, methods and performance measures."""
    parts = [
        "# The studies by ADEMP",
        "Aims, data-generating mechanisms, estimands, methods and performance measures, as Morris, White & Crowther\n"
        "(Statistics in Medicine 38 (2019) 2074-2102) ask of simulation studies.",
    ]
    for run in runs:
        study = run.study
        comments = [line.lstrip("# ") for line in run.config.splitlines() if line.startswith("#")]
        trials = getattr(study.design, "trials", None)
        data = f"Points on a sphere in {study.dimension} dimensions, x = c + r u + σ z: u uniform on a cap, "
        parts += [
            f"## {run.name}",
            "**Aims.** " + (comments[0] if comments else "As the config says."),
            f"**Data.** {data}{_noise(study)}. {_conditions(run)} Trials: {trials:,}. Seed: {study.seed}.",
            "**Estimands.** The centre c; radius and noise beside it.",
            "**Methods.** " + "; ".join(f"`{name}` ({_reference(name)})" for name in study.estimators) + ".",
            f"**Performance.** {_PERFORMANCE} {run.manifest['failures']:,} of {run.manifest['fits']:,} fits raised.",
        ]
    return "\n\n".join(parts) + "\n"


def _reference(name: str) -> str:
    return ESTIMATORS[name].reference if name in ESTIMATORS else "the user's own"


def _noise(study: Study) -> str:
    """The law of the noise z."""
    given = study.design.given()
    if study.noise_shape is not None:
        rows = ", ".join(f"[{_values(list(row))}]" for row in study.noise_shape)
        words = f"z normal with the covariance [{rows}]"
    else:
        words = "z of covariance I, by the law of the noise" if LAW.name in given else "z normal"
    outliers = "; some samples are outliers, displaced in a random direction" if OUTLIER_SHARE.name in given else ""
    return words + outliers


def _conditions(run: ArchivedRun) -> str:
    """The conditions of a design as its manifest has them."""
    design = run.manifest["config"]["design"]
    given = {name: value for name, value in design.items() if name in CONDITIONS and value is not None}
    words = "; ".join(f"{CONDITIONS[name].symbol}: {_values(value)}" for name, value in given.items())
    return f"{'Every combination' if design['kind'] == 'grid' else 'Each trial draws its own conditions'}: {words}."


def _values(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {each}" for key, each in value.items())
    return (
        ", ".join(f"{each:g}" if isinstance(each, float) else str(each) for each in value)
        if isinstance(value, list)
        else str(value)
    )


def codemeta(runs: Sequence[ArchivedRun]) -> dict[str, object]:
    """CodeMeta 3.0 of the software that computed the runs."""
    software = runs[0].manifest["software"]
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
    }

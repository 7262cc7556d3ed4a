"""Completeness of a run: its tables are as its manifest says, and nothing is left to compute."""

from study.runs.jobs import output
from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import FORMAT
from study.runs.storage.run_folder import Run

DERIVED = ("posterior", "answers", "draws", "claims")
"""Tables that are not made from units, and so stay when units are computed again."""


def finished(run: Run) -> bool:
    """Tell whether a run is finished and the tables of its units have the digests of its manifest."""
    if run.study.keep not in digests(run) or run.stopped() is not None:
        return False
    apart = {*DERIVED, *({"summary"} - {run.study.keep})}
    return not set(damaged(run)) - apart


def damaged(run: Run) -> list[str]:
    """Names of the tables in a run's manifest that have changed since, are gone, or have other columns."""
    try:
        tables = run.manifest()["tables"]
    except RunError:
        return []
    return [name for name, digest in tables.items() if run.fingerprint(name) != digest or run.column_fault(name)]


def digests(run: Run) -> dict[str, str]:
    """Digests of the tables in a run's manifest, by name; none of a run that is not finished."""
    try:
        manifest = run.manifest()
    except RunError:
        return {}
    known = manifest["format"] == FORMAT and set(manifest.get("estimators", ())) == set(run.study.estimators)
    return dict(manifest["tables"]) if known else {}


def up_to_date(run: Run) -> bool:
    """Tell whether a finished run has nothing left to compute: no estimator is newer, and no unit lost its worker."""
    manifest = run.manifest()
    return not manifest["lost"] and all(f"{n}@{v}" == output(n) for n, v in manifest["estimators"].items())

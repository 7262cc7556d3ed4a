"""Completeness of a run: its tables are as its manifest says, and nothing is left to compute."""

from study.runs.jobs import output
from study.runs.storage.atomic_write import RunError
from study.runs.storage.parts import FORMAT
from study.runs.storage.run_folder import Run


def finished(run: Run) -> bool:
    """Tell whether a run is finished and its tables have the digests of its manifest."""
    return run.study.keep in digests(run) and run.stopped() is None and not damaged(run)


def damaged(run: Run) -> list[str]:
    """Names of a finished run's tables whose bytes have changed since they were written."""
    return [name for name, digest in digests(run).items() if run.fingerprint(name) != digest]


def digests(run: Run) -> dict[str, str]:
    """Digests of the tables in a run's manifest, by name; none of a run that is not finished."""
    try:
        manifest = run.manifest()
        known = manifest["format"] == FORMAT and set(manifest["estimators"]) == set(run.study.estimators)
        return dict(manifest["tables"]) if known else {}
    except (RunError, KeyError, TypeError, ValueError):
        return {}


def up_to_date(run: Run) -> bool:
    """Tell whether a finished run has nothing left to compute: no estimator is newer, and no unit lost its worker."""
    manifest = run.manifest()
    return not manifest["lost"] and all(f"{n}@{v}" == output(n) for n, v in manifest["estimators"].items())

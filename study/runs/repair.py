"""Repair of a run's folder: damaged files are named and set aside, so that they are made again."""

from collections.abc import Callable

from study.runs.completeness import DERIVED, damaged
from study.runs.storage.atomic_write import RunError
from study.runs.storage.manifest import NAME
from study.runs.storage.run_folder import Run


def set_damaged_aside(run: Run, warn: Callable[[str], None]) -> None:
    """Move a damaged manifest and damaged tables to ``parts/damaged``.

    Args:
        run: the run, whose lock is held.
        warn: callback for warnings, a line for each file.
    """
    config = run.folder / "config.toml"
    try:
        changed = config.exists() and Run.open(run.folder).study.digest() != run.study.digest()
    except RunError:
        changed = True
    if changed:
        warn(f"{config}: not the config that the run was made of; written again")
    if (fault := run.set_manifest_aside()) is not None:
        warn(f"{fault}; set aside in parts/damaged, and its tables are made again")
    for name in _unknown(run):
        warn(f"{run.path(name)}: not in {NAME}; set aside in parts/damaged; {run.again(name)} makes it again")
        run.set_aside(name)
    for name in damaged(run):
        ours = name != "claims"  # which may need other runs
        words = "damaged; set aside in parts/damaged" if run.has(name) else "missing"
        warn(f"{run.path(name)}: {words}{', and made again' if ours else f'; {run.again(name)} makes it again'}")
        run.set_aside(name)
        if not ours:
            run.forget(name)


def _unknown(run: Run) -> list[str]:
    """Tables that no manifest vouches for, and that the run will not make again."""
    try:
        known = run.manifest()["tables"]
    except RunError:
        known = {}
    made = ("posterior", "answers", "draws") if run.study.posterior is not None else ()
    return [name for name in DERIVED if name not in made and name not in known and run.has(name)]

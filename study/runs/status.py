"""Status of a run, found without changing it."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from study.experiment.config import Study
from study.experiment.units import spans
from study.runs.adaptive.checkpoint_rounds import Rounds
from study.runs.adaptive.group_progress import CAP, TARGET
from study.runs.completeness import damaged, finished, up_to_date
from study.runs.jobs import Jobs
from study.runs.layout import Layout
from study.runs.provenance import described, other_version
from study.runs.reuse import ReuseLayout
from study.runs.storage.atomic_write import RunError
from study.runs.storage.lock import holder
from study.runs.storage.manifest import ManifestDamagedError
from study.runs.storage.parts import DAMAGED, Parts
from study.runs.storage.run_folder import Run
from study.text.columns import columns


def printed(folder: Path) -> Iterator[str]:
    """Lines about the status of a run, for a terminal.

    Args:
        folder: the run's.

    Raises:
        RunError: if there is no run, or it is of a newer version.
    """
    run = Run.open(folder)
    run.refuse_newer()
    parts = Parts(folder, "units")
    parts.load(set_aside=False)
    yield f"{run.study.run_name()}: {_state(run, parts)}"
    yield from columns(_facts(run, parts), indent=2)


def _facts(run: Run, parts: Parts) -> Iterator[tuple[str, str]]:
    """Names and values of the lines."""
    if (writer := holder(run.folder)) is not None:
        yield "written by", f"{writer}, at this moment"
    layout = _layout(run, parts)
    yield "units", _units(run, parts, layout)
    if run.study.precision is not None:
        yield "cells", _cells(run, layout)
    yield "parts", f"{parts.count:,} whole, {_aside(parts)}"
    yield "failures", _failures(run)
    yield "tables", _tables(run)
    makers = [made for made in [run.maker(), *parts.made_by] if made]
    for made in makers or [{}]:
        yield "made by", described(made) + (", not this one" if other_version(made) else "")


def _state(run: Run, parts: Parts) -> str:
    try:
        run.manifest()
    except ManifestDamagedError as error:
        return str(error)
    except RunError:
        pass
    if finished(run):
        return "finished" if up_to_date(run) else "finished, but `study run` would compute some of it again"
    if damaged(run):
        return "damaged; `study run` computes the lost rows again"
    if (seconds := run.stopped()) is not None:
        return f"stopped by its budget of {seconds:g} s; `study run` resumes it"
    return "begun, not finished" if parts.count else "not begun, or nothing of it is stored"


def _layout(run: Run, parts: Parts) -> Layout:
    """The units of a run, cut as the stored parts are."""
    if run.study.precision is None:
        return ReuseLayout(run.study, Study.model_validate_json(parts.note) if parts.note else None)
    rounds = Rounds(run.study)
    while rounds.advance(parts):
        pass
    return rounds


def _units(run: Run, parts: Parts, layout: Layout) -> str:
    if finished(run) and up_to_date(run):
        return "all done" if run.study.precision else f"{sum(1 for _ in spans(run.study)):,}, all done"
    total = sum(1 for _ in layout.pieces())
    missing = sum(1 for _ in Jobs(run.study).missing(layout.pending(), parts.outputs))
    known = f"{total:,} up to this round" if run.study.precision else f"{total:,}"
    return f"{known}, of which {total - missing:,} are done and {missing:,} missing"


def _cells(run: Run, layout: Layout) -> str:
    """Numbers of cells that have enough trials, by the reason, and of those that are open."""
    found = Counter(run.manifest()["precision"]) if finished(run) else Counter[str]()
    if not found and isinstance(layout, Rounds):
        found = layout.reasons()
    total = run.study.cells()
    counts = [f"{found[TARGET]:,} reached the target", f"{found[CAP]:,} the cap", f"{total - found.total():,} are open"]
    return f"{total:,}, of which {', '.join(counts)}"


def _aside(parts: Parts) -> str:
    aside = len(list((parts.folder / DAMAGED).glob("*"))) if parts.folder.is_dir() else 0
    return f"{len(parts.damaged):,} damaged, {aside:,} set aside as damaged before"


def _failures(run: Run) -> str:
    try:
        manifest = run.manifest()
        fits = f"{manifest['failures']:,} of {manifest['fits']:,} fits"
        return f"{fits}, {manifest['lost']:,} of them because a worker died"
    except (RunError, KeyError):  # chains may be stored before the run is finished
        return "known when the run is finished"


def _tables(run: Run) -> str:
    broken = damaged(run)
    found = sorted(path.stem for path in run.folder.glob("*.parquet"))
    return ", ".join(f"{name} (damaged)" if name in broken else name for name in found) or "none"

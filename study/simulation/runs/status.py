"""Status of a run."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from study.files import RunError, holder
from study.simulation.experiment.config import Study
from study.simulation.runs.adaptive import CAP, TARGET, Rounds
from study.simulation.runs.parts import DAMAGED, Layout, Parts, ShareLayout
from study.simulation.runs.provenance import described, other_version
from study.simulation.runs.run_folder import ManifestMissingError, Run
from study.text import columns


class RunStatus:
    """The status of a run.

    Args:
        folder: the run's, in which nothing is changed.

    Attributes:
        run: its name.
        folder: its folder.
        state: its state in words.
        finished: True if its tables are written and whole, and `study run` would compute none of it again.
        writer: the process that writes it at this moment; None if there is none.
        units: numbers of units by ``total``, ``done`` and ``missing``; those of a finished run with a target of
            precision are not counted, and None.
        cells: numbers of cells by ``total``, those that reached the ``target`` and the ``cap``, and those that are
            ``open``; None without a target of precision.
        parts: numbers of stored parts by ``whole``, ``damaged`` and ``set_aside``, damaged before.
        failures: numbers of ``fits``, of those that ``failed``, and of those ``lost`` because a worker died; None until
            the run is finished.
        tables: names of the stored tables.
        damaged: those of them that are damaged, and tables that are missing.
        made_by: the software of each part of it, as `study.simulation.runs.provenance.software` has it.

    Raises:
        RunError: if there is no run, or it is of a newer version.
    """

    def __init__(self, folder: Path) -> None:
        run = Run.open(folder)
        run.refuse_newer()
        parts = Parts(folder, "units")
        parts.load(set_aside=False)
        layout, broken, known, made = _layout(run, parts), run.damaged(), run.known(), run.makers()
        self.run, self.folder, self.state = run.study.run_name(), folder, _state(run, parts, layout, bool(broken))
        self.finished = run.finished() and run.up_to_date() and not broken
        self.writer, self.units = holder(folder), _units(run, parts, layout)
        self.cells = None if run.study.precision is None else _cells(run, layout)
        set_aside = len(list((parts.folder / DAMAGED).glob("*.part")))
        self.parts = {"whole": parts.count, "damaged": len(parts.damaged), "set_aside": set_aside}
        failures = {"fits": "fits", "failed": "failures", "lost": "lost"}
        self.failures = {name: known[entry] for name, entry in failures.items()} if "fits" in known else None
        self.tables, self.damaged = sorted(path.stem for path in folder.glob("*.parquet")), sorted(broken)
        self.made_by = made + [other for other in parts.made_by if other and other not in made]


def _layout(run: Run, parts: Parts) -> Layout:
    """The units of a run, cut as the stored parts are."""
    if (known := run.share()) is not None:
        return ShareLayout(run.study, known[0])
    if run.study.precision is None:
        return Layout(run.study, Study.model_validate_json(parts.note) if parts.note else None)
    rounds = Rounds(run.study)
    try:
        while rounds.advance(parts):
            pass
    except FileNotFoundError:  # the run has finished meanwhile: its manifest has what the parts had
        parts.load(set_aside=False)
        return Rounds(run.study)
    return rounds


def _state(run: Run, parts: Parts, layout: Layout, broken: bool) -> str:
    try:
        run.manifest()
    except ManifestMissingError:
        pass
    except RunError as error:
        return str(error)
    if run.finished() and broken:
        return "finished, but a table is damaged or missing; `study run` makes it again"
    if run.finished():
        return "finished" if run.up_to_date() else "finished, but `study run` would compute some of it again"
    if broken:
        return "damaged; `study run` computes the lost rows again"
    if (seconds := run.stopped()) is not None:
        return f"stopped by its budget of {seconds:g} s; `study run` resumes it"
    if (known := run.share()) is not None:
        missing = next(layout.missing(parts), None) is not None
        after = f"not complete; `study run CONFIG --part {known[0]}` resumes it" if missing else "complete"
        return f"share {known[0]} of a run, {after}"
    return "begun, not finished" if parts.count else "not begun, or nothing of it is stored"


def _units(run: Run, parts: Parts, layout: Layout) -> dict[str, int | None]:
    if run.finished() and run.up_to_date():
        total = None if run.study.precision else sum(1 for _ in run.study.units())
        return {"total": total, "done": total, "missing": 0}
    count, missing = (sum(1 for _ in pieces) for pieces in (layout.pieces(), layout.missing(parts)))
    return {"total": count, "done": count - missing, "missing": missing}


def _cells(run: Run, layout: Layout) -> dict[str, int]:
    """Numbers of cells that have enough trials, by the reason, and of those that are open."""
    reasons = Counter(run.manifest()["precision"]) if run.finished() else Counter[str]()
    if not reasons and isinstance(layout, Rounds):
        reasons = layout.reasons()
    total = run.study.cells()
    return {"total": total, "target": reasons[TARGET], "cap": reasons[CAP], "open": total - reasons.total()}


def printed(status: RunStatus) -> Iterator[str]:
    """The status of a run for a terminal."""
    yield f"{status.run}: {status.state}"
    yield from columns(_facts(status), indent=2)


def _facts(status: RunStatus) -> Iterator[tuple[str, str]]:
    """Names and values of the lines."""
    if status.writer is not None:
        yield "written by", f"{status.writer}, at this moment"
    total, done, missing = status.units.values()
    if not missing:
        yield "units", "all done" if total is None else f"{total:,}, all done"
    else:
        known = f"{total:,} up to this round" if status.cells else f"{total:,}"
        yield "units", f"{known}, of which {done:,} are done and {missing:,} missing"
    if (cells := status.cells) is not None:
        counts = [f"{cells['target']:,} reached the target", f"{cells['cap']:,} the cap", f"{cells['open']:,} are open"]
        yield "cells", f"{cells['total']:,}, of which {', '.join(counts)}"
    whole, damaged, aside = status.parts.values()
    yield "parts", f"{whole:,} whole, {damaged:,} damaged, {aside:,} set aside as damaged before"
    words = "known when the run is finished"
    if status.failures is not None:
        fits, failed, lost = status.failures.values()
        words = f"{failed:,} of {fits:,} fits, {lost:,} of them because a worker died"
    yield "failures", words
    names = [f"{name} (damaged)" if name in status.damaged else name for name in status.tables]
    names += [f"{name} (missing)" for name in status.damaged if name not in status.tables]
    yield "tables", ", ".join(names) or "none"
    for made in status.made_by or [{}]:
        yield "made by", described(made) + (", not this one" if other_version(made) else "")

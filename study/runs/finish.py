"""The last step of a run: its parts are joined to tables, and the manifest is written."""

import json
import time
from collections import Counter
from collections.abc import Iterator
from datetime import datetime
from itertools import chain, islice

import pyarrow as pa

from study.estimators import ESTIMATORS
from study.estimators.own.register import origins
from study.runs import assemble, provenance
from study.runs.adaptive.checkpoint_rounds import Rounds
from study.runs.adaptive.group_progress import BUDGET, TARGET
from study.runs.adaptive.time_budget import TimeBudget
from study.runs.layout import Layout
from study.runs.storage import manifest, schemas
from study.runs.storage.parts import FORMAT, Parts
from study.runs.storage.run_folder import Run
from study.runs.workers.choose import Workers


def finish(
    store: Run, parts: Parts, layout: Layout, started: datetime, workers: Workers, budget: TimeBudget | None = None
) -> None:
    """Join the parts to the run's tables, in the order of the units, and remove them, unless a budget stopped the run.

    The error table's metadata hold the config and the software, but nothing of time, machine or workers, so that equal
    runs are equal to the byte. The manifest comes last: a run that is killed before is finished again from its parts.

    Args:
        store: the run.
        parts: the stored rows of all its units.
        layout: the units, and how each was cut. Cells that are still open stay as they were at their last checkpoint.
        started: time at which the run started.
        workers: the workers that computed it.
        budget: its time budget.

    Raises:
        RunError: if the folder cannot be written; the parts stay.
    """
    study, clock = store.study, time.perf_counter()
    metadata = {"study.config": study.canonical(), "study.software": json.dumps(parts.software)}
    store.forget(*schemas.of_units(study.dimension, study.conditions()), "precision")  # they are about to be replaced
    store.remove("summary")
    written, causes, reasons = [], Counter[str](), Counter[str]()
    if isinstance(layout, Rounds):
        layout.stop()
        reasons = layout.reasons()
        store.join("precision", schemas.precision(study.conditions()), [layout.table()], metadata)
        written.append("precision")
    for name, columns in schemas.of_units(study.dimension, study.conditions()).items():
        rows = assemble.rows(study, parts, layout, name)
        if name == "failures":
            rows = _counted(rows, causes)
        first = list(islice(rows, 1))
        if first or name in (study.keep, "timings") or (name == "points" and study.keep_points):
            store.join(name, columns, chain(first, rows), metadata)
            written.append(name)
        else:
            store.remove(name)
    before = store.manifest() if (store.folder / manifest.NAME).is_file() else {"tables": {}}
    store.save_manifest(
        {key: value for key, value in before.items() if key == "posterior"}
        | ({"precision": dict(reasons)} if reasons else {})
        | ({"stopped_after": budget.seconds} if budget and reasons[BUDGET] else {})
        | {
            "format": FORMAT,
            "run": study.run_name(),
            "config": study.model_dump(mode="json"),
            "cells": study.cells(),
            "fits": sum(piece.rows for piece in layout.pieces()) * len(study.estimators),
            "failures": causes.total(),
            "lost": causes["worker"],
            "estimators": {name: ESTIMATORS[name].version for name in study.estimators},
            "tables": {name: store.fingerprint(name) for name in written} | before["tables"],
            **({"own_estimators": own} if (own := origins(study.estimators)) else {}),
            "started": started.isoformat(timespec="seconds"),
            "seconds_computing": round(parts.seconds, 3),
            "seconds": round(parts.seconds + time.perf_counter() - clock, 3),
            "jobs": workers.jobs,
            "backend": workers.backend,
            "software": parts.software,
            "also_computed_by": parts.made_by,
            "machine": provenance.machine(),
        }
    )
    if not reasons[BUDGET]:
        parts.remove()


def budget_message(run: Run) -> str | None:
    """Message for a run that its budget stopped; None for another."""
    if (seconds := run.stopped()) is None:
        return None
    found, all_cells = run.manifest()["precision"], run.manifest()["cells"]
    done = f"{found.get(TARGET, 0):,} of {all_cells:,} cells reached the target"
    return f"{run.folder}: stopped by its budget of {seconds:g} s: {done}; {run.again()} resumes it"


def failure_message(run: Run) -> str | None:
    """Message for a finished run whose share of failed fits is larger than its config tolerates; None for another."""
    found, tolerated = run.manifest(), run.study.tolerate_failures
    failures, fits = found["failures"], found["fits"]
    if failures <= tolerated * fits:
        return None
    words = f"{failures:,} of {fits:,} fits raised an exception or killed their worker"
    return f"{run.path('failures')}: {words}; tolerate_failures = {tolerated:g}"


def _counted(rows: Iterator[pa.Table], causes: Counter[str]) -> Iterator[pa.Table]:
    """Count the causes of failures as their rows pass."""
    for table in rows:
        causes.update(table["cause"].cast(pa.string()).to_pylist())
        yield table

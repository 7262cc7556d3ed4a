"""From units to the store: joblib computes, the parent writes each unit as it comes back."""

import contextlib
import time
import warnings
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from study.experiment.config import Study
from study.experiment.design import Unit, units
from study.experiment.work import Result, compute
from study.runs import provenance
from study.runs.store import Run

Progress = Callable[[float], None]
"""Told the share of the work, in [0, 1], that one more unit was."""


def weight(unit: Unit) -> float:
    """Work of a unit in comparable numbers: samples drawn and fitted, and an overhead per batch and cell."""
    return sum(
        batch.trials * batch.samples * (1.0 + len(batch.cells)) + 10_000.0 * (1 + len(batch.cells))
        for batch in unit.batches
    )


def run(study: Study, config: str, folder: Path, jobs: int = 2, progress: Progress | None = None) -> Run:
    """Run a study.

    Args:
        study: the config.
        config: its text, stored beside the tables.
        folder: the run's folder.
        jobs: number of workers. They are threads: the compiled loops release the interpreter's lock.
        progress: called after each unit with its share of the work.

    Returns:
        The finished run. Its error table does not depend on ``jobs`` or on the order in which units finish.

    Raises:
        RunError: if the folder belongs to another config or cannot be written.
    """
    started, clock = datetime.now(UTC), time.perf_counter()
    store = Run.create(folder, study, config)
    todo = list(units(study))
    weights = [weight(unit) for unit in todo]
    whole = sum(weights)
    longest_first = sorted(range(len(todo)), key=lambda i: -weights[i])
    results: dict[int, Result] = {}
    with threadpool_limits(limits=1), contextlib.closing(_compute(study, todo, longest_first, jobs)) as finished:
        machine = provenance.machine()
        for index, result in finished:
            store.commit(todo[index], result)
            results[index] = replace(result, errors={})
            if progress is not None:
                progress(weights[index] / whole)
    computed = time.perf_counter() - clock
    software = provenance.software()
    store.finish(todo, lambda: (results[i] for i in range(len(todo))), software)
    before = store.manifest() if (folder / "manifest.json").is_file() else {}
    store.save_manifest(
        {key: value for key, value in before.items() if key == "posterior"}
        | {
            "run": study.run_name(),
            "config": study.model_dump(mode="json"),
            "cells": study.cells(),
            "started": started.isoformat(timespec="seconds"),
            "seconds_computing": round(computed, 3),
            "seconds": round(time.perf_counter() - clock, 3),
            "jobs": jobs,
            "software": software,
            "machine": machine,
        }
    )
    return store


def _compute(study: Study, todo: list[Unit], order: list[int], jobs: int) -> Generator[tuple[int, Result]]:
    """Results of the units with their numbers, as they finish.

    None is computed in the main thread, where Ctrl-C could strike inside compiled code that cannot take it.
    """
    if jobs == 1:  # joblib would use the main thread
        with ThreadPoolExecutor(1) as pool:
            for i in order:
                yield pool.submit(_numbered, study, i, todo[i]).result()
        return
    parallel = Parallel(n_jobs=jobs, prefer="threads", return_as="generator_unordered", pre_dispatch="2*n_jobs")
    with warnings.catch_warnings():
        # said when a run ends early, which is told in our own words
        warnings.filterwarnings("ignore", message=".*tasks have been successfully executed", category=UserWarning)
        warnings.filterwarnings("ignore", message=".*tasks which were still being processed", category=UserWarning)
        yield from parallel(delayed(_numbered)(study, i, todo[i]) for i in order)


def _numbered(study: Study, index: int, unit: Unit) -> tuple[int, Result]:
    return index, compute(study, unit)

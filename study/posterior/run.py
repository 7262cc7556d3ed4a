"""The posterior tables of a run: chains computed by workers, stored as they finish, and joined at the end."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace

import pyarrow.compute as pc
from threadpoolctl import threadpool_limits

from study.experiment.config import Study
from study.experiment.posterior_config import Posterior
from study.posterior.chain_task import ChainTask, chain_tasks
from study.runs.storage import schemas
from study.runs.storage.atomic_write import RunError
from study.runs.storage.lock import writing
from study.runs.storage.parts import Packet, Parts
from study.runs.storage.run_folder import Run
from study.runs.workers.backend import Backend
from study.runs.workers.choose import Workers
from study.runs.workers.dispatch import Dispatch

_OUTPUTS = ("chain",)
_HEAVY = 1e8
"""Weight of a chain per sample, so large that each chain is sent to a worker alone."""
Shared = tuple[Study, Posterior]


def compute(run: Run, jobs: Workers | int = 2, progress: Callable[[float], None] | None = None) -> None:
    """Compute the posterior tables that a run's config asks for; finished chains are not computed again.

    Args:
        run: the run; only its config is used.
        jobs: number of workers, or the workers. Processes take the place of threads, because emcee's steps hold the
            interpreter's lock.
        progress: called after each chain with its share of the work.

    Raises:
        RunError: if the config asks for none, chooses no cell, or the folder cannot be written.
    """
    workers = Workers(jobs=jobs) if isinstance(jobs, int) else jobs
    study, posterior = run.study, run.study.posterior
    if posterior is None:
        raise RunError(f"{run.folder}: its config has no [posterior]; add one, as in configs/posterior.toml")
    todo = chain_tasks(study, posterior)
    if not todo:
        raise RunError(f"{run.folder}: [posterior] where = {dict(posterior.where)} chooses none of its cells")
    keys = {task.part(study, posterior): task for task in todo}
    metadata = {"study.config": study.canonical(), "study.posterior": json.dumps(list(keys))}
    d = study.dimension
    stored = {"answers": schemas.answers(d), "draws": schemas.draws(d)}
    stored["posterior"] = schemas.posterior(d, study.conditions())
    usable = all(map(run.valid, stored))
    if usable and run.metadata("posterior").get("study.posterior") == metadata["study.posterior"]:
        return
    if workers.backend == "threads" and workers.jobs > 1:
        workers = replace(workers, backend="loky")
    with workers.open() as backend, threadpool_limits(limits=1), writing(run.folder):
        parts = Parts(run.folder, "chains")
        parts.load()
        for name in parts.damaged:
            print(f"{parts.folder / name}: damaged; moved to parts/damaged and computed again", file=sys.stderr)
        if usable:
            _keep_finished(run, parts, keys, list(stored))
        run.forget(*stored)
        _compute(parts, (study, posterior), keys, backend, progress)
        for name, columns in stored.items():
            found = (table for key in keys for _, _, table in parts.tables(key, name))
            run.join(name, columns, found, metadata)
        made = {"chains": len(todo), "seconds": round(parts.seconds, 3), "jobs": workers.jobs}
        run.record(*stored, posterior=made)
        parts.remove()


def _keep_finished(run: Run, parts: Parts, wanted: dict[str, ChainTask], names: list[str]) -> None:
    """Reuse chains of finished tables that were made for other settings, so that only new chains are computed."""
    held = set(json.loads(run.metadata("posterior").get("study.posterior", "[]"))) & set(wanted)
    stored = {name: run.arrow(name) for name in names} if held else {}
    for part in held:
        mine = pc.scalar(True)
        for column, value in wanted[part].key.items():
            mine = mine & (pc.field(column) == value)
        parts.add(Packet.of([(part, _OUTPUTS)], [{name: table.filter(mine) for name, table in stored.items()}]))
    parts.commit()


def _compute(
    parts: Parts, shared: Shared, keys: dict[str, ChainTask], backend: Backend, progress: Callable[[float], None] | None
) -> None:
    """Run the missing chains and store each as it finishes."""
    missing = [item for item in keys.items() if not parts.outputs(item[0])]
    lost: list[str] = []

    def ended(items: tuple[tuple[str, ChainTask], ...], failure: str) -> None:
        if failure:
            lost.append(failure)
        if progress is not None:
            progress(len(items) / len(missing))

    dispatch = Dispatch(backend, _chains, shared, parts)
    dispatch.compute(missing, lambda item: _HEAVY * item[1].address.cell.samples, ended)
    if lost:
        raise RunError(f"{parts.folder.parent}: {len(lost)} chains could not be run: {lost[0]}; the others are stored")


def _chains(shared: Shared, items: tuple[tuple[str, ChainTask], ...]) -> Packet:
    """Run chains, in a worker."""
    return Packet.of([(key, _OUTPUTS) for key, _ in items], [task.compute(*shared) for _, task in items])

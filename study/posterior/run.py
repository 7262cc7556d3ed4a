"""The posterior tables of a run: which chains, computed by workers, each kept as it comes back, joined at the end.

A chain is named by its cell, trial, likelihood and whether the noise is known, and draws from a stream of that name.
So the tables depend neither on the number of workers nor on what was interrupted, and more trials or cells leave the
chains that are there as they were.
"""

import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from threadpoolctl import threadpool_limits

from study.experiment.conditions import named_in
from study.experiment.config import Study
from study.experiment.designs.cells import Cell
from study.experiment.posterior_config import Posterior
from study.experiment.replay import Address, addresses, replay
from study.experiment.streams import old_stream
from study.posterior import calibration, tables
from study.posterior.sampler import Chain, Prior, sample
from study.runs.storage import schemas
from study.runs.storage.atomic_write import RunError
from study.runs.storage.lock import writing
from study.runs.storage.parts import Packet, Parts
from study.runs.storage.run_folder import Run
from study.runs.workers.dispatch import Crew, Pool, Workers, kept

FORMAT = 2
"""To be raised when a chain of the same name would draw otherwise: finished chains are kept by it."""
_OUTPUTS = ("chain",)
_HEAVY = 1e8
"""Weight of a chain per sample: none is so light that it would be sent together with others."""
Shared = tuple[Study, Posterior]


@dataclass(frozen=True)
class Task:
    """One chain to run.

    Attributes:
        address: the trial.
        likelihood: its name.
        noise_is: known or unknown.
    """

    address: Address
    likelihood: str
    noise_is: str

    @property
    def key(self) -> dict[str, str | int]:
        """What names the chain in every table."""
        where = self.address
        names = {"likelihood": self.likelihood, "noise_is": self.noise_is}
        return {"cell": where.cell.name, "trial": where.trial, **names}

    def part(self, study: Study, posterior: Posterior) -> str:
        """Name of the chain's part: a digest of all that determines it."""
        settings = (posterior.box, posterior.walkers, posterior.max_steps, self._kept(posterior))
        content = repr((FORMAT, study.seed, study.dimension, study.estimators, settings, self.key, self.address.cell))
        return hashlib.sha256(content.encode()).hexdigest()[:20]

    def compute(self, study: Study, posterior: Posterior) -> dict[str, pa.Table]:
        """Run the chain."""
        trial = replay(study, self.address)
        prior = prior_of(trial.cell, posterior, self.noise_is == "known")
        random = old_stream(study.seed, "posterior", *self.key.values())
        chain: Chain = sample(trial.samples, prior, self.likelihood, random, posterior.walkers, posterior.max_steps)
        return tables.rows(study, trial, chain, self.key, posterior.walkers, self._kept(posterior))

    def _kept(self, posterior: Posterior) -> bool:
        return self.address.trial < posterior.keep_draws


def prior_of(cell: Cell, posterior: Posterior, known: bool) -> Prior:
    """The prior of a cell's trials: a box about the true centre, and any radius that a centre in it can have."""
    center, width = np.array(cell.center), posterior.box * cell.radius
    return Prior(center, width, 2.0 * cell.radius + len(center) ** 0.5 * width, cell.noise, known)


def tasks(study: Study, posterior: Posterior) -> list[Task]:
    """Every chain that a config asks for, in the order of the tables."""
    places = [a for a in addresses(study, posterior.trials) if posterior.chooses(a.cell)]
    return [Task(place, name, noise) for place in places for name in posterior.likelihood for noise in posterior.noise]


def compute(run: Run, jobs: Workers | int = 2, progress: Callable[[float], None] | None = None) -> None:
    """Compute the posterior tables that a run's config asks for; what is there already is not computed again.

    Args:
        run: the run; only its config is looked at.
        jobs: number of workers, or who they are. Threads are made processes: emcee's steps hold the interpreter's lock.
        progress: called after each chain with its share of the work.

    Raises:
        RunError: if the config asks for none, chooses no cell, or the folder cannot be written.
    """
    workers = Workers(jobs=jobs) if isinstance(jobs, int) else jobs
    study, posterior = run.study, run.study.posterior
    if posterior is None:
        raise RunError(f"{run.folder}: its config has no [posterior]; add one, as in configs/posterior.toml")
    todo = tasks(study, posterior)
    if not todo:
        raise RunError(f"{run.folder}: [posterior] where = {dict(posterior.where)} chooses none of its cells")
    keys = {task.part(study, posterior): task for task in todo}
    metadata = {"study.config": study.canonical(), "study.posterior": json.dumps(list(keys))}
    if run.metadata("posterior").get("study.posterior") == metadata["study.posterior"]:
        return
    d = study.dimension
    stored = {"answers": schemas.answers(d), "draws": schemas.draws(d)}
    stored["posterior"] = schemas.posterior(d, study.conditions())
    if workers.backend == "threads" and workers.jobs > 1:
        workers = replace(workers, backend="loky")
    with workers.open() as pool, threadpool_limits(limits=1), writing(run.folder):
        parts = Parts(run.folder, "chains")
        parts.load()
        for name in parts.damaged:
            print(f"{parts.folder / name}: damaged; set aside in parts/damaged, and computed again", file=sys.stderr)
        _keep_finished(run, parts, keys, list(stored))
        _compute(parts, (study, posterior), keys, pool, progress)
        for name, columns in stored.items():  # ``posterior`` last: where it is, the others are
            found = (table for key in keys for _, _, table in parts.tables(key, name))
            run.join(name, columns, found, metadata)
        run.amend_manifest(
            {"posterior": {"chains": len(todo), "seconds": round(parts.seconds, 3), "jobs": workers.jobs}}
        )
        parts.remove()


def _keep_finished(run: Run, parts: Parts, wanted: dict[str, Task], names: list[str]) -> None:
    """Take chains out of finished tables that held others, so that only the new ones are computed."""
    held = set(json.loads(run.metadata("posterior").get("study.posterior", "[]"))) & set(wanted)
    stored = {name: run.arrow(name) for name in names} if held else {}
    for part in held:
        mine = pc.scalar(True)
        for column, value in wanted[part].key.items():
            mine = mine & (pc.field(column) == value)
        parts.add(Packet.of([(part, _OUTPUTS)], [{name: table.filter(mine) for name, table in stored.items()}]))
    parts.commit()


def _compute(
    parts: Parts, shared: Shared, keys: dict[str, Task], pool: Pool, progress: Callable[[float], None] | None
) -> None:
    """Run the chains that are not there, and store each as it comes back."""
    missing = [item for item in keys.items() if not parts.outputs(item[0])]
    lost: list[str] = []
    crew: Crew[tuple[str, Task]] = Crew(pool, _chains, shared)
    with kept(crew, parts):
        for done in crew.results(missing, lambda item: _HEAVY * item[1].address.cell.samples, parts.patience):
            if done is None:
                parts.commit()
                continue
            if done.packet is None:
                lost.append(done.message)
            else:
                parts.add(done.packet)
            if progress is not None:
                progress(len(done.items) / len(missing))
    if lost:
        raise RunError(f"{parts.folder.parent}: {len(lost)} chains could not be run: {lost[0]}; the others are kept")


def _chains(shared: Shared, items: tuple[tuple[str, Task], ...]) -> Packet:
    """Run chains; this is what a worker does."""
    return Packet.of([(key, _OUTPUTS) for key, _ in items], [task.compute(*shared) for _, task in items])


def printed(run: Run) -> Iterator[str]:
    """The posterior tables in short, for a terminal.

    Yields:
        A title, a header, a line per cell and kind of chain as `study.posterior.calibration.by_cell` has them, and
        then the coverage of all, where they are independent of each other.
    """
    found, beside = run.table("posterior"), run.table("answers")
    yield f"{run.study.run_name()}: posteriors, largest shift of the mean from the MLE (in sd), and sd over bound"
    conditions = named_in(found)
    titles = "".join(f"{c.symbol:>10}" for c in conditions) + f"  {'likelihood':<13}{'noise':<9}"
    yield titles + f"{'ok':>7}{'shift':>8}{'sd over bound':>17}{'τ':>7}"
    for row in calibration.by_cell(found, beside).to_dict("records"):
        text = (
            "".join(f"{c.written(c.of(row)):>10}" for c in conditions)
            + f"  {row['likelihood']:<13}{row['noise_is']:<9}{row['ok']:>3}/{row['chains']:<3}"
        )
        if row["ok"]:
            text += f"{row['shift']:>8.2f}{row['least']:>9.2f} … {row['most']:.2f}{row['tau']:>8.0f}"
        yield text
    if run.study.independent():
        yield from calibration.printed(calibration.trials(found, beside))

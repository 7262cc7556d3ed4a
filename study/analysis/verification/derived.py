"""Rows of a summary and chains of posteriors, computed again and compared with the stored ones."""

import json
from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from study.analysis.error_groups import Grouped
from study.analysis.summary import rows_of_groups
from study.analysis.verification.bits import chosen, difference
from study.analysis.verification.units import Recomputed
from study.posterior.chain_task import chain_tasks
from study.runs.storage.run_folder import Run

CHAIN_TABLES = ("posterior", "answers", "draws")


def recompute_summary(run: Run, seed: str, share: float) -> Recomputed:
    """Compute a share of the rows of a run's summary again from its error table.

    Args:
        run: a run whose error table and summary have the right digests.
        seed: text that determines the choice.
        share: of the rows, in [0, 1].
    """
    grouped, stored = Grouped(run), run.arrow("summary")
    keys = list(grouped.counts)
    found = Recomputed(0, len(keys), "rows")
    if stored.num_rows != len(keys):
        found.faults.append(f"{stored.num_rows:,} rows are stored, and {len(keys):,} belong to the error table")
        return found
    use = chosen(seed, range(len(keys)), share)
    found.done = len(use)
    if use:
        computed = pa.concat_tables(rows_of_groups(run, grouped, [keys[i] for i in use])).unify_dictionaries()
        if (fault := difference(stored.take(np.array(use)), computed)) is not None:
            found.faults.append(fault)
    return found


def recompute_chains(run: Run, names: list[str], seed: str, share: float) -> dict[str, Recomputed]:
    """Run a share of a run's chains again.

    Args:
        run: the run.
        names: tables whose digests are right.
        seed: text that determines the choice.
        share: of the chains, in [0, 1].

    Returns:
        Results by table; none if not all three tables of chains are there.
    """
    study, posterior = run.study, run.study.posterior
    if not set(CHAIN_TABLES) <= set(names):
        return {}
    tasks = chain_tasks(study, posterior) if posterior is not None else []
    found = {name: Recomputed(0, len(tasks), "chains") for name in CHAIN_TABLES}
    asked = [task.part(study, posterior) for task in tasks] if posterior is not None else []
    if json.loads(run.metadata("posterior").get("study.posterior", "[]")) != asked:
        words = f"not the chains that config.toml asks for; `study posterior {run.folder}` computes those"
        found["posterior"].faults.append(words)
        return found
    stored = {name: run.arrow(name) for name in CHAIN_TABLES}
    if stored["posterior"].num_rows != len(tasks):
        found["posterior"].faults.append(f"{stored['posterior'].num_rows:,} of {len(tasks):,} chains are stored")
    use, seen = chosen(seed, tasks, share), Counter[str]()
    for task in use:
        assert posterior is not None
        computed, mine = task.compute(study, posterior), pc.scalar(True)
        for column, value in task.key.items():
            mine = mine & (pc.field(column) == value)
        for name in CHAIN_TABLES:
            found[name].done += 1
            rows = stored[name].filter(mine)
            seen[name] += rows.num_rows
            if (fault := difference(rows, computed[name])) is not None:
                found[name].faults.append(fault)
    for name in CHAIN_TABLES if len(use) == len(tasks) else ():
        if strays := stored[name].num_rows - seen[name]:
            found[name].faults.append(f"{strays:,} rows are of no chain")
    return found

"""The claims of the paper, in its order, each judged by stored tables.

To add a claim, write a `Claim` in the file of its subject: the tables it reads, its measure, and its rule.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pandas as pd

from study import files
from study.files import RunError, writing
from study.simulation.claims import (
    bias,
    bound,
    costs,
    error_by_noise,
    outliers,
    power_law,
    recordings,
    several_markers,
    ugdk,
)
from study.simulation.claims.claim import Claim, Evidence, Verdict, evaluate, frame
from study.simulation.runs import kept, schemas
from study.simulation.runs.run_folder import Run
from study.text import columns

CLAIMS: tuple[Claim, ...] = (
    *error_by_noise.CLAIMS,
    *outliers.CLAIMS,
    *bias.CLAIMS,
    *bound.CLAIMS,
    *ugdk.CLAIMS,
    *several_markers.CLAIMS,
    *costs.CLAIMS,
    *power_law.CLAIMS,
    *recordings.CLAIMS,
)

__all__ = ["CLAIMS", "Claim", "Evidence", "Verdict", "as_data", "judge_all", "key", "printed", "save", "stored"]


def judge_all(runs: Iterable[Run], cost: Path | None = None, spreads: pd.DataFrame | None = None) -> pd.DataFrame:
    """Judge every claim by the runs at hand.

    Args:
        runs: finished runs, of different configs.
        cost: the file of a cost table, as `study cost` writes it.
        spreads: spreads of the joints of recordings, as `study.simulation.claims.recordings` reads them.

    Returns:
        The claims table: a row per claim; columns as `study.simulation.runs.schemas.CLAIMS` declares them.

    Raises:
        RunError: if two runs have one name, or the cost table cannot be read.
    """
    evidence = Evidence.of(runs, cost, spreads)
    return frame(evaluate(CLAIMS, evidence), evidence)


def key(runs: Sequence[Run], cost: Path | None = None, spreads: pd.DataFrame | None = None) -> str | None:
    """Key of all that claims are judged by; see `study.simulation.runs.kept.key`, and `judge_all` for the arguments."""
    try:
        digest = None if cost is None else files.of_file(cost)
    except RunError:  # a folder, perhaps: `judge_all` says so
        return None
    if (digest is None) != (cost is None):
        return None
    table = None if spreads is None else spreads.to_csv(float_format="%.17g")
    return kept.key(runs, "claims", digest, table, *(run.again() for run in runs))  # reasons name these commands


def stored(run: Run, known: str | None) -> pd.DataFrame | None:
    """The claims table that a run's folder has, if it was judged by the same tables and the same program, else None.

    Args:
        run: the run in whose folder the table was stored.
        known: the key; see `key`.
    """
    digest = kept.find(run, "claims", known)
    if digest is None or not run.valid("claims") or digest.decode() != run.fingerprint("claims"):
        return None
    return run.table("claims")


def save(run: Run, claims: pd.DataFrame, known: str | None = None) -> None:
    """Store the claims table in a run's folder; a stored one stays where no claim could be judged.

    Args:
        run: the run.
        claims: the claims table.
        known: the key of what the claims were judged by; see `key`.
    """
    if run.valid("claims") and bool((claims["verdict"] == Verdict.NOT_EVALUATED).all()):
        return
    data = {column.name: claims[column.name].to_numpy() for column in schemas.CLAIMS}
    with writing(run.folder):  # the key too: else another command's table could come between the two
        run.save("claims", schemas.table(schemas.CLAIMS, data))
        kept.keep(run, "claims", known, str(run.fingerprint("claims")).encode())


def as_data(runs: Iterable[Run], claims: pd.DataFrame) -> dict[str, object]:
    """The claims for other programs: names of the runs, counts of the verdicts, and a mapping per claim."""
    counts = claims["verdict"].value_counts()
    return {
        "runs": [run.study.run_name() for run in runs],
        "verdicts": {verdict: int(counts.get(verdict, 0)) for verdict in map(str, Verdict)},
        "claims": claims[[column.name for column in schemas.CLAIMS]].to_dict("records"),
    }


def printed(claims: pd.DataFrame) -> Iterator[str]:
    """The claims for a terminal: a line per claim, one per number below it, and the count of each verdict."""
    heads = [
        [str(row.number), f"§{row.section}", str(row.verdict).upper(), str(row.statement)]
        for row in claims.itertuples()
    ]
    for head, finding in zip(columns(heads, align="><"), claims["finding"], strict=True):
        yield head
        yield from (f"    {line}" for line in str(finding).splitlines())
    counts = claims["verdict"].value_counts()
    yield "; ".join(f"{counts[verdict]} {verdict}" for verdict in map(str, Verdict) if verdict in counts)

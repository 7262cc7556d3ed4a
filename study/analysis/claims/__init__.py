"""The claims of the paper, in its order, each judged by stored tables.

To add one, write a `Claim` in the file of its subject, with what it reads, measures and judges by.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import pandas as pd

from study.analysis.claims import bias, bound, costs, errors, markers, outliers, power, recordings, ugdk
from study.analysis.claims.claim import Claim, Evidence, Verdict, evaluate, frame
from study.runs.storage import schemas
from study.runs.storage.run_folder import Run

CLAIMS: tuple[Claim, ...] = (
    *errors.CLAIMS,
    *outliers.CLAIMS,
    *bias.CLAIMS,
    *bound.CLAIMS,
    *ugdk.CLAIMS,
    *markers.CLAIMS,
    *costs.CLAIMS,
    *power.CLAIMS,
    *recordings.CLAIMS,
)

__all__ = ["CLAIMS", "Claim", "Evidence", "Verdict", "judge_all", "printed", "save"]


def judge_all(runs: Iterable[Run], cost: Path | None = None, spreads: pd.DataFrame | None = None) -> pd.DataFrame:
    """Judge every claim by the runs at hand.

    Args:
        runs: finished runs, of different configs.
        cost: the file of a cost table, as `study cost` writes it.
        spreads: of the joints of recordings, as `study.mocap.case_study.stored_case_studies` reads them.

    Returns:
        The claims table: a row per claim; columns as `study.runs.storage.schemas.CLAIMS` declares them.

    Raises:
        RunError: if two runs have one name, or the cost table cannot be read.
    """
    evidence = Evidence.of(runs, cost, spreads)
    return frame(evaluate(CLAIMS, evidence), evidence)


def save(run: Run, claims: pd.DataFrame) -> None:
    """Store the claims table in a run's folder."""
    data = {column.name: claims[column.name].to_numpy() for column in schemas.CLAIMS}
    run.save("claims", schemas.table(schemas.CLAIMS, data))


def printed(claims: pd.DataFrame) -> Iterator[str]:
    """The claims for a terminal: a line for each and for each number, and how many there are of each verdict."""
    for row in claims.itertuples():
        yield f"{row.number:>2}  §{row.section:<6} {str(row.verdict).upper():<18} {row.statement}"
        yield from (f"    {line}" for line in str(row.finding).splitlines())
    counts = claims["verdict"].value_counts()
    yield "; ".join(f"{counts[verdict]} {verdict}" for verdict in map(str, Verdict) if verdict in counts)

"""The claims of the paper, by their numbers, each judged by stored tables.

To add a claim, write a subclass of `Claim` in the file of its subject: the tables that it reads, its criterion and
its measure.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import pandas as pd

from study.files import writing
from study.simulation.claims import bound, costs, error_by_noise, outliers, recordings, ugdk
from study.simulation.claims.claim import OTHER_CAUSE, Claim, Evidence, Verdict, evaluate, frame, read_cost
from study.simulation.runs import schemas
from study.simulation.runs.run_folder import Run
from study.text import columns

_CHAPTERS = (error_by_noise, outliers, bound, ugdk, costs, recordings)
_KINDS = [thing for chapter in _CHAPTERS for thing in vars(chapter).values() if isinstance(thing, type)]
CLAIMS: tuple[Claim, ...] = tuple(
    sorted(
        (kind() for kind in _KINDS if issubclass(kind, Claim) and kind is not Claim),
        key=lambda claim: claim.number,
    )
)
"""Every claim, in the order of their numbers: those of the text, of the abstract, and what was added."""

__all__ = ["CLAIMS", "Claim", "Evidence", "Verdict", "as_data", "judge_all", "printed", "save"]


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
    evidence = Evidence(runs, read_cost(cost), spreads)
    return frame(evaluate(CLAIMS, evidence), evidence)


def save(run: Run, claims: pd.DataFrame) -> None:
    """Store the claims table in a run's folder; a stored one stays where no claim could be judged.

    Args:
        run: the run.
        claims: the claims table.
    """
    if run.valid("claims") and bool((claims["verdict"] == Verdict.NOT_EVALUATED).all()):
        return
    data = {column.name: claims[column.name].to_numpy() for column in schemas.CLAIMS}
    with writing(run.folder):
        run.forget()  # refuses a damaged manifest; the stored table counts until the new one is whole
        run.join("claims", schemas.CLAIMS, [schemas.table(schemas.CLAIMS, data)], {})
        run.record("claims")


def counted(claims: pd.DataFrame) -> dict[str, int]:
    """The number of claims of each verdict, in the order of verdicts, and of those with another cause among them."""
    verdicts = [str(verdict) for verdict in claims["verdict"]]
    counts = Counter(verdict.removesuffix(OTHER_CAUSE) for verdict in verdicts)
    counted = {verdict: counts.pop(verdict, 0) for verdict in map(str, Verdict)} | counts  # those of a later version
    return counted | {"of these with another cause": sum(verdict.endswith(OTHER_CAUSE) for verdict in verdicts)}


def judged(claims: pd.DataFrame) -> bool:
    """True if any claim has a verdict."""
    return not claims.empty and bool((claims["verdict"] != Verdict.NOT_EVALUATED).any())


def needs(claims: pd.DataFrame) -> str:
    """The runs that claims need, in words."""
    reads = [read for text in claims["reads"] for read in text.split(", ")]
    names = dict.fromkeys(name for name, _, table in (read.partition("/") for read in reads) if table)
    return f"they need runs of {', '.join(names)}, as `make paper` makes them" if names else "they need other tables"


def as_data(runs: Iterable[Run], claims: pd.DataFrame) -> dict[str, object]:
    """The claims for other programs: names of the runs, counts of the verdicts, and a mapping per claim."""
    return {
        "runs": [run.study.run_name() for run in runs],
        "verdicts": counted(claims),
        "claims": claims[[column.name for column in schemas.CLAIMS]].to_dict("records"),
    }


def printed(claims: pd.DataFrame) -> Iterator[str]:
    """The claims for a terminal: a line per claim, one per number below it, and the count of each verdict.

    Claims of which none can be judged are one line that says what they need.
    """
    if not judged(claims):
        yield f"{len(claims)} claims of the paper, none of which these runs can judge: {needs(claims)}"
        return
    heads = [
        [str(number), f"{'§' * str(section)[0].isdigit()}{section}", str(verdict).upper(), str(statement)]
        for number, section, verdict, statement in claims[["number", "section", "verdict", "statement"]].to_numpy()
    ]
    for head, finding in zip(columns(heads, align="><"), claims["finding"], strict=True):
        yield head
        yield from (f"    {line}" for line in str(finding).splitlines())
    yield tally(claims)


def tally(claims: pd.DataFrame) -> str:
    """The count of each verdict, in one line."""
    return "; ".join(f"{count} {verdict}" for verdict, count in counted(claims).items() if count)

"""What a claim of the paper is, and how stored tables become its verdict. No verdict is written down anywhere.

A `Claim` names the tables that it reads. Its ``measure`` turns them into numbers, each with its Monte-Carlo error, and
its ``judge`` turns the numbers into a verdict; the criterion says the same in words. Change a table and the verdict
changes with it; take one away and the claim says which is missing, and has no verdict.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from study.runs.storage import schemas
from study.runs.storage.run_folder import Run, RunError
from study.statistics.measures import UNKNOWN, Measure


class Verdict(StrEnum):
    """What the numbers say of a claim."""

    REPRODUCED = "reproduced"
    PARTLY = "partly"
    NOT_REPRODUCED = "not reproduced"
    NOT_EVALUATED = "not evaluated"


class Number(NamedTuple):
    """One number behind a verdict.

    Attributes:
        words: what it is, for a reader, unit included: "GDKE's bias over its own standard deviation".
        value: the number.
        error: its Monte-Carlo standard error; 0 for what is counted, NaN where there is none to give.
        trials: the smallest number of data sets behind it; 0 for what no trial enters.
    """

    words: str
    value: float
    error: float
    trials: int

    @classmethod
    def of(cls, words: str, measure: Measure, trials: int) -> "Number":
        """A measure, with words for it."""
        return cls(words, measure.value, measure.error, trials)

    @classmethod
    def unknown(cls, words: str) -> "Number":
        """One that cannot be formed from the tables."""
        return cls.of(words, UNKNOWN, 0)

    def __str__(self) -> str:
        """The number with its error, and what it is."""
        if math.isnan(self.error) or self.error == 0.0:
            return f"{self.words}: {self.value:.4g}"
        return f"{self.words}: {self.value:.4g} ± {self.error:.2g}"


class TableMissing(Exception):  # noqa: N818  no error: most sets of runs lack some claim's tables
    """Tables that a claim reads are not there; the message says which, and what makes them."""


@dataclass(frozen=True)
class Evidence:
    """The runs that claims are judged by.

    Attributes:
        runs: by the name of their config: ``paper`` of configs/paper.toml.
        cost: the table of `study cost`, or None.
        recordings: spreads of joints from case studies, or None; columns as in
            `study.mocap.case_study.stored_case_studies`.
    """

    runs: Mapping[str, Run]
    cost: pd.DataFrame | None = None
    recordings: pd.DataFrame | None = None
    _read: dict[tuple[str, str], pd.DataFrame] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def of(cls, runs: Iterable[Run], cost: Path | None = None, recordings: pd.DataFrame | None = None) -> "Evidence":
        """Take runs, of different configs, the file of a cost table, and spreads of joints.

        Raises:
            RunError: if two runs are of one config's name, or a file cannot be read.
        """
        named: dict[str, Run] = {}
        for run in runs:
            name = run.study.name
            if name in named:
                raise RunError(f"{named[name].folder} and {run.folder}: both are runs named {name!r}; give one of them")
            named[name] = run
        return cls(named, None if cost is None else _cost(cost), recordings)

    def table(self, config: str, name: str) -> Any:
        """A table of the run of a config, read once.

        Raises:
            TableMissing: if there is no such run, or it did not finish.
        """
        if config not in self.runs:
            raise TableMissing(f"needs a run of configs/{config}.toml")
        if (config, name) not in self._read:
            try:
                self._read[config, name] = self.runs[config].table(name)
            except RunError as error:
                raise TableMissing(str(error)) from None
        return self._read[config, name]

    def costs(self) -> pd.DataFrame:
        """The cost table.

        Raises:
            TableMissing: if none was given.
        """
        if self.cost is None:
            raise TableMissing("needs the cost table: `study cost` makes it")
        return self.cost

    def spreads(self) -> pd.DataFrame:
        """Spreads of joints of recordings.

        Raises:
            TableMissing: if none were given.
        """
        if self.recordings is None:
            raise TableMissing("needs a recording: `study case-study FILE --out DIR`, then `--recording DIR` here")
        return self.recordings


@dataclass(frozen=True)
class Claim:
    """One statement of the paper, and how it is judged.

    Attributes:
        name: a word or two for it, in lower case with hyphens.
        section: of the paper.
        statement: what the paper says, in our words.
        quantity: what is measured.
        criterion: how the numbers become the verdict, in words; it says what ``judge`` does.
        reads: tables, as "config/table"; "cost" for the cost table, "case-study" for those of recordings.
        measure: from the tables to numbers, the headline first.
        judge: from these numbers, in that order, to a verdict. It sees nothing else.
        figure: name of the figure that shows it, or "".
        remark: what a reader should know besides: where the paper's number comes from, what explains ours.
    """

    name: str
    section: str
    statement: str
    quantity: str
    criterion: str
    reads: tuple[str, ...]
    measure: Callable[[Evidence], list[Number]]
    judge: Callable[[list[Number]], Verdict]
    figure: str = ""
    remark: str = ""


class Finding(NamedTuple):
    """A claim's verdict and the numbers behind it; without numbers, the reason why there are none."""

    claim: Claim
    verdict: Verdict
    numbers: list[Number]
    reason: str = ""


def evaluate(claims: Iterable[Claim], evidence: Evidence) -> list[Finding]:
    """Judge claims by the tables at hand.

    Returns:
        A finding per claim. One whose tables are missing is not evaluated and says so; one whose numbers cannot be
        formed, because the tables hold too few trials or conditions, likewise. No number is ever made up.
    """
    return [_evaluate(claim, evidence) for claim in claims]


def _evaluate(claim: Claim, evidence: Evidence) -> Finding:
    try:
        numbers = claim.measure(evidence)
    except TableMissing as missing:
        return Finding(claim, Verdict.NOT_EVALUATED, [], str(missing))
    unformed = [number.words for number in numbers if math.isnan(number.value)]
    if unformed:
        reason = f"too little in the tables for: {'; '.join(unformed)}"
        return Finding(claim, Verdict.NOT_EVALUATED, numbers, reason)
    return Finding(claim, claim.judge(numbers), numbers)


def frame(findings: Iterable[Finding], evidence: Evidence) -> pd.DataFrame:
    """The claims table: a row per claim; columns as `study.runs.storage.schemas.CLAIMS` declares them."""
    rows = []
    for number, (claim, verdict, numbers, reason) in enumerate(findings, start=1):
        head = numbers[0] if numbers else Number.unknown("")
        used = {config for config, _, table in (read.partition("/") for read in claim.reads) if table}
        rows.append(
            {
                "number": number,
                "name": claim.name,
                "section": claim.section,
                "statement": claim.statement,
                "quantity": claim.quantity,
                "value": head.value,
                "error": head.error,
                "trials": min((n.trials for n in numbers if n.trials), default=0),
                "verdict": str(verdict),
                "finding": reason or "\n".join(map(str, numbers)),
                "criterion": claim.criterion,
                "remark": claim.remark,
                "reads": ", ".join(claim.reads),
                "runs": ", ".join(evidence.runs[name].study.run_name() for name in sorted(used & set(evidence.runs))),
                "figure": claim.figure,
            }
        )
    return pd.DataFrame(rows, columns=[column.name for column in schemas.CLAIMS])


def _cost(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise RunError(f"{path}: no cost table; `study cost --out {path}` makes one")
    try:
        table: pd.DataFrame = schemas.read(path)
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read: {error}") from None
    missing = {"estimator", "flops_per_sample", "paper_flops", "scalar_seconds", "vector_seconds"} - set(table.columns)
    if missing:
        raise RunError(f"{path}: not a cost table, without {', '.join(sorted(missing))}; `study cost` makes one")
    return table

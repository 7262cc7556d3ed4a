"""Evaluation of claims: from stored tables to findings, and from findings to the claims table."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import pandas as pd

from study.analysis.claims.claim import Claim, Number, Verdict
from study.analysis.claims.evidence import Evidence, TableMissing
from study.runs.storage import schemas


class Finding(NamedTuple):
    """A claim's verdict and the numbers behind it, or the reason why it could not be evaluated."""

    claim: Claim
    verdict: Verdict
    numbers: list[Number]
    reason: str = ""


def evaluate(claims: Iterable[Claim], evidence: Evidence) -> list[Finding]:
    """Judge claims by the tables at hand.

    Returns:
        A finding per claim. A claim is not evaluated if a table is missing, or holds too few trials or conditions for
        one of the claim's numbers; the finding gives the reason.
    """
    return [_evaluate(claim, evidence) for claim in claims]


def _evaluate(claim: Claim, evidence: Evidence) -> Finding:
    try:
        numbers = claim.measure(evidence)
    except TableMissing as missing:
        return Finding(claim, Verdict.NOT_EVALUATED, [], str(missing))
    unknown = [number.words for number in numbers if math.isnan(number.value)]
    if unknown:
        reason = f"too few trials or conditions in the tables for: {'; '.join(unknown)}"
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

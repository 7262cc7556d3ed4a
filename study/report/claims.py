"""The section of the paper's claims: each with its verdict, the numbers behind it, and the rule that joins them."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

import pandas as pd

from study.analysis.claims.claim import Verdict
from study.report.answers import answer
from study.report.blocks import (
    Badge,
    Block,
    Content,
    Facts,
    Folded,
    InlineCode,
    Items,
    Link,
    Row,
    Section,
    Table,
    Text,
    coded,
)
from study.report.material import Material
from study.report.overview import run_id
from study.report.words import count, readable

_LOOKS = {
    Verdict.REPRODUCED: "good",
    Verdict.PARTLY: "partly",
    Verdict.NOT_REPRODUCED: "bad",
    Verdict.NOT_EVALUATED: "untested",
}


def claims_section(material: Material) -> Iterable[Section]:
    """Section of the claims: first those with a verdict, then those without, and why."""
    claims = material.claims
    yield Section("The paper's claims", "claims", [*_claims(material, claims)])


def _claims(material: Material, claims: pd.DataFrame) -> Iterable[Block]:
    if claims.empty:
        yield Text(
            "No claim of the paper was judged: that takes runs of the project's own configs, such as paper.toml."
        )
        return
    without = claims["verdict"] == Verdict.NOT_EVALUATED
    judged, rest = claims[~without], claims[without]
    if judged.empty:
        yield Text("These runs can judge none of the claims.")
    else:
        head = ["No.", "§", "The paper says", "Found"]
        rows = [_judged(row, material) for row in judged.rename(columns={"name": "claim"}).itertuples()]
        caption = "Each verdict is computed from numbers with their Monte-Carlo errors, by the rule given with them."
        yield Table("The paper's claims and what was found", caption, head, rows, prose=True)
    if not rest.empty:
        rows = [
            Row([str(r.number), str(r.section), str(r.statement), coded(str(r.finding))]) for r in rest.itertuples()
        ]
        table = Table("Claims not evaluated", "", ["No.", "§", "Claim", "Why not"], rows, prose=True)
        title = f"{len(rows)} claim{'s' * (len(rows) > 1)} not evaluated, and why"
        yield from _missing(rest, judged, material)
        yield Folded(title, table)


def tally(claims: pd.DataFrame) -> Text:
    """The sentence that counts each verdict, in the order of the verdicts."""
    found = Counter(str(verdict) for verdict in claims["verdict"])
    order = [*(str(v) for v in Verdict if str(v) in found), *sorted(set(found) - {str(v) for v in Verdict})]
    badges: list[str | Block] = [f"{len(claims)} claim{'s' * (len(claims) > 1)}: "]
    for verdict in order:
        badges += [_badge(verdict, f"{found[verdict]} {verdict}"), " "]
    return Text(badges[:-1])


def _badge(verdict: str, words: str) -> Badge:
    return Badge(words, _LOOKS.get(Verdict(verdict), "untested") if verdict in set(Verdict) else "untested")


def _judged(row: Any, material: Material) -> Row:
    """A claim with a verdict; the row comes from `DataFrame.itertuples`."""
    name = str(row.figure)
    places = {record.name: run_id(record) for record in material.records}
    runs: list[str | Block] = []
    for run in filter(None, str(row.runs).split(", ")):
        runs += [", "] * bool(runs) + [Link(run, places[run]) if run in places else run]
    facts: list[tuple[str, Content]] = [
        ("Measured", str(row.quantity)),
        ("Criterion", str(row.criterion)),
        ("Remark", str(row.remark)),
        ("Trials", f"at least {count(int(row.trials))} behind each number" if row.trials else ""),
        ("Runs", runs),
        ("Tables", InlineCode(str(row.reads)) if row.reads else ""),
        ("Figure", Link(name, name) if name in material.pictures else name),
    ]
    numbers = Items([readable(part) for part in str(row.finding).splitlines()])
    rule = Facts([(term, content) for term, content in facts if content])
    verdict = str(row.verdict)
    found: list[str | Block] = [
        Text([_badge(verdict, verdict)]),
        Text(coded(answer(str(row.claim), verdict, str(row.finding)))),
        Folded("Numbers and rule", [numbers, rule]),
    ]
    cells: list[Content] = [str(row.number), str(row.section), str(row.statement), found]
    return Row(cells, id=f"claim-{row.number}")


def _missing(rest: pd.DataFrame, judged: pd.DataFrame, material: Material) -> Iterable[Block]:
    """Sentence that names the runs or tables that the remaining claims need."""
    reads = _reads(rest)
    given = {record.run.study.name for record in material.records}
    configs = dict.fromkeys(config for config, _, table in (read.partition("/") for read in reads) if table)
    needed: list[str | Block] = [f"configs/{name}.toml" for name in configs if name not in given]
    if needed:
        needed = [f"runs of {', '.join(map(str, needed))}"]
    for table, option in (("cost", "--cost"), ("case-study", "--recording")):
        if table in reads and table not in _reads(judged):
            needed += [", and "] * bool(needed) + [
                "what ",
                InlineCode(f"study {table}"),
                " writes, given by ",
                InlineCode(option),
            ]
    if needed:
        yield Text(["Missing are ", *needed, "."])


def _reads(claims: pd.DataFrame) -> list[str]:
    return [part for cell in claims["reads"] for part in str(cell).split(", ")]

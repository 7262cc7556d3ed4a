"""Verdicts under every reading of the paper: choices that its text leaves open, run and judged again.

A config of readings has for each choice the paper's words, the readings, the one that the study uses, and why. A
reading changes the designs of studies, takes another program for an estimator, or changes a rule of judging. One choice
is read otherwise at a time. A claim is judged again if a reading changes a run that it reads, or a rule.
"""

import json
import tomllib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from study.files import stored_csv
from study.simulation.claims import CLAIMS
from study.simulation.claims.claim import NAMED, Claim, Evidence, Rules, Verdict, evaluate, frame, read_cost
from study.simulation.experiment.config import parse, shipped_config
from study.simulation.runs import runner
from study.simulation.runs.run_folder import Run
from study.text import columns, did_you_mean
from study.toml import Fault, Frozen, Listed, read_document, toml_text

Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
Sentence = Annotated[str, Field(min_length=1)]


class Reading(Frozen):
    """One way to read a choice.

    Attributes:
        name: its name, unique among those of the choice.
        words: what it is.
        clause: the same as the end of a sentence: "if the noise is along the radius"; none for the one that is used.
        runs: names of the configs that it changes.
        design: entries of their designs in place of their own.
        estimators: for estimators of the configs the ones that take their place, and their names in the tables.
        rules: rules of judging.
    """

    name: Name
    words: Sentence
    clause: str = ""
    runs: Listed[str] = ()
    design: Annotated[dict[str, Any], Field(default_factory=dict)]
    estimators: Annotated[dict[str, str], Field(default_factory=dict)]
    rules: Rules = Rules()

    def config(self, name: str) -> str:
        """Text of a shipped config, read in this way; without estimators that no claim names."""
        tables = tomllib.loads(toml_text(shipped_config(name)))
        tables["design"] = {**tables["design"], **self.design}
        tables["estimators"] = [self.estimators.get(other, other) for other in tables["estimators"] if other in NAMED]
        head = f"# configs/{name}.toml, read otherwise: {self.words}\n\n"
        return head + "".join(f"{key} = {_toml(value)}\n" for key, value in tables.items())

    def concerns(self, claim: Claim) -> bool:
        """True if a claim reads errors or points of a run that this reading changes, or it changes a rule.

        Times are left out: they are others each time.
        """
        return self.rules != Rules() or bool(set(self.runs) & _configs(claim, {"errors", "points"}))


class OpenChoice(Frozen):
    """Something that the paper leaves open.

    Attributes:
        name: its name.
        issue: what it is, in a few words.
        section: section of the paper.
        says: what the paper says of it.
        used: name of the reading that the study uses.
        why: the reason.
        as_read: end of a sentence about the reading used: "as eq. 9 is read".
        reading: all readings.
    """

    name: Name
    issue: Sentence
    section: Sentence
    says: Sentence
    used: Name
    why: Sentence
    as_read: str = "as the study reads the paper"
    reading: Annotated[Listed[Reading], Field(min_length=2)]


class _Document(Frozen):
    choice: Annotated[Listed[OpenChoice], Field(min_length=1)]


def _configs(claim: Claim, tables: Collection[str] = ("errors", "points", "timings")) -> set[str]:
    """Names of the configs of whose runs a claim reads one of these tables."""
    return {config for config, _, table in (read.partition("/") for read in claim.reads) if table in tables}


def own_configs() -> list[str]:
    """Names of the configs whose runs claims read, each once."""
    return list(dict.fromkeys(name for claim in CLAIMS for name in sorted(_configs(claim))))


def _toml(value: object) -> str:
    """A value in TOML; tables are inline."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(entry)}' for key, entry in value.items())} }}"
    return f"[{', '.join(map(_toml, value))}]" if isinstance(value, list) else json.dumps(value)


def read(path: Path) -> list[OpenChoice]:
    """Read a config of readings.

    Raises:
        ConfigError: with every fault, its place and its value.
    """
    keys: dict[tuple[str, ...], list[str]] = {(): ["choice"], ("choice",): [*OpenChoice.model_fields]}
    keys["choice", "reading"] = [*Reading.model_fields]
    choices = list(read_document(path, _Document, keys, _faults).choice)
    for choice in choices:
        for reading in choice.reading:
            for name in reading.runs:
                parse(reading.config(name), f"{path}, {choice.name} read as {reading.name}: {name}")
    return choices


def _faults(document: _Document) -> Iterator[Fault]:
    """Entries of choices that do not go together."""
    choices = Counter(choice.name for choice in document.choice)
    for place, choice in enumerate(document.choice):
        names = [reading.name for reading in choice.reading]
        if choices[choice.name] > 1:
            yield Fault(("choice", place, "name"), "is that of another choice", choice.name)
        if choice.used not in names:
            yield Fault(("choice", place, "used"), f"is no reading; {did_you_mean(choice.used, names)}", choice.used)
        for number, reading in enumerate(choice.reading):
            path, used = ("choice", place, "reading", number), reading.name == choice.used
            changes = bool(reading.runs) or reading.rules != Rules()
            if names.count(reading.name) > 1:
                yield Fault((*path, "name"), "is that of another reading", reading.name)
            if used == changes:
                words = "is the one used, and must change nothing" if used else "must change runs or rules"
                yield Fault((*path, "name"), words, reading.name)
            if not used and not reading.clause:
                yield Fault((*path, "clause"), "required for a reading that is not used, but missing")


class _Otherwise:
    """A run whose estimators stand under the names of those whose place they take."""

    def __init__(self, run: Run, names: dict[str, str]) -> None:
        self.study, self.folder = run.study, run.folder
        self._run, self._names = run, names

    def table(
        self, name: str, columns: Collection[str] | None = None, estimators: Collection[str] | None = None
    ) -> pd.DataFrame:
        """A table of the run; see `Run.table`."""
        asked = None if estimators is None else [self._names.get(other, other) for other in estimators]
        table, back = self._run.table(name, columns, asked), {other: own for own, other in self._names.items()}
        named = [column for column in ("estimator", "step") if column in table]
        return table.assign(**{column: table[column].astype(str).replace(back).astype("category") for column in named})


COLUMNS = ("choice", "reading", "number", "claim", "verdict", "used", "value", "error", "trials", "finding")
"""Columns of the table of readings: ``used`` is the verdict under the reading that the study uses."""


def judge(
    choices: Sequence[OpenChoice],
    runs: Sequence[Run],
    folder: Path,
    jobs: int = 2,
    cost: Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """Judge the claims under every reading.

    Args:
        choices: what the paper leaves open.
        runs: the study's own runs, of different configs.
        folder: where the runs of readings go; those that are there already are used.
        jobs: number of workers.
        cost: the file of a cost table.
        progress: called with a line for each reading.

    Returns:
        A row for each reading that is not used and each claim that it may change; see `COLUMNS`.
    """
    own, costs = {run.study.name: run for run in runs}, read_cost(cost)
    used = frame(evaluate(CLAIMS, evidence := Evidence(runs, costs)), evidence).set_index("name")["verdict"]
    parts = []
    for choice, reading in ((one, other) for one in choices for other in one.reading if other.name != one.used):
        claims = [claim for claim in CLAIMS if reading.concerns(claim)]
        if progress is not None:
            progress(f"{choice.issue}: {reading.words}")
        changed: dict[str, Any] = {}
        for name in reading.runs:
            text = reading.config(name)
            run = runner.run(parse(text), text, folder / f"{choice.name}-{reading.name}" / name, jobs)
            changed[name] = _Otherwise(run, reading.estimators) if reading.estimators else run
        needed = set().union(*map(_configs, claims))
        known = {name: run for name, run in {**own, **changed}.items() if name in needed}
        evidence = Evidence(known.values(), costs, rules=reading.rules)
        table = frame(evaluate(claims, evidence), evidence).rename(columns={"name": "claim"})
        table = table.assign(choice=choice.name, reading=reading.name, finding=table["finding"].str.replace("\n", "; "))
        parts.append(table.assign(used=table["claim"].map(used)))
    return pd.concat(parts, ignore_index=True)[list(COLUMNS)]


_HOLDS = {
    Verdict.REPRODUCED: "it holds",
    Verdict.MOSTLY: "it mostly holds",
    Verdict.IN_PART: "it holds in part",
    Verdict.NOT_REPRODUCED: "it does not hold",
}


class Readings:
    """The verdicts under every reading.

    Args:
        choices: what the paper leaves open.
        table: the table of `judge`.

    Attributes:
        letters: number and letter of each reading, by the names of its choice and its own.
        others: the same names of those that are not used.
        changed: its rows in which a verdict is another than under the reading that is used, by the claim's number.
        standing: names of the claims whose verdict is the same under all readings.
    """

    def __init__(self, choices: Sequence[OpenChoice], table: pd.DataFrame) -> None:
        self.choices, self.table = choices, table
        named = zip(table["claim"], table["choice"], table["reading"], strict=True)
        self._verdicts = dict(zip(named, map(str, table["verdict"]), strict=True))
        self._choices = {choice.name: choice for choice in choices}
        self._readings = {(choice.name, one.name): one for choice in choices for one in choice.reading}
        self.letters = {
            (choice.name, one.name): f"{number}{letter}"
            for number, choice in enumerate(choices, start=1)
            for letter, one in zip("abcdefgh", choice.reading, strict=False)
        }
        self.others = [key for key in self._readings if key[1] != self._choices[key[0]].used]
        known = (table[["verdict", "used"]] != str(Verdict.NOT_EVALUATED)).all(axis=1)
        ours = [key in self._readings for key in zip(table["choice"], table["reading"], strict=True)]
        moved = table[known & np.array(ours, dtype=bool) & (table["verdict"] != table["used"])]
        self.changed = moved.sort_values("number", kind="stable")
        self.standing = list(dict.fromkeys(table.loc[known & ~table["claim"].isin(moved["claim"]), "claim"]))

    @classmethod
    def load(cls, path: Path) -> "Readings":
        """Read the table that `study readings` stored, with the shipped choices.

        Raises:
            RunError: if it cannot be read, or is no such table.
        """
        table = stored_csv(path, COLUMNS, f"table of readings; `study readings --out {path}` makes it")
        return cls(read(shipped_config("readings")), table)

    def reading(self, row: Any) -> Reading:
        """The reading of a row of the table."""
        return self._readings[str(row.choice), str(row.reading)]

    def verdict(self, claim: str, choice: str, reading: str) -> str:
        """The verdict on a claim under a reading that may change it, or an empty text."""
        return self._verdicts.get((claim, choice, reading), "")

    def otherwise(self, claim: str) -> str:
        """The end of a sentence on a claim: as what it is read, and how it fares if that is read otherwise."""
        rows = [row for row in self.changed.itertuples() if row.claim == claim]
        if not rows:
            return ""
        parts = [f"{_HOLDS[Verdict(str(row.verdict))]} {self.reading(row).clause}" for row in rows]
        return f" {self._choices[str(rows[0].choice)].as_read}; {'; '.join(parts)}"

    def printed(self) -> Iterator[str]:
        """The verdicts that change, a line each, and the count of those that stand under all readings."""
        rows = [
            [str(row.number), str(row.claim), f"{row.used} → {row.verdict}", self.reading(row).clause]
            for row in self.changed.itertuples()
        ]
        yield from columns(rows, ["", "claim", "verdict", ""], "><")
        head = f"{len(self.choices)} choices, {len(self.others)} other readings"
        moved = self.changed["claim"].nunique()
        yield f"{head}: {len(self.standing)} verdicts stand under all, {moved} change under some"

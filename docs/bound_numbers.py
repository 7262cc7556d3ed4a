"""Numbers of the documents, bound to the tables that they come from.

    python docs/bound_numbers.py            # fails where a text and its table differ; `make lint` runs it
    python docs/bound_numbers.py --write    # writes the tables' numbers into the texts; `make numbers` runs it

`docs/numbers.toml` says which number of which text comes from where:

- ``[tables]``: a name for each stored table;
- ``[numbers]``: a name for each number: the table, the rows (a query of pandas, "" for all), and a column. Of several
  rows one number is made by a word before the column: ``min``, ``max``, ``mean``, ``median``, ``sum``, ``count``. A
  column may be an expression of columns, such as ``error / value``;
- ``[phrases]``: for each text its phrases, word by word, with a name in braces in place of each number. Lines may be
  broken anywhere. A format follows the name after a colon: Python's, or ``.2s`` for two decimals without the zero
  before the point, or ``w`` for a word (seven). ``%`` makes a percentage, with the space before its sign, and ``p`` one
  without the sign;
- ``[given]``: for each text, what looks measured (``±``, ``%``, a factor) and is not: a definition, a level, the
  paper's own number. Anything else that looks measured and is in no phrase is an error.

Whole tables stand between ``<!-- table: x -->`` and ``<!-- end -->``; `docs/number_tables.py` makes x.
"""

import argparse
import math
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import number_tables
import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
WORDS = ["none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
NUMBER = rf"[-\d][\d.,]*\d(?:e-?\d+|\ %)?|\d(?:\ %)?|\.\d+(?:\ %)?|{'|'.join(WORDS)}"
PLACE = re.compile(r"\{(\w+)(?::([^}]*))?\}")
TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
UNMEASURED = re.compile(r"^```.*?^```|^(?: {4}|\t).*?$|`[^`\n]*`|<!-- (?:made|table).*?<!-- end -->", re.M | re.S)
"""Blocks and commands, whose outputs are compared by running them, and tables that are made."""
MEASURED = re.compile(r"[\d.]+ ± [\d.]+|[\d.,]+ %|[\d.]+(?: to [\d.]+)? times\b")
"""Pattern of a measured number in prose."""


class NumbersError(Exception):
    """The file of numbers cannot be used."""


class Fault(NamedTuple):
    """A place at which a text and its table differ.

    Attributes:
        path: of the text, from the root of the repository.
        line: number of the line, from 1.
        words: what is wrong there.
    """

    path: str
    line: int
    words: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.words}"


class Bound:
    """The numbers of the documents of one copy of the repository.

    Attributes:
        root: folder of the repository.
        tables, numbers, phrases, given: the sections of ``docs/numbers.toml``.
        used: names of the numbers that stand in some phrase.
    """

    def __init__(self, root: Path = ROOT) -> None:
        self.root = root
        sections = tomllib.loads((root / "docs" / "numbers.toml").read_text(encoding="utf-8"))
        self.tables: dict[str, str] = sections["tables"]
        self.numbers: dict[str, list[str]] = sections["numbers"]
        self.phrases: dict[str, list[str]] = sections["phrases"]
        self.given: dict[str, list[str]] = sections["given"]
        self.used: set[str] = set()
        self.table = cache(self._read)

    def texts(self) -> list[str]:
        """Paths of the texts: documents, and other files that have phrases."""
        pages = [*self.root.glob("*.md"), *self.root.glob("docs/*.md")]
        names = {path.relative_to(self.root).as_posix() for path in pages} - {"CHANGELOG.md"}
        return sorted(names | set(self.phrases))

    def value(self, name: str) -> float:
        """The number of this name.

        Raises:
            NumbersError: if there is no such name, or its table has no such rows or columns.
        """
        if name not in self.numbers:
            raise NumbersError(f"docs/numbers.toml: no number {name!r} in [numbers]")
        self.used.add(name)
        table, rows, column = self.numbers[name]
        how, _, rest = column.partition(" ")
        several = how in ("min", "max", "mean", "median", "sum")
        try:
            chosen = self.table(table)
            chosen = chosen.query(rows, engine="python") if rows else chosen
            if how == "count":
                return float(len(chosen))
            values = chosen.eval(rest if several else column, engine="python")
        except (KeyError, ValueError, SyntaxError, AttributeError, pd.errors.UndefinedVariableError) as error:
            raise NumbersError(f"docs/numbers.toml: {name}: {error}") from None
        if len(values) != 1 and not (several and len(values)):
            words = f"{len(values) or 'no'} such rows in {self.tables[table]}: {rows}"
            raise NumbersError(f"docs/numbers.toml: {name}: {words}")
        value = float(getattr(values, how)() if several else values.iloc[0])
        if not math.isfinite(value):
            raise NumbersError(f"docs/numbers.toml: {name}: {value} in {self.tables[table]}")
        return value

    def faults(self, path: str, text: str) -> tuple[list[Fault], str]:
        """Compare a text with its tables.

        Args:
            path: of the text, from the root.
            text: its content.

        Returns:
            What differs, and the text with the tables' numbers.
        """
        faults: list[Fault] = []
        edits: list[tuple[int, int, str]] = []
        bound: list[tuple[int, int]] = []

        def at(place: int, words: str) -> None:
            faults.append(Fault(path, text.count("\n", 0, place) + 1, words))

        for phrase in self.phrases.get(path, []):
            matches = list(_pattern(phrase).finditer(text))
            if len(matches) != 1:
                at(0, f"{'no' if not matches else len(matches)} such phrase (docs/numbers.toml): “{phrase}”")
                continue
            (match,) = matches
            bound.append(match.span())
            for group, (name, spec) in enumerate(PLACE.findall(phrase), start=1):
                try:
                    new = formatted(self.value(name), spec)
                except NumbersError as error:
                    at(match.start(group), str(error))
                    continue
                if match[group] != new:
                    source = self.tables[self.numbers[name][0]]
                    at(match.start(group), f"{match[group]} is {new} in {source} ({name})")
                    edits.append((*match.span(group), new))
        for match in TABLE.finditer(text):
            try:
                new = f"\n{self._made(match[2])}\n\n"
            except NumbersError as error:
                at(match.start(), str(error))
                continue
            old = text[match.end(1) : match.start(3)]
            if old != new:
                for place, words in _differences(old, new):
                    at(match.end(1) + place, f"table {match[2]}: {words}")
                edits.append((match.end(1), match.start(3), new))
        for place, words in self._unbound(path, text, bound):
            at(place, f"{words} looks measured: bind it, or give its phrase, in docs/numbers.toml")
        return faults, replaced(text, edits)

    def _unbound(self, path: str, text: str, bound: list[tuple[int, int]]) -> Iterator[tuple[int, str]]:
        """Numbers of prose that look measured and stand in no phrase."""
        if not path.endswith((".md", ".typ")):
            return
        spans = [*bound, *(match.span() for match in UNMEASURED.finditer(text))]
        for phrase in [*self.given.get("everywhere", []), *self.given.get(path, [])]:
            spans += [match.span() for match in _pattern(phrase).finditer(text)]
        for match in MEASURED.finditer(text):
            if not any(start <= match.start() and match.end() <= end for start, end in spans):
                yield match.start(), match[0]

    def _made(self, name: str) -> str:
        return number_tables.markdown(getattr(number_tables, name)(self.table))

    def _read(self, name: str) -> pd.DataFrame:
        """A stored table; as ``findings``, that of the claims with a row for each number of their findings."""
        if name not in self.tables:
            raise NumbersError(f"docs/numbers.toml: no table {name!r} in [tables]")
        path = self.root / self.tables[name]
        if not path.exists():
            raise NumbersError(f"docs/numbers.toml: [tables] {name}: there is no {self.tables[name]}")
        table = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
        return findings(table) if name == "findings" else table


def findings(claims: pd.DataFrame) -> pd.DataFrame:
    """The numbers in the findings of claims.

    Args:
        claims: the table that `study claims` stores.

    Returns:
        A row for each number: ``claim`` (its name), ``verdict``, ``quantity``, ``value`` and ``error``.
    """
    rows = []
    for name, verdict, finding in claims[["name", "verdict", "finding"]].itertuples(index=False):
        for line in finding.splitlines():
            quantity, _, numbers = line.rpartition(": ")
            value, _, error = numbers.partition(" ± ")
            if re.fullmatch(r"[-\d.e+]+", value):
                rows.append((name, verdict, quantity, float(value), float(error or "nan")))
    return pd.DataFrame(rows, columns=["claim", "verdict", "quantity", "value", "error"])


def replaced(text: str, edits: list[tuple[int, int, str]]) -> str:
    """A text with some of its parts replaced: the start and the end of each, and what takes its place."""
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def formatted(value: float, spec: str) -> str:
    """A number as a text has it.

    Args:
        value: the number.
        spec: Python's format, or ``.2s`` (no zero before the point), ``w`` (a word), ``.0%`` or ``.0p``.
    """
    if spec == "w":
        return WORDS[round(value)] if round(value) < len(WORDS) else str(round(value))
    if spec.endswith("s"):
        return re.sub(r"^(-?)0\.", r"\1.", format(value, f"{spec[:-1]}f"))
    if spec.endswith("p"):
        return format(100.0 * value, f"{spec[:-1]}f")
    if spec.endswith("d"):
        return format(round(value), spec)
    return format(value, spec).replace("%", " %")


def _pattern(phrase: str) -> re.Pattern[str]:
    """Search for a phrase with any number in its places, and any break of its lines."""
    parts = PLACE.split(phrase)
    literal = [r"\s+".join(map(re.escape, re.split(r"\s", part))) for part in parts[::3]]
    return re.compile(f"({NUMBER})".join(literal))


def _differences(old: str, new: str) -> Iterator[tuple[int, str]]:
    """The first lines of a table that differ: the place in the old one, and what differs."""
    before, after, place = old.splitlines(keepends=True), new.splitlines(keepends=True), 0
    if len(before) != len(after):
        yield 0, f"{len(after)} lines instead of {len(before)}"
        return
    for one, two in zip(before, after, strict=True):
        if one != two:
            cells = zip(re.split(r"[ |]+", one), re.split(r"[ |]+", two), strict=False)
            here, there = next(((a, b) for a, b in cells if a != b), (one.strip(), two.strip()))
            yield place, f"{here} is {there}"
        place += len(one)


def main() -> None:
    """Compare, or write."""
    options = argparse.ArgumentParser(description="Compare the numbers of texts with the tables they come from.")
    options.add_argument("--write", action="store_true", help="write the tables' numbers into the texts")
    write = options.parse_args().write
    left: list[str] = []
    bound = Bound()
    for path in bound.texts():
        old = (ROOT / path).read_text(encoding="utf-8")
        faults, new = bound.faults(path, old)
        if write and new != old:
            (ROOT / path).write_text(new, encoding="utf-8")
            print(f"{path}: written")
            faults, _ = bound.faults(path, new)
        left += map(str, faults)
    left += [f"docs/numbers.toml: {name}: no phrase has it" for name in sorted(set(bound.numbers) - bound.used)]
    if left:
        advice = "" if write else "\n`make numbers` writes the numbers of the tables into the texts."
        sys.exit("\n".join(left) + advice)


if __name__ == "__main__":
    main()

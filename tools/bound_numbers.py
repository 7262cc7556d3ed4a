"""Numbers of the documents, bound to the tables that they come from.

    python tools/bound_numbers.py            # fails where a text and its table differ; `make lint` runs it
    python tools/bound_numbers.py --write    # writes the tables' numbers into the texts; `make numbers` runs it

`tools/numbers.toml` says which number of which text comes from where:

- ``[tables]``: a name for each stored table;
- ``[numbers]``: a name for each number: the table, the rows (a query of pandas, "" for all), and a column. Of several
  rows one number is made by a word before the column: ``min``, ``max``, ``mean``, ``median``, ``sum``, ``count``. A
  column may be an expression of columns, such as ``error / value``;
- ``[phrases]``: for each text its phrases, word by word, with a name in braces in place of each number. Lines may be
  broken anywhere. A format follows the name after a colon: Python's, or ``w`` for a word (seven). ``%`` makes a
  percentage, with the space before its sign, and ``p`` one without the sign;
- ``[given]``: for each text, what looks measured (``±``, ``%``, a factor) and is not: a definition, a level, the
  paper's own number. Anything else that looks measured and is in no phrase is an error.
- ``[made]``: whole tables, which stand between ``<!-- table: x -->`` and ``<!-- end -->``; `tools/number_tables.py`
  explains how they are described, and makes them.
"""

import argparse
import re
import sys
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import number_tables
import pandas as pd
from number_tables import PLACE, WORDS, formatted

ROOT = Path(__file__).resolve().parents[1]
NUMBER = rf"[-\d][\d.,]*\d(?:e-?\d+|\ %)?|\d(?:\ %)?|{'|'.join(WORDS)}"
TABLE = re.compile(r"(?<=<!-- table: )(\w+) -->\n(.*?)(?=<!-- end -->)", re.DOTALL)
UNMEASURED = re.compile(r"^```.*?^```|^(?: {4}|\t).*?$|`[^`\n]*`|<!-- (?:made|table).*?<!-- end -->", re.M | re.S)
"""Blocks and commands, whose outputs are compared by running them, and tables that are made."""
MEASURED = re.compile(r"[\d.]+ ± [\d.]+|[\d.,]+ %|[\d.]+(?: to [\d.]+)? times\b")
"""Pattern of a measured number in prose."""
MISTAKES = (KeyError, ValueError, SyntaxError, AttributeError, pd.errors.UndefinedVariableError)
"""What a mistake in the file of numbers raises."""


class Bound:
    """The numbers of the documents of one copy of the repository.

    Attributes:
        root: folder of the repository.
        tables, numbers, phrases, given, made: the sections of ``tools/numbers.toml``.
        used: names of the numbers that stand in some phrase.
        table: a stored table by its name.
    """

    def __init__(self, root: Path = ROOT) -> None:
        self.root, self.used = root, set[str]()
        sections = tomllib.loads((root / "tools" / "numbers.toml").read_text(encoding="utf-8"))
        self.tables, self.numbers, self.made = sections["tables"], sections["numbers"], sections["made"]
        self.phrases, self.given = sections["phrases"], sections["given"]
        self.table = cache(self._read)

    def texts(self) -> list[str]:
        """Paths of the texts: documents, and other files that have phrases."""
        pages = [*self.root.glob("*.md"), *self.root.glob("docs/*.md")]
        names = {path.relative_to(self.root).as_posix() for path in pages} - {"CHANGELOG.md"}
        return sorted(names | set(self.phrases))

    def value(self, name: str) -> float:
        """The number of this name; ValueError or another of `MISTAKES` if it is described wrongly."""
        if name not in self.numbers:
            raise ValueError("there is no such number in [numbers]")
        self.used.add(name)
        table, rows, column = self.numbers[name]
        chosen = self.table(table).query(rows, engine="python") if rows else self.table(table)
        how, _, rest = column.partition(" ")
        if how == "count":
            return float(len(chosen))
        several = how in ("min", "max", "mean", "median", "sum")
        values = chosen.eval(rest if several else column, engine="python")
        if len(values) == 0 or (len(values) > 1 and not several):
            raise ValueError(f"{len(values) or 'no'} such rows in {self.tables[table]}: {rows}")
        value = float(getattr(values, how)() if several else values.iloc[0])
        if not abs(value) < float("inf"):
            raise ValueError(f"{value} in {self.tables[table]}")
        return value

    def rows(self, name: str) -> number_tables.Rows:
        """The rows of a whole table of a document."""
        if name in self.made and "cells" in self.made[name]:
            return number_tables.described(self.made[name], self.table)
        return getattr(number_tables, name)(self.table)

    def faults(self, path: str, text: str) -> tuple[list[str], str]:
        """Compare a text with its tables.

        Args:
            path: of the text, from the root.
            text: its content.

        Returns:
            What differs, with the path and the line, and the text with the tables' numbers.
        """
        faults: list[str] = []
        edits: list[tuple[int, int, str]] = []
        bound: list[tuple[int, int]] = []

        def add(place: int, words: str) -> None:
            line = text.count("\n", 0, place) + 1
            faults.append(f"{path}:{line}: {words}")

        def bind(start: int, end: int, source: str, make: Callable[[], str]) -> None:
            try:
                edits.append((start, end, make()))
            except MISTAKES as mistake:
                add(start, f"tools/numbers.toml: {source}: {mistake.args[0]}")
            else:
                for place, words in differences(text[start:end], edits[-1][2]):
                    add(start + place, f"{words} ({source})")

        for phrase in self.phrases.get(path, []):
            matches = list(_pattern(phrase).finditer(text))
            if len(matches) != 1:
                add(0, f"{'no' if not matches else len(matches)} such phrase (tools/numbers.toml): “{phrase}”")
                continue
            bound.append(matches[0].span())
            for group, (name, spec) in enumerate(PLACE.findall(phrase), start=1):
                table = self.tables.get(self.numbers.get(name, [""])[0], "")
                number = f"{name}, {table}" if table else name
                bind(*matches[0].span(group), number, lambda name=name, spec=spec: formatted(self.value(name), spec))
        for match in TABLE.finditer(text):
            name = match[1]
            bind(*match.span(2), f"table {name}", lambda name=name: f"\n{number_tables.markdown(self.rows(name))}\n\n")
        for place, words in self._unbound(path, text, bound):
            add(place, f"{words} looks measured: bind it, or give its phrase, in tools/numbers.toml")
        return faults, replaced(text, edits)

    def _unbound(self, path: str, text: str, bound: list[tuple[int, int]]) -> Iterator[tuple[int, str]]:
        """Numbers of prose that look measured and stand in no phrase."""
        if not path.endswith((".md", ".typ")):
            return
        given = self.given.get("everywhere", []) + self.given.get(path, [])
        spans = bound + [
            match.span() for words in [UNMEASURED, *map(_pattern, given)] for match in words.finditer(text)
        ]
        for match in MEASURED.finditer(text):
            if not any(start <= match.start() and match.end() <= end for start, end in spans):
                yield match.start(), match[0]

    def _read(self, name: str) -> pd.DataFrame:
        """A stored table, or what is derived from one."""
        if name not in self.tables:
            raise ValueError(f"there is no table {name!r} in [tables]")
        path = self.root / self.tables[name]
        if not path.exists():
            raise ValueError(f"[tables] {name}: there is no {self.tables[name]}")
        table = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
        return number_tables.DERIVED.get(name, lambda stored: stored)(table)


def replaced(text: str, edits: list[tuple[int, int, str]]) -> str:
    """A text with some of its parts replaced: the start and the end of each, and what takes its place."""
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text


def _pattern(phrase: str) -> re.Pattern[str]:
    """Search for a phrase with any number in its places, and any break of its lines."""
    literal = [r"\s+".join(map(re.escape, re.split(r"\s", part))) for part in PLACE.split(phrase)[::3]]
    return re.compile(f"({NUMBER})".join(literal))


def differences(old: str, new: str) -> Iterator[tuple[int, str]]:
    """The lines that differ, or that their numbers do: the place in the old text, and the first cell that differs."""
    before, after, place = old.splitlines(keepends=True), new.splitlines(keepends=True), 0
    if len(before) != len(after):
        yield 0, f"{len(before)} lines are {len(after)}"
        return
    for one, two in zip(before, after, strict=True):
        if one != two:
            cells = zip(*(line.strip("| \n").split(" | ") for line in (one, two)), strict=False)
            yield place, "{} is {}".format(*next((pair for pair in cells if pair[0] != pair[1]), (one, two)))
        place += len(one)


def main() -> None:
    """Compare, or write."""
    options = argparse.ArgumentParser(description="Compare the numbers of texts with the tables they come from.")
    options.add_argument("--write", action="store_true", help="write the tables' numbers into the texts")
    write, faults, bound = options.parse_args().write, [], Bound()
    for path in bound.texts():
        old = (bound.root / path).read_text(encoding="utf-8")
        here, new = bound.faults(path, old)
        if write and new != old:
            (bound.root / path).write_text(new, encoding="utf-8")
            print(f"{path}: written")
            here, _ = bound.faults(path, new)
        faults += here
    faults += [f"tools/numbers.toml: {name}: no phrase has it" for name in sorted(set(bound.numbers) - bound.used)]
    if faults:
        advice = "" if write else "\n`make numbers` writes the numbers of the tables into the texts."
        sys.exit("\n".join(faults) + advice)


if __name__ == "__main__":
    main()

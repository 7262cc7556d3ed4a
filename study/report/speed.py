"""Section on speed: the ratios that `make bench` stored, by group, with the machine's name."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from study.report import words
from study.report.blocks import Block, Row, Section, Table, Text
from study.report.material import Material
from study.runs.storage.atomic_write import RunError
from study.text.regular_file import regular

COLUMNS = ("group", "what", "cost", "measured", "ratio", "aim", "machine")

_TIMES = ((1e9, "s"), (1e6, "ms"), (1e3, "µs"))


def read_bench(path: Path) -> pd.DataFrame:
    """The table that `make bench` writes.

    Raises:
        RunError: if it cannot be read, or is no such table.
    """
    try:
        found = pd.read_csv(regular(path), dtype=str, keep_default_na=False)
    except (OSError, UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        why = getattr(error, "strerror", None) or error
        raise RunError(f"{path}: cannot be read: {why}; make bench writes it") from None
    if tuple(found.columns) != COLUMNS or found.empty:
        raise RunError(f"{path}: no table of ratios: needs the columns {', '.join(COLUMNS)}; make bench writes it")
    return found


def _spoken(cost: str, unit: str) -> str:
    """A cost in the unit that suits it: 8.69e+06 ns are 8.69 ms."""
    if unit != "ns":
        return f"{cost}{words.JOINED}{unit}"
    value = float(cost)
    size, name = next((pair for pair in _TIMES if value >= pair[0]), (1.0, "ns"))
    return f"{words.timed(value / size)}{words.JOINED}{name}"


def speed_section(material: Material) -> Iterable[Section]:
    """Section with a table per group of benchmarks; empty if there are none."""
    if material.bench is None:
        return
    machine = material.bench["machine"].iloc[0]
    content: list[Block] = [
        Text(
            f"Measured on {machine}, in one run. A ratio compares a row with the row of its group whose ratio is 1, by "
            "the best of many rounds of each. A group without such a row has times alone."
        )
    ]
    for group, part in material.bench.groupby("group", sort=False):
        cells = part[["what", "cost", "measured", "ratio", "aim"]].to_numpy(dtype=str).tolist()
        rows = [Row([what, _spoken(cost, unit), words.readable(ratio), aim]) for what, cost, unit, ratio, aim in cells]
        head = ["What", "Cost", "Ratio", "Aim"]
        content.append(Table(f"Speed: {group}", str(group), head, rows, numeric=frozenset({1, 2})))
    yield Section("Speed", "speed", content)

"""The output of `study fit`: for people, as JSON, or as CSV."""

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from study.analysis.points.fitting import STANDARD_UNCERTAINTY, Row, all_ok, fit_rows, printed
from study.analysis.points.point_file import PointTable
from study.analysis.points.remarks import doubts, intervals_in_words, uses_outliers
from study.estimators import Fit
from study.estimators.answer.table import statuses
from study.text.columns import columns
from study.text.json_text import json_text
from study.text.numbers import number, with_error
from study.text.spreadsheet_cell import inert


class FileFits(NamedTuple):
    """The points of a file and their fits.

    Attributes:
        path: the file; ``-`` for standard input.
        table: its points.
        fits: of shape (), by estimator.
    """

    path: Path
    table: PointTable
    fits: dict[str, Fit]

    def rows(self) -> list[Row]:
        """A row per fit."""
        return fit_rows(self.fits, self.table.names)

    def ok(self) -> bool:
        """True if every fit is ok and uses no outliers."""
        return all_ok(self.rows()) and not any(map(uses_outliers, self.fits.values()))


def as_text(files: list[FileFits], noise: float | None = None) -> Iterator[str]:
    """Lines for a terminal: the fits of a file, or a line for each of several, and what the numbers are.

    Args:
        files: the fits.
        noise: the noise that was given.
    """
    if len(files) == 1:
        (only,) = files
        yield from printed(only.rows(), only.table.names)
        first = next(iter(only.fits.values()))
        yield from intervals_in_words(first, only.table.names)
        yield from doubts(first)
    else:
        yield from _table(files)
    chosen = [
        f"coordinates are {', '.join(names)}; columns left out: {', '.join(left)}" for _, names, left in _tables(files)
    ]
    yield from dict.fromkeys(chosen)
    idle = [] if noise is None else [name for name, fit in files[0].fits.items() if not fit.noise_is_known]
    if idle:
        yield f"--noise {noise:g} is not used by {', '.join(idle)}: the noise is found in the points"
    yield STANDARD_UNCERTAINTY


def _tables(files: list[FileFits]) -> list[PointTable]:
    """The tables of which columns were left out."""
    return [each.table for each in files if each.table.left]


def _table(files: list[FileFits]) -> Iterator[str]:
    """A line per file and estimator, and the meaning of statuses that are not ok."""
    most = max(files, key=lambda each: len(each.table.names)).table.names
    same = all(each.table.names == most for each in files)
    axes = most if same else [f"center {i}" for i in range(1, len(most) + 1)]
    cells, meanings, remarks = [], {}, 0
    for each in files:
        for (estimator, fit), row in zip(each.fits.items(), each.rows(), strict=True):
            names = each.table.names
            center = [with_error(row[f"center_{name}"], row[f"error_{name}"]) for name in names]
            center += ["-"] * (len(axes) - len(names))
            radius, noise = with_error(row["radius"], row["radius_error"]), number(row["noise"])
            status, said = statuses(fit.status), len(list(doubts(fit)))
            if not fit.ok:
                meanings[status] = row["status"]
            remarks += said
            cells.append(
                [str(each.path), estimator, *center, radius, noise, str(row["samples"]), str(said or "-"), status]
            )
    yield from columns(cells, ["file", "estimator", *axes, "radius", "noise", "samples", "remarks", "status"])
    yield from (
        meaning if meaning.startswith(status) else f"{status}: {meaning}" for status, meaning in meanings.items()
    )
    if remarks:
        yield "study fit with one of the files prints the remarks on it, such as its outliers"


def as_json(files: list[FileFits]) -> str:
    """A list of objects, one per file and estimator, with the library's names; null where there is no number."""
    return json_text([_object(each, fit) for each in files for fit in each.fits.values()])


def as_csv(files: list[FileFits]) -> str:
    """A row per file and estimator, with a header; an empty cell where there is no number."""
    rows = [{"file": str(each.path)} | row for each in files for row in each.rows()]
    text = io.StringIO()
    titles = {name: inert(name) for row in rows for name in row}
    writer = csv.DictWriter(text, list(titles), lineterminator="\n")
    writer.writerow(titles)
    for row in rows:
        writer.writerow({name: "" if _is_no_number(value) else inert(value) for name, value in row.items()})
    return text.getvalue().rstrip("\n")


def _object(each: FileFits, fit: Fit) -> dict[str, object]:
    more = {"file": each.path, "coordinates": each.table.names, "columns_left_out": each.table.left}
    return more | fit.to_dict()


def _is_no_number(value: object) -> bool:
    return isinstance(value, float) and not math.isfinite(value)

"""The output of `study fit`: for people, as JSON, or as CSV."""

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from study.analysis.points.fitting import STANDARD_UNCERTAINTY, Row, all_ok, fit_rows, printed
from study.analysis.points.point_file import PointTable
from study.analysis.points.remarks import LEVEL, doubts, intervals_in_words, uses_outliers
from study.estimators import Fit, Status
from study.text.json_text import json_text


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
    """Lines for a terminal: the fits of each file, and what the numbers are.

    Args:
        files: the fits.
        noise: the noise that was given.
    """
    for place, each in enumerate(files):
        if len(files) > 1:
            yield from [""] * (place > 0)
            yield f"{each.path}"
        yield from printed(each.rows(), each.table.names)
        first = next(iter(each.fits.values()))
        yield from intervals_in_words(first, each.table.names)
        yield from doubts(first)
        if len(each.table.names) > 3:
            yield f"{len(each.table.names)} columns are a sphere in as many dimensions; --columns chooses some of them"
        if each.table.left:
            yield f"coordinates are {', '.join(each.table.names)}; columns left out: {', '.join(each.table.left)}"
    idle = [] if noise is None else [name for name, fit in files[0].fits.items() if not fit.noise_is_known]
    if idle:
        yield f"--noise {noise:g} is not used by {', '.join(idle)}: the noise is found in the points"
    yield STANDARD_UNCERTAINTY


def as_json(files: list[FileFits]) -> str:
    """A list of objects, one per file and estimator, with the library's names; null where there is no number."""
    return json_text([_object(each, *pair) for each in files for pair in each.fits.items()])


def as_csv(files: list[FileFits]) -> str:
    """A row per file and estimator, with a header; an empty cell where there is no number."""
    rows = [{"file": str(each.path)} | row for each in files for row in each.rows()]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(name for row in rows for name in row)), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: "" if _is_no_number(value) else value for name, value in row.items()})
    return text.getvalue().rstrip("\n")


def _object(each: FileFits, estimator: str, fit: Fit) -> dict[str, object]:
    errors = fit.standard_errors
    status = Status(int(fit.status))
    return {
        "file": each.path,
        "estimator": estimator,
        "ok": fit.ok,
        "status": status.name.lower(),
        "status_text": status.text,
        "samples": fit.count,
        "coordinates": each.table.names,
        "outliers": fit.outliers.nonzero()[0],
        "copies": fit.copies,
        "columns_left_out": each.table.left,
        "center": fit.center,
        "center_errors": errors[:-1],
        "radius": fit.radius,
        "radius_error": errors[-1],
        "diameter": fit.diameter,
        "diameter_error": 2.0 * errors[-1],
        "correlation": fit.correlation,
        "sigma": fit.sigma,
        "residual_rms": fit.residual_rms,
        "form_error": fit.form_error,
        "largest_deviation": fit.largest_deviation,
        "condition": fit.condition,
        "radius_interval": fit.interval("radius", LEVEL),
        "center_intervals": fit.interval("center", LEVEL),
    }


def _is_no_number(value: object) -> bool:
    return isinstance(value, float) and not math.isfinite(value)

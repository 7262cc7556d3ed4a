"""A user's own points, fitted by one estimator or all: centres, radii, their standard errors, and the form."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from study.analysis.points.remarks import interval_numbers
from study.analysis.points.source import PointFileError
from study.estimators import ESTIMATORS, Fit, Status, fit
from study.estimators.own.plugin_file import load
from study.estimators.status import explain
from study.sphere.types import Floats
from study.text.columns import columns
from study.text.nearest import did_you_mean
from study.text.numbers import number, with_error

Row = dict[str, Any]
"""A fit by the names of its numbers."""
STANDARD_UNCERTAINTY = "± is one standard uncertainty"


def choose(estimator: str, noise: float | None) -> list[str]:
    """Names of the estimators to use; "all" leaves out those that need a noise that is not given.

    Args:
        estimator: a name, or "all"; or a file of estimators and a name, ``my.py:name``.
        noise: standard deviation of a coordinate, if known.

    Raises:
        PluginError: if the file of estimators cannot be used.
        PointFileError: if there is no such estimator, or it needs the noise, or the noise is not positive.
    """
    if noise is not None and not (math.isfinite(noise) and noise > 0.0):
        raise PointFileError(f"--noise {noise:g}: a standard deviation must be positive and finite")
    if noise is not None and not 0.0 < noise * noise < math.inf:
        raise PointFileError(f"--noise {noise:g}: too small or large to compute with, its square is not a number")
    file, colon, name = estimator.rpartition(":")
    if colon and file.endswith(".py"):
        load(Path(file))
        estimator = name
    if estimator == "all":
        return [name for name, entry in ESTIMATORS.items() if noise is not None or entry.needs != "noise"]
    if estimator not in ESTIMATORS:
        hint = did_you_mean(estimator, [*ESTIMATORS, "all"])
        raise PointFileError(f"--estimator {estimator}: unknown; {hint}")
    if noise is None and ESTIMATORS[estimator].needs == "noise":
        raise PointFileError(f"--estimator {estimator}: needs the noise level; give --noise, or take als")
    return [estimator]


def fit_all(points: Floats, estimators: list[str], noise: float | None) -> dict[str, Fit]:
    """Fit points (n, d) by each estimator."""
    return {name: fit(points, name, noise) for name in estimators}


def fit_rows(fits: dict[str, Fit], names: list[str]) -> list[Row]:
    """The fits as rows of a table.

    Args:
        fits: fits of shape () by estimator.
        names: the coordinates' names.

    Returns:
        A row per estimator: estimator, each coordinate of the centre (center_x) and its standard error (error_x),
        radius and diameter with theirs, noise σ̂, residual RMS, form error, largest deviation, ρ, the ends of the 95 %
        intervals (radius_low, radius_high, center_x_low, …), numbers of outliers and copies, samples used, status in
        words.
    """
    rows = []
    for estimator, result in fits.items():
        row: Row = {"estimator": estimator}
        *errors, radius_error = result.standard_errors
        for name, value, error in zip(names, result.center, errors, strict=True):
            row[f"center_{name}"], row[f"error_{name}"] = float(value), float(error)
        row["radius"], row["radius_error"] = float(result.radius), float(radius_error)
        row["diameter"], row["diameter_error"] = float(result.diameter), 2.0 * float(radius_error)
        row["noise"] = float(result.sigma)
        row["residual_rms"], row["condition"] = float(result.residual_rms), float(result.condition)
        row["form_error"], row["largest_deviation"] = float(result.form_error), float(result.largest_deviation)
        row |= interval_numbers(result, names)
        row["outliers"], row["copies"] = int(result.outliers.sum()), int(result.copies)
        row["samples"], row["status"] = int(result.count), explain(int(result.status))
        rows.append(row)
    return rows


def all_ok(rows: Iterable[Row]) -> bool:
    """True if every fit's status is ok."""
    return all(row["status"] == Status.OK.text for row in rows)


def printed(rows: list[Row], names: list[str]) -> Iterator[str]:
    """The fits for a terminal: numbers to two digits of their standard error, the form, and remarks on the fits."""
    cells, form = [], []
    notes: dict[str, list[str]] = {}
    for row in rows:
        measured = [with_error(row[f"center_{name}"], row[f"error_{name}"]) for name in names]
        measured.append(with_error(row["radius"], row["radius_error"]))
        others = [number(row["noise"]), number(row["residual_rms"]), number(row["condition"], ".2g")]
        ok = row["status"] == Status.OK.text
        cells.append([row["estimator"], *measured, *others, str(row["samples"]), "ok" if ok else "see below"])
        shape = [number(row["form_error"]), number(row["largest_deviation"])]
        form.append([row["estimator"], with_error(row["diameter"], row["diameter_error"]), *shape])
        if not ok:
            notes.setdefault(row["status"], []).append(row["estimator"])
    yield from columns(cells, ["estimator", *names, "radius", "noise", "rms", "ρ", "samples", "status"])
    yield ""
    yield from columns(form, ["estimator", "diameter", "form error", "largest deviation"])
    for status, estimators in notes.items():
        yield f"{', '.join(estimators)}: {status}"
    cautions = {ESTIMATORS[row["estimator"]].caution for row in rows} - {""}
    for caution in sorted(cautions):
        estimators = [row["estimator"] for row in rows if ESTIMATORS[row["estimator"]].caution == caution]
        yield f"{', '.join(estimators)}: {caution}"

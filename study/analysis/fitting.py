"""A user's own points, fitted by one estimator or all: a table of answers with standard errors."""

import difflib
import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.analysis.pointfile import PointFileError
from study.estimators import ESTIMATORS, Fit, Status, fit
from study.estimators.status import explain
from study.sphere.types import Floats


def choose(estimator: str, noise: float | None) -> list[str]:
    """Names of the estimators asked for; "all" leaves out those that need a noise that is not given.

    Raises:
        PointFileError: if there is no such estimator, or it needs the noise, or the noise is not positive.
    """
    if noise is not None and not (math.isfinite(noise) and noise > 0.0):
        raise PointFileError(f"--noise {noise:g}: a standard deviation must be positive and finite")
    if estimator == "all":
        return [name for name, entry in ESTIMATORS.items() if noise is not None or entry.needs != "noise"]
    if estimator not in ESTIMATORS:
        near = difflib.get_close_matches(estimator, [*ESTIMATORS, "all"], n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise PointFileError(f"--estimator {estimator}: {hint}known are {', '.join(ESTIMATORS)}, or all")
    if noise is None and ESTIMATORS[estimator].needs == "noise":
        raise PointFileError(f"--estimator {estimator}: needs the noise level; give --noise, or take als")
    return [estimator]


def fit_all(points: Floats, estimators: list[str], noise: float | None) -> dict[str, Fit]:
    """Fit points (n, d) by each estimator."""
    return {name: fit(points, name, noise) for name in estimators}


def answers(fits: dict[str, Fit], names: list[str]) -> pd.DataFrame:
    """A row per estimator.

    Args:
        fits: answers of shape () by estimator.
        names: the coordinates' names.

    Returns:
        Columns: estimator, each coordinate of the centre (center_x) and its standard error (error_x), radius and
        radius_error, noise σ̂, residual RMS, ρ, samples used, status.
    """
    rows = []
    for estimator, result in fits.items():
        row: dict[str, object] = {"estimator": estimator}
        *errors, radius_error = result.standard_errors
        for name, value, error in zip(names, result.center, errors, strict=True):
            row[f"center_{name}"], row[f"error_{name}"] = float(value), float(error)
        row["radius"], row["radius_error"] = float(result.radius), float(radius_error)
        row["noise"] = float(np.sqrt(result.noise_variance))
        row["residual_rms"], row["condition"] = float(result.residual_rms), float(result.condition)
        row["samples"], row["status"] = int(result.count), explain(int(result.status))
        rows.append(row)
    return pd.DataFrame(rows)


def printed(table: pd.DataFrame, names: list[str]) -> Iterator[str]:
    """The table for a terminal: numbers to two digits of their standard error, and what is not ok below."""
    lines = [["estimator", *names, "radius", "noise", "rms", "ρ", "samples", "status"]]
    notes: dict[str, list[str]] = {}
    for _, row in table.iterrows():
        measured = [_with_error(row[f"center_{name}"], row[f"error_{name}"]) for name in names]
        measured.append(_with_error(row["radius"], row["radius_error"]))
        others = [f"{row['noise']:.3g}", f"{row['residual_rms']:.3g}", f"{row['condition']:.2g}"]
        others = [other.replace("nan", "-") for other in others]
        ok = row["status"] == Status.OK.text
        lines.append([row["estimator"], *measured, *others, str(row["samples"]), "ok" if ok else "see below"])
        if not ok:
            notes.setdefault(row["status"], []).append(row["estimator"])
    wide = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    for line in lines:
        yield "  ".join(f"{cell:<{w}}" for cell, w in zip(line, wide, strict=True)).rstrip()
    for status, estimators in notes.items():
        yield f"{', '.join(estimators)}: {status}"
    cautions = {ESTIMATORS[name].caution for name in table["estimator"]} - {""}
    for caution in sorted(cautions):
        estimators = [name for name in table["estimator"] if ESTIMATORS[name].caution == caution]
        yield f"{', '.join(estimators)}: {caution}"


def described() -> Iterator[str]:
    """The registry for a terminal: a line per estimator."""
    rows = [["estimator", "FLOPs per sample (3-D)", "needs", "from"]]
    for name, entry in ESTIMATORS.items():
        cost = f"{entry.flops(3):g} {entry.flops_of}".strip() if entry.flops else "-"
        rows.append([name, cost, entry.needs or "-", entry.reference])
    wide = [max(len(row[i]) for row in rows) for i in range(3)]
    for row in rows:
        yield "  ".join(f"{cell:<{w}}" for cell, w in zip(row, [*wide, 0], strict=True)).rstrip()


def _with_error(value: float, error: float) -> str:
    """A value to the second digit of its error: 12.345 ± 0.067."""
    if not math.isfinite(value):
        return "-"
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g} ± ?"
    digits = 1 - int(f"{error:.1e}".partition("e")[2])  # of the rounded error: 0.0996 is 0.10
    if not -6 <= digits <= 12:
        return f"{value:.6g} ± {error:.2g}"
    return " ± ".join(f"{round(number, digits) + 0.0:.{max(digits, 0)}f}" for number in (value, error))

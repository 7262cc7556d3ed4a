"""A user's own points, fitted by one estimator or all: centres, radii and their standard errors."""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.analysis.pointfile import PointFileError
from study.estimators import ESTIMATORS, Fit, Status, fit
from study.estimators.status import explain
from study.sphere.types import Floats
from study.text.columns import columns
from study.text.nearest import did_you_mean
from study.text.numbers import number, with_error


def choose(estimator: str, noise: float | None) -> list[str]:
    """Names of the estimators to use; "all" leaves out those that need a noise that is not given.

    Args:
        estimator: a name, or "all".
        noise: standard deviation of a coordinate, if known.

    Raises:
        PointFileError: if there is no such estimator, or it needs the noise, or the noise is not positive.
    """
    if noise is not None and not (math.isfinite(noise) and noise > 0.0):
        raise PointFileError(f"--noise {noise:g}: a standard deviation must be positive and finite")
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


def fit_table(fits: dict[str, Fit], names: list[str]) -> pd.DataFrame:
    """The fits as a table, a row per estimator.

    Args:
        fits: fits of shape () by estimator.
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
    """The fits for a terminal: numbers to two digits of their standard error, and remarks on the fits below them."""
    rows = []
    notes: dict[str, list[str]] = {}
    for _, row in table.iterrows():
        measured = [with_error(row[f"center_{name}"], row[f"error_{name}"]) for name in names]
        measured.append(with_error(row["radius"], row["radius_error"]))
        others = [number(row["noise"]), number(row["residual_rms"]), number(row["condition"], ".2g")]
        ok = row["status"] == Status.OK.text
        rows.append([row["estimator"], *measured, *others, str(row["samples"]), "ok" if ok else "see below"])
        if not ok:
            notes.setdefault(row["status"], []).append(row["estimator"])
    yield from columns(rows, ["estimator", *names, "radius", "noise", "rms", "ρ", "samples", "status"])
    for status, estimators in notes.items():
        yield f"{', '.join(estimators)}: {status}"
    cautions = {ESTIMATORS[name].caution for name in table["estimator"]} - {""}
    for caution in sorted(cautions):
        estimators = [name for name in table["estimator"] if ESTIMATORS[name].caution == caution]
        yield f"{', '.join(estimators)}: {caution}"

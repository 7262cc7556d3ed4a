"""One trial drawn again: its points, the truth, the bound, and every estimator's fit."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.estimators import Fit
from study.estimators.estimates import blank
from study.estimators.registry import as_fit
from study.estimators.status import explain
from study.experiment.conditions import CONDITIONS, bound_law
from study.experiment.config import Study
from study.experiment.guarded_fit import attempt
from study.experiment.replay import Trial
from study.text.columns import columns


def points(trial: Trial) -> pd.DataFrame:
    """The points, a row per sample: columns x_1 … x_d."""
    return pd.DataFrame({f"x_{i + 1}": row for i, row in enumerate(trial.samples.x[0])})


def fits(study: Study, trial: Trial) -> dict[str, Fit]:
    """The true sphere under the name "truth", and every estimator's fit, each of shape ()."""
    cell = trial.cell
    truth = blank(1, study.dimension)
    truth.center[:], truth.radius[:] = cell.center, cell.radius
    found = {"truth": Fit(truth.reshape(), trial.samples, "truth")}
    for name in study.estimators:
        found[name] = as_fit(attempt(name, trial.samples)[0].reshape(), trial.samples, name)
    return found


def fit_table(study: Study, trial: Trial) -> pd.DataFrame:
    """Every estimator's fit as a row, with the same numbers as in the run's error table.

    Returns:
        Columns: estimator, error (distance of the centre from the truth), over_bound (in units of √tr CRLB of the
        realised directions), axis (error along the cap's axis), radius_error, noise (σ̂, or the σ that was given),
        condition (ρ), iterations, status in words.
    """
    d, scale, level = study.dimension, trial.cell.scale, trial.cell.level
    bound = trial.cell.noise * float(np.sqrt(np.trace(trial.unit_bound[:d, :d])))
    rows = []
    for name in study.estimators:
        fit, raised = attempt(name, trial.level)
        vector = (fit.center[0] - np.array(level.center)) * scale
        error = float(np.linalg.norm(vector))
        rows.append(
            {
                "estimator": name,
                "error": error,
                "over_bound": error / bound,
                "axis": float(vector[0]),
                "radius_error": float((fit.radius[0] - level.radius) * scale),
                "noise": float(np.sqrt(fit.noise_variance[0]) * scale),
                "condition": float(fit.condition[0]),
                "iterations": int(fit.iterations[0]),
                "status": raised.get(0, explain(int(fit.status[0]))),
            }
        )
    return pd.DataFrame(rows)


def printed(study: Study, trial: Trial) -> Iterator[str]:
    """The trial for a terminal: its conditions, the bound, and a line per estimator."""
    cell, d = trial.cell, study.dimension
    errors = cell.noise * np.sqrt(np.diag(trial.unit_bound))
    center = ", ".join(f"{value:.9g}" for value in cell.center)
    yield f"{study.run_name()}, cell {cell.name}, trial {trial.trial}"
    further = "".join(f", {CONDITIONS[name].label(cell.values)}" for name, _ in cell.further)
    yield f"  N = {cell.samples:,}, σ = {cell.noise:g} ({cell.noise / cell.radius:.3g} r), φ = {cell.angle:g}°{further}"
    yield f"  true centre ({center}), radius {cell.radius:g}"
    law = bound_law(dict(cell.further))
    yield (
        f"  {law or 'bound'}: {np.sqrt(np.sum(errors[:d] ** 2)):.3g} for the centre ({errors[0]:.3g} along the axis), "
        f"{errors[d]:.3g} for the radius"
    )
    rows = []
    for row in fit_table(study, trial).to_dict("records"):
        numbers = [row[name] for name in ("error", "over_bound", "axis", "radius_error", "noise", "condition")]
        texts = [f"{value:.3g}" if np.isfinite(value) else "-" for value in numbers]
        rows.append([row["estimator"], *texts, str(row["iterations"] or "-"), row["status"]])
    titles = ["estimator", "error", "over bound", "along axis", "radius error", "noise", "ρ", "iterations", "status"]
    yield from columns(rows, titles)

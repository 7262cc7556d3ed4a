"""One trial drawn again, for a reader: the truth, the bound, and what every estimator makes of it."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.estimators import Fit
from study.estimators.fit import blank
from study.estimators.status import explain
from study.experiment.config import Study
from study.experiment.guarded_fit import attempt
from study.experiment.replay import Trial


def points(trial: Trial) -> pd.DataFrame:
    """The points, a row per sample: columns x_1 … x_d."""
    return pd.DataFrame({f"x_{i + 1}": row for i, row in enumerate(trial.samples.x[0])})


def fits(study: Study, trial: Trial) -> dict[str, Fit]:
    """Every estimator's answer, and the true sphere, each a fit of shape ()."""
    cell = trial.cell
    found = {name: attempt(name, trial.samples)[0].reshape(samples=trial.samples) for name in study.estimators}
    truth = blank(1, study.dimension)
    truth.center[:], truth.radius[:] = cell.center, cell.radius
    return {"truth": truth.reshape(samples=trial.samples)} | found


def answers(study: Study, trial: Trial) -> pd.DataFrame:
    """Every estimator's answer, a row each, as the run's error table has them.

    Returns:
        Columns: estimator, error (distance of the centre from the truth), over_bound (in units of √tr CRLB of the
        realised directions), axis (error along the cap's axis), radius_error, noise (σ̂, or σ as told), condition (ρ),
        iterations, status in words.
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
    yield f"  N = {cell.samples:,}, σ = {cell.noise:g} ({cell.noise / cell.radius:.3g} r), φ = {cell.angle:g}°"
    yield f"  true centre ({center}), radius {cell.radius:g}"
    yield (
        f"  bound: {np.sqrt(np.sum(errors[:d] ** 2)):.3g} for the centre ({errors[0]:.3g} along the axis), "
        f"{errors[d]:.3g} for the radius"
    )
    lines = [["estimator", "error", "over bound", "along axis", "radius error", "noise", "ρ", "steps", "status"]]
    for row in answers(study, trial).to_dict("records"):
        numbers = [row[name] for name in ("error", "over_bound", "axis", "radius_error", "noise", "condition")]
        texts = [f"{value:.3g}" if np.isfinite(value) else "-" for value in numbers]
        lines.append([row["estimator"], *texts, str(row["iterations"] or "-"), row["status"]])
    wide = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    for line in lines:
        yield "  ".join(f"{text:<{w}}" for text, w in zip(line, wide, strict=True)).rstrip()

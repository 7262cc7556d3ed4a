"""The tables of a chain: the posterior in numbers, each estimator's fit beside it, and stored draws."""

import math
from typing import Any

import numpy as np
import pyarrow as pa
from scipy import special

from study.estimators import ESTIMATORS, Samples
from study.estimators.registry import fit_samples
from study.experiment.config import Study
from study.experiment.replay import Trial
from study.posterior.sampler import Chain
from study.runs.storage import schemas
from study.sphere.cap_moments import cap_moments
from study.sphere.types import Floats

Row = dict[str, Any]

STORED_DRAWS = 2000
"""Largest number of draws that are stored of a chain."""


def rows(study: Study, trial: Trial, chain: Chain, key: Row, walkers: int, keep: bool) -> dict[str, pa.Table]:
    """Rows of the three tables for one chain.

    Args:
        study: the config, which has the estimators whose fits are compared with the chain, and the conditions.
        trial: the data set.
        chain: the posterior of its sphere.
        key: columns that identify the chain: cell, trial, likelihood, noise_is.
        walkers: number of walkers.
        keep: store draws.

    Returns:
        Tables ``posterior`` (one row), ``answers`` (a row per estimator) and ``draws`` (empty if they are not stored).
    """
    d = trial.samples.x.shape[1]
    truth = np.array([*trial.cell.center, trial.cell.radius, trial.cell.noise])
    known = key["noise_is"] == "known"
    draws = chain.flat - truth[: d + 2 - known]
    beside = [key | _answer(trial, name, draws, known) for name in study.estimators]
    walker_by_walker = np.arange(len(draws)).reshape(-1, walkers).T.ravel()
    chosen = np.linspace(0, len(draws) - 1, min(len(draws), STORED_DRAWS)).round().astype(int)
    stored = draws[walker_by_walker[chosen]] if keep and len(draws) else draws[:0]
    noise = stored[:, d + 1] + trial.cell.noise if not known else np.full(len(stored), trial.cell.noise)
    columns = {f"error_{i + 1}": stored[:, i] for i in range(d)} | {"radius_error": stored[:, d], "noise": noise}
    return {
        "posterior": _table(schemas.posterior(d, study.conditions()), [key | _posterior(trial, chain, draws, walkers)]),
        "answers": _table(schemas.answers(d), beside),
        "draws": schemas.table(schemas.draws(d), {k: [v] * len(stored) for k, v in key.items()} | columns),
    }


def _table(columns: list[schemas.Column], found: list[Row]) -> pa.Table:
    return schemas.table(columns, {column.name: [row[column.name] for row in found] for column in columns})


def names(dimension: int) -> list[str]:
    """Endings of the columns that exist once per parameter."""
    return [*(str(i + 1) for i in range(dimension)), "radius", "noise"]


def _posterior(trial: Trial, chain: Chain, draws: Floats, walkers: int) -> Row:
    """The row of the posterior table; draws (n, parameters) are differences from the truth."""
    cell, d = trial.cell, trial.samples.x.shape[1]
    extent = cell.radius**2 * cap_moments(math.radians(cell.angle), d).along
    row: Row = cell.values | {"flatness": cell.noise**2 / extent}
    row |= {"status": int(chain.status), "tau": chain.tau, "acceptance": chain.acceptance}
    row |= {"steps": chain.steps, "walkers": walkers, "draws": len(draws) / chain.tau}
    unit = np.sqrt(np.diag(trial.unit_bound))
    row |= {f"bound_{name}": cell.noise * unit[i] for i, name in enumerate(names(d)[: d + 1])}
    correlation = trial.unit_bound[0] / unit / unit[0]
    row |= {f"bound_with_{name}": correlation[i] for i, name in enumerate(names(d)[: d + 1]) if i}
    row |= {"trace": math.nan, "level": math.nan}
    for i, name in enumerate(names(d)):
        known = i < draws.shape[1] and len(draws) > 0
        values = draws[:, i] if known else np.full(1, math.nan)
        row |= {f"mean_{name}": values.mean(), f"sd_{name}": values.std()}
        row |= {
            f"{label}_{name}": quantile
            for label, quantile in zip(
                schemas.POSTERIOR_QUANTILES,
                np.quantile(values, list(schemas.POSTERIOR_QUANTILES.values())),
                strict=True,
            )
        }
        row[f"rank_{name}"] = float(np.mean(values < 0.0)) if known else math.nan
    if len(draws):
        center, covariance = draws[:, :d].mean(axis=0), np.cov(draws[:, :d].T)
        squares = _squares(draws[:, :d] - center, covariance)
        row["trace"] = float(np.trace(covariance))
        row["level"] = float(np.mean(squares < _squares(center[None], covariance)))
    return row


def _answer(trial: Trial, name: str, draws: Floats, known: bool) -> Row:
    """An estimator's row: its distance from the posterior mean, and the truth's quantiles in its own distribution."""
    d = trial.samples.x.shape[1]
    given = known or ESTIMATORS[name].needs == "noise"
    samples = Samples(trial.samples.x, trial.samples.noise if given else None)
    fit = fit_samples(samples, name)
    answer = np.append(fit.center[0] - np.array(trial.cell.center), fit.radius[0] - trial.cell.radius)
    error = fit.standard_errors[0]
    spare, given = samples.x.shape[2] - d - 1, fit.noise_is_known
    known_law = given or spare > 0
    row: Row = {"estimator": name, "status": int(fit.own_status[0]), "distance": math.nan, "level": math.nan}
    mean, sd = np.full(d + 1, math.nan), np.full(d + 1, math.nan)
    if len(draws):
        mean, sd = draws[:, : d + 1].mean(axis=0), draws[:, : d + 1].std(axis=0)
        square = _squares((answer - mean)[None, :d], np.cov(draws[:, :d].T))
        row["distance"] = float(np.sqrt(square[0]))
    with np.errstate(all="ignore"):  # a fit may have no number, or no error
        away, spread, ranks = (answer - mean) / sd, error / sd, -answer / error
    for i, ending in enumerate(names(d)[: d + 1]):
        row |= {f"away_{ending}": away[i], f"spread_{ending}": spread[i]}
        rank = special.ndtr(ranks[i]) if given else special.stdtr(spare, ranks[i]) if known_law else math.nan
        row[f"rank_{ending}"] = float(rank)
    covariance = fit.covariance[0, :d, :d]
    if known_law and np.isfinite(covariance).all() and np.isfinite(answer[:d]).all():
        square = _squares(answer[None, :d], covariance)[0]
        row["level"] = float(special.chdtr(d, square) if given else special.fdtr(d, spare, square / d))
    return row


def _squares(vectors: Floats, covariance: Floats) -> Floats:
    """Squared Mahalanobis distances of vectors (n, d)."""
    values, axes = np.linalg.eigh(covariance)
    with np.errstate(all="ignore"):
        return np.asarray((((vectors @ axes) ** 2) / values).sum(axis=1))

"""Estimators against theory and against each other: regret, expected errors, joints of several markers, single trials.

The regret of an estimator is its error over that of the best estimator in each cell of a grid, and its mean over cells.
No estimator is the best in every cell, and a user does not know which cell the data are from; an estimator of small
regret is never far from the best. Errors are taken as they come, whatever the status; a fit without a number counts as
worse than any. Means over cells are geometric. Monte-Carlo errors are those of a jackknife over groups of trials:
trials that share draws are left out together, in all cells.

Theory is about directions u uniform on a cap, with mean (m₁, 0, …) and covariance diag(Kₐ, Kₚ, …): `study.fits.cap`.
With the radius as the unit the points' variance along the axis, v, is Kₐ, and noise is σ/r.

Joints of several markers are the cells of a grid of radii that share one centre; they are fitted as `study.mgdk` does
for a noise that is known (theory §2), all trials of a joint at once.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from study.arrays import Bools, Floats, Ints
from study.files import RunError
from study.fits import ESTIMATORS, Fit
from study.fits.bounds import Cap, by_quadrature, cramer_rao, unit_rule
from study.fits.cap import CapMoments, cap_moments
from study.fits.markers import MarkersMoments
from study.fits.moments import Moments
from study.fits.registry import as_fit
from study.fits.samples import blank, explain
from study.simulation.experiment.compute import Trial, attempt
from study.simulation.experiment.conditions import CONDITIONS, RADIUS, STATED_VARIANCE, STORED, bound_law, named_in
from study.simulation.experiment.config import Study
from study.simulation.runs.run_folder import Run
from study.text import columns

_NODES = 24
"""Nodes for the attainable bound: it has three digits, eight times as fast as with five."""
_CLEAR = 1e-3
"""Noise below this share of the half-angle leaves the attainable bound at the Cramér-Rao bound, to three digits."""


def gdke_bias(noise: float, moments: CapMoments, noise_shape: Floats) -> float:
    """Length of GDKE's bias for many samples, (C₀ + Σ)⁻¹ Σ (c₀ - μ̄), which points towards the samples.

    Args:
        noise: σ over the radius.
        moments: of the cap.
        noise_shape: covariance of a sample in units of σ² (d, d).

    Returns:
        The length over the radius.
    """
    d = len(noise_shape)
    extent = np.diag([moments.along] + [moments.across] * (d - 1))
    sigma = noise**2 * noise_shape
    to_center = np.zeros(d)
    to_center[0] = -moments.mean
    return float(np.linalg.norm(np.linalg.solve(extent + sigma, sigma @ to_center)))


def gdke_leaves(samples: float, moments: CapMoments) -> float:
    """Noise s* = √(Kₐ/N)/m₁ above which GDKE's bias exceeds its scatter (theory §3).

    It is infinite on the whole sphere, where there is no bias.
    """
    return math.sqrt(moments.along / samples) / moments.mean if moments.mean > 1e-9 else math.inf


def ugdk_leaves(moments: CapMoments) -> float:
    """Noise above which UGDK exceeds the bound, σ² = v/2 (theory §3)."""
    return math.sqrt(moments.along / 2.0)


def kappa(noise: float, samples: float, moments: CapMoments) -> float:
    """κ = (v/σ²) √(N/2): the larger it is, the more certainly C - Σ is positive definite (theory §2.2)."""
    return moments.along / noise**2 * math.sqrt(samples / 2.0)


def noise_at_kappa(value: float, samples: float, moments: CapMoments) -> float:
    """Noise at which κ has this value."""
    return math.sqrt(moments.along * math.sqrt(samples / 2.0) / value)


def ugdk_variance(noise: float, moments: CapMoments, dimension: int) -> float:
    """Variance of UGDK along the axis over the bound's, for many samples and isotropic noise: theory (5.3)."""
    of_noise = (2.0 * dimension + 16.0) / 4.0
    return 1.0 + noise**2 * (of_noise + (1.0 - moments.along + moments.mean**2) / moments.along)


def bound_shares(moments: CapMoments, dimension: int) -> tuple[float, float]:
    """Share of tr CRLB along the axis, and of each coordinate across it, for isotropic noise: theory (3.2)."""
    total = 1.0 / moments.along + (dimension - 1) / moments.across
    return 1.0 / moments.along / total, 1.0 / moments.across / total


@lru_cache(maxsize=4096)
def median_at_bound(moments: CapMoments, dimension: int) -> float:
    """Median error over √tr CRLB of an estimator whose errors are Gaussian at the bound, for isotropic noise.

    It is NaN where a cap is so small that float64 cannot hold its variance along the axis.
    """
    if moments.along < sys.float_info.min:
        return math.nan
    return _median_length(*bound_shares(moments, dimension), dimension)


@lru_cache(maxsize=4096)
def median_attainable(angle: float, noise: float, dimension: int) -> float:
    """Median error over √tr CRLB of an estimator whose errors are Gaussian at the attainable bound.

    Both bounds fall as 1/N, so that their ratio does not depend on N.

    Args:
        angle: half-angle of the cap in degrees.
        noise: σ over the radius, of isotropic Gaussian noise.
        dimension: d.

    Returns:
        The median, to three digits; NaN where noise hides the cap so far that the bound cannot be formed.
    """
    cap = Cap(math.radians(angle), noise, dimension)
    if noise <= _CLEAR * cap.half_angle:
        return median_at_bound(cap_moments(cap.half_angle, dimension), dimension)
    try:
        bound = by_quadrature(cap, _NODES)
    except ValueError:
        return math.nan
    along, across = float(bound[0, 0]), float(bound[1, 1])
    total = along + (dimension - 1) * across
    ratio = math.sqrt(total / float(np.trace(cramer_rao(cap)[:-1, :-1])))
    return ratio * _median_length(along / total, across / total, dimension)


def _median_length(along: float, across: float, dimension: int) -> float:
    """Median length of a normal vector with total variance 1, by its variances along an axis and across it.

    The distribution function of the length is that of the d - 1 coordinates across, averaged over the one along.
    """
    nodes, weights = unit_rule(200)

    def excess(length: float) -> float:
        limit = length / math.sqrt(along)
        z = limit * nodes
        inside = scipy.special.gammainc(0.5 * (dimension - 1), 0.5 * (length**2 - along * z**2) / across)
        return float(limit * np.sum(weights * np.exp(-0.5 * z**2) * inside)) / math.sqrt(2.0 * math.pi) - 0.5

    from scipy.optimize import brentq  # imported here, as it takes as long as the rest of the module

    return float(brentq(excess, 1e-3, 3.0))


def estimators_printed() -> Iterator[str]:
    """A header, and a line per estimator."""
    rows = []
    for name, entry in ESTIMATORS.items():
        cost = f"{entry.flops(3):g} {entry.flops_of}".strip() if entry.flops else "-"
        rows.append([name, cost, entry.needs or "-", entry.reference])
    yield from columns(rows, ["estimator", "FLOPs per sample (3-D)", "needs", "from"])


class JointMarkers(NamedTuple):
    """Markers about one centre, in many trials.

    Attributes:
        sigma: standard deviation of a coordinate that the fits are given, the same for all markers.
        radii: radius of each marker's sphere (M,), ascending.
        markers: points of each marker (trials, n, d), measured from the true centre.
    """

    sigma: float
    radii: Floats
    markers: list[Floats]


def point_sets(points: pd.DataFrame, cell: str) -> Floats:
    """Point sets (trials, n, d) of one cell, measured from the true centre."""
    mine = points[points["cell"] == cell].sort_values(["trial", "sample"])
    dimension = sum(name.startswith("center_") for name in points.columns)
    axes = range(1, dimension + 1)
    flat = np.stack([(mine[f"x_{i}"] - mine[f"center_{i}"]).to_numpy() for i in axes], axis=1)
    return flat.reshape(max(mine["trial"].nunique(), 1), -1, dimension)


def joint_markers(errors: pd.DataFrame, points: pd.DataFrame) -> Iterator[JointMarkers]:
    """The joints of a grid run with several radii, drawn independently, whose points were stored.

    Args:
        errors: the run's error table, for the conditions of its cells.
        points: its table of points.

    Yields:
        A joint per noise (ascending), number of samples, angle and centre, with a marker for each radius. Conditions
        with a single radius yield nothing.
    """
    cells = errors.drop_duplicates("cell").astype({"cell": str}).sort_values("radius")
    by_name = points.assign(cell=points["cell"].astype(str))
    others = [condition.name for condition in STORED if condition is not RADIUS and condition.name in cells]
    for _, mine in cells.groupby(others):
        if len(mine) > 1:
            sets = [point_sets(by_name, cell) for cell in mine["cell"]]
            count = min(map(len, sets))
            markers = [x[:count] for x in sets]
            stated = math.sqrt(mine[STATED_VARIANCE.name].iloc[0]) if STATED_VARIANCE.name in mine else 1.0
            yield JointMarkers(float(mine["noise"].iloc[0]) * stated, mine["radius"].to_numpy(), markers)


class JointFits(NamedTuple):
    """One centre fitted to markers, in many trials.

    Attributes:
        center: ĉ (trials, d).
        squares: r̂² of each marker (M, trials); negative where the noise hides the marker's extent.
        definite: true where Σ w (C - Σ̂) is positive definite, without which a fit is not ok (trials,).
    """

    center: Floats
    squares: Floats
    definite: Bools

    def distances(self) -> Floats:
        """Errors of all fits, infinite where there is no number (trials,); the true centre is the origin."""
        distances: Floats = np.linalg.norm(self.center, axis=1)
        return np.nan_to_num(distances, nan=np.inf)


def fit_joints(markers: Sequence[Floats], sigma: float, weighted: bool = False) -> JointFits:
    """Fit one centre to markers by eq. 22, corrected, in each trial. For a single marker that is UGDK.

    Args:
        markers: points of each marker (trials, n, d), n ≥ 2.
        sigma: standard deviation of a coordinate.
        weighted: weigh markers by 1/r̂².
    """
    # contiguous, as a study's points are: its compiled code serves here, too
    joint = MarkersMoments.of([Moments.of(np.ascontiguousarray(x.swapaxes(1, 2))) for x in markers])
    noise = sigma**2 * np.eye(joint.mean.shape[2])
    center, weights = joint.known(noise, weighted)
    subtracted = joint.subtracted(noise)
    matrix = np.einsum("mt,mtij->tij", weights, joint.c - subtracted)
    return JointFits(center, joint.square_radii(center, subtracted), np.linalg.eigvalsh(matrix)[:, 0] > 0.0)


QUANTILES = {"median": 0.5, "q95": 0.95}
_GROUPS = 10
"""Groups of trials, one of which is left out at a time."""


def _by_trial(part: pd.DataFrame, estimators: list[str]) -> tuple[Floats, Ints]:
    """A cell's errors (estimators, trials), infinite where there is none, and each trial's group (trials,)."""
    trials, column = np.unique(part["trial"].to_numpy(), return_inverse=True)
    row = pd.Index(estimators).get_indexer(pd.Index(part["estimator"].astype(str)))
    distances, use = np.full((len(estimators), len(trials)), np.inf), row >= 0
    distances[row[use], column[use]] = np.nan_to_num(
        part["error"].to_numpy(dtype=float)[use], nan=np.inf, posinf=np.inf
    )
    return distances, trials % _GROUPS


def by_cell(errors: pd.DataFrame, estimators: list[str]) -> pd.DataFrame:
    """Regret in each cell.

    Args:
        errors: the error table: cell, samples, trial, estimator and error.
        estimators: names of the estimators that are compared.

    Returns:
        A row per cell and estimator: ``cell``, ``samples``, ``estimator``, and the median and the 95 % quantile of the
        error over the least among the estimators (``median``, ``q95``), also without each group of trials
        (``median_0`` …). Cells in which no estimator has an answer at the quantile are not a number.
    """
    rows: list[pd.DataFrame] = []
    for cell, part in errors.groupby("cell", observed=True, sort=False):
        distances, groups = _by_trial(part, estimators)
        chosen = [groups >= 0, *(groups != group for group in range(_GROUPS))]
        if min(map(np.sum, chosen)) == 0:
            raise RunError(f"cell {cell}: {len(groups)} trials; regret needs at least 2")
        numbers: dict[str, Floats] = {}
        for ending, use in zip(["", *(f"_{group}" for group in range(_GROUPS))], chosen, strict=True):
            levels = np.quantile(distances[:, use], list(QUANTILES.values()), axis=1, method="lower")
            with np.errstate(invalid="ignore"):
                ratios = levels / levels.min(axis=1, keepdims=True)
            numbers |= {f"{name}{ending}": values for name, values in zip(QUANTILES, ratios, strict=True)}
        row = {"cell": str(cell), "samples": int(part["samples"].iloc[0]), "estimator": estimators}
        rows.append(pd.DataFrame({**row, **numbers}))
    return pd.concat(rows, ignore_index=True)


def regret(cells: pd.DataFrame) -> pd.DataFrame:
    """Mean regret of each estimator, over all cells and over those of each number of samples.

    Args:
        cells: the table of `by_cell`.

    Returns:
        A row per number of samples and estimator: ``samples`` (0 for all), ``estimator``, ``cells``, and of the
        ``median`` and the ``q95`` the geometric mean over the cells, its Monte-Carlo standard error (``…_error``) and
        the largest (``…_worst``). They are infinite for an estimator without an answer in a cell in which another has
        one.
    """
    rows = []
    for samples in [0, *sorted(cells["samples"].unique())]:
        chosen = cells if samples == 0 else cells[cells["samples"] == samples]
        for estimator, part in chosen.groupby("estimator", observed=True, sort=False):
            row: dict[str, float | str] = {"samples": int(samples), "estimator": str(estimator), "cells": len(part)}
            for name in QUANTILES:
                used = part[part[name].notna()]
                named = [name, *(f"{name}_{group}" for group in range(_GROUPS))]
                means = np.exp(np.log(used[named]).mean().to_numpy())
                error = math.inf
                if np.isfinite(means).all():
                    error = math.sqrt(np.sum((means[1:] - means[1:].mean()) ** 2) * (_GROUPS - 1.0) / _GROUPS)
                row |= {name: means[0], f"{name}_error": error, f"{name}_worst": used[name].max()}
            rows.append(row)
    return pd.DataFrame(rows)


def of_run(run: Run) -> pd.DataFrame:
    """The table of `by_cell` of a finished run.

    Raises:
        RunError: if the run is not finished, has no error table, is not a grid, or has one estimator only.
    """
    if run.study.design.kind != "grid":
        raise RunError(f'{run.folder}: regret needs many trials of each condition: kind = "grid" in the config')
    if run.study.keep != "errors":
        raise RunError(f'{run.folder}: regret needs every error: keep = "errors" in the config')
    if len(run.study.estimators) < 2:
        raise RunError(f"{run.folder}: regret compares estimators: list more than one in the config")
    used = ["cell", "samples", "trial", "estimator", "error"]
    return by_cell(run.table("errors", used), list(run.study.estimators))


def printed(run: Run, table: pd.DataFrame) -> Iterator[str]:
    """The table of `regret` for a terminal."""
    whole, conditions = table[table["samples"] == 0], named_in([c.name for c in run.study.conditions()])
    varied = ", ".join(condition.symbol for condition in conditions)
    yield f"{run.study.run_name()}: error of the centre over that of the best estimator in each cell of {varied}"
    yield f"geometric means over {whole['cells'].max()} cells; the largest in brackets"
    sizes = [int(n) for n in table["samples"].unique() if n]
    rows = []
    for row in whole.sort_values("median", kind="stable").to_dict("records"):
        mine = table[table["estimator"] == row["estimator"]].set_index("samples")
        texts = [f"{row[name]:.3f} ± {row[f'{name}_error']:.3f} ({row[f'{name}_worst']:.2f})" for name in QUANTILES]
        by_samples = [f"{mine.loc[n, 'median']:.3f} / {mine.loc[n, 'q95']:.3f}" for n in sizes]
        rows.append([row["estimator"], *texts, *by_samples])
    yield from columns(rows, ["", "median", "95 % quantile", *(f"N = {n}" for n in sizes)], "<>")


def points(trial: Trial) -> pd.DataFrame:
    """The points, a row per sample: columns x_1 … x_d."""
    return pd.DataFrame({f"x_{i + 1}": row for i, row in enumerate(trial.samples.x[0])})


def fits(study: Study, trial: Trial) -> dict[str, Fit]:
    """The true sphere under the name "truth", and every estimator's fit, each of shape ()."""
    cell = trial.cell
    truth = blank(1, study.dimension)
    truth.center[:], truth.radius[:] = cell.center, cell.radius
    results = {"truth": Fit(truth.reshape(), trial.samples, "truth")}
    for name in study.estimators:
        results[name] = as_fit(attempt(name, trial.samples)[0].reshape(), trial.samples, name)
    return results


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


def trial_printed(study: Study, trial: Trial) -> Iterator[str]:
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

"""Coverage of one cell: draws, fits, intervals, and shares with their Monte-Carlo errors."""

import math

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.special import stdtrit

from study.coverage.config import CoverageCell, CoverageDesign
from study.estimators import Samples, Status
from study.estimators.intervals import intervals
from study.estimators.registry import fit_samples
from study.experiment.streams import lanes
from study.sphere import cap
from study.sphere.attainable import attainable_bound, cramer_rao
from study.sphere.bounds import crlb
from study.sphere.cap_mixture import Cap
from study.sphere.types import Bools, Floats

INTERVAL = "interval"
_BATCH = 400_000
"""Samples that are drawn at a time."""
_LARGEST_WIDTH = 1e9


def measure(design: CoverageDesign, jobs: int = 2) -> pd.DataFrame:
    """Measure every cell of a design.

    Args:
        design: the config.
        jobs: number of threads; no number depends on it.

    Returns:
        A row per cell and method, an estimator or "interval". ``samples``, ``angle``, ``kappa``, ``sigma``, ``trials``;
        ``radius``, ``axis``, ``across``: share of all trials in which the truth is covered, of the radius, of the
        centre along the cap's axis and across it; ``ok``: share of fits that are ok, by the estimator's own status,
        and for the interval by `Intervals.identified`; ``radius_ok``: coverage of the radius of those; ``open``: share
        without an upper end; ``width``: median width over that of ± t standard deviations of the Cramér-Rao bound;
        ``width_attainable``: over those of the attainable bound. Beside each share and width its Monte-Carlo standard
        error, ``…_error``.
    """
    cells = design.cells()
    order = sorted(cells, key=lambda cell: -cell.samples * cell.trials)  # long ones first, so that threads end together
    rows = Parallel(n_jobs=jobs, backend="threading")(delayed(_cell)(design, cell) for cell in order)
    by_cell = dict(zip(order, rows, strict=True))
    return pd.DataFrame([row for cell in cells for row in by_cell[cell]])


def _cell(design: CoverageDesign, cell: CoverageCell) -> list[dict[str, object]]:
    """Rows of a cell, one per method."""
    state = lanes(design.seed, "coverage", cell.samples, cell.angle, cell.kappa)
    found: dict[str, list[Floats]] = {name: [] for name in (*design.estimators, INTERVAL)}
    left = cell.trials
    while left > 0:
        batch = min(left, max(_BATCH // cell.samples, 1))
        left -= batch
        directions, noise = np.empty((batch, 3, cell.samples)), np.empty((batch, 3, cell.samples))
        cap.draw(state, math.radians(cell.angle), directions, noise)
        directions[:, 0] = 1.0 - directions[:, 0]
        samples = Samples(directions + cell.sigma * noise)
        for name, outcome in _outcomes(design, samples, directions, cell.sigma).items():
            found[name].append(outcome)
    return [_row(cell, name, np.concatenate(parts)) for name, parts in found.items()]


def _outcomes(design: CoverageDesign, samples: Samples, directions: Floats, sigma: float) -> dict[str, Floats]:
    """Six numbers of each trial and method: covered (radius, axis, across), ok, open, and the relative width."""
    _, d, n = samples.shape
    quantile = float(stdtrit(n - d - 1, 0.5 * (1.0 + design.level)))
    efficient = 2.0 * quantile * np.sqrt(crlb(directions.swapaxes(1, 2), sigma)[:, d, d])
    found = {}
    for name in design.estimators:
        fit = fit_samples(samples, name)
        with np.errstate(all="ignore"):
            half = quantile * fit.standard_errors
            estimate = np.column_stack([fit.center, fit.radius])
            ends = np.stack([estimate - half, estimate + half], axis=2)
        found[name] = _outcome(ends, fit.own_status == Status.OK, efficient)
    known = intervals(samples, design.level)
    both = np.concatenate([known.center, known.radius[:, None]], axis=1)
    found[INTERVAL] = _outcome(both, known.identified, efficient)
    return found


def _outcome(ends: Floats, ok: Bools, efficient: Floats) -> Floats:
    truth = np.array([0.0, 0.0, 0.0, 1.0])
    covered = (ends[:, :, 0] <= truth) & (truth <= ends[:, :, 1])  # False where an end is NaN
    width = (ends[:, 3, 1] - ends[:, 3, 0]) / efficient
    width = np.where(np.isnan(width), np.inf, width)
    return np.column_stack([covered[:, 3], covered[:, 0], covered[:, 1], ok, np.isinf(ends[:, 3, 1]), width])


def _row(cell: CoverageCell, name: str, outcome: Floats) -> dict[str, object]:
    """Shares of a cell with their binomial errors, and the median width with its own."""
    row: dict[str, object] = {**cell._asdict(), "method": name}
    ok = outcome[:, 3] == 1.0
    for place, column in enumerate(("radius", "axis", "across", "ok", "open")):
        row[column], row[f"{column}_error"] = _share(outcome[:, place])
    row["radius_ok"], row["radius_ok_error"] = _share(outcome[ok, 0])
    ordered = np.minimum(np.sort(outcome[:, 5]), _LARGEST_WIDTH)
    reach = 0.5 * math.sqrt(len(ordered))  # of the median's rank
    low, middle, high = (ordered[int(0.5 * len(ordered) + by)] for by in (-reach, 0.0, reach))
    bounded = high < _LARGEST_WIDTH
    width = float(middle) if middle < _LARGEST_WIDTH else math.inf
    width_error = float(0.5 * (high - low)) if bounded else math.nan
    larger = _attainable_ratio(cell)
    widths = {"width": width, "width_error": width_error}
    return row | widths | {"width_attainable": width / larger, "width_attainable_error": width_error / larger}


def _attainable_ratio(cell: CoverageCell) -> float:
    """Standard deviation of the radius at the attainable bound over that at the Cramér-Rao bound; NaN if out of reach.

    The attainable bound does not know the directions, as no interval does.
    """
    try:
        reached = attainable_bound(cell.angle, cell.sigma)[3, 3]
    except ValueError:  # noise hides the cap
        return math.nan
    return math.sqrt(reached / cramer_rao(Cap(math.radians(cell.angle), cell.sigma, 3))[3, 3])


def _share(hits: Floats) -> tuple[float, float]:
    """Share of hits and its standard error, at least that of half a hit; NaN where nothing was counted."""
    n = len(hits)
    if n == 0:
        return math.nan, math.nan
    share = float(hits.mean())
    held = min(max(share, 0.5 / n), 1.0 - 0.5 / n)
    return share, math.sqrt(held * (1.0 - held) / n)

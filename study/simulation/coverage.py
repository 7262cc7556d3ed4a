"""Coverage of intervals and standard errors on caps, from little noise up to the level at which curvature is lost.

Noise is given by κ = (v/σ²)√(N/2), the least variance v of the directions over the standard error of the noise's
variance. It compares the extent along the cap's axis with the noise. Curvature is lost near κ = 1, whatever the cap.
A cell of the config is drawn and fitted, and its shares get Monte-Carlo errors; the table is printed, and drawn.

In the figure a point is a cell; its colour is the number of samples. The band is 0.93 to 0.97 at the level 0.95
(see `band`). Look at: the interval within the band up to σ = 0.2 r and near it up to 0.5 r, above and below; and the
standard errors, which leave it where the noise grows, most of all among the fits that the estimators call ok.
"""

import math
from collections.abc import Iterator
from itertools import chain, product
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from pydantic import AfterValidator, Field
from scipy.special import stdtrit

from study import style
from study.arrays import Bools, Floats, Words
from study.fits import ESTIMATORS, Samples, Status, cap
from study.fits.answer import white_covariance
from study.fits.bounds import Cap, attainable_bound, cramer_rao, crlb
from study.fits.intervals import intervals
from study.fits.jit import always_compiled
from study.fits.random import lanes
from study.fits.registry import fit_samples
from study.simulation.experiment.config import EstimatorNames, FolderName
from study.text import columns
from study.toml import Distinct, Fault, Frozen, read_document


def _without_noise(names: tuple[str, ...]) -> tuple[str, ...]:
    if given := [name for name in names if ESTIMATORS[name].needs]:
        raise ValueError(f"{', '.join(map(repr, given))}: needs the noise, which no interval is given; leave it out")
    return names


_LEAST_TRIALS = 20
"""Trials of a cell from which shares and medians have errors."""
_Degrees = Annotated[float, Field(gt=0.0, le=180.0)]


class CoverageCell(NamedTuple):
    """One condition: N, φ in degrees, κ, σ in radii, and its number of trials."""

    samples: int
    angle: float
    kappa: float
    sigma: float
    trials: int


class CoverageDesign(Frozen):
    """A coverage study on spherical caps in three dimensions.

    Attributes:
        name: name of the results' folder.
        seed: of the streams.
        estimators: those whose estimate ± t standard errors is compared with the interval.
        angle: half-angles of the caps, in degrees.
        samples: numbers of samples N.
        kappa: values of κ.
        largest_noise: cells with σ above this many radii are left out.
        level: nominal coverage.
        trials: number of trials of a cell.
        most_samples: number of samples of all trials of a cell, at most: cells with large N have fewer trials.
    """

    name: FolderName
    seed: Annotated[int, Field(ge=0)]
    estimators: Annotated[EstimatorNames, AfterValidator(_without_noise)]
    angle: Distinct[_Degrees]
    samples: Distinct[Annotated[int, Field(ge=6)]]
    kappa: Distinct[Annotated[float, Field(gt=0.0)]]
    largest_noise: Annotated[float, Field(gt=0.0)] = 0.9
    level: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.95
    trials: Annotated[int, Field(ge=100)] = 4000
    most_samples: Annotated[int, Field(ge=10_000)] = 4_000_000

    def cells(self) -> list[CoverageCell]:
        """All conditions whose noise is not too large."""
        result = []
        for n, angle, kappa in product(self.samples, self.angle, self.kappa):
            sigma = relative_noise(n, angle, kappa)
            if sigma <= self.largest_noise:
                result.append(CoverageCell(n, angle, kappa, sigma, min(self.trials, self.most_samples // n)))
        return result


def relative_noise(samples: int, angle: float, kappa: float) -> float:
    """The noise σ in radii that has a κ."""
    return math.sqrt(least_variance(angle) / kappa * math.sqrt(samples / 2.0))


def least_variance(angle: float) -> float:
    """The least variance v of directions that are uniform on a cap of a half-angle in degrees, in three dimensions."""
    height = 2.0 * math.sin(math.radians(angle) / 2.0) ** 2
    along = height * height / 12.0
    across = 0.5 * (1.0 - (along + (1.0 - height / 2.0) ** 2))
    return min(along, across)


def read_design(path: Path) -> CoverageDesign:
    """Read a config of a coverage study.

    Raises:
        ConfigError: with every fault, its place and its value.
    """
    return read_document(path, CoverageDesign, {(): list(CoverageDesign.model_fields)}, _faults)


def _faults(design: CoverageDesign) -> Iterator[Fault]:
    """Faults of a design whose entries are fine by themselves."""
    least = min(relative_noise(*cell) for cell in product(design.samples, design.angle, design.kappa))
    if least > design.largest_noise:
        words = f"leaves no cell, as the least noise is {least:.3g} radii; raise it, or kappa"
        yield Fault(("largest_noise",), words, design.largest_noise)
    most = max(design.samples)
    if design.most_samples < _LEAST_TRIALS * most:
        trials = f"{design.most_samples // most:,} of the {_LEAST_TRIALS} trials that a cell with N = {most:,} needs"
        words = f"is enough for {trials}; give at least {_LEAST_TRIALS * most:,}, or smaller samples"
        yield Fault(("most_samples",), words, design.most_samples)


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
    rows = Parallel(n_jobs=jobs, backend="threading")(delayed(_cell)(design, cell) for cell in design.cells())
    return pd.DataFrame(list(chain.from_iterable(rows)))


@always_compiled()
def _cell(design: CoverageDesign, cell: CoverageCell) -> list[dict[str, object]]:
    """Rows of a cell, one per method."""
    state = lanes(design.seed, "coverage", cell.samples, cell.angle, cell.kappa)
    result: dict[str, list[Floats]] = {name: [] for name in (*design.estimators, INTERVAL)}
    for directions, noise in draws(state, cell.trials, (3, cell.samples), cell.angle):
        samples = Samples(directions + cell.sigma * noise)
        for name, outcome in _outcomes(design, samples, directions, cell.sigma).items():
            result[name].append(outcome)
    return [_row(cell, name, np.concatenate(parts)) for name, parts in result.items()]


def draws(
    state: Words, sets: int, shape: tuple[int, int], angle: float, together: int = _BATCH
) -> Iterator[tuple[Floats, Floats]]:
    """Draw unit directions and unit noise (b, d, n) of so many sets of points on a cap, some at a time.

    Args:
        state: of the generator.
        sets: their number.
        shape: d and n.
        angle: half-angle of the cap, in degrees.
        together: number of samples that are drawn at a time.
    """
    while sets > 0:
        batch = min(sets, max(together // shape[1], 1))
        sets -= batch
        directions, noise = np.empty((batch, *shape)), np.empty((batch, *shape))
        cap.draw(state, math.radians(angle), directions, noise)
        directions[:, 0] = 1.0 - directions[:, 0]  # heights to cosines
        yield directions, noise


def _outcomes(design: CoverageDesign, samples: Samples, directions: Floats, sigma: float) -> dict[str, Floats]:
    """Six numbers of each trial and method: covered (radius, axis, across), ok, open, and the relative width."""
    _, d, n = samples.shape
    quantile = float(stdtrit(n - d - 1, 0.5 * (1.0 + design.level)))
    efficient = 2.0 * quantile * np.sqrt(crlb(directions.swapaxes(1, 2), sigma)[:, d, d])
    result = {}
    for name in design.estimators:
        fit = fit_samples(samples, name)
        with np.errstate(all="ignore"):
            half = quantile * np.sqrt(np.einsum("bii->bi", white_covariance(fit)))
            estimate = np.column_stack([fit.center, fit.radius])
            ends = np.stack([estimate - half, estimate + half], axis=2)
        result[name] = _outcome(ends, fit.estimates.status == Status.OK, efficient)
    known = intervals(samples, design.level)
    both = np.concatenate([known.center, known.radius[:, None]], axis=1)
    result[INTERVAL] = _outcome(both, known.identified, efficient)
    return result


def _outcome(ends: Floats, ok: Bools, efficient: Floats) -> Floats:
    truth = np.array([0.0, 0.0, 0.0, 1.0])
    covered = (ends[:, :, 0] <= truth) & (truth <= ends[:, :, 1])  # False where an end is NaN
    width = (ends[:, 3, 1] - ends[:, 3, 0]) / efficient
    width = np.where(np.isnan(width), np.inf, width)
    return np.column_stack([covered[:, 3], covered[:, 0], covered[:, 1], ok, np.isinf(ends[:, 3, 1]), width])


def _row(cell: CoverageCell, name: str, outcome: Floats) -> dict[str, object]:
    """Shares of a cell with their binomial errors, and the median width with its own."""
    row: dict[str, object] = {**cell._asdict(), "method": name}
    hits = dict(zip(("radius", "axis", "across", "ok", "open"), outcome.T, strict=False))
    for column, of_column in (hits | {"radius_ok": outcome[outcome[:, 3] == 1.0, 0]}).items():
        row[column], row[f"{column}_error"] = _share(of_column)
    ordered = np.minimum(np.sort(outcome[:, 5]), _LARGEST_WIDTH)
    reach = 0.5 * math.sqrt(len(ordered))  # of the median's rank
    low, middle, high = (ordered[int(0.5 * len(ordered) + by)] for by in (-reach, 0.0, reach))
    width = float(middle) if middle < _LARGEST_WIDTH else math.inf
    error = float(0.5 * (high - low)) if high < _LARGEST_WIDTH else math.nan
    larger = _attainable_ratio(cell)
    widths = {"width": width, "width_error": error}
    return row | widths | {"width_attainable": width / larger, "width_attainable_error": error / larger}


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


_LITTLE, _MUCH = 0.2, 0.5


def printed(table: pd.DataFrame, level: float = 0.95) -> Iterator[str]:
    """Lines: coverage of the radius by each method over all fits, of each cell; then a summary of each method."""
    methods = list(dict.fromkeys(table["method"]))
    head, *rows = by_cell(table, methods)
    yield f"Coverage of the radius over all fits: {' / '.join(methods)}"
    yield from columns(rows, head)
    yield ""
    summaries = [summary(table, name, level) for name in methods]
    yield from columns([list(row.values()) for row in summaries], list(summaries[0]))


def by_cell(table: pd.DataFrame, methods: list[str]) -> list[list[str]]:
    """Coverage of the radius in every cell: a row of titles, then one per N and cap with a column per κ."""
    kappas = sorted(table["kappa"].unique())
    rows = [["N", "cap", *[f"κ={kappa:g}" for kappa in kappas]]]
    for (n, angle), part in table.groupby(["samples", "angle"]):
        cells = []
        for kappa in kappas:
            here = part[part["kappa"] == kappa].set_index("method")["radius"]
            cells.append("/".join(f"{here[name]:.3f}" for name in methods) if len(here) else "-")
        rows.append([f"{n}", f"{angle:g}°", *cells])
    return rows


def band(level: float) -> tuple[float, float]:
    """Coverage that counts as near a level: 0.93 to 0.97 at 0.95, as many standard errors of a share at any other."""
    reach = 0.02 * math.sqrt(level * (1.0 - level) / (0.95 * 0.05))
    return level - reach, min(level + reach, 1.0)


def summary(table: pd.DataFrame, name: str, level: float = 0.95) -> dict[str, str]:
    """Coverage by one method over the cells, by the titles of the columns."""
    part = table[table["method"] == name]
    little, moderate = part[part["sigma"] < _LITTLE], part[part["sigma"] <= _MUCH]
    low, high = band(level)
    inside = little["radius"].between(low, high)
    often = part[(part["ok"] >= 0.2) & (part["sigma"] < 0.35)]
    clear = part[(part["kappa"] == 100.0) & (part["samples"] >= 40) & (part["sigma"] < _LITTLE)]["width_attainable"]
    center = np.minimum(moderate["axis"], moderate["across"])
    return {
        "method": "interval" if name == INTERVAL else f"{name} ± t s.e.",
        "σ < 0.2 r: mean": f"{little['radius'].mean():.3f}",
        f"within {low:.3g}-{high:.3g}": f"{100.0 * inside.mean():.0f} %",
        "least": f"{little['radius'].min():.3f}",
        "σ ≤ 0.5 r: least": f"{moderate['radius'].min():.3f}",
        "centre: least": f"{center.min():.3f}",
        "ok fits: mean": f"{often['radius_ok'].mean():.3f}",
        "ok fits: least": f"{often['radius_ok'].min():.3f}",
        "width at κ=100, N ≥ 40": f"{clear.min():.2f}-{clear.max():.2f}" if len(clear) else "-",
    }


_BAND = "#dddddd"
_LEAST_OK = 0.2
"""Cells in which fewer fits are ok are left out of the lower row."""


@style.journal()
def draw(table: pd.DataFrame, stamp: str, level: float = 0.95) -> Figure:
    """Draw the table of `study.simulation.coverage.measure`: a column of panels per method."""
    methods = list(dict.fromkeys(table["method"]))
    numbers = sorted(table["samples"].unique())
    low, high = band(level)
    figure = style.Picture(figsize=(style.PAGE, 4.4), layout="constrained")
    axes = figure.subplots(2, len(methods), sharex=True, sharey="row", squeeze=False)
    for column, method in enumerate(methods):
        part = table[table["method"] == method]
        often = part[part["ok"] >= _LEAST_OK]
        _points(axes[0, column], part, "radius", numbers, level)
        _points(axes[1, column], often, "radius_ok", numbers, level)
        title = "interval" if method == INTERVAL else f"{style.label(method)} ± t s.e."
        axes[0, column].set_title(title, loc="left")
        axes[1, column].set_xlabel("noise σ / radius")
    axes[0, 0].set_ylabel("coverage, all fits")
    axes[1, 0].set_ylabel("coverage, fits that are ok")
    grey = Patch(color=_BAND, label=f"{low:.3g} to {high:.3g}")
    handles = [
        Line2D([], [], ls="", marker="o", ms=4, color=color, label=f"N = {n:,}")
        for n, color in zip(numbers, style.shades(len(numbers)), strict=True)
    ]
    figure.legend(handles=[*handles, grey], loc="outside upper center", ncols=min(len(handles) + 1, 7))
    style.stamp(figure, stamp)
    return figure


def _points(ax: Axes, part: pd.DataFrame, column: str, numbers: list[int], level: float) -> None:
    """Cells of one method; log-odds would hide a coverage of zero, so the axis is linear."""
    ax.axhspan(*band(level), color=_BAND, linewidth=0.0, zorder=0)
    ax.axhline(level, color="black", linewidth=0.6, zorder=1)
    for n, color in zip(numbers, style.shades(len(numbers)), strict=True):
        rows = part[part["samples"] == n]
        ax.errorbar(rows["sigma"], rows[column], rows[f"{column}_error"], fmt="o", ms=2.6, lw=0.6, color=color)
    ax.set_xscale("log")
    ax.set_ylim(-0.03, 1.03)
    ax.set_yticks(np.arange(0.0, 1.01, 0.2))

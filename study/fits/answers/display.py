"""Fits as a reader sees them: a line for a terminal, a table for a notebook, and a data frame."""

import html
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from study.arrays import Floats, Ints
from study.fits.points.samples import Status
from study.text import number, with_error

if TYPE_CHECKING:
    import pandas as pd


_MOST_ROWS = 10


def frame(fit: Any) -> "pd.DataFrame":
    """A row per fit; see `Fit.to_frame`."""
    import pandas as pd

    d = fit.estimates.center.shape[-1]
    errors, known = _errors(fit)
    flat = fit.estimates.reshape(-1)
    columns: dict[str, object] = {}
    for i in range(d):
        columns[f"center_{i + 1}"], columns[f"error_{i + 1}"] = flat.center[:, i], errors[:, i]
    columns |= {"radius": flat.radius, "radius_error": errors[:, d], "noise": np.ravel(fit.sigma)}
    columns["residual_rms"] = np.ravel(fit.residual_rms) if known else np.nan
    columns |= in_words(coordinates(d), flat.center, errors[:, :d], flat.radius, errors[:, d])
    if known and hasattr(fit, "interval"):
        columns |= ends(coordinates(d), fit.interval("radius"), fit.interval("center"))
    columns |= {"condition": flat.condition, "iterations": flat.iterations}
    if known:
        columns["samples"] = np.ravel(fit.count)
    columns["status"] = [Status(int(status)).text for status in np.ravel(fit.status)]
    table = pd.DataFrame(columns)
    if len(fit.shape) > 1:
        table.index = pd.MultiIndex.from_product([range(length) for length in fit.shape])
    return table


def coordinates(d: int) -> list[str]:
    """Names of coordinates that have none: x, y and z in up to three dimensions, else their numbers from 1."""
    return list("xyz"[:d]) if d <= 3 else [str(i + 1) for i in range(d)]


def in_words(names: list[str], center: Floats, center_errors: Floats, radius: Floats, error: Floats) -> dict[str, Any]:
    """Centre (…, d) and diameter (…) with their standard errors, by the names of the coordinates: center_x, error_x."""
    columns: dict[str, Any] = {}
    for i, name in enumerate(names):
        columns[f"center_{name}"], columns[f"error_{name}"] = center[..., i], center_errors[..., i]
    return columns | {"diameter": 2.0 * radius, "diameter_error": 2.0 * error}


def ends(names: list[str], radius: Floats, center: Floats) -> dict[str, Any]:
    """Ends of the 95 % intervals of radius (…, 2) and centre (…, d, 2), by the coordinates' names: center_x_low."""
    pairs = {"radius": radius} | {f"center_{name}": center[..., i, :] for i, name in enumerate(names)}
    return {
        f"{name}_{end}": np.ravel(pair[..., k]) for name, pair in pairs.items() for k, end in enumerate(("low", "high"))
    }


def as_dict(fit: Any) -> dict[str, Any]:
    """The numbers of a single fit as plain Python; see `Fit.to_dict`."""
    if fit.shape:
        raise ValueError(f"{fit.radius.size:,} fits of shape {fit.shape}: take one, or to_frame() for a table")
    errors, status = fit.standard_errors, Status(int(fit.status))
    numbers = {"estimator": fit.estimator, "ok": fit.ok, "status": status.name.lower(), "status_text": status.text}
    numbers |= {"samples": fit.count, "outliers": fit.outliers.nonzero()[0]}
    numbers |= {"center": fit.center, "center_errors": errors[:-1], "radius": fit.radius, "radius_error": errors[-1]}
    with np.errstate(all="ignore"):
        numbers["correlation"] = fit.covariance / errors[:, None] / errors
        sizes = np.fmin.reduce(fit.residuals), np.fmax.reduce(fit.residuals)
        numbers |= {"form_error": sizes[1] - sizes[0], "largest_deviation": np.fmax(-sizes[0], sizes[1])}
    numbers |= {"sigma": fit.sigma, "residual_rms": fit.residual_rms, "condition": fit.estimates.condition}
    names, intervals = coordinates(len(fit.center)), (fit.interval("radius"), fit.interval("center"))
    numbers |= {"radius_interval": intervals[0], "center_intervals": intervals[1]}
    numbers |= in_words(names, fit.center, errors[:-1], fit.radius, errors[-1])
    numbers |= {name: end[0] for name, end in ends(names, *intervals).items()}
    plain = {name: value if isinstance(value, str) else np.asarray(value).tolist() for name, value in numbers.items()}
    plain["goodness"] = {name: float(p) for name, p in ({"p": fit.goodness.p} | fit.goodness.by_block()).items()}
    plain["tests"] = fit.goodness.in_words()
    plain["misfit"], plain["allowance"] = str(fit.goodness.first()), fit.allowance.tolist()
    hinge = status == Status.HINGE
    plain["circle"] = {name: part.tolist() for name, part in fit.circle._asdict().items()} if hinge else None
    return plain


def named_axis(of: str, d: int) -> int | None:
    """The coordinate that an interval is asked of by name; None for the radius, the diameter or the whole centre."""
    axes = {f"center_{i + 1}": i for i in range(d)} | {letter: i for i, letter in enumerate("xyz"[:d]) if d <= 3}
    if of not in ("radius", "diameter", "center", *axes):
        letters = ", ".join(map(repr, [name for name in axes if d > 3 or len(name) == 1]))
        raise ValueError(f"of = {of!r}: an interval is that of 'radius', 'diameter', 'center', {letters}")
    return axes.get(of)


def as_text(fit: Any) -> str:
    """One line: the numbers of a single fit with their standard errors, the statuses of a batch."""
    name, sphere = f"{fit.estimator}: " if fit.estimator else "", fit.estimates
    if fit.shape:
        return f"Fit({name}{sphere.radius.size:,} fits of shape {fit.shape}, {statuses(fit.status)})"
    errors, known = _errors(fit)
    *center, radius = [_measured(*pair, known) for pair in zip([*sphere.center, sphere.radius], errors[0], strict=True)]
    count = f", {int(fit.count):,} points" if known else ""
    sigma = f"sigma {number(float(fit.sigma))}{count}, {statuses(fit.status)}"
    return f"Fit({name}center ({', '.join(center)}), radius {radius}, {sigma})"


def as_html(fit: Any) -> str:
    """A table of the first fits, for a notebook."""
    size = fit.estimates.radius.size
    part = fit if size <= _MOST_ROWS else fit[np.unravel_index(np.arange(_MOST_ROWS), fit.shape)]
    titles = [f"center {i + 1}" for i in range(fit.estimates.center.shape[-1])]
    titles = [*["index"] * bool(fit.shape), *titles, "radius", "sigma", "status"]
    lines = ["<table><thead><tr>", *[f"<th>{title}</th>" for title in titles], "</tr></thead><tbody>"]
    for place, row in zip(np.ndindex(fit.shape), _rows(part), strict=False):
        index = [", ".join(map(str, place))] * bool(fit.shape)
        lines += ["<tr>", *[f"<td>{html.escape(cell)}</td>" for cell in [*index, *row]], "</tr>"]
    more = f"; the first {_MOST_ROWS} are shown" if size > _MOST_ROWS else ""
    caption = f"{fit.estimator}: {statuses(fit.status)}{more}. ± is one standard error."
    return "".join([*lines, f"</tbody></table><p>{html.escape(caption)}</p>"])


def statuses(status: Ints) -> str:
    """The statuses of fits in a few words: "ok" for one, "198 ok, 2 singular" for several."""
    numbers, counts = np.unique(status, return_counts=True)
    words = [Status(int(own)).name.lower().replace("_", " ") for own in numbers]
    if np.ndim(status) == 0:
        return words[0]
    return ", ".join(f"{count:,} {word}" for word, count in zip(words, counts, strict=True)) or "none"


def meanings(texts: dict[str, str]) -> Iterator[str]:
    """A line for each status in a few words, with its text."""
    yield from (text if text.startswith(words) else f"{words}: {text}" for words, text in texts.items())


def _rows(fit: Any) -> Iterator[list[str]]:
    """Centre, radius, σ̂ and status of each fit, as texts."""
    errors, known = _errors(fit)
    flat = fit.estimates.reshape(-1)
    for i, (sigma, status) in enumerate(zip(np.ravel(fit.sigma), np.ravel(fit.status), strict=True)):
        sphere = [*flat.center[i], flat.radius[i]]
        measured = [_measured(*pair, known) for pair in zip(sphere, errors[i], strict=True)]
        yield [*measured, number(float(sigma)), statuses(np.asarray(status))]


def _measured(value: float, error: float, known: bool) -> str:
    return with_error(float(value), float(error)) if known else number(float(value), ".6g")


def _errors(fit: Any) -> tuple[Floats, bool]:
    """Standard errors (b, d+1), and False if the fit does not hold the points that they need."""
    d = fit.estimates.center.shape[-1]
    if fit.samples is None:
        return np.full((fit.estimates.radius.size, d + 1), np.nan), False
    return fit.standard_errors.reshape(-1, d + 1), True

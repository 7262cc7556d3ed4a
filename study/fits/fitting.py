"""The command `study fit`: points of files fitted by one estimator or all, and printed for people, as JSON or as CSV.

Below the numbers stand remarks in words: the intervals of radius and centre, outliers, copies, and what the test of fit
says.
"""

import csv
import io
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from study.arrays import Floats
from study.fits import ESTIMATORS, Fit, Status, fit
from study.fits.answers.answer import visible_moves
from study.fits.answers.display import meanings, statuses
from study.fits.evidence.form import FORM_DEGREES
from study.fits.evidence.goodness import fewest_points
from study.fits.evidence.judge import INFLUENCE, LARGEST_UNSEEN, NOTHING, Assumptions
from study.fits.points.point_files import PointTable
from study.fits.points.point_formats import PointFileError
from study.fits.registry import load, takes
from study.text import columns, inert, json_text, number, with_error
from study.words import estimator_remedy

LEVEL = 0.95
"""Coverage of the intervals."""
_NAMED = 5
"""Rows of outliers that are named."""
_REASONS = {
    "shape": "another shape, or an error that follows the direction",
    "unequal noise": "noise that is larger in some directions, or outliers",
    "tails": "outliers, or noise that is not normal",
    "memory": "rows that share their noise with their neighbours",
}
"""Likely reasons for each block of the test of fit."""


def doubts(fit: Fit) -> Iterator[str]:
    """Lines about points that a fit should not be trusted with: outliers, copies, few points, another shape.

    Rows are counted from 1 and include those with missing coordinates.
    """
    numbers = fit.to_dict()
    rows, samples, planned = (fit.outliers.nonzero()[0] + 1).tolist(), int(fit.count), fit.residuals.shape[0]
    infinite = [] if fit.samples is None else np.isinf(fit.samples.points[0]).any(axis=1).nonzero()[0] + 1
    if len(infinite):
        yield f"not finite in {len(infinite)} of {planned} rows, the first of which is row {infinite[0]}"
    if samples < planned:
        yield f"{planned - samples} of {planned} rows lack a coordinate and are left out"
    robust = ESTIMATORS[fit.estimator].without_outliers
    if rows:
        named = ", ".join(str(row) for row in rows[:_NAMED]) + (" …" if len(rows) > _NAMED else "")
        are, it = ("is an outlier (row", "it") if len(rows) == 1 else ("are outliers (rows", "them")
        use = f"leaves {it} out" if robust else f"uses {it}; -e robust leaves {it} out"
        if not robust:
            size = numbers["outlier_influence"]
            use += f"; without {it} it moves by {number(size, '.2g')} ±" if math.isfinite(size) else ""
        yield f"{len(rows)} of {samples} points {are} {named}): the fit {use}"
    copies = numbers["copies"]
    if copies:
        repeat, they = ("repeats an earlier one", "it is") if copies == 1 else ("repeat earlier ones", "they are")
        yield f"{copies} of {samples} rows {repeat}; if {they} no new measurement, every ± is too small"
        yield "for the intervals, rows that repeat an earlier one count once"
    if fit.status == Status.HINGE:
        yield from _circle_in_words(fit)
    elif (fit.status == Status.MISFIT or robust or not rows) and (block := str(fit.goodness.first())):
        yield _misfit_in_words(fit, block, numbers["ordered"])


def _circle_in_words(fit: Fit) -> Iterator[str]:
    """Lines with the circle in space on which the points lie."""
    circle = fit.circle
    center = ", ".join(with_error(float(c), float(e)) for c, e in zip(circle.center, circle.center_errors, strict=True))
    axis = ", ".join(f"{float(part):.3f}" for part in circle.axis)
    radius = with_error(float(circle.radius), float(circle.radius_error))
    yield f"the circle: centre {center}; radius {radius}; axis ({axis}) ± {float(circle.axis_error):.2g} rad"
    yield "a sphere's centre may be anywhere on that axis, and its mirror image in the circle's plane fits as well"


def _misfit_in_words(fit: Fit, block: str, ordered: bool) -> str:
    """A line about what the test of fit sees, and what the errors make of it."""
    shape = "circle" if fit.center.shape[0] == 2 else "sphere"
    p = float(getattr(fit.goodness, block.replace(" ", "_")))
    size = "p < 1e-9" if p < 1e-9 else f"p = {number(p, '.2g')}"
    largest = float(fit.allowance.max())
    allowed = f"every ± allows for it, up to {number(largest, '.2g')} times that of white noise"
    if block == "memory" and not ordered:
        allowed = "every ± may be too small; if the rows are in order of time, ordered=True (--ordered) allows for it"
    elif block == "tails":
        allowed = "± does not change"
    elif largest == 1.0:
        allowed = "that of white noise is as large"
    return f"not a {shape} with white noise ({block}, {size}): {_REASONS[block]}; {allowed}"


def noise_law_in_words(fit: Fit, other: Fit, names: list[str]) -> Iterator[str]:
    """A line where the fits of `corrected` and `mle` differ by more than the stated ±, with the number that most does.

    Noise along the radius alone leaves no trace in the points: there `mle` is right, and `corrected` corrects for a
    bias that is not there.

    Args:
        fit: by `corrected`.
        other: by `mle`.
        names: the coordinates' names.
    """
    values, others = (np.append(one.center, one.radius) for one in (fit, other))
    with np.errstate(all="ignore"):
        apart = np.nan_to_num(np.abs(values - others) / fit.standard_errors)
    place = int(apart.argmax())
    if not (fit.ok and np.isfinite(others).all() and apart[place] > 1.0):
        return
    name, value = [*names, "radius"][place], with_error(float(values[place]), float(fit.standard_errors[place]))
    mle = _digits(float(others[place]), float(fit.standard_errors[place]))
    yield (
        f"{name} {value} by corrected, {mle} by mle: corrected is right if the noise is alike in all directions, mle "
        "if it is along the radius alone, as of a probe or a scanner within (--law radial); the points cannot tell"
    )


def answers_in_words(fit: Fit) -> str:
    """A line with the answer of each test."""
    by_answer: dict[str, list[str]] = {}
    for name, answer in fit.goodness.in_words().items():
        by_answer.setdefault(answer, []).append(name)
    parts = [f"{answer.partition(':')[0]} {', '.join(names)}" for answer, names in by_answer.items()]
    reasons = [answer.partition(": ")[2] for answer in by_answer]
    parts = [f"{part} ({reason})" if reason else part for part, reason in zip(parts, reasons, strict=True)]
    return f"tests: {'; '.join(parts)}"


def visible_in_words(fit: Fit) -> Iterator[str]:
    """A line with the form that the test of shape just sees, what it moves, and what would show a smaller one."""
    size, (*center, radius) = float(fit.goodness.visible_form), visible_moves(fit)
    if not math.isfinite(size) or fit.status not in (Status.OK, Status.UNTESTED):
        return
    moves = f"the radius by {number(float(radius), '.2g')} ±, the centre" if radius > 0.0 else "the centre"
    moves = f"it moves {moves} by up to {number(float(max(center)), '.2g')} ±"
    form = f"a form of {number(size, '.2g')} σ"
    if size <= LARGEST_UNSEEN:
        yield f"the test of shape sees {form} in half of such sets; unseen, {moves}"
        return
    fewest = fewest_points(len(center), LARGEST_UNSEEN)
    yield f"{fit.count} points would often hide {form}; {moves}"
    yield f"to settle it: {fewest} points or more, or the noise (--noise), or --assume sphere if you know it is one"


def sensitivity_in_words(fit: Fit, names: list[str]) -> Iterator[str]:
    """Lines with the form errors that move each number by its ±."""
    for degree, sizes in zip(FORM_DEGREES, fit.sensitivity(), strict=True):
        told = zip([*names, "radius"], sizes, strict=True)
        parts = [f"{name} {number(float(size), '.2g')} σ" for name, size in told if size < math.inf]
        yield f"form of degree {degree}, rms over the whole sphere, that moves a number by its ±: {', '.join(parts)}"


def intervals_in_words(fit: Fit, names: list[str]) -> Iterator[str]:
    """Lines with the 95 % intervals of the radius and the centre, which depend on the points alone."""
    low, high = (float(end) for end in fit.interval("radius", LEVEL))
    title = f"{LEVEL:.0%} intervals".replace("%", " %")
    if not math.isfinite(high):
        told = f"radius at least {_digits(low, low)}" if low > 0.0 else "the radius may be anything"
        yield f"{title}: {told}; the points do not bound it, nor the centre"
        return
    parts = [f"radius {_between(low, high)}"] if high > low else []  # a known radius has none
    parts += [f"{name} {_between(*ends)}" for name, ends in zip(names, fit.interval("center", LEVEL), strict=True)]
    yield f"{title}: {', '.join(parts)}"


def expanded_in_words(fit: Fit, names: list[str]) -> Iterator[str]:
    """Lines for a report: radius and diameter with the expanded uncertainty U, the longer side of the interval."""
    radius, (low, high) = float(fit.radius), (float(end) for end in fit.interval("radius", LEVEL))
    if not (fit.ok and math.isfinite(high) and low < high):
        return
    units = {match[1] if (match := re.search(r"\[([^\]]+)\]$", name)) else "" for name in names}
    unit = f" {units.pop()}" if len(units) == 1 and "" not in units else ""
    for name, factor in (("radius", 1.0), ("diameter", 2.0)):
        size, digits = factor * max(high - radius, radius - low), factor * (high - low)
        expanded = f"{_digits(factor * radius, digits)}{unit}, U = {number(size, '.2g')}{unit}"
        yield f"{name} {expanded} (k = 2, by the interval)"


def _between(low: float, high: float) -> str:
    return f"{_digits(low, high - low)} to {_digits(high, high - low)}"


def _digits(value: float, width: float) -> str:
    """A value to the third digit of a width."""
    if not (math.isfinite(value) and width > 0.0):
        return f"{value:.6g}"
    digits = 2 - math.floor(math.log10(width))
    return f"{value:.{digits}f}" if 0 <= digits <= 12 else f"{value:.6g}"


_SIZES = ("residual_rms", "condition", "form_error", "largest_deviation")
Row = dict[str, Any]
"""A fit by the names of its numbers."""
_VARIANTS = {"lls_single", "mle_mirror"}
"""Estimators that show what a wrong start or short numbers cost, which nobody uses for an answer."""
STANDARD_UNCERTAINTY = "± is one standard uncertainty"


def choose(estimator: str, noise: float | None) -> list[str]:
    """Names of the estimators to use; "all" leaves out variants, and those that need a noise that is not given.

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
        usable = [name for name, entry in ESTIMATORS.items() if noise is not None or entry.needs != "noise"]
        return [name for name in usable if name not in _VARIANTS]
    if estimator not in ESTIMATORS:
        hint = estimator_remedy(estimator, [*ESTIMATORS, "all"])
        raise PointFileError(f"--estimator {estimator}: unknown; {hint}")
    if noise is None and ESTIMATORS[estimator].needs == "noise":
        raise PointFileError(f"--estimator {estimator}: needs the noise level; give --noise, or take als")
    return [estimator]


def fit_all(
    points: Floats,
    estimators: list[str],
    noise: float | Floats | None,
    assumed: Assumptions = NOTHING,
    radius: float | tuple[float, float] | None = None,
    scale: str = "given",
) -> dict[str, Fit]:
    """Fit points (n, d) by each estimator.

    Args:
        points: the points.
        estimators: their names; of several, those that do not take what is known are left out.
        noise: standard deviation of a coordinate, of all points or of each, if it is known; see `study.fit`.
        assumed: what is known of the points.
        radius: the radius, if it is known, or the radius and its standard uncertainty.
        scale: see `study.fit`.

    Raises:
        PointFileError: if an estimator does not take what is known, with those that do.
    """
    known: dict[str, Any] = {"radius": radius, "scale": scale, "ordered": assumed.ordered}
    known |= {"assume": "sphere" if assumed.sphere else None, "law": "radial" if assumed.radial else "isotropic"}
    if len(estimators) > 1 and (radius is not None or isinstance(noise, np.ndarray) or assumed.radial):
        estimators = [name for name in estimators if takes(name, points, noise, known)]
    try:
        return {name: fit(points, name, noise, **known) for name in estimators}
    except ValueError as error:
        raise PointFileError(str(error)) from None


def fit_rows(fits: dict[str, Fit], names: list[str]) -> list[Row]:
    """The fits as rows of a table.

    Args:
        fits: fits of shape () by estimator.
        names: the coordinates' names.

    Returns:
        A row per estimator: estimator, each coordinate of the centre (center_x) and its standard error (error_x),
        radius and diameter with theirs, noise σ̂, residual RMS, form error, largest deviation, ρ, the ends of the 95 %
        intervals (radius_low, radius_high, center_x_low, …), the p values of the test of fit (goodness_shape, …), the
        largest factor on errors for structure (allowance), numbers of outliers and copies, samples used, status in
        words.
    """
    rows = []
    for estimator, result in fits.items():
        numbers = result.to_dict()
        row: Row = {"estimator": estimator}
        for name, value, error in zip(names, numbers["center"], numbers["center_errors"], strict=True):
            row[f"center_{name}"], row[f"error_{name}"] = value, error
        row |= {name: numbers[name] for name in ("radius", "radius_error", "diameter", "diameter_error")}
        row["noise"] = numbers["sigma"]
        row |= {name: numbers[name] for name in _SIZES}
        ends = {"radius": numbers["radius_interval"]}
        ends |= {f"center_{name}": pair for name, pair in zip(names, numbers["center_intervals"], strict=True)}
        for name, (low, high) in ends.items():
            row[f"{name}_low"], row[f"{name}_high"] = low, high
        row |= {f"goodness_{name}": p for name, p in numbers["goodness"].items() if name != "p"}
        row["allowance"], row["outliers"] = max(numbers["allowance"]), len(numbers["outliers"])
        row |= {"copies": numbers["copies"], "samples": numbers["samples"], "status": numbers["status_text"]}
        rows.append(row)
    return rows


def printed(rows: list[Row], names: list[str]) -> Iterator[str]:
    """The fits for a terminal: numbers to two digits of their standard error, the form, and remarks on the fits."""
    cells, form = [], []
    judged = len(rows) > 1 or math.isfinite(rows[0]["condition"])  # most estimators have no ρ
    notes: dict[str, list[str]] = {}
    for row in rows:
        measured = _measured(row, names)
        others = [number(row["noise"]), number(row["residual_rms"]), *[number(row["condition"], ".2g")] * judged]
        ok = row["status"] == Status.OK.text
        cells.append([row["estimator"], *measured, *others, str(row["samples"]), "ok" if ok else "see below"])
        shape = [number(row["form_error"]), number(row["largest_deviation"])]
        form.append([row["estimator"], with_error(row["diameter"], row["diameter_error"]), *shape])
        if not ok:
            notes.setdefault(row["status"], []).append(row["estimator"])
    yield from columns(cells, ["estimator", *names, "radius", "noise", "rms", *["ρ"] * judged, "samples", "status"])
    yield ""
    yield from columns(form, ["estimator", "diameter", "form error", "largest deviation"])
    for status, estimators in notes.items():
        yield f"{', '.join(estimators)}: {status}"
    cautions = {ESTIMATORS[row["estimator"]].caution for row in rows} - {""}
    for caution in sorted(cautions):
        estimators = [row["estimator"] for row in rows if ESTIMATORS[row["estimator"]].caution == caution]
        yield f"{', '.join(estimators)}: {caution}"


def _measured(row: Row, names: list[str]) -> list[str]:
    """Coordinates of the centre and radius with their standard errors."""
    sizes = [(row[f"center_{name}"], row[f"error_{name}"]) for name in names]
    return [with_error(*pair) for pair in [*sizes, (row["radius"], row["radius_error"])]]


class FileFits(NamedTuple):
    """The points of a file and their fits.

    Attributes:
        path: the file; ``-`` for standard input.
        table: its points.
        fits: of shape (), by estimator.
    """

    path: Path
    table: PointTable
    fits: dict[str, Fit]

    def rows(self) -> list[Row]:
        """A row per fit."""
        return fit_rows(self.fits, self.table.names)

    def ok(self) -> bool:
        """True if every fit is ok, and uses no outliers that move it."""
        return all(bool(fit.ok) and fit.to_dict()["outlier_influence"] <= INFLUENCE for fit in self.fits.values())


def as_text(files: list[FileFits], noise: float | None = None, sensitivity: bool = False) -> Iterator[str]:
    """Lines for a terminal: the fits of a file, or a line for each of several, and what the numbers are.

    Args:
        files: the fits.
        noise: the noise that was given.
        sensitivity: say how large a form error moves the numbers of the first fit of a file.
    """
    if len(files) == 1:
        (only,) = files
        yield from printed(only.rows(), only.table.names)
        first = next(iter(only.fits.values()))
        yield from intervals_in_words(first, only.table.names)
        yield from expanded_in_words(first, only.table.names)
        yield from doubts(first)
        yield answers_in_words(first)
        yield from visible_in_words(first)
        samples = first.samples
        known = samples is not None and samples.given is not None and not samples.sigma_alone
        if first.ok and next(iter(only.fits)) == "corrected" and not known:
            yield from noise_law_in_words(first, fit(only.table.points, "mle"), only.table.names)
        yield from first.remarks()
        if sensitivity:
            yield from sensitivity_in_words(first, only.table.names)
    else:
        yield from _table(files)
    tables = [one.table for one in files if one.table.left]
    chosen = [f"coordinates are {', '.join(t.names)}; columns left out: {', '.join(t.left)}" for t in tables]
    yield from dict.fromkeys(chosen)
    if noise is not None and any(file.table.noise is not None for file in files):
        yield f"--noise {noise:g} is not used where columns (sigma, or sx, sy, sz) have the noise of each point"
    yield STANDARD_UNCERTAINTY


def _table(files: list[FileFits]) -> Iterator[str]:
    """A line per file and estimator, and the meaning of statuses that are not ok."""
    most = max(files, key=lambda file: len(file.table.names)).table.names
    same = all(file.table.names == most for file in files)
    axes = most if same else [f"center {i}" for i in range(1, len(most) + 1)]
    cells, texts, remarks = [], {}, 0
    for file in files:
        for (estimator, answer), row in zip(file.fits.items(), file.rows(), strict=True):
            *center, radius = _measured(row, file.table.names)
            center += ["-"] * (len(axes) - len(center))
            status, said = statuses(answer.status), len(list(doubts(answer)))
            if not answer.ok:
                texts[status] = row["status"]
            remarks += said
            counts = [str(row["samples"]), str(said or "-")]
            cells.append([str(file.path), estimator, *center, radius, number(row["noise"]), *counts, status])
    yield from columns(cells, ["file", "estimator", *axes, "radius", "noise", "samples", "remarks", "status"])
    yield from meanings(texts)
    if remarks:
        yield "study fit with one of the files prints the remarks on it, such as its outliers"


def as_json(files: list[FileFits]) -> str:
    """A list of objects, one per file and estimator, with the library's names; null where there is no number."""
    rows = []
    for one in files:
        head = {"file": one.path, "coordinates": one.table.names, "columns_left_out": one.table.left}
        rows += [head | fit.to_dict() for fit in one.fits.values()]
    return json_text(rows)


def as_csv(files: list[FileFits]) -> str:
    """A row per file and estimator, with a header; an empty cell where there is no number."""
    rows = [{"file": str(file.path)} | row for file in files for row in file.rows()]
    text = io.StringIO()
    titles = {name: inert(name) for row in rows for name in row}
    writer = csv.DictWriter(text, list(titles), lineterminator="\n")
    writer.writerow(titles)
    for row in rows:
        empty = {name for name, value in row.items() if isinstance(value, float) and not math.isfinite(value)}
        writer.writerow({name: "" if name in empty else inert(value) for name, value in row.items()})
    return text.getvalue().rstrip("\n")

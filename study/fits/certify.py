"""Certified fits: reference pairs of points and sphere, solved with 60 digits, and the fits' errors beside them.

A pair is made by a null-space construction, so that its answer is known before it is solved. For least squares the
residuals are orthogonal to the directions and to a constant; for the minimum zone d + 2 directions carry multipliers of
both signs, and the sign says on which side of the zone their points lie. Then the points are rounded to double
precision, and the answer of the rounded points is found with decimal numbers, from the known one.

Rounding limits what a pair can tell: moving each coordinate by half a unit in its last place moves the answer. Where
that is more than the limit, the points as stored do not determine the sphere to the limit, and the pair is counted
apart.

A folder of pairs has a file ``NAME.ds``, a point a line, and a file ``NAME.fit`` beside it, a number a line: the centre
and the *diameter*. It is the form of NIST's reference data sets for least squares.

Source: Shakarji 1998, Least-squares fitting algorithms of the NIST algorithm testing system; ISO 10360-6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from decimal import Context, Decimal, InvalidOperation, localcontext
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from study.arrays import Floats, Ints
from study.files import InputError, explained, regular, write
from study.fits.evidence.form import minimum_zone
from study.fits.loops.random import stream
from study.fits.registry import ESTIMATORS, fit
from study.text import columns, number
from study.words import estimator_remedy

if TYPE_CHECKING:
    import pandas as pd

LIMIT = 1e-9
"""Largest error, as a share of the radius, of a pair that passes."""
_COARSEST = 1e-3
"""Largest share of the radius that last digits excuse: beyond, the sphere does not belong to the points."""
DIGITS = 60
"""Digits of the answers that are written."""
_WORKING = Context(prec=90)
"""Digits of the arithmetic; far from the origin some of them cancel."""
_SEED = 20090220
_CAPS = (2, 10, 45, 90, 180)
"""Half-angles of the caps in degrees."""
_OFFSETS = (0.0, 1e3, 1e6)
"""Distances of the centre from the origin, in radii."""
_FORMS = (0.0, 1e-3, 0.05)
"""Largest residual as a share of the cap's height."""
_RADII = (25.0, 1.0, 2e-3, 4e3)
_FEWEST, _MOST = 8, 60
"""Least and largest number of points of a set."""
_CHOICES = 50
"""Draws of the d + 2 points that touch a zone, of which the best conditioned is taken."""
_INSIDE = 0.9
"""Largest residual of the points that do not touch a zone, as a share of its half width."""
ZONE = "minimum_zone"

Sphere = tuple[Decimal, ...]
"""Centre and radius, d + 1 numbers."""


class ReferencePair(NamedTuple):
    """A set of points with its certified sphere.

    Attributes:
        name: of the set.
        points: coordinates (n, d).
        sphere: centre and radius, to `DIGITS` digits or as a file has them.
    """

    name: str
    points: Floats
    sphere: Sphere


class Certificate(NamedTuple):
    """Errors of a fit beside a certified sphere, as shares of its radius.

    Attributes:
        name: of the set.
        center: distance between the centres.
        radius: difference of the radii, without sign.
        resolution: change of the answer if each coordinate moves by half a unit in its last place.
    """

    name: str
    center: float
    radius: float
    resolution: float

    @property
    def error(self) -> float:
        """The larger of the two errors; infinite if there is no fit."""
        worst = max(self.center, self.radius)
        return worst if math.isfinite(self.center + self.radius) else math.inf

    def is_told(self, limit: float) -> bool:
        """True if double precision determines the sphere to the limit."""
        return self.resolution <= limit

    def passes(self, limit: float) -> bool:
        """True if the errors are within the limit, or within what the last digits of the points decide."""
        return self.error <= max(limit, min(self.resolution, _COARSEST))


Decimals = NDArray[np.object_]
"""Array of decimal numbers, on which NumPy computes in the precision of the context."""
_roots: Callable[[Decimals], Decimals] = np.frompyfunc(Decimal.sqrt, 1, 1)


def _decimals(values: ArrayLike) -> Decimals:
    """Floating-point numbers as decimal ones, exactly."""
    return np.asarray(np.frompyfunc(lambda value: Decimal(float(value)), 1, 1)(values))


def _solve(matrix: Decimals, right: Decimals) -> Decimals:
    """Solution of a linear system by elimination with pivots."""
    system = np.column_stack([matrix, right])
    for i in range(len(system)):
        pivot = i + int(np.argmax(np.abs(system[i:, i])))
        system[[i, pivot]] = system[[pivot, i]]
        for row in range(len(system)):
            if row != i:
                system[row] -= system[row, i] / system[i, i] * system[i]
    return np.asarray(system[:, -1] / system.diagonal())


def least_squares(points: Floats, start: Floats) -> Sphere:
    """Geometric least squares, min Σ(|xᵢ - c| - r)², by Newton's method with decimal numbers.

    Args:
        points: coordinates (n, d).
        start: a centre near the minimum (d,).
    """
    with localcontext(_WORKING):
        x, center = _decimals(points), _decimals(start)
        while True:
            rays = x - center
            lengths = _roots((rays * rays).sum(axis=1))
            units, radius = rays / lengths[:, None], lengths.mean()
            mean, ratios = units.sum(axis=0), radius / lengths
            curve = (ratios[:, None] * units).T @ units - np.outer(mean, mean) / len(x)
            curve += (1 - ratios).sum() * np.eye(len(mean), dtype=int)
            step = _solve(curve, (lengths - radius) @ units)
            center = center + step
            if np.abs(step).max() < radius.scaleb(-DIGITS - 2):
                return _rounded([*center, radius])


def linear_least_squares(points: Floats, start: Floats) -> Sphere:
    """Least squares in the squared distances, min Σ(|xᵢ - c|² - r²)², by its normal equations with decimal numbers.

    ``start`` is a point near the set (d,), from which coordinates are counted.
    """
    with localcontext(_WORKING):
        near = _decimals(start)
        rows = _decimals(points) - near
        design = np.column_stack([2 * rows, _decimals(np.ones(len(rows)))])
        solution = _solve(design.T @ design, design.T @ (rows * rows).sum(axis=1))
        center, rest = solution[:-1], solution[-1]
        return _rounded([*(center + near), (rest + center @ center).sqrt()])


def narrowest_zone(points: Floats, sides: Ints) -> Sphere:
    """Sphere midway in the zone that d + 2 points touch, with decimal numbers.

    With the signs s, |x - c|² = (r + s t)² is linear in c and r t once one point's equation is subtracted.

    Args:
        points: coordinates (d + 2, d).
        sides: 1 for a point outside the middle sphere, -1 for one inside it (d + 2,).
    """
    with localcontext(_WORKING):
        x, signs = _decimals(points), sides.astype(object)
        rays = x[1:] - x[0]
        solution = _solve(np.column_stack([2 * rays, 2 * (signs[1:] - signs[0])]), (rays * rays).sum(axis=1))
        center, product_rt = solution[:-1], solution[-1]
        middle = center @ center - 2 * signs[0] * product_rt  # r² + t²
        radius = ((middle + 2 * product_rt).sqrt() + (middle - 2 * product_rt).sqrt()) / 2
        return _rounded([*(center + x[0]), radius])


def _rounded(values: list[Decimal]) -> Sphere:
    with localcontext(Context(prec=DIGITS)):
        return tuple(+value for value in values)


class _Layout(NamedTuple):
    """Directions (n, d) and centre (d,) of a set to be made, its radius, and the height of its cap."""

    name: str
    directions: Floats
    center: Floats
    radius: float
    height: float
    form: float
    rng: np.random.Generator

    def points(self, residuals: Floats) -> Floats:
        """The points whose distances from the centre are the radius and the residuals (n,), rounded."""
        return self.center + (self.radius + residuals)[:, None] * self.directions


def _layouts(zone: bool) -> Iterator[_Layout]:
    """Layouts of all sets, each from a stream of its own; a zone has width."""
    kinds = product((3, 2), _CAPS, _OFFSETS, _FORMS[1:] if zone else _FORMS)
    for index, (d, angle, offset, form) in enumerate(kinds):
        word = "sphere" if d == 3 else "circle"
        name = f"{word}-cap{angle:03d}-offset{offset:.0e}-form{form:g}".replace("0e+00", "0").replace("e+0", "e")
        rng = stream(_SEED, "certify", name, int(zone))
        radius, cosine = _RADII[index % len(_RADII)], math.cos(math.radians(angle))
        n = int(rng.integers(_FEWEST, _MOST + 1))
        if d == 3:
            heights = rng.uniform(cosine, 1.0, n)
            turns = rng.uniform(0.0, 2.0 * math.pi, n)
            across = np.sqrt(1.0 - heights**2)
            cap = np.stack([across * np.cos(turns), across * np.sin(turns), heights], axis=1)
        else:
            turns = math.radians(angle) * rng.uniform(-1.0, 1.0, n)
            cap = np.stack([np.sin(turns), np.cos(turns)], axis=1)
        frame = np.linalg.qr(rng.standard_normal((d, d)))[0]
        away = rng.standard_normal(d)
        center = offset * radius * away / np.linalg.norm(away)
        yield _Layout(name, cap @ frame.T, center, radius, radius * (1.0 - cosine), form, rng)


def _touching(base: Floats, rng: np.random.Generator) -> tuple[Ints, Ints]:
    """Numbers of the d + 2 points that touch a zone, and their sides, from the sign of their multipliers.

    ``base`` holds the directions and a constant (n, d + 1).
    """
    best = (-1.0, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    for _ in range(_CHOICES):
        rows = rng.choice(len(base), base.shape[1] + 1, replace=False)
        multipliers = np.linalg.svd(base[rows].T)[2][-1]
        balance = float(np.abs(multipliers).min() / np.abs(multipliers).max())
        if balance > best[0]:
            best = (balance, rows.astype(np.int64), np.sign(multipliers).astype(np.int64))
    return best[1], best[2]


def reference_pairs(estimator: str) -> Iterator[ReferencePair]:
    """The package's own pairs: caps of 2° to 180°, up to a million radii from the origin, with and without form.

    Args:
        estimator: ``mle``, ``gdke`` or ``minimum_zone``.
    """
    for layout in _layouts(estimator == ZONE):
        base = np.column_stack([layout.directions, np.ones(len(layout.directions))])
        if estimator == ZONE:
            rows, sides = _touching(base, layout.rng)
            residuals = layout.rng.uniform(-_INSIDE, _INSIDE, len(base))
            residuals[rows] = sides
            points = layout.points(0.5 * layout.form * layout.height * residuals)
            sphere = narrowest_zone(points[rows], sides)
        else:  # residuals orthogonal to the directions and to a constant, so that the sphere is the minimum
            residuals = layout.rng.standard_normal(len(base))
            residuals -= base @ np.linalg.lstsq(base, residuals)[0]
            points = layout.points(layout.form * layout.height * residuals / np.abs(residuals).max())
            sphere = SOLVERS[estimator](points, layout.center)
        yield ReferencePair(layout.name, points, sphere)


SOLVERS: dict[str, Callable[[Floats, Floats], Sphere]] = {"mle": least_squares, "gdke": linear_least_squares}
"""Solutions with decimal numbers, by the estimator that they certify."""
CERTIFIED = (*SOLVERS, ZONE)
"""Fits for which the package has pairs of its own."""


def _resolution(pair: ReferencePair, zone: bool) -> float:
    """Change of centre and radius, in radii, if each coordinate moves by half a unit in its last place, at random."""
    *center, radius = pair.sphere
    with localcontext(_WORKING):
        rays = _decimals(pair.points) - np.array(center)
        distance = _roots((rays * rays).sum(axis=1))
        lengths = (distance / radius).astype(float)
        units = (rays / (distance + (distance == 0))[:, None]).astype(float)
    base = np.column_stack([units, np.ones(len(units))])
    with np.errstate(over="ignore"):  # of a sphere that does not belong to the points
        moved = np.minimum(np.spacing(np.abs(pair.points)) / float(radius), 1.0) * 0.5 * units
    if zone:  # only the points that touch it count
        rows = np.argsort(-np.abs(lengths - 1.0), kind="stable")[: base.shape[1] + 1]
        base, moved = np.column_stack([base[rows], np.sign(lengths[rows] - 1.0)]), moved[rows]
    change = np.linalg.pinv(base)[: pair.points.shape[1] + 1] * np.linalg.norm(moved, axis=1)
    return float(np.linalg.norm(change))


def certificate(pair: ReferencePair, estimator: str) -> Certificate:
    """Errors of an estimator on a pair."""
    if estimator == ZONE:
        zone = minimum_zone(pair.points)
        answer = [*zone.center, zone.radius]
    else:
        fitted = fit(pair.points, estimator)
        answer = [*fitted.center, fitted.radius]
    errors = (math.inf, math.inf)
    if np.isfinite(answer).all():
        with localcontext(_WORKING):
            *across, along = ((_decimals(answer) - np.array(pair.sphere)) / pair.sphere[-1]).astype(float)
        errors = (math.hypot(*across), float(abs(along)))
    return Certificate(pair.name, *errors, _resolution(pair, estimator == ZONE))


def printed(results: dict[str, list[Certificate]], limit: float) -> Iterator[str]:
    """Table of the largest errors for each estimator, and a line for each set that fails.

    A micrometre is one on a sphere of 100 mm in diameter.
    """
    if not results:
        return
    rows = []
    for estimator, each in results.items():
        told = [one for one in each if one.is_told(limit)]
        rest = [one for one in each if not one.is_told(limit)]
        for words, part in (("", told), (" *", rest)):
            if part:
                center, radius = max(one.center for one in part), max(one.radius for one in part)
                worst = max(part, key=lambda one: one.error)
                size = number(5e4 * max(center, radius), ".1e")
                rows.append([estimator + words, str(len(part)), f"{center:.1e}", f"{radius:.1e}", size, worst.name])
    yield from columns(rows, ["estimator", "sets", "centre", "radius", "µm on 100 mm", "worst set"], "<>>>><")
    yield f"errors are shares of the radius; {limit:g} is asked, and instruments are often asked for 0.1 µm on 100 mm"
    apart = [one for each in results.values() for one in each if not one.is_told(limit)]
    if apart:
        most = max(one.resolution for one in apart)
        yield f"* sets whose last digits, in double precision, decide more than {limit:g}: up to {most:.1e}"
    for estimator, each in results.items():
        for one in each:
            if not one.passes(limit):
                words = f"differs by {one.error:.2e} of the radius" if one.error < math.inf else "has no answer"
                yield f"{one.name}: {estimator} {words}; the points tell {one.resolution:.1e}"


def chosen(name: str | None, own: bool) -> tuple[str, ...]:
    """Names of the fits to certify.

    Args:
        name: of one fit, or None for all that the pairs are for.
        own: true for the package's own pairs.

    Raises:
        InputError: if there is no such fit, or no pairs for it.
    """
    if name is None:
        return CERTIFIED if own else ("mle",)
    known = CERTIFIED if own else (*ESTIMATORS, ZONE)
    if name not in known:
        raise InputError(f"--estimator {name}: {estimator_remedy(name, known)}")
    return (name,)


def frame(results: dict[str, list[Certificate]], limit: float) -> pd.DataFrame:
    """Table of all errors: estimator, set, centre, radius, resolution, and if double precision tells the sphere."""
    import pandas as pd

    every = [(name, one) for name, part in results.items() for one in part]
    rows = [{"estimator": name, **one._asdict(), "told": one.is_told(limit)} for name, one in every]
    return pd.DataFrame(rows, columns=["estimator", *Certificate._fields, "told"])


def read_pairs(folders: Iterable[Path], complaints: list[str]) -> Iterator[ReferencePair]:
    """Read the pairs of folders; those that cannot be read add a line each to the complaints."""
    for folder in folders:
        try:
            files = pair_files(folder)
        except InputError as error:
            complaints.append(str(error))
            continue
        for path in files:
            try:
                yield read_pair(path)
            except InputError as error:
                complaints.append(str(error))


def pair_files(folder: Path) -> list[Path]:
    """The ``.ds`` files of a folder, by name.

    Raises:
        InputError: if there are none, or no such folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give one with pairs of files NAME.ds and NAME.fit")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".ds")
    if not files:
        raise InputError(f"{folder}: holds no .ds file; a pair is NAME.ds, a point a line, and NAME.fit")
    return files


def read_pair(path: Path) -> ReferencePair:
    """Read a pair from its ``.ds`` file and the ``.fit`` file beside it.

    Raises:
        InputError: if one cannot be read, or they do not fit together; in one line.
    """
    rows = _read_numbers(path)
    beside = path.with_suffix(".FIT" if path.suffix.isupper() else ".fit")
    values = [value for row in _read_numbers(beside) for value in row]
    width = len(rows[0])
    for line, row in enumerate(rows, 1):
        if len(row) != width:
            raise InputError(f"{path}: point {line} has {len(row)} numbers and the first has {width}; a point a line")
    if width not in (2, 3) or len(rows) < width + 1:
        raise InputError(f"{path}: {len(rows)} points of {width} coordinates; a sphere needs 4 of 3, a circle 3 of 2")
    if len(values) != width + 1:
        reason = f"points of {width} coordinates have a centre and a diameter, {width + 1} numbers"
        raise InputError(f"{beside}: {len(values)} numbers; {reason}")
    if values[-1] <= 0:
        raise InputError(f"{beside}: the diameter is {values[-1]}; it is the last number, and above 0")
    with localcontext(_WORKING):
        sphere = (*values[:-1], values[-1] / 2)
    return ReferencePair(path.stem, np.array([[float(value) for value in row] for row in rows]), sphere)


def _read_numbers(path: Path) -> list[list[Decimal]]:
    """Numbers of each line that is not empty.

    Raises:
        InputError: if there is no such file, none in it, or something else than finite numbers.
    """
    try:
        text = regular(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; a pair is NAME.ds and NAME.fit in one folder") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text of numbers"
        raise InputError(f"{path}: cannot be read: {reason}") from None
    rows = []
    for line, words in enumerate(text.splitlines(), 1):
        try:
            row = [Decimal(word) for word in words.replace(",", " ").split()]
        except InvalidOperation:
            row = [Decimal("NaN")]
        if not all(value.is_finite() and math.isfinite(float(value)) for value in row):
            raise InputError(f"{path}: line {line}, {words.strip()[:40]!r}: expected finite numbers")
        if row:
            rows.append(row)
    if not rows:
        raise InputError(f"{path}: holds no numbers")
    return rows


def write_pairs(pairs: Iterable[ReferencePair], folder: Path) -> None:
    """Write pairs as ``.ds`` and ``.fit`` files; the points are read back exactly.

    Raises:
        RunError: if a file cannot be written.
    """
    with explained(folder, of_run=False):
        folder.mkdir(parents=True, exist_ok=True)
        for name, points, (*center, radius) in pairs:
            with localcontext(Context(prec=DIGITS)):
                values = [*center, 2 * radius]
            lines = [" ".join(repr(float(value)) for value in row) for row in points]
            write(folder / f"{name}.ds", ("\n".join(lines) + "\n").encode())
            write(folder / f"{name}.fit", ("\n".join(map(str, values)) + "\n").encode())

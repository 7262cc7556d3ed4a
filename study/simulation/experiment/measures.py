"""The registry of measures: numbers that a study stores of each fit beside its error; one's own is an entry, too.

A config lists them: ``measures = ["interval", "jaccard"]``. A measure of one's own comes from a file (``--plugin``) or
a program that calls `study.register_measure`. Its function sees the fits of one estimator at a time, so that no column
depends on what else a study has.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainc, stdtrit

from study.arrays import Bools, Floats
from study.fits import Estimates, Fit, Samples
from study.fits.answers.answer import white_covariance
from study.fits.errors.intervals import Intervals, intervals
from study.fits.points.information import crlb
from study.fits.registry import ESTIMATORS, Origin, Registry, as_fit, sound_samples, source
from study.fits.registry import REGISTRIES as ALL_REGISTRIES
from study.simulation.experiment.laws import raised

Values = dict[str, NDArray[np.generic]]
"""Columns of measures by their stored names."""
LEVEL = 0.95
"""Nominal coverage of the intervals that are measured."""


class Truth(NamedTuple):
    """The truth behind the trials of a batch, in the unit of the points.

    Attributes:
        center: of the sphere (d,).
        radius: of the sphere.
        sigma: standard deviation of a coordinate.
        bound: the Cramér-Rao bound of centre and radius, for the realised directions (b, d+1, d+1).
    """

    center: Floats
    radius: float
    sigma: float
    bound: Floats

    def only(self, trial: int) -> "Truth":
        """The truth of one trial, by its place."""
        return self._replace(bound=self.bound[trial : trial + 1])


Function = Callable[[Samples, Fit, Truth], Mapping[str, ArrayLike]]


class MeasureColumn(NamedTuple):
    """A column of a measure, as tables store it: its name, its type, bool or float, and its meaning."""

    name: str
    kind: type
    meaning: str

    @property
    def summaries(self) -> tuple[str, ...]:
        """Names that its summaries over all fits have: a share of truth values, or mean and median of numbers."""
        return (self.name,) if self.kind is bool else (f"{self.name}_mean", f"{self.name}_median")


@dataclass(frozen=True)
class FitMeasure:
    """A measure of fits, as the registry lists it.

    Attributes:
        function: takes the samples of a batch, the fits of one estimator, and the truth; returns an array per column.
        sentence: what it measures.
        columns: type and meaning of each column, by name. A name that ends in ``_i`` stands for a column per axis.
        reference: where it is described.
        version: to be raised with every change of its numbers; a digest of its code, if it is not shipped.
    """

    function: Function
    sentence: str
    columns: Mapping[str, tuple[type, str]]
    reference: str = ""
    version: int | str = 1


def _described(function: Function) -> str:
    """The sentence of a measure: the first of its function's docstring."""
    return " ".join((function.__doc__ or "").partition("\n\n")[0].split())


@lru_cache(maxsize=1)
def _known_interval(samples: Samples) -> Intervals:
    """Intervals of the samples, which are the same for every estimator and so computed once."""
    return intervals(samples, LEVEL)


def _quantile(spare: float) -> float:
    """Student's two-sided quantile of `LEVEL`; the normal law's for infinite degrees of freedom."""
    return float(stdtrit(spare, 0.5 * (1.0 + LEVEL)))


def _held(center: Floats, radius: Floats, truth: Truth, spare: float) -> dict[str, Floats | Bools]:
    """The ends of intervals (b, d, 2) and (b, 2) that hold the truth, and the width of the radius's.

    Args:
        center: ends of each coordinate.
        radius: ends of the radius.
        truth: the truth.
        spare: degrees of freedom of the noise.
    """
    efficient = 2.0 * _quantile(spare) * np.sqrt(truth.bound[:, -1, -1])
    width = (radius[:, 1] - radius[:, 0]) / efficient
    return {
        "radius": (radius[:, 0] <= truth.radius) & (truth.radius <= radius[:, 1]),
        "center_i": (center[:, :, 0] <= truth.center) & (truth.center <= center[:, :, 1]),
        "width": np.where(np.isnan(width), np.inf, width),
    }


def interval(samples: Samples, fit: Fit, truth: Truth) -> dict[str, Floats | Bools]:
    """95 % intervals from the points alone, whatever the estimator."""
    _, d, n = samples.shape
    known = _known_interval(samples)
    return {**_held(known.center, known.radius, truth, n - d - 1), "identified": known.identified}


def _own_ends(samples: Samples, fit: Fit) -> tuple[Floats, float]:
    """The estimate ± t standard errors of the estimator's own (b, d+1, 2), and the degrees of freedom of the noise."""
    _, d, n = samples.shape
    entry = ESTIMATORS[fit.estimator]
    spare = math.inf if entry.needs or entry.takes_noise else n - d - 1
    half = _quantile(spare) * np.sqrt(np.einsum("bii->bi", white_covariance(fit)))
    estimate = np.column_stack([fit.center, fit.radius])
    return np.stack([estimate - half, estimate + half], axis=2), spare


def own_errors(samples: Samples, fit: Fit, truth: Truth) -> dict[str, Floats | Bools]:
    """95 % intervals of the estimate ± t standard errors of the estimator's own, from the noise that it found.

    They are ± z of an estimator that takes σ from the study.
    """
    ends, spare = _own_ends(samples, fit)
    return _held(ends[:, :-1], ends[:, -1], truth, spare)


def ends(samples: Samples, fit: Fit, truth: Truth) -> dict[str, Floats]:
    """Ends of the 95 % intervals of `interval` and `own_errors` of the radius, over the true radius."""
    known, (own, _) = _known_interval(samples).radius / truth.radius, _own_ends(samples, fit)
    own = own[:, -1] / truth.radius
    return {"low": known[:, 0], "high": known[:, 1], "own_low": own[:, 0], "own_high": own[:, 1]}


def jaccard(samples: Samples, fit: Fit, truth: Truth) -> dict[str, Floats]:
    """Jaccard index of the fitted and the true ball, or disc: the volume that both have over that of their union."""
    apart = np.linalg.norm(fit.center - truth.center, axis=1)
    return {"index": jaccard_index(apart, np.abs(fit.radius), np.full(len(apart), truth.radius), samples.shape[1])}


def jaccard_index(apart: Floats, radius: Floats, true_radius: Floats, dimension: int) -> Floats:
    """Volume of the intersection of two balls over that of their union.

    A ball of radius r is cut by a plane at a distance a from its centre into caps of the shares I(1 - a²/r²)/2 and the
    rest, I the regularised incomplete beta function of (d+1)/2 and 1/2. The two balls' spheres cut each other in such a
    plane.

    Args:
        apart: distance of the centres.
        radius: of one ball.
        true_radius: of the other.
        dimension: d; 2 for discs.
    """
    d, radii = dimension, (radius, true_radius)
    both = np.zeros(np.shape(apart))
    with np.errstate(all="ignore"):  # no plane cuts concentric balls
        for own, other in (radii, radii[::-1]):
            plane = (apart**2 + own**2 - other**2) / (2.0 * apart * own)  # its distance from the centre, over own
            outer = 0.5 * betainc(0.5 * (d + 1), 0.5, np.clip(1.0 - plane**2, 0.0, 1.0))
            both = both + own**d * np.where(plane > 0.0, outer, 1.0 - outer)
        both = np.where(apart <= np.abs(radius - true_radius), np.minimum(*radii) ** d, both)  # one within the other
        return np.asarray(both / (radius**d + true_radius**d - both))


_HOLDS = {
    "radius": (bool, "the interval of the radius holds the truth"),
    "center_i": (bool, "the interval of the centre's component {} holds the truth"),
    "width": (float, "length of the radius's interval over that of ± t (or z) standard deviations of the bound"),
}
_OWN = {
    "radius": (bool, "the radius ± t of its standard errors holds the truth"),
    "center_i": (bool, "the centre's component {} ± t of its standard errors holds the truth"),
    "width": (float, "standard error of the radius over the standard deviation of the bound"),
}
_IDENTIFIED = {"identified": (bool, "the points bound the radius, and the noise is below 0.35 radii")}
_ENDS = {
    "low": (float, "lower end of the radius's interval from the points alone, over the true radius"),
    "high": (float, "its upper end, infinite if the points do not bound it"),
    "own_low": (float, "the radius less t of its standard errors, over the true radius"),
    "own_high": (float, "the radius plus t of its standard errors, likewise"),
}
_INDEX = {"index": (float, "volume of the intersection of the fitted and the true ball over that of their union")}
MEASURES: dict[str, FitMeasure] = {
    "interval": FitMeasure(interval, _described(interval), {**_HOLDS, **_IDENTIFIED}, "theory §10"),
    "own_errors": FitMeasure(own_errors, _described(own_errors), _OWN),
    "ends": FitMeasure(ends, _described(ends), _ENDS),
    "jaccard": FitMeasure(jaccard, _described(jaccard), _INDEX, "Jaccard 1912"),
}
"""The measures by name."""


def stored(names: Iterable[str], dimension: int) -> tuple[MeasureColumn, ...]:
    """The columns of some measures, as tables store them: ``interval_radius``, ``interval_center_1`` and so on."""
    result = []
    for name in names:
        for column, (kind, meaning) in MEASURES[name].columns.items():
            for ending in _endings(column, dimension):
                full = f"{name}_{column.removesuffix('i') if ending else column}{ending}"
                result.append(MeasureColumn(full, kind, f"{name}: {meaning.replace('{}', ending)}"))
    return tuple(result)


def _endings(column: str, dimension: int) -> list[str]:
    """Endings of the stored names of a column: the numbers of the axes, if it has one for each."""
    return [str(i + 1) for i in range(dimension)] if column.endswith("_i") else [""]


def missing(names: Iterable[str], dimension: int, shape: int | tuple[int, ...]) -> Values:
    """Columns of some fits that could not be measured: False, or not a number."""
    return {c.name: np.full(shape, False if c.kind is bool else np.nan) for c in stored(names, dimension)}


def attempt(
    name: str, samples: Samples, estimates: Estimates, estimator: str, truth: Truth
) -> tuple[Values, dict[int, str]]:
    """Measure the fits of a batch; a trial on which the function raises has False, or not a number.

    Args:
        name: the measure's.
        samples: the batch, without the noise.
        estimates: its fits.
        estimator: name of the estimator.
        truth: the truth.

    Returns:
        The columns, and the messages of exceptions by the number of the trial, from 0.
    """
    b, d, _ = samples.shape
    estimates = Estimates._make(map(np.copy, estimates))  # whatever a function does with them, the errors stay
    try:
        return _called(name, samples, as_fit(estimates, samples, estimator), truth), {}
    except (Exception, SystemExit):  # trying each trial by itself shows which of them raise
        result = missing([name], d, b)
    faults = {}
    for t in range(b):
        one, part = samples.only(t), Estimates._make([array[t : t + 1] for array in estimates])
        try:
            answer = _called(name, one, as_fit(part, one, estimator), truth.only(t))
        except (Exception, SystemExit) as error:
            faults[t] = f"measure {name}: {raised(error, MEASURES[name].function)}"
            continue
        for column, values in answer.items():
            result[column][t] = values[0]
    return result, faults


def _called(name: str, samples: Samples, fit: Fit, truth: Truth) -> Values:
    """Call a measure; ValueError if it does not answer once for each fit and column."""
    entry, (b, d, _) = MEASURES[name], samples.shape
    with np.errstate(all="ignore"):
        answer = entry.function(samples, fit, truth)
    if not isinstance(answer, Mapping) or set(answer) != set(entry.columns):
        given = ", ".join(map(str, answer)) or "no column" if isinstance(answer, Mapping) else type(answer).__name__
        raise ValueError(f"returned {given}, expected a dictionary of {', '.join(entry.columns)}")
    parts: list[NDArray[np.generic]] = []
    for column, (kind, _) in entry.columns.items():
        values = np.asarray(answer[column])
        shape = (b, d) if column.endswith("_i") else (b,)
        if values.shape != shape:
            raise ValueError(f"{column} has shape {values.shape}, expected {shape}")
        if not np.issubdtype(values.dtype, np.bool_ if kind is bool else np.number):
            raise ValueError(f"{column} has type {values.dtype}, expected {kind.__name__}")
        parts += list(values.astype(kind).reshape(b, -1).T)
    return {c.name: part for c, part in zip(stored([name], d), parts, strict=True)}


FIRST_WORDS = {"error", "radius", "noise", "outlier", "stated", "relative", "ratio", "far", "axis", "tail", "bias"}
FIRST_WORDS |= {"rmse", "not", "at", "too", "weakly"}
"""First words of columns of the tables, which no measure's name begins with."""


def register_measure(
    name: str, function: Function, columns: Mapping[str, tuple[type, str]], *, reference: str = ""
) -> None:
    """Register a measure of one's own; from then on configs know its name: ``measures = ["near"]``.

    Args:
        name: lower-case letters, digits and underscores, a letter first.
        function: takes the samples of a batch, whose points are ``samples.points`` (b, n, d), without the noise; the
            fits of one estimator, a `study.Fit` of shape (b,); and the truth: ``truth.center`` (d,), ``truth.radius``,
            ``truth.sigma``, and ``truth.bound`` (b, d+1, d+1), the Cramér-Rao bound of centre and radius. It returns a
            dictionary with an array (b,) for each column. Its docstring begins with a sentence that says what it
            measures. A fit may hold a NaN. Divide lengths by the radius: the unit of the points is another in the
            tables.
        columns: for each column its type, bool or float, and its meaning in a few words. The tables have it as
            ``near_center`` for the column ``center`` of the measure ``near``. A name that ends in ``_i`` has an array
            (b, d), and a column for each axis.
        reference: where it is described.

    Raises:
        TypeError: if the function cannot be called.
        ValueError: if the name cannot be used or is taken, there is no sentence, or a column is not described.

    Examples:
        >>> import numpy as np, study
        >>> def near(samples, fit, truth):
        ...     "Distance of the fitted from the true centre, in radii."
        ...     away = np.linalg.norm(fit.center - truth.center, axis=1) / truth.radius
        ...     return {"center": away < 0.1, "distance": away}
        >>> columns = {"center": (bool, "within 0.1 radii"), "distance": (float, "distance over the radius")}
        >>> study.register_measure("near", near, columns)
    """
    call = f"register_measure({name!r})"
    if not callable(function):
        raise TypeError(f"{call}: {type(function).__name__} is not a function")
    if not (sentence := _described(function)):
        raise ValueError(f"{call}: give the function a docstring: its first sentence says what it measures")
    if not isinstance(columns, Mapping) or not columns:
        raise ValueError(f"{call}: columns = {columns!r}: give at least one, such as {{'near': (bool, 'meaning')}}")
    for column, pair in columns.items():
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,40}", str(column)):
            raise ValueError(f"{call}: column {column!r}: a name has lower-case letters, digits and underscores")
        if not isinstance(pair, tuple) or len(pair) != 2 or pair[0] not in (bool, float) or not str(pair[1]).strip():
            raise ValueError(f"{call}: column {column!r} = {pair!r}: give bool or float, and its meaning")
    origin = source(function)
    _REGISTRY.enter(name, origin, (name in MEASURES and name not in ORIGINS) or name.partition("_")[0] in FIRST_WORDS)
    entry = FitMeasure(function, sentence, dict(columns), reference)
    MEASURES[name] = replace(entry, version=origin.digest[:10] or entry.version)


ORIGINS: dict[str, Origin] = {}
"""Origins of the measures that are not shipped, by their names."""


def origins(names: Iterable[str]) -> list[dict[str, object]]:
    """The origins of those among some measures that are not shipped, as a manifest has them."""
    return _REGISTRY.listed(names, "measures")


def only_here(names: Iterable[str]) -> list[str]:
    """Those among some measures that worker processes cannot have."""
    return _REGISTRY.only_here(names)


def _measured(name: str, d: int, size: float = 1.0, trial: int | None = None) -> Values:
    """A measure of fits to two sets of sound points, of which perhaps one alone; ValueError and others if it fails."""
    sound = sound_samples(d)
    u = sound.points / np.linalg.norm(sound.points, axis=2, keepdims=True)
    samples, truth = Samples(size * sound.x), Truth(np.zeros(d), size, 0.01 * size, crlb(u, 0.01 * size))
    if trial is not None:
        samples, truth = samples.only(trial), truth.only(trial)
    return _called(name, samples, as_fit(ESTIMATORS[_TRIED](samples), samples, _TRIED), truth)


_TRIED = "als"
"""The estimator on whose fits a measure is tried out."""


def tried(name: str, dimension: int) -> str:
    """Try out a measure of one's own on sound points; what is wrong with it, or nothing."""
    try:
        if name in ORIGINS:
            _measured(name, dimension)
    except (Exception, SystemExit) as error:
        return raised(error, MEASURES[name].function)
    return ""


def _fault(name: str) -> str:
    """The fault of a measure that fails in the plane and in space alike; empty for others."""
    faults = [tried(name, d) for d in (2, 3)]
    return faults[1] if all(faults) else ""


def _remove(name: str) -> None:
    """Take a measure that is not shipped out of the registry."""
    if ORIGINS.pop(name, None) is not None:
        del MEASURES[name]


_REGISTRY = Registry("measure", "register_measure", ORIGINS, _remove, "20 sound points", _fault)
ALL_REGISTRIES.append(_REGISTRY)


def check(file: str) -> tuple[list[str], list[str]]:
    """Check the measures that a file registered: again, for a trial alone, and on spheres of four times the size.

    Args:
        file: its name.

    Returns:
        A sentence for each property that a measure violates, and lines that say what they are.
    """
    violations, lines = list[str](), list[str]()
    for name in [name for name, origin in ORIGINS.items() if origin.name == file]:
        lines.append(f"{name}: measure. {MEASURES[name].sentence}")
        faults = {d: fault for d in (2, 3) if (fault := tried(name, d))}
        lines += [f"{name}: d = {d} is left out: {fault}" for d, fault in faults.items()]
        for d in {2, 3} - set(faults):
            first = _measured(name, d)
            for words, other, part in (
                ("another answer for the same fits", _measured(name, d), slice(None)),
                ("a fit differs alone and beside others", _measured(name, d, trial=1), slice(1, 2)),
                ("depends on the unit: divide lengths by truth.radius", _measured(name, d, 4.0), slice(None)),
            ):
                wrong = [c for c in first if not np.allclose(first[c][part], other[c], 1e-6, equal_nan=True)]
                violations += [f"{', '.join(wrong)}: {words} (d = {d})"] if wrong else []
    return violations, lines


def faults(names: Iterable[str], dimension: int) -> Iterable[str]:
    """Faults of the measures of a study: one that fails on sound points, and two with columns of one name."""
    for name in names:
        if fault := tried(name, dimension):
            yield f"{name} fails on 20 sound points: {fault}"
    columns = [column.name for column in stored(names, dimension)]
    if twice := [name for name in dict.fromkeys(columns) if columns.count(name) > 1]:
        yield f"two measures have a column {twice[0]}: leave one of them out"

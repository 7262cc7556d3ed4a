"""The conditions of an experiment in one table: configs, cells, stored tables and labels are made from it.

A *silent* condition leaves no trace where it has its default value: not in the digest of a config, not in the names of
cells and streams, not in the columns of the tables. So the tables of a study that does not use it are, to the byte,
what they were before the condition was added.

Below stand the laws that a random design draws its conditions from, each as the inverse of its distribution function.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Container
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self

from pydantic import BeforeValidator, Field, model_validator

from study.simulation.experiment import laws
from study.toml import Frozen, Listed

if TYPE_CHECKING:
    import pandas as pd


Value = int | float | str


class RowValues(Protocol):
    """A row of a table, or the values of a cell: values by the name of their column."""

    def __contains__(self, name: object, /) -> bool: ...
    def __getitem__(self, name: Any, /) -> Any: ...


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One condition of an experiment.

    Attributes:
        name: its key in a config, and the name of its column in the tables.
        symbol: for labels.
        meaning: of its column in the tables, in words.
        in_full: the longer meaning that the error table has; the same as elsewhere, if empty.
        unit: of its column: length, degree, or none.
        allowed: true for the values that may be given.
        rule: the values allowed, in words; made from the registry, if the values are laws.
        laws: kind of the laws that its values are, as `study.simulation.experiment.laws` has it; empty for others.
        kind: of its values: int, float or str.
        default: its value where a config gives none; without a default, a config must give it or its alternative.
        alternative: another condition that a config may give instead of it.
        silent: the default leaves no trace.
        own_draws: cells with different values have different draws; otherwise the same draws are placed differently.
        axis: a grid may list its values.
        law: a random design may draw it; a word is the same for all of its trials.
        by_moments: the route through joint moments takes account of it; otherwise that route refuses it.
        by_posterior: the likelihoods of posteriors take account of it; otherwise a config with [posterior] refuses it.
        stored: it has a column in the tables.
        derived: finds it from the other conditions of a row, if it has no column.
        labelled: labels name it.
        digits: of a value in a label.
        mark: the sign behind a value in a label.
    """

    name: str
    symbol: str
    meaning: str
    in_full: str = ""
    unit: str = ""
    allowed: Callable[[Any], bool]
    rule: str = ""
    laws: str = ""
    kind: type[int] | type[float] | type[str] = float
    default: Value | None = None
    alternative: str = ""
    silent: bool = False
    own_draws: bool = False
    axis: bool = True
    law: bool = True
    by_moments: bool = False
    by_posterior: bool = False
    stored: bool = True
    derived: Callable[[RowValues], Any] | None = None
    labelled: bool = True
    digits: int = 6
    mark: str = ""

    def holds(self, value: object) -> bool:
        """True if a value is of its kind: a word, or a number that floating point can hold."""
        return isinstance(value, str) if self.kind is str else is_number(value)

    @property
    def must_be(self) -> str:
        """The values allowed, in words."""
        return laws.rule(self.laws) if self.laws else self.rule

    def of(self, row: RowValues) -> Any:
        """Its value in a row of a table, or among the values of a cell."""
        return row[self.name] if self.derived is None else self.derived(row)

    def written(self, value: Value) -> str:
        """A value as a label has it: ``20°``."""
        return (value if isinstance(value, str) else f"{value:.{self.digits}g}") + self.mark

    def label(self, row: RowValues) -> str:
        """Its symbol and its value in a row: ``φ = 20°``."""
        return f"{self.symbol} = {self.written(self.of(row))}"


def is_number(value: object) -> bool:
    """True if a config's value is a number that floating point can hold."""
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:
        return False


_placing = partial(Condition, by_moments=True, by_posterior=True)
"""Makes a condition of the sphere and of the placing of its points, of which all routes take account."""
_silent = partial(Condition, silent=True)


def _of_laws(kind: str, **others: Any) -> Condition:
    """Make a condition whose values are the laws of a kind."""
    allowed = partial(laws.is_law, kind)
    return _silent(laws=kind, kind=str, default=laws.PLAIN[kind], allowed=allowed, **others)


SAMPLES = _placing(
    name="samples",
    symbol="N",
    meaning="number of samples N",
    in_full="number of samples N of the data set",
    allowed=lambda v: v >= 3 and v == int(v),
    rule="a whole number, at least dimension + 1",
    kind=int,
    own_draws=True,
)
NOISE = _placing(
    name="noise",
    symbol="σ",
    meaning="standard deviation σ",
    in_full="standard deviation σ of each coordinate",
    unit="length",
    allowed=lambda v: v > 0,
    rule="above 0, in the unit of the radius",
    alternative="noise_over_radius",
    labelled=False,
)
NOISE_OVER_RADIUS = _placing(
    name="noise_over_radius",
    symbol="σ/r",
    meaning="standard deviation σ over radius r",
    allowed=lambda v: v > 0,
    rule="above 0, as a share of the radius",
    alternative="noise",
    stored=False,
    derived=lambda row: row["noise"] / row["radius"],
    digits=3,
)
ANGLE = _placing(
    name="angle",
    symbol="φ",
    meaning="confinement half-angle φ",
    in_full="confinement half-angle φ about the first axis",
    unit="degree",
    allowed=lambda v: 0 < v <= 180,
    rule="above 0 and at most 180 degrees",
    own_draws=True,
    digits=4,
    mark="°",
)
RADIUS = _placing(
    name="radius",
    symbol="r",
    meaning="true radius r",
    unit="length",
    allowed=lambda v: 1e-100 <= v <= 1e100,  # beyond, squares of errors leave the range of numbers
    rule="above 0, between 1e-100 and 1e100",
    default=1.0,
)
CENTER = _placing(
    name="center",
    symbol="|c|",
    meaning="distance |c| from the origin",
    in_full="distance |c| of the true centre from the origin",
    unit="length",
    allowed=lambda v: v >= 0,
    rule="at least 0: the distance of the centre from the origin",
    default=0.0,
)
LAW = _of_laws(
    laws.NOISE,
    name="law",
    symbol="law",
    meaning="law of the noise",
    in_full="law of the noise, of covariance σ² I; radial, rim and form depend on the direction (docs/robustness.md)",
)
OUTLIER_SHARE = _silent(
    name="outlier_share",
    symbol="outliers",
    meaning="probability that a sample is an outlier",
    in_full="probability that a sample is an outlier, displaced in a random direction",
    allowed=lambda v: 0 <= v < 1,
    rule="a share: at least 0 and below 1",
    default=0.0,
)
OUTLIER_SIZE = _silent(
    name="outlier_size",
    symbol="outliers by",
    meaning="distance by which outliers are displaced, in units of σ",
    allowed=lambda v: v > 0,
    rule="above 0, in units of σ",
    default=laws.SIZE,
    digits=4,
    mark="σ",
)
STATED_VARIANCE = _silent(
    name="stated_variance",
    symbol="σ̂²/σ²",
    meaning="noise variance that the estimators are given, in units of σ²",
    allowed=lambda v: v > 0,
    rule="above 0, in units of σ²",
    default=1.0,
    digits=4,
)
DIRECTIONS = _of_laws(
    laws.DIRECTIONS,
    name="directions",
    symbol="directions",
    meaning="law of the directions",
    in_full="law of the directions: uniform by area or by the polar angle, equally spaced, or a path",
    own_draws=True,
    by_moments=True,
)
OUTLIER_LAW = _of_laws(
    laws.OUTLIERS,
    name="outlier_law",
    symbol="law of outliers",
    meaning="law by which outliers are displaced",
    in_full="law by which outliers are displaced: by outlier_size in any direction, or as the word says",
)
COORDINATES = _of_laws(
    laws.COORDINATES,
    name="coordinates",
    symbol="coordinates",
    meaning="change of the coordinates that are measured",
    in_full="change of the coordinates that are measured: none, or rounded to a grid",
)
KAPPA = _silent(
    name="kappa",
    symbol="κ",
    meaning="least variance of the directions over the standard error of the noise's variance",
    in_full="κ = (v/σ²)√(N/2), v the least variance of the directions: at 1 the noise hides the curvature of any cap",
    allowed=lambda v: v > 0,
    rule="above 0: the noise follows from it, the number of samples, the angle and the radius",
    alternative="noise",
    law=False,
    by_moments=True,
    by_posterior=True,
)
DEPARTURES = (LAW, OUTLIER_SHARE, OUTLIER_SIZE, OUTLIER_LAW, COORDINATES)
"""The conditions that make the noise other than normal."""

_PLACING = (SAMPLES, NOISE, NOISE_OVER_RADIUS, ANGLE, RADIUS, CENTER)
_FURTHER = (LAW, OUTLIER_SHARE, OUTLIER_SIZE, STATED_VARIANCE, DIRECTIONS, OUTLIER_LAW, COORDINATES, KAPPA)
CONDITIONS = {c.name: c for c in (*_PLACING, *_FURTHER)}
"""Every condition by its name, in the order of keys, columns and labels. A new one is appended."""

STORED = tuple(c for c in CONDITIONS.values() if c.stored)
"""The conditions with a column of their own."""

SILENT = tuple(c for c in CONDITIONS.values() if c.silent)
"""The conditions that leave no trace at their defaults."""

COLUMNS = tuple(c for c in STORED if not c.silent)
"""The conditions that are columns of every table."""

LABELS = tuple(c for c in CONDITIONS.values() if c.labelled)
"""The conditions that labels may name."""

ALWAYS = (SAMPLES, NOISE_OVER_RADIUS, ANGLE)
"""The conditions that a label names in any case."""


def distinguishing(table: "pd.DataFrame") -> list[Condition]:
    """The conditions that distinguish the rows of a table: N, σ/r and φ in any case, others if they vary."""
    return [c for c in LABELS if c in ALWAYS or (c.name in table and table[c.name].nunique() > 1)]


def named_in(columns: Container[str]) -> list[Condition]:
    """The conditions that a text names for rows with these columns: N, σ/r and φ, and the silent ones among them."""
    return [c for c in LABELS if c in ALWAYS or (c.silent and c.name in columns)]


def bound_law(conditions: Container[str]) -> str:
    """Words for the law of noise that the Cramér-Rao bound assumes; empty if the study's noise is normal.

    Args:
        conditions: names of the conditions that a study gives, or columns of its tables.
    """
    return "Gaussian bound at the same σ" if any(c.name in conditions for c in DEPARTURES) else ""


def label(row: RowValues) -> str:
    """A row's conditions in words: ``N = 10, σ/r = 0.1, φ = 90°``, and the silent ones that its table has."""
    return ", ".join(c.label(row) for c in named_in(row))


class Distribution(Frozen):
    """A law that a number is drawn from: one of a few values, each equally likely, unless it says otherwise."""

    continuous: ClassVar[bool] = False
    """It has a density on an interval; otherwise it has a few values."""
    name: ClassVar[str]
    """The law in words, if it is continuous."""

    def at(self, u: float) -> float:
        """The number drawn, from a uniform one u in [0, 1)."""
        values = self.possible()
        return values[int(u * len(values))]

    @abstractmethod
    def possible(self) -> tuple[float, ...]:
        """The values that can be drawn; of a continuous law the ends, of which the lower is never drawn."""


class Constant(Distribution):
    """Always the same value."""

    law: Literal["constant"]
    value: float

    def possible(self) -> tuple[float, ...]:
        """The value."""
        return (self.value,)


class Choice(Distribution):
    """One of a list of values, each equally likely."""

    law: Literal["choice"]
    values: Annotated[Listed[float], Field(min_length=1)]

    def possible(self) -> tuple[float, ...]:
        """The values."""
        return self.values


class _Interval(Distribution):
    continuous = True
    low: float
    high: float

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}")
        return self

    def possible(self) -> tuple[float, ...]:
        """The ends of the interval."""
        return self.low, self.high


class Uniform(_Interval):
    """Uniform on (low, high]."""

    law: Literal["uniform"]
    name = "uniform"

    def at(self, u: float) -> float:
        """The value at quantile 1 - u, u in [0, 1)."""
        return self.high - (self.high - self.low) * u


class LogUniform(_Interval):
    """Uniform in the logarithm, on (low, high]."""

    law: Literal["log_uniform"]
    name = "log-uniform"
    low: Annotated[float, Field(gt=0)]

    def at(self, u: float) -> float:
        """The value at quantile 1 - u, u in [0, 1)."""
        value = float(self.low**u * self.high ** (1.0 - u))
        return min(max(value, self.low), self.high)


LAWS = ("constant", "choice", "uniform", "log_uniform")


def _plain_number(value: object) -> object:
    """Make a constant of a number, and refuse anything but a law with an example of one."""
    if is_number(value):
        return {"law": "constant", "value": value}
    if not isinstance(value, dict | Frozen) or (isinstance(value, dict) and "law" not in value):
        example = '{ law = "uniform", low = …, high = … }'
        raise ValueError(f"must be a finite number or a law such as {example} ({', '.join(LAWS)})")
    return value


Law = Annotated[
    Annotated[Constant | Choice | Uniform | LogUniform, Field(discriminator="law")], BeforeValidator(_plain_number)
]
"""A law as written in a config, ``{ law = "uniform", low = 0, high = 37 }``; a plain number is a constant."""

"""Designs of a study: the cells of a grid or of a random design, and the batches of trials that they share.

A config's ``[design]`` is made from the table of conditions: a grid lists values, and every combination of them is a
cell of so many trials; in a random design each trial draws its own conditions from declared laws, as in the paper's
§4.1. Cells that differ in the placing of points alone share their draws and form a group; a batch is a range of a
group's trials: a unit of work, which a worker computes at once, or a part of one.
"""

import hashlib
import math
import operator
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from itertools import chain, product
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    create_model,
    model_serializer,
)

from study.fits.loops.random import Name, stream
from study.fits.points.cap import cap_moments
from study.simulation.experiment import laws
from study.simulation.experiment.conditions import (
    CONDITIONS,
    SILENT,
    Condition,
    Constant,
    Distribution,
    Law,
    Value,
    is_number,
)
from study.toml import Frozen, each_once, shorten

Further = tuple[tuple[str, Value], ...]
"""Names and values of silent conditions that are not at their defaults, in the order of the table."""


@dataclass(frozen=True)
class Cell:
    """One combination of the conditions of the experiment.

    Attributes:
        samples: number of samples N.
        noise: σ, standard deviation of each coordinate.
        angle: confinement half-angle φ in degrees.
        radius: r, in the unit of the noise.
        center: c (d,).
        scale: the unit in which the points are formed and fitted. Fits depend on it by rounding alone, so cells of a
            grid whose radii differ by a power of ten are fitted once.
        further: the silent conditions, see `Further`.
    """

    samples: int
    noise: float
    angle: float
    radius: float
    center: tuple[float, ...]
    scale: float = 1.0
    further: Further = ()

    @classmethod
    def of(cls, values: Mapping[str, Value], center: tuple[float, ...], scale: float = 1.0) -> "Cell":
        """Make a cell from the values of its conditions by name; the noise may be relative to the radius, or by κ."""
        samples, angle, radius = int(values["samples"]), float(values["angle"]), float(values["radius"])
        if "noise" in values:
            sigma = float(values["noise"])
        elif "noise_over_radius" in values:
            sigma = float(values["noise_over_radius"]) * radius
        else:
            sigma = rounded(relative_noise(samples, angle, float(values["kappa"]), len(center)) * radius)
        return cls(samples, sigma, angle, radius, center, scale, further(values))

    @cached_property
    def name(self) -> str:
        """Digest of the conditions, ten hexadecimal digits; it is the same in every study."""
        numbers = [self.samples, *(float(v).hex() for v in (self.noise, self.angle, self.radius, *self.center))]
        return hashlib.blake2b(repr([*numbers, *self.further]).encode(), digest_size=5).hexdigest()

    @cached_property
    def level(self) -> "Cell":
        """The cell in units of ``scale``, in which its points are formed; cells of equal levels are fitted once."""
        if self.scale == 1.0:
            return self
        noise, radius, *center = (rounded(v / self.scale) for v in (self.noise, self.radius, *self.center))
        return replace(self, noise=noise, radius=radius, center=tuple(center), scale=1.0)

    @property
    def stated_noise(self) -> float:
        """The standard deviation σ that the estimators are given."""
        variance = float(dict(self.further).get("stated_variance", 1.0))
        return self.noise if variance == 1.0 else self.noise * math.sqrt(variance)

    @property
    def directions(self) -> str:
        """Law of the directions."""
        return str(self.values["directions"])

    @property
    def distance(self) -> float:
        """Distance |c| of the centre from the origin."""
        return math.hypot(*self.center)

    @property
    def values(self) -> dict[str, Value]:
        """The values of all stored conditions by name."""
        known = {name: getattr(self, name) for name in ("samples", "noise", "angle", "radius")}
        silent = {c.name: c.default for c in SILENT if c.default is not None}
        return known | {"center": self.distance} | silent | dict(self.further)


def relative_noise(samples: int, angle: float, kappa: float, dimension: int) -> float:
    """The noise σ in radii that has a κ."""
    return math.sqrt(_least_variance(angle, dimension) / kappa * math.sqrt(samples / 2.0))


@cache
def _least_variance(angle: float, dimension: int) -> float:
    """The least variance of directions that are uniform by area on a cap of a half-angle in degrees."""
    moments = cap_moments(math.radians(angle), dimension)
    return min(moments.along, moments.across)


def further(values: Mapping[str, Value]) -> Further:
    """Select the silent conditions that are not at their defaults."""
    return tuple((c.name, values[c.name]) for c in SILENT if values.get(c.name, c.default) != c.default)


def rounded(value: float) -> float:
    """Round to twelve digits: readable, and the same on machines whose exp differs in the last bit. -0.0 is 0.0."""
    return float(f"{value:.12g}") + 0.0


MAX_CELLS = 10_000_000

TypeAndDefault = tuple[Any, Any]
"""Type and default of a field, as `pydantic.create_model` takes them."""
_TUPLES: dict[type, Any] = {int: tuple[int, ...], float: tuple[float, ...], str: tuple[str, ...]}


def axis(condition: Condition) -> TypeAndDefault:
    """The field of a condition in a grid: the tuple of its values."""
    values: Any = Annotated[_TUPLES[condition.kind], BeforeValidator(lambda entry: _expanded(condition, entry))]
    return _field(condition, values, None if condition.default is None else (condition.default,))


def law(condition: Condition) -> TypeAndDefault:
    """The field of a condition in a random design: the law that it is drawn from, or a word."""
    if condition.kind is str:
        word: Any = Annotated[str, AfterValidator(lambda given: _expanded(condition, given)[0])]
        return _field(condition, word, condition.default)
    laws: Any = Annotated[Law, AfterValidator(lambda given: _within(condition, given))]
    default = None if condition.default is None else Constant(law="constant", value=float(condition.default))
    return _field(condition, laws, default)


def _field(condition: Condition, given: Any, default: object) -> TypeAndDefault:
    if condition.alternative:
        return given | None, None
    return given, ... if default is None else default


def as_list(value: Any) -> Sequence[Any]:
    """A list of one value, unless it is a list."""
    return value if isinstance(value, list | tuple) else (value,)


def _expanded(condition: Condition, given: Any) -> tuple[Value, ...]:
    """Expand a grid axis, which is a value, a list, ``linspace`` or ``logspace``, and check every value."""
    values: list[Any] = _spaced(given) if isinstance(given, dict) else list(as_list(given))
    if isinstance(given, dict) and condition.kind is int:
        values = [float(round(v)) if math.isfinite(v) else v for v in values]
    if not values:
        raise ValueError(f"the list is empty; give at least one value, each {condition.must_be}")
    wrong = [v for v in values if not condition.holds(v) or not condition.allowed(v)]
    if wrong:
        listed = ", ".join(shorten(v) for v in wrong[:5]) + (", …" if len(wrong) > 5 else "")
        own = f"; {laws.OF_YOUR_OWN}" if condition.laws else ""
        raise ValueError(f"{listed} not allowed: every value must be {condition.must_be}{own}")
    if condition.kind is float:
        values = [v + 0.0 for v in values]  # -0.0 is 0.0
    result: tuple[Value, ...] = tuple(map(condition.kind, values))
    # a range of whole numbers may round to equal ones; in a list, a second one is a mistake
    return tuple(dict.fromkeys(result)) if isinstance(given, dict) else each_once(result)


def _spaced(given: dict[str, Any]) -> list[float]:
    """Values of ``{ linspace = [first, last, count] }`` or ``{ logspace = [first, last, count] }``, ends included."""
    words = "write { linspace = [first, last, count] } or { logspace = [first, last, count] }"
    if len(given) != 1 or next(iter(given)) not in ("linspace", "logspace"):
        raise ValueError(f"keys {', '.join(given) or 'none'} not understood: {words}")
    ((kind, ends),) = given.items()
    if not isinstance(ends, list) or len(ends) != 3 or not all(is_number(v) for v in ends):
        raise ValueError(f"{kind} = {ends!r} not understood: {words}")
    first, last, count = ends
    if not isinstance(count, int) or not 1 <= count <= MAX_CELLS:
        raise ValueError(f"count = {count!r} in {kind} must be a whole number from 1 to {MAX_CELLS}")
    if count == 1 and first != last:
        raise ValueError(f"{kind} from {first} to {last} cannot be 1 value: {words}")
    if kind == "logspace" and not (first > 0 and last > 0):
        raise ValueError(f"logspace from {first} to {last} must have both ends above 0")
    space = np.linspace if kind == "linspace" else np.geomspace
    with np.errstate(all="ignore"):  # a range beyond floating point gives values that are not allowed
        values = space(float(first), float(last), count)
    # twelve digits: 0.1 instead of 0.10000000000000002, on every machine
    return [float(f"{v:.12g}") for v in values]


def _within(condition: Condition, given: Distribution) -> Distribution:
    """Check that a law stays within the values allowed for a condition; an open lower end may touch the limit."""
    values = given.possible()
    if given.continuous and condition.kind is int:
        values = tuple(float(round(v)) for v in values)
    elif given.continuous and values[0] == 0.0:
        values = values[1:]
    wrong = [f"{v:.12g}" for v in dict.fromkeys(values) if not condition.allowed(v)]
    if wrong:
        raise ValueError(f"{' and '.join(wrong)} not allowed: every value must be {condition.must_be}")
    return given


BLOCK_SAMPLES = 2**15
BLOCK_TRIALS = 1000
_SAMPLES_PER_UNIT = 8_000_000
_FITS_PER_UNIT = 20_000
"""Data sets of a unit, of any number of samples: its rows lie in memory until they are written."""


def block_trials(samples: int) -> int:
    """Number of trials that are drawn from one pair of streams; it depends on the number of samples alone."""
    return max(1, min(BLOCK_TRIALS, BLOCK_SAMPLES // samples))


@dataclass(frozen=True)
class Group:
    """Cells that share draws.

    Attributes:
        stream: name of the draws, without the number of the block.
        size: number of trials in a block, which are drawn from one pair of streams.
        cells: the cells, all of the same number of samples, angle and law of directions.
    """

    stream: Name
    size: int
    cells: tuple[Cell, ...]

    @property
    def samples(self) -> int:
        """Number of samples of each trial; 0 if every trial draws its own."""
        return self.cells[0].samples if self.cells else 0

    @property
    def width(self) -> int:
        """Number of data sets of a trial: one for each cell."""
        return max(1, len(self.cells))

    @cached_property
    def levels(self) -> tuple[tuple[int, ...], ...]:
        """Places of the cells of each level, at which the draws are placed and fitted once."""
        places: dict[Cell, list[int]] = {}
        for place, cell in enumerate(self.cells):
            places.setdefault(cell.level, []).append(place)
        return tuple(map(tuple, places.values())) or ((0,),)

    @cached_property
    def digest(self) -> bytes:
        """Digest of all that determines the draws and the cells, without the study's seed."""
        values = [(c.samples, c.noise, c.angle, c.radius, c.center, *c.further) for c in self.cells]
        return _digest((self.stream, self.size, values))

    def trials_per_unit(self, levels: int) -> int:
        """Number of trials of a unit, if each is fitted at so many levels.

        They are whole blocks: enough for a worker to be busy, and so few that the unit's rows fit in memory.
        """
        enough = -(-_SAMPLES_PER_UNIT // (self.size * self.samples * levels))
        return self.size * min(enough, max(1, _FITS_PER_UNIT // (self.size * self.width)))

    def places(self, first: int, last: int) -> Iterator[tuple[Cell, int, int]]:
        """The cells of the trials from first to before last, each with its first trial and the one after its last."""
        return ((cell, first, last) for cell in self.cells)

    def sizes(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """Numbers of samples of the trials from first to before last, each with the number of such trials."""
        yield self.samples, last - first

    def only(self, cells: Collection[Cell]) -> Self:
        """The same group with some of its cells."""
        return replace(self, cells=tuple(cell for cell in self.cells if cell in cells))

    def shared(self, other: "Group") -> tuple[Self | None, Self | None]:
        """Split off the cells that another group of the same stream has too: those and the rest, None if empty.

        A random design is shared whole: a trial draws the same cell wherever the laws are the same.
        """
        known = frozenset(other.cells)
        common, rest = self.only(known), self.only(frozenset(self.cells) - known)
        if not rest.cells:
            return self, None
        return (common, rest) if common.cells else (None, self)


def _digest(content: object) -> bytes:
    return hashlib.blake2b(repr(content).encode(), digest_size=16).digest()


@dataclass(frozen=True)
class Batch:
    """Trials of cells that share draws: the work of a unit, or a part of it that is drawn at once.

    Attributes:
        group: the cells.
        first: number of the first trial.
        last: one more than that of the last.
    """

    group: Group
    first: int
    last: int

    @property
    def cells(self) -> tuple[Cell, ...]:
        """The cells; none in a random design, where each trial has its own (see `parts`)."""
        return self.group.cells

    @property
    def trials(self) -> int:
        """Number of trials."""
        return self.last - self.first

    @property
    def rows(self) -> int:
        """Number of data sets: trials times cells."""
        return self.trials * self.group.width

    @property
    def words(self) -> str:
        """The trials for a message: ``trials 0 to 99 of 4 cells with N = 20``."""
        trials, count = f"trials {self.first:,} to {self.last - 1:,}", len(self.cells)
        cells = "1 cell" if count == 1 else f"{count:,} cells"
        return f"{trials} of {cells} with N = {self.group.samples:,}" if count else trials

    def blocks(self) -> list[tuple[Name, int, int]]:
        """The streams of its trials: name, number of trials that are drawn and left out, and number of those used."""
        size, result = self.group.size, []
        for block in range(self.first // size, -(-self.last // size)):
            start = max(self.first, block * size)
            trials = min(self.last, (block + 1) * size) - start
            result.append(((*self.group.stream, block), start - block * size, trials))
        return result

    def parts(self, samples: int) -> Iterator["Batch"]:
        """Cut into whole blocks of at most so many samples, or one block; in a random design, into single trials."""
        if isinstance(self.group, RandomGroup):
            for i in range(self.first, self.last):
                yield Batch(Group(self.group.stream, 1, (self.group.cell(i),)), i, i + 1)
            return
        size, first = self.group.size, self.first
        end = min(self.last, (first // size + 1) * size)
        while first < self.last:
            further = min(self.last, end + size)
            if end < self.last and (further - first) * self.group.samples <= samples:
                end = further
            else:
                yield Batch(self.group, first, end)
                first, end = end, further


class _Design(Frozen):
    """Conditions of a study, and the number of trials."""

    kind: str
    trials: Annotated[int, Field(ge=1, le=MAX_CELLS)]
    """Number of data sets: in each cell of a grid, or in all cells of a random design together."""
    one_trial_a_cell: ClassVar[bool]
    """Every trial is a cell of its own, so that measures of performance combine many cells."""

    def given(self) -> dict[str, Any]:
        """The axes, or the laws, by the condition's name; silent conditions only if they are not at their default."""
        result = {}
        for name, condition in CONDITIONS.items():
            entry = getattr(self, name, None)
            if entry is not None and not (condition.silent and entry == type(self).model_fields[name].default):
                result[name] = entry
        return result

    def possible(self, name: str) -> tuple[Value, ...]:
        """The values listed of a condition, or those that its law can draw, or the ends of its range."""
        entry: tuple[Value, ...] | Distribution = self.given()[name]
        return entry.possible() if isinstance(entry, Distribution) else entry

    def _unwritten(self) -> set[str]:
        """Names of the entries that have no effect."""
        return {condition.name for condition in SILENT} - set(self.given())

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out entries without effect, so that a config keeps its digest when new entries are invented."""
        left_out = self._unwritten()
        return {key: value for key, value in handler(self).items() if key not in left_out}


class Grid(_Design):
    """A grid, of which `GridDesign` adds the axes."""

    kind: Literal["grid"]
    """Every combination of the values is a cell."""
    draws: Literal["shared", "independent"] = "shared"
    """Cells of equal samples and angle share their draws, so that differences are precise; or each cell has its own."""
    most_samples: Annotated[int, Field(ge=1)] | None = None
    """Limit of trials times samples: cells of many samples have fewer trials."""
    most_noise: Annotated[float, Field(gt=0.0)] | None = None
    """Largest noise σ, as a share of the radius: cells of larger noise are left out."""
    one_trial_a_cell = False

    def cells(self) -> int:
        """Number of combinations, also of those that `most_noise` leaves out."""
        return math.prod(len(values) for values in self.given().values())

    def trials_of(self, samples: int) -> int:
        """Number of trials of each cell of so many samples."""
        return self.trials if self.most_samples is None else max(1, min(self.trials, self.most_samples // samples))

    def values(self, condition: Condition) -> tuple[Value, ...]:
        """The values that a condition takes: also those of σ if σ/r is listed, and the reverse."""
        given: dict[str, tuple[Value, ...]] = self.given()
        if condition.name in given:
            return given[condition.name]
        if condition.alternative and not condition.silent:
            change = operator.mul if condition.name == "noise" else operator.truediv
            other = given.get(condition.alternative, ())
            return tuple(change(float(v), float(r)) for v, r in product(other, given["radius"]))
        return () if condition.default is None else (condition.default,)

    def independent(self) -> bool:
        """True if every cell has draws of its own."""
        return self.draws == "independent" or self.cells() == 1

    def same_draws(self, other: "Grid | Random") -> bool:
        """True if the other is a grid whose cells share draws in the same way."""
        shared = {"kind", "draws"}
        return self.model_dump(include=shared) == other.model_dump(include=shared)

    def groups(self, seed: int, dimension: int) -> Iterator[Group]:
        """A group for each number of samples, angle and other drawn condition; or one for each cell, if independent."""
        given = self.given()
        apart = [name for name in given if CONDITIONS[name].own_draws]
        together = [name for name in given if name not in apart]
        for drawn in product(*(given[name] for name in apart)):
            common = dict(zip(apart, drawn, strict=True))
            placed = product(*(given[name] for name in together))
            whole = (_cell(common | dict(zip(together, values, strict=True)), dimension) for values in placed)
            most = math.inf if self.most_noise is None else self.most_noise
            if not (cells := tuple(cell for cell in whole if cell.noise <= most * cell.radius)):
                continue
            name: Name = ("draw", cells[0].samples, cells[0].angle, dimension, *chain(*further(common)))
            size = block_trials(cells[0].samples)
            if self.draws == "shared":
                yield Group(name, size, cells)
            else:
                yield from (Group((*name, cell.name), size, (cell,)) for cell in cells)

    def _unwritten(self) -> set[str]:
        return super()._unwritten() | {name for name in ("most_samples", "most_noise") if getattr(self, name) is None}


_AXES: Any = {name: axis(condition) for name, condition in CONDITIONS.items() if condition.axis}
Axes: Any = create_model("Axes", __base__=_Design, __module__=__name__, **_AXES)
GridDesign: type[Grid] = create_model("GridDesign", __base__=(Grid, Axes), __module__=__name__)
"""A grid with all of its entries: kind and trials, then the axes, then the others. The digest needs this order."""


def diagonal_center(distance: float, dimension: int) -> tuple[float, ...]:
    """Centre of a grid's cells: on the main diagonal, at a distance from the origin."""
    return (distance / math.sqrt(dimension),) * dimension


def _cell(values: Mapping[str, Value], dimension: int) -> Cell:
    """Make the cell of a combination of values; it is fitted in a unit of about its radius."""
    scale = float(f"1e{math.floor(math.log10(float(values['radius'])))}")
    return Cell.of(values, diagonal_center(float(values["center"]), dimension), scale)


_BLOCK = 1024
"""Number of trials whose values are drawn from one stream."""
_TRIALS_PER_UNIT = 25


class Random(_Design):
    """A random design, of which `RandomDesign` adds the laws."""

    kind: Literal["random"]
    """Every trial draws its own conditions from the laws."""
    one_trial_a_cell = True

    def cells(self) -> int:
        """Number of trials."""
        return self.trials

    def trials_of(self, samples: int) -> int:
        """Number of trials of the whole design, whatever number of samples they draw."""
        return self.trials

    def values(self, condition: Condition) -> tuple[Value, ...] | None:
        """The values that a condition takes; None where a law leaves them open."""
        law: Distribution | str | None = self.given().get(condition.name)
        if isinstance(law, str):
            return (law,)
        if law is not None:
            return None if law.continuous else law.possible()
        return None if condition.default is None else (condition.default,)

    def independent(self) -> bool:
        """True: every trial has draws of its own."""
        return True

    def same_draws(self, other: "Grid | Random") -> bool:
        """True if the other is a random design of the same laws."""
        return self.model_dump(exclude={"trials"}) == other.model_dump(exclude={"trials"})

    def groups(self, seed: int, dimension: int) -> Iterator[Group]:
        """One group of all trials."""
        yield RandomGroup(("trial",), 1, (), seed, dimension, self)


_LAWS: Any = {name: law(condition) for name, condition in CONDITIONS.items() if condition.law}
Laws: Any = create_model("Laws", __base__=_Design, __module__=__name__, **_LAWS)
RandomDesign: type[Random] = create_model("RandomDesign", __base__=(Random, Laws), __module__=__name__)
"""A random design with all of its entries: kind and trials, then the laws."""


@dataclass(frozen=True)
class RandomGroup(Group):
    """The trials of a random design, each of which is a cell of its own.

    Attributes:
        seed: the study's.
        dimension: the study's.
        design: the laws; the number of trials has no effect.
    """

    seed: int
    dimension: int
    design: Random

    @cached_property
    def digest(self) -> bytes:
        """Digest of the laws, without the study's seed."""
        return _digest((_BLOCK, self.design.model_dump_json(exclude={"trials"})))

    @cached_property
    def _given(self) -> tuple[str, ...]:
        """Names of the conditions that have a law."""
        return tuple(self.design.given())

    def trials_per_unit(self, levels: int) -> int:
        """A few: their numbers of samples are not known before they are drawn."""
        return _TRIALS_PER_UNIT

    def places(self, first: int, last: int) -> Iterator[tuple[Cell, int, int]]:
        """The cell of each trial, with that trial alone."""
        return ((self.cell(i), i, i + 1) for i in range(first, last))

    def sizes(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """Number of samples of each of the trials from first to before last."""
        return ((int(self._drawn(CONDITIONS["samples"], i)), 1) for i in range(first, last))

    def cell(self, trial: int) -> Cell:
        """Draw the cell of a trial. Every condition is drawn from a stream of its own."""
        values: dict[str, Value] = {name: self._drawn(CONDITIONS[name], trial) for name in self._given}
        heading = stream(self.seed, "design", "heading", trial).standard_normal(self.dimension)
        center = float(values["center"]) * heading / np.linalg.norm(heading)
        return Cell.of(values, tuple(rounded(v) for v in center))

    def _drawn(self, condition: Condition, trial: int) -> Value:
        """Draw the value of a condition for a trial; rounded, if it is a whole number. A word is not drawn."""
        law: Distribution | str = getattr(self.design, condition.name)
        if isinstance(law, str):
            return law
        block, index = divmod(trial, _BLOCK)
        number = law.at(_uniforms(self.seed, condition.name, block)[index])
        number = rounded(number) if law.continuous else number
        return round(number) if condition.kind is int else number


@lru_cache(maxsize=64)
def _uniforms(seed: int, name: str, block: int) -> tuple[float, ...]:
    """Draw uniform numbers of a condition for a block of trials."""
    return tuple(stream(seed, "design", name, block).random(_BLOCK).tolist())

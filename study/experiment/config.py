"""A study's config: TOML in, a frozen `Study` out, or one message with every fault."""

import difflib
import hashlib
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, ValidationError

from study.estimators import ESTIMATORS
from study.experiment.faults import ConfigError, Fault, report, shorten
from study.experiment.laws import Choice, Constant, Frozen, Law, LogUniform, Uniform, is_number

MAX_CELLS = 10_000_000

_ALLOWED: dict[str, tuple[Callable[[float], bool], str]] = {
    "samples": (lambda v: v >= 3 and v == int(v), "a whole number, at least dimension + 1"),
    "noise": (lambda v: v > 0, "above 0, in the unit of the radius"),
    "angle": (lambda v: 0 < v <= 180, "above 0 and at most 180 degrees"),
    "radius": (lambda v: v > 0, "above 0"),
    "center": (lambda v: v >= 0, "at least 0: the distance of the centre from the origin"),
}


def _axis(quantity: str) -> BeforeValidator:
    """Expand a grid axis - a number, a list, ``linspace`` or ``logspace`` - and check every value."""
    allowed, words = _ALLOWED[quantity]

    def expand(value: Any) -> object:
        numbers: list[Any]
        if isinstance(value, dict):
            numbers = _spaced(value)
            if quantity == "samples":
                numbers = [float(round(v)) if math.isfinite(v) else v for v in numbers]
        elif isinstance(value, list | tuple):
            numbers = list(value)
        else:
            numbers = [value]
        if not numbers:
            raise ValueError(f"the list is empty; give at least one value, each {words}")
        wrong = [v for v in numbers if not is_number(v) or not allowed(v)]
        if wrong:
            listed = ", ".join(shorten(v) for v in wrong[:5]) + (", …" if len(wrong) > 5 else "")
            raise ValueError(f"{listed} not allowed: every value must be {words}")
        if quantity == "samples":
            return tuple(dict.fromkeys(int(v) for v in numbers))
        return tuple(dict.fromkeys(float(v) + 0.0 for v in numbers))  # -0.0 is 0.0

    return BeforeValidator(expand)


def _spaced(value: dict[str, Any]) -> list[float]:
    """Values of ``{ linspace = [first, last, count] }`` or ``{ logspace = [first, last, count] }``, ends included."""
    words = "write { linspace = [first, last, count] } or { logspace = [first, last, count] }"
    if len(value) != 1 or next(iter(value)) not in ("linspace", "logspace"):
        raise ValueError(f"keys {', '.join(value) or 'none'} not understood: {words}")
    ((kind, ends),) = value.items()
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


def _law(quantity: str) -> AfterValidator:
    """Check that a law stays within the values allowed for a quantity; an open lower end may touch the limit."""
    allowed, words = _ALLOWED[quantity]

    def check(law: Constant | Choice | Uniform | LogUniform) -> Constant | Choice | Uniform | LogUniform:
        values = law.possible()
        if isinstance(law, Uniform | LogUniform):
            if quantity == "samples":
                values = tuple(float(round(v)) for v in values)
            elif law.low == 0.0:
                values = values[1:]  # an open end may touch the limit
        wrong = [f"{v:.12g}" for v in dict.fromkeys(values) if not allowed(v)]
        if wrong:
            raise ValueError(f"{' and '.join(wrong)} not allowed: every value must be {words}")
        return law

    return AfterValidator(check)


class RandomDesign(Frozen):
    """Each trial draws its own conditions from declared laws (the paper's §4.1)."""

    kind: Literal["random"]
    trials: Annotated[int, Field(ge=1, le=MAX_CELLS)]
    samples: Annotated[Law, _law("samples")]
    noise: Annotated[Law, _law("noise")] | None = None
    noise_over_radius: Annotated[Law, _law("noise")] | None = None
    angle: Annotated[Law, _law("angle")]
    radius: Annotated[Law, _law("radius")] = Constant(law="constant", value=1.0)
    center: Annotated[Law, _law("center")] = Constant(law="constant", value=0.0)


class GridDesign(Frozen):
    """Every combination of the listed values is a cell of so many trials."""

    kind: Literal["grid"]
    trials: Annotated[int, Field(ge=1, le=MAX_CELLS)]
    samples: Annotated[tuple[int, ...], _axis("samples")]
    noise: Annotated[tuple[float, ...], _axis("noise")] | None = None
    noise_over_radius: Annotated[tuple[float, ...], _axis("noise")] | None = None
    angle: Annotated[tuple[float, ...], _axis("angle")]
    radius: Annotated[tuple[float, ...], _axis("radius")] = (1.0,)
    center: Annotated[tuple[float, ...], _axis("center")] = (0.0,)
    draws: Literal["shared", "independent"] = "shared"


def _tuples(value: object) -> object:
    """Lists as TOML has them, to tuples, which a frozen config holds."""
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _known_estimators(names: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in ESTIMATORS]
    if unknown:
        near = [difflib.get_close_matches(name, ESTIMATORS, n=1) for name in unknown]
        hint = "".join(f"; did you mean {n[0]!r}?" for n in near if n)
        raise ValueError(f"{', '.join(map(repr, unknown))} unknown: known are {', '.join(ESTIMATORS)}{hint}")
    if len(set(names)) < len(names):
        raise ValueError("an estimator is named twice")
    return names


class Study(Frozen):
    """A whole study, as its config says it."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,60}$")]
    seed: Annotated[int, Field(ge=0)]
    dimension: Annotated[int, Field(ge=2, le=50)] = 3
    estimators: Annotated[
        tuple[str, ...], BeforeValidator(_tuples), Field(min_length=1), AfterValidator(_known_estimators)
    ]
    noise_shape: Annotated[tuple[tuple[float, ...], ...], BeforeValidator(_tuples)] | None = None
    """Covariance of a sample in units of σ² (d, d); the identity if absent."""
    keep_points: Annotated[int, Field(ge=0)] = 0
    """The trials whose points are stored: those with a number below this one, in each cell."""
    design: Annotated[RandomDesign | GridDesign, Field(discriminator="kind")]

    def cells(self) -> int:
        """Number of conditions: in a random design, one per trial."""
        design = self.design
        if isinstance(design, RandomDesign):
            return design.trials
        noises = design.noise or design.noise_over_radius or ()
        return math.prod(len(axis) for axis in (design.samples, noises, design.angle, design.radius, design.center))

    def digest(self) -> str:
        """Ten hexadecimal digits that stand for the canonical config."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:10]

    def run_name(self) -> str:
        """Name of the run's folder."""
        return f"{self.name}-{self.digest()}"


def parse(text: str, source: str = "config") -> Study:
    """Read a config.

    Args:
        text: the TOML document.
        source: what to call it in messages.

    Raises:
        ConfigError: with every fault, its place, the value and what is allowed.
    """
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits, or brackets in thousands
        raise ConfigError(f"{source}: not TOML: {error}") from None
    faults = _across(raw)
    study = None
    try:
        study = Study.model_validate(raw)
    except ValidationError as error:
        faults = report(error, _KEYS) + faults
    if study is not None and study.cells() > MAX_CELLS:
        faults.append(Fault(("design",), f"{study.cells():,} cells; at most {MAX_CELLS:,} are allowed"))
    if faults or study is None:
        raise ConfigError.listing(source, text, faults)
    return study


def load(path: Path) -> Study:
    """Read a config file; see `parse`."""
    return read(path)[0]


def read(path: Path) -> tuple[Study, str]:
    """Read a config file and return its text as well; see `parse`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from None
    return parse(text, str(path)), text


def _across(raw: dict[str, Any]) -> list[Fault]:
    """Faults that lie between keys. Keys of the wrong type are left to the schema."""
    faults: list[Fault] = []
    design, d = raw.get("design"), raw.get("dimension", 3)
    if not isinstance(d, int) or not isinstance(design, dict):
        return faults
    given = [key for key in ("noise", "noise_over_radius") if key in design]
    if len(given) != 1:
        found = " and ".join(given) or "neither"
        faults.append(Fault(("design",), f"give noise or noise_over_radius, one of the two (found {found})"))
    few = _least_samples(design.get("samples"))
    if few is not None and few < d + 1:
        words = f"{few:g} samples are too few: a sphere in dimension {d} needs at least {d + 1}"
        faults.append(Fault(("design", "samples"), words))
    shape = raw.get("noise_shape")
    if shape is not None:
        faults += _shape_faults(shape, d)
    return faults


def _least_samples(samples: object) -> float | None:
    """Smallest sample count that a design's entry can give; None where the schema will complain."""
    if isinstance(samples, dict):
        if "law" in samples:
            values = [samples.get("low"), samples.get("value"), *_as_list(samples.get("values"))]
        else:
            values = [v for ends in samples.values() for v in _as_list(ends)[:2]]
    else:
        values = _as_list(samples)
    numbers = [round(v) for v in values if isinstance(v, int | float) and is_number(v)]
    return min(numbers, default=None)


def _as_list(value: object) -> list[Any]:
    return list(value) if isinstance(value, list) else [value]


def _shape_faults(shape: object, d: int) -> list[Fault]:
    """A noise shape must be a covariance (d, d)."""
    try:
        matrix = np.asarray(shape, dtype=float)
        good = matrix.shape == (d, d) and bool(np.all(np.isfinite(matrix))) and bool(np.all(matrix == matrix.T))
        if good:
            values = np.linalg.eigvalsh(matrix)
            good = bool(values[0] > d * np.finfo(float).eps * values[-1])
    except (ValueError, TypeError, OverflowError):
        good = False
    words = f"must be a symmetric, positive definite {d} × {d} matrix (list of rows)"
    return [] if good else [Fault(("noise_shape",), words, shape)]


_KEYS: dict[tuple[str, ...], list[str]] = {
    (): list(Study.model_fields),
    ("design",): sorted({*RandomDesign.model_fields, *GridDesign.model_fields}),
    **{("design", key): ["law", "value", "values", "low", "high", "linspace", "logspace"] for key in _ALLOWED},
}
assert set(get_args(Study.model_fields["design"].annotation)) == {RandomDesign, GridDesign}

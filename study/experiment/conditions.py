"""Conditions of a study: values allowed, and the two designs: a grid of them, or laws that every trial draws from."""

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer

from study.experiment.config_faults import shorten
from study.experiment.distributions import Choice, Constant, Frozen, Law, LogUniform, Uniform, is_number

MAX_CELLS = 10_000_000

ALLOWED: dict[str, tuple[Callable[[float], bool], str]] = {
    "samples": (lambda v: v >= 3 and v == int(v), "a whole number, at least dimension + 1"),
    "noise": (lambda v: v > 0, "above 0, in the unit of the radius"),
    "angle": (lambda v: 0 < v <= 180, "above 0 and at most 180 degrees"),
    "radius": (lambda v: v > 0, "above 0"),
    "center": (lambda v: v >= 0, "at least 0: the distance of the centre from the origin"),
}


def _axis(quantity: str) -> BeforeValidator:
    """Expand a grid axis - a number, a list, ``linspace`` or ``logspace`` - and check every value."""
    allowed, words = ALLOWED[quantity]

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
    allowed, words = ALLOWED[quantity]

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
    most_samples: Annotated[int, Field(ge=1)] | None = None
    """Cells of many samples have fewer trials: so many that trials times samples do not exceed this."""

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Without the limit where there is none: configs from before it was are what they were."""
        return {k: v for k, v in handler(self).items() if k != "most_samples" or v is not None}

    def trials_of(self, samples: int) -> int:
        """Number of trials of each cell of so many samples."""
        return self.trials if self.most_samples is None else max(1, min(self.trials, self.most_samples // samples))

"""Entries of a config's ``[design]``, made from the table of conditions: axes of a grid, laws of a random design."""

import math
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from study.experiment.conditions import CONDITIONS, Condition, Value, is_number
from study.experiment.config_faults import shorten
from study.experiment.distributions import Constant, Distribution, Law
from study.experiment.toml_model import each_once

MAX_CELLS = 10_000_000

Field = tuple[Any, Any]
"""Type and default of a field, as `pydantic.create_model` takes them."""
_TUPLES: dict[type, Any] = {int: tuple[int, ...], float: tuple[float, ...], str: tuple[str, ...]}


def axes() -> dict[str, Any]:
    """The fields of a grid by the condition's name."""
    return {name: axis(condition) for name, condition in CONDITIONS.items() if condition.axis}


def laws() -> dict[str, Any]:
    """The fields of a random design by the condition's name."""
    return {name: law(condition) for name, condition in CONDITIONS.items() if condition.law}


def axis(condition: Condition) -> Field:
    """The field of a condition in a grid: the tuple of its values."""
    values: Any = Annotated[_TUPLES[condition.kind], BeforeValidator(lambda given: _expanded(condition, given))]
    return _field(condition, values, None if condition.default is None else (condition.default,))


def law(condition: Condition) -> Field:
    """The field of a condition in a random design: the law that it is drawn from."""
    laws: Any = Annotated[Law, AfterValidator(lambda given: _within(condition, given))]
    default = None if condition.default is None else Constant(law="constant", value=float(condition.default))
    return _field(condition, laws, default)


def _field(condition: Condition, given: Any, default: object) -> Field:
    if condition.alternative:
        return given | None, None
    return given, ... if default is None else default


def _expanded(condition: Condition, given: Any) -> tuple[Value, ...]:
    """Expand a grid axis, which is a value, a list, ``linspace`` or ``logspace``, and check every value."""
    values: list[Any]
    if isinstance(given, dict):
        values = _spaced(given)
        if condition.kind is int:
            values = [float(round(v)) if math.isfinite(v) else v for v in values]
    else:
        values = list(given) if isinstance(given, list | tuple) else [given]
    if not values:
        raise ValueError(f"the list is empty; give at least one value, each {condition.rule}")
    wrong = [v for v in values if not condition.holds(v) or not condition.allowed(v)]
    if wrong:
        listed = ", ".join(shorten(v) for v in wrong[:5]) + (", …" if len(wrong) > 5 else "")
        raise ValueError(f"{listed} not allowed: every value must be {condition.rule}")
    if condition.kind is float:
        values = [v + 0.0 for v in values]  # -0.0 is 0.0
    found: tuple[Value, ...] = tuple(map(condition.kind, values))
    # a range of whole numbers may round to equal ones; in a list, a second one is a mistake
    return tuple(dict.fromkeys(found)) if isinstance(given, dict) else each_once(found)


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
        raise ValueError(f"{' and '.join(wrong)} not allowed: every value must be {condition.rule}")
    return given

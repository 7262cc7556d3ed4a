"""The laws that a random design draws its conditions from, each as the inverse of its distribution function."""

import math
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator


class Frozen(BaseModel):
    """A part of a config: immutable, typed strictly, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Constant(Frozen):
    """Always the same value."""

    law: Literal["constant"]
    value: float

    def at(self, u: float) -> float:
        """The value, whatever u is."""
        return self.value

    def possible(self) -> tuple[float, ...]:
        """The values that can be drawn."""
        return (self.value,)


def _nonempty_tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


class Choice(Frozen):
    """One of a list of values, each equally likely."""

    law: Literal["choice"]
    values: Annotated[tuple[float, ...], BeforeValidator(_nonempty_tuple), Field(min_length=1)]

    def at(self, u: float) -> float:
        """The value at quantile u in [0, 1)."""
        return self.values[int(u * len(self.values))]

    def possible(self) -> tuple[float, ...]:
        """The values that can be drawn."""
        return self.values


class _Interval(Frozen):
    low: float
    high: float

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}")
        return self

    def possible(self) -> tuple[float, ...]:
        """The ends of what can be drawn; the lower one itself never is."""
        return self.low, self.high


class Uniform(_Interval):
    """Uniform on (low, high]."""

    law: Literal["uniform"]

    def at(self, u: float) -> float:
        """The value at quantile 1 - u, u in [0, 1)."""
        return self.high - (self.high - self.low) * u


class LogUniform(_Interval):
    """Uniform in the logarithm, on (low, high]."""

    law: Literal["log_uniform"]
    low: Annotated[float, Field(gt=0)]

    def at(self, u: float) -> float:
        """The value at quantile 1 - u, u in [0, 1)."""
        value = float(self.low**u * self.high ** (1.0 - u))
        return min(max(value, self.low), self.high)


LAWS = ("constant", "choice", "uniform", "log_uniform")


def is_number(value: object) -> bool:
    """Whether a config's value is a number that floating point can hold."""
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:
        return False


def _plain_number(value: object) -> object:
    """A number stands for a constant; what is neither a number nor a law is told what a law looks like."""
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

"""The laws that a random design draws its conditions from, each as the inverse of its distribution function."""

from abc import abstractmethod
from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from study.experiment.conditions import is_number
from study.experiment.toml_model import Frozen, Listed


class Distribution(Frozen):
    """A law that a number is drawn from."""

    continuous: ClassVar[bool] = False
    """It has a density on an interval; otherwise it has a few values."""
    name: ClassVar[str]
    """The law in words."""

    @abstractmethod
    def at(self, u: float) -> float:
        """The number drawn, from a uniform one u in [0, 1)."""

    @abstractmethod
    def possible(self) -> tuple[float, ...]:
        """The values that can be drawn; of a continuous law the ends, of which the lower is never drawn."""


class Constant(Distribution):
    """Always the same value."""

    law: Literal["constant"]
    name = "constant"
    value: float

    def at(self, u: float) -> float:
        """The value, whatever u is."""
        return self.value

    def possible(self) -> tuple[float, ...]:
        """The values that can be drawn."""
        return (self.value,)


class Choice(Distribution):
    """One of a list of values, each equally likely."""

    law: Literal["choice"]
    name = "choice"
    values: Annotated[Listed[float], Field(min_length=1)]

    def at(self, u: float) -> float:
        """The value at quantile u in [0, 1)."""
        return self.values[int(u * len(self.values))]

    def possible(self) -> tuple[float, ...]:
        """The values that can be drawn."""
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

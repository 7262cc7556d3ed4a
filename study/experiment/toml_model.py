"""Models of TOML documents: a frozen section, and its lists, which become tuples."""

from collections import Counter
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

T = TypeVar("T")


class Frozen(BaseModel):
    """A section of a document: immutable, typed strictly, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def as_tuple(value: object) -> object:
    """A tuple, which a frozen model holds, of a list, which TOML has; anything else as it is."""
    return tuple(value) if isinstance(value, list) else value


def each_once(values: tuple[T, ...]) -> tuple[T, ...]:
    """The values, of which none may be there twice: a second one would be lost, or count twice."""
    twice = [repr(v) if isinstance(v, str) else f"{v:.12g}" for v, count in Counter(values).items() if count > 1]
    if twice:
        raise ValueError(f"{', '.join(twice)} given more than once; give each value once")
    return values


Listed = Annotated[tuple[T, ...], BeforeValidator(as_tuple)]
"""A list of any length."""
Distinct = Annotated[Listed[T], Field(min_length=1), AfterValidator(each_once)]
"""A list of at least one value, each of them there once."""

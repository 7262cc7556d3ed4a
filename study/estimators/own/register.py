"""Registration of one's own estimators, and the record of where they come from."""

import contextlib
import hashlib
import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from study.estimators.estimator import Estimator
from study.estimators.own.simple_form import SimpleForm
from study.estimators.registry import ESTIMATORS

IN_PROGRAM = "this program"


class Origin(NamedTuple):
    """The source of an estimator that is not shipped.

    Attributes:
        name: of a file, or of a package with its version; or `IN_PROGRAM`.
        digest: SHA-256 of the file's or the function's text, or empty if that is not known.
        everywhere: worker processes can have it: it is from a file or from an installed package.
    """

    name: str
    digest: str
    everywhere: bool = True


ORIGINS: dict[str, Origin] = {}
"""Origins of the registered estimators that are not shipped, by their names."""

_source: list[Origin] = []


def register(
    name: str, function: Callable[..., Any], *, needs: str = "", reference: str = "", batched: bool = False
) -> None:
    """Register an estimator of one's own; from then on `study.fit`, configs and figures know its name.

    Args:
        name: lower-case letters, digits and underscores, a letter first.
        function: takes the points (n, d) of one set, and returns a centre (d,) and a radius. It may raise on data: the
            fit is then counted as failed. With ``batched``, it takes `study.Samples` and returns a `study.Estimates`.
        needs: ``"noise"`` if the function cannot do without the standard deviation of a coordinate, which is then its
            second argument (with ``batched``: ``samples.noise``).
        reference: where the method is described.
        batched: the function fits a batch of sets at once, which is faster.

    Raises:
        TypeError: if the function cannot be called.
        ValueError: if the name cannot be used or is taken, or ``needs`` is not understood.

    Example:
        >>> study.register("centroid", lambda points: (points.mean(axis=0), 1.0))
    """
    if not callable(function):
        raise TypeError(f"register({name!r}): {type(function).__name__} is not a function")
    if needs not in ("", "noise"):
        raise ValueError(f"register({name!r}): needs = {needs!r}: must be 'noise' or left out")
    origin = _source[-1] if _source else _in_program(function)
    call = function if batched else SimpleForm(function, needs)
    add(name, Estimator(call, reference, needs), origin)


def add(name: str, entry: Estimator, origin: Origin) -> None:
    """Enter an estimator into the registry; ValueError if its name cannot be used or is taken."""
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,40}", name) or name == "all":
        raise ValueError(f"register({name!r}): a name has lower-case letters, digits and underscores, a letter first")
    before = ORIGINS.get(name)
    if name in ESTIMATORS and (before is None or before.name != origin.name or before.everywhere):
        taken = f"by {before.name}" if before is not None else "by a shipped estimator"
        raise ValueError(f"register({name!r}): the name is taken {taken}; choose another")
    ESTIMATORS[name] = replace(entry, version=origin.digest[:10] or entry.version)
    ORIGINS[name] = origin


def remove(names: Iterable[str]) -> None:
    """Take estimators that are not shipped out of the registry."""
    for name in names:
        if ORIGINS.pop(name, None) is not None:
            del ESTIMATORS[name]


@contextlib.contextmanager
def registering(origin: Origin) -> Iterator[Callable[[], tuple[str, ...]]]:
    """Note what is registered meanwhile as from an origin; after an exception it is taken out again.

    Yields:
        A function that gives the names registered so far.
    """
    before = set(ORIGINS)

    def found() -> tuple[str, ...]:
        return tuple(name for name in ORIGINS if name not in before)

    _source.append(origin)
    try:
        yield found
    except BaseException:
        remove(found())
        raise
    finally:
        _source.pop()


def origins(estimators: Iterable[str]) -> list[dict[str, object]]:
    """The origins of those among some estimators that are not shipped, as a manifest has them."""
    found: dict[Origin, list[str]] = {}
    for name in estimators:
        if name in ORIGINS:
            found.setdefault(ORIGINS[name], []).append(name)
    return [{"from": o.name, "sha256": o.digest, "estimators": names} for o, names in found.items()]


def only_here(estimators: Iterable[str]) -> list[str]:
    """Those among some estimators that worker processes cannot have."""
    return [name for name in estimators if name in ORIGINS and not ORIGINS[name].everywhere]


def _in_program(function: Callable[..., Any]) -> Origin:
    """The origin of a function that a program registers itself."""
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError):  # typed at a prompt, or compiled
        text = ""
    digest = hashlib.sha256(text.encode()).hexdigest() if text else ""
    return Origin(IN_PROGRAM, digest, everywhere=False)

"""Reasons why figures were not drawn: the place of a failure in this package, and what runs lack."""

import traceback
from collections.abc import Mapping
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
FAILED = "failed: "
"""Beginning of the reason why a figure that failed was not drawn; other reasons say that a run cannot feed it."""


def failure(error: Exception) -> str:
    """A figure's failure in one line.

    Args:
        error: the exception, in the function that caught it.

    Returns:
        "failed: KeyError('noise') at study/figures/fig_map.py, line 31, in prepare": the innermost line of this
        package, whatever library it called; the innermost line of all, if the figure is not of this package.
    """
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first caught it
    own = [frame for frame in frames if PACKAGE in Path(frame.filename).parents]
    words = FAILED + " ".join(repr(error).split())
    if not frames:
        return words
    place = (own or frames)[-1]
    path = Path(place.filename)
    name = path.relative_to(PACKAGE.parent).as_posix() if own else path.name
    return f"{words} at {name}, line {place.lineno}, in {place.name}"


def gathered(reasons: Mapping[str, str], runs: int) -> str:
    """Reasons by the runs' names in words, each once, with its runs unless it holds for all of so many."""
    found: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        found.setdefault(reason, []).append(name)
    each = (reason if len(names) == runs else f"{reason} ({', '.join(names)})" for reason, names in found.items())
    return "; ".join(each)

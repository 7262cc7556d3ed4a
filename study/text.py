"""Text for people and for other programs: aligned tables, JSON, near names, numbers, cells safe for a spreadsheet."""

import difflib
import inspect
import json
import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from rich.cells import cell_len

if TYPE_CHECKING:
    import pandas as pd


_GAP = "  "


def columns(
    rows: Iterable[Sequence[str]],
    header: Sequence[str] = (),
    align: str = "<",
    indent: int = 0,
    width: int | None = None,
) -> Iterator[str]:
    """Lay out rows as aligned columns, two spaces apart.

    The lines depend on the arguments alone, never on the terminal.

    Args:
        rows: texts, one per column; a row may leave out its last ones.
        header: titles of the columns; no header line if empty.
        align: a mark per column, ``<`` for left and ``>`` for right; the last mark serves all further columns.
        indent: spaces before each line.
        width: longest line: the last column is wrapped between words to keep within it, the others never are.
            Nothing is wrapped if it is None.

    Yields:
        Lines without trailing spaces.
    """
    lines = [list(line) for line in ([header] if header else [])] + [list(row) for row in rows]
    count = max(map(len, lines), default=0)
    if count == 0:
        return
    filled = [line + [""] * (count - len(line)) for line in lines]
    widths = [max(map(cell_len, texts)) for texts in zip(*filled, strict=True)]
    start = indent + sum(widths[:-1]) + len(_GAP) * (count - 1)
    if width is not None:
        widths[-1] = max(min(widths[-1], width - start), 1)
    for *line, last in filled:
        wrapped = [last] if width is None else textwrap.wrap(last, widths[-1], break_long_words=False) or [""]
        for piece in wrapped:
            cells = []
            for text, size, mark in zip([*line, piece], widths, align.ljust(count, align[-1]), strict=False):
                spaces = " " * (size - cell_len(text))  # in cells of a terminal: a combining accent takes none
                cells.append(spaces + text if mark == ">" else text + spaces)
            yield (" " * indent + _GAP.join(cells)).rstrip()
            line = [""] * (count - 1)


def json_text(data: Mapping[str, object] | Sequence[object], indent: int | None = 2) -> str:
    """A mapping as a JSON object, in the order of its keys; or a list.

    Args:
        data: what JSON has, mappings, lists, tuples, texts, numbers and None; also arrays of NumPy, and paths.
        indent: spaces of each level; None for one line.

    Returns:
        The text, its letters as they are. NaN and infinities, which JSON does not have, are
        null.

    Raises:
        TypeError: if there is anything else in it.
    """
    return json.dumps(_plain(data), indent=indent, ensure_ascii=False, allow_nan=False)


def _plain(value: object) -> object:
    if hasattr(value, "tolist"):  # an array or a number of NumPy
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value


def paragraphs(thing: object) -> list[str]:
    """The paragraphs of a docstring, each in one line."""
    return [one_line(part) for part in re.split(r"\n\s*\n", inspect.getdoc(thing) or "")]


def one_line(text: str) -> str:
    """A text that stands in several lines of a program, in one."""
    return re.sub(r"[ \n]+", " ", text.strip(" \n"))


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name most like an unknown one, or the only one that begins with it; None if there is neither.

    Capitals count as small letters.
    """
    small = {word.casefold(): word for word in known}
    name = name.casefold()
    longer = [word for word in small if name and word.startswith(name)]
    close = difflib.get_close_matches(name, list(small), n=1) or (longer if len(longer) == 1 else [])
    return small[close[0]] if close else None


def listed(names: Iterable[str]) -> str:
    """Names with commas between them: forty at most, each of forty characters at most, and the number of the others."""
    names = [name if len(name) <= 40 else f"{name[:37]}..." for name in names]
    return ", ".join(names[:40] + [f"and {len(names) - 40:,} more"] * (len(names) > 40))


def did_you_mean(names: str | Iterable[str], known: Iterable[str]) -> str:
    """The remedy for an unknown name, as the end of a message.

    Args:
        names: the unknown name, or several.
        known: the names that are known, in the order in which to list them.

    Returns:
        "did you mean 'kasa'? Known are kasa, lls"; without a name that is much like it, "known are kasa, lls".
    """
    known = list(known)
    result = [nearest(name, known) for name in ([names] if isinstance(names, str) else [*islice(names, 5)])]
    close = list(dict.fromkeys(name for name in result if name is not None))
    words = f"nown are {listed(known)}"
    return f"did you mean {' and '.join(map(repr, close))}? K{words}" if close else f"k{words}"


_BYTES = {"EB": 1e18, "PB": 1e15, "TB": 1e12, "GB": 1e9, "MB": 1e6}
DAY = 86_400.0
YEAR = 365.25 * DAY
_TIMES = {"years": YEAR, "days": DAY, "h": 3600.0, "min": 60.0, "s": 1.0}


def number(value: float, form: str = ".3g") -> str:
    """A number in a format of Python's; "-" for NaN."""
    return "-" if math.isnan(value) else f"{value:{form}}"


def with_error(value: float, error: float) -> str:
    """A value to the second digit of its error: 12.345 ± 0.067; alone if it has none, as a radius that is known."""
    if not math.isfinite(value):
        return "-"
    if error == 0.0:
        return f"{value:.6g}"
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g} ± ?"
    digits = 1 - int(f"{error:.1e}".partition("e")[2])  # of the rounded error: 0.0996 is 0.10
    if not -6 <= digits <= 12:
        return f"{value:.6g} ± {error:.2g}"
    return " ± ".join(f"{round(x, digits) + 0.0:.{max(digits, 0)}f}" for x in (value, error))


def size(count: float) -> str:
    """A number of bytes in the largest unit of which there are at least two, from MB: 3.6 TB."""
    return _in_units(count, _BYTES, "MB")


def duration(seconds: float) -> str:
    """A time in the largest unit of which there are at least two, from s: 3.6 years."""
    return _in_units(seconds, _TIMES, "s")


def _in_units(value: float, units: dict[str, float], least: str) -> str:
    unit = next((name for name, factor in units.items() if value >= 2.0 * factor), least)
    return f"{value / units[unit]:,.1f} {unit}"


_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def inert_frame(frame: "pd.DataFrame") -> "pd.DataFrame":
    """A data frame whose titles and texts are `inert`, to be written as CSV."""
    frame = frame.rename(columns=inert)
    words = [place for place, kind in enumerate(frame.dtypes) if kind.kind == "O"]
    return frame.assign(**{str(frame.columns[i]): frame.iloc[:, i].map(inert) for i in words}) if words else frame


def inert(cell: object) -> object:
    """A cell that no spreadsheet computes: a text that begins like a formula gets an apostrophe in front.

    Numbers stay, and so does a text of one character.

    Source: OWASP, "CSV Injection".
    """
    return f"'{cell}" if isinstance(cell, str) and len(cell) > 1 and cell.startswith(_FORMULA) else cell

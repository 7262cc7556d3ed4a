"""Tables for a terminal: rows as aligned columns of plain text."""

import textwrap
from collections.abc import Iterable, Iterator, Sequence

from rich.cells import cell_len

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
            texts = zip([*line, piece], widths, align.ljust(count, align[-1]), strict=False)
            yield (" " * indent + _GAP.join(_padded(*text) for text in texts)).rstrip()
            line = [""] * (count - 1)


def _padded(text: str, width: int, mark: str) -> str:
    """A text with spaces up to a width, counted in cells of a terminal: a combining accent takes none."""
    spaces = " " * (width - cell_len(text))
    return spaces + text if mark == ">" else text + spaces

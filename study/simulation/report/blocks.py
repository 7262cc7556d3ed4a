"""Blocks of a page: plain data that the template turns into HTML, kind by kind."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

PRINTED = 30
"""Rows of the longest table that is printed."""


@dataclass(frozen=True)
class Block:
    """A piece of a page; ``kind`` names its look in the template."""

    kind: ClassVar[str]


Content = str | Block | Sequence["str | Block"]
"""Text, which is escaped, or a block, or several of either."""


@dataclass(frozen=True)
class Text(Block):
    """Paragraph of text."""

    kind: ClassVar[str] = "text"
    content: Content


@dataclass(frozen=True)
class Note(Block):
    """Smaller text below other text."""

    kind: ClassVar[str] = "note"
    content: Content


@dataclass(frozen=True)
class Heading(Block):
    """A heading within a section; ``id`` is unique on the page."""

    kind: ClassVar[str] = "heading"
    title: str
    id: str


@dataclass(frozen=True)
class Link(Block):
    """A link to a place on the page."""

    kind: ClassVar[str] = "link"
    words: str
    target: str


@dataclass(frozen=True)
class Badge(Block):
    """A verdict in words, on a colour that only repeats them; ``look`` is a class of the style sheet."""

    kind: ClassVar[str] = "badge"
    words: str
    look: str


@dataclass(frozen=True)
class InlineCode(Block):
    """A name or a command within text."""

    kind: ClassVar[str] = "code"
    text: str


@dataclass(frozen=True)
class Verbatim(Block):
    """Preformatted lines."""

    kind: ClassVar[str] = "verbatim"
    text: str
    label: str


@dataclass(frozen=True)
class Items(Block):
    """Bulleted list."""

    kind: ClassVar[str] = "items"
    items: Sequence[Content]


@dataclass(frozen=True)
class Facts(Block):
    """List of terms with a description of each."""

    kind: ClassVar[str] = "facts"
    pairs: Sequence[tuple[str, Content]]


@dataclass(frozen=True)
class Folded(Block):
    """Block that a reader can open; in print it is open if ``printed``, else left out.

    With an ``id``, unique on the page, its summary is a heading within the section.
    """

    kind: ClassVar[str] = "folded"
    summary: Content
    content: Content
    printed: bool = True
    id: str = ""


@dataclass(frozen=True)
class Row:
    """A row of a table; its first cell is its header."""

    cells: Sequence[Content]
    id: str = ""


@dataclass(frozen=True)
class Table(Block):
    """A table, which scrolls within its own box where it is too wide.

    Attributes:
        label: what it is, in a few words, unlike any other on the page: for those who hear the page.
        caption: what it shows, above the box, so that it does not scroll with it.
        head: titles of the columns.
        rows: as many cells each as there are titles.
        numeric: numbers of the columns that hold numbers, from 0.
        stacked: whether a narrow screen shows each row as a card, each cell beside its title.
        prose: whether a narrow screen and paper show each row as a card, from the third cell on over the whole width;
            for cells of sentences.
    """

    kind: ClassVar[str] = "table"
    label: str
    caption: Content
    head: Sequence[str]
    rows: Sequence[Row]
    numeric: frozenset[int] = frozenset()
    stacked: bool = False
    prose: bool = False

    @property
    def long(self) -> bool:
        """True if it has too many rows for paper."""
        return len(self.rows) > PRINTED and not (self.stacked or self.prose)

    def __post_init__(self) -> None:
        """Refuse rows that do not fit the head, which would shift columns silently."""
        if any(len(row.cells) != len(self.head) for row in self.rows):
            raise ValueError(f"{self.label}: a row has not {len(self.head)} cells")


@dataclass(frozen=True)
class Picture(Block):
    """A picture within the page.

    Attributes:
        id: its place, to link to.
        source: the picture itself, as a data URI.
        alt: what it shows, for those who do not see it.
        width, height: in pixels.
        caption: below it.
    """

    kind: ClassVar[str] = "picture"
    id: str
    source: str = field(repr=False)
    alt: str
    width: int
    height: int
    caption: Content

    @property
    def wide(self) -> bool:
        """True if its letters would be too small on a phone, where it then scrolls in a box of its own."""
        return self.width > 1000

    @property
    def tall(self) -> bool:
        """True if it is nearly as high as wide, or higher, and so needs more of a sheet of paper."""
        return self.height > 0.9 * self.width


@dataclass(frozen=True)
class Section:
    """A part of the page, with an entry in its table of contents if ``listed``, and on paper if ``printed``."""

    title: str
    id: str
    content: Sequence[Block]
    listed: bool = True
    printed: bool = True


def coded(text: str) -> list[str | Block]:
    """Text with the parts between backticks as code."""
    return [InlineCode(part) if i % 2 else part for i, part in enumerate(text.split("`"))]

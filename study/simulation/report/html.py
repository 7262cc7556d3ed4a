"""Pieces of a page as HTML: functions from text to `Markup`, which escape all that is not markup already."""

import base64
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

PRINTED = 30
"""Rows of the longest table that is printed."""

Content = str | Sequence["Content"]
"""Text, which is escaped, or markup, which is a text that is not; or several of either, one after the other."""


@dataclass(frozen=True)
class Section:
    """A part of the page, with an entry in its table of contents if ``listed``, and on paper if ``printed``."""

    title: str
    id: str
    content: Sequence[Markup]
    listed: bool = True
    printed: bool = True


def joined(content: Content) -> Markup:
    """Content as markup."""
    return escape(content) if isinstance(content, str) else Markup("").join(map(joined, content))


def _filled(markup: str, *contents: Content) -> Markup:
    """Markup with a content in the place of each pair of braces."""
    return Markup(markup).format(*map(joined, contents))


def coded(text: str) -> Markup:
    """Text with the parts between backticks as code."""
    return joined([code(part) if i % 2 else part for i, part in enumerate(text.split("`"))])


def paragraph(content: Content) -> Markup:
    """Paragraph of text."""
    return _filled("<p>{}</p>", content)


def note(content: Content) -> Markup:
    """Smaller text below other text."""
    return _filled('<span class="note">{}</span>', content)


def heading(title: str, id: str) -> Markup:
    """A heading within a section; ``id`` is unique on the page."""
    return _filled('<h3 id="{}">{}</h3>', id, title)


def link(words: str, target: str) -> Markup:
    """A link to a place on the page."""
    return _filled('<a href="#{}">{}</a>', target, words)


def badge(words: str, look: str) -> Markup:
    """A verdict in words, on a colour that only repeats them; ``look`` is a class of the style sheet."""
    return _filled('<span class="badge {}">{}</span>', look, words)


def code(text: str) -> Markup:
    """A name or a command within text."""
    return _filled("<code>{}</code>", text)


def verbatim(text: str, label: str) -> Markup:
    """Preformatted lines; ``label`` is for those who hear the page."""
    return scrolling("scroll", label, _filled("<pre>\n{}</pre>", text))


def items(contents: Sequence[Content]) -> Markup:
    """Bulleted list."""
    return _filled("<ul>{}</ul>", [_filled("<li>{}</li>", content) for content in contents])


def facts(pairs: Sequence[tuple[str, Content]]) -> Markup:
    """List of terms with a description of each."""
    entries = [_filled("<div><dt>{}</dt><dd>{}</dd></div>", term, content) for term, content in pairs]
    return _filled("<dl>{}</dl>", entries)


def folded(summary: Content, content: Content, printed: bool = True, id: str = "") -> Markup:
    """Content that a reader can open; in print it is open if ``printed``, else left out.

    With an ``id``, unique on the page, its summary is a heading within the section.
    """
    attributes = _filled(' id="{}"', id) if id else Markup("")
    attributes += Markup("" if printed else ' class="screen"')
    title = _filled("<h3>{}</h3>", summary) if id else summary
    return _filled("<details{}><summary>{}</summary>{}</details>", attributes, title, content)


def scrolling(look: str, label: str, content: Content) -> Markup:
    """A box that scrolls where its content is too wide; ``look`` has its classes of the style sheet."""
    return _filled('<div class="{}" role="region" tabindex="0" aria-label="{}">{}</div>', look, label, content)


def table(
    label: str,
    caption: Content,
    head: Sequence[str],
    rows: Sequence[Sequence[Content]],
    numeric: Collection[int] = (),
    look: str = "",
    ids: Sequence[str] = (),
) -> Markup:
    """A table, which scrolls within its own box where it is too wide; a row's first cell is its header.

    Args:
        label: what it is, in a few words, unlike any other on the page: for those who hear the page.
        caption: what it shows, above the box, so that it does not scroll with it.
        head: titles of the columns.
        rows: as many cells each as there are titles.
        numeric: numbers of the columns that hold numbers, from 0.
        look: "stacked", if a narrow screen shows each row as a card, each cell beside its title; "stacked prose", if
            paper does so too, from the third cell on over the whole width, for cells of sentences.
        ids: an anchor for each row, if rows are linked to.

    Raises:
        ValueError: if a row does not fit the head, which would shift columns silently.
    """
    if any(len(row) != len(head) for row in rows):
        raise ValueError(f"{label}: a row has not {len(head)} cells")
    number = [Markup(' class="number"' if place in numeric else "") for place in range(len(head))]
    named = {"label": label, "caption": caption, "head": head, "rows": rows, "number": number, "look": look, "ids": ids}
    return Markup(rendered("assets/table.html", long=len(rows) > PRINTED and not look, **named).rstrip("\n"))


def picture(id: str, data: bytes, alt: str, caption: Content) -> Markup:
    """A PNG within the page.

    Args:
        id: its place, to link to.
        data: the picture.
        alt: what it shows, for those who do not see it.
        caption: below it.
    """
    # a PNG begins with a signature, a length and "IHDR"; then come width and height
    width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
    tall = Markup(' class="tall"' if height > 0.9 * width else "")  # it needs more of a sheet of paper
    source = f"data:image/png;base64,{base64.b64encode(data).decode()}"
    image = _filled('<img{} src="{}" alt="{}" width="{}" height="{}">', tall, source, alt, str(width), str(height))
    if width > 1000:  # its letters would be too small on a phone
        image = scrolling("scroll framed", f"Figure {id}", image)
    return _filled('<figure id="{}">{}<figcaption>{}</figcaption></figure>', id, image, caption)


def rendered(template: str, **entries: object) -> str:
    """A template beside this file, with entries in their places."""
    return _TEMPLATES.get_template(template).render(entries)


_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent, encoding="utf-8"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_TEMPLATES.filters |= {"coded": coded, "joined": joined}

"""Figures embedded in the page as PNG data URIs, with alternative text."""

import base64
import inspect
import io
import re

from matplotlib.figure import Figure

from study.figures import FIGURES, FigureModule, NotApplicable, Tables, style
from study.figures.failure import failure
from study.report.blocks import InlineCode, Picture, Text


def add_pictures(tables: Tables, pictures: dict[str, Picture], undrawn: dict[str, dict[str, str]]) -> None:
    """Draw the figures that a run can feed and no earlier run could.

    Args:
        tables: the run.
        pictures: those drawn so far; new ones are added.
        undrawn: for each figure not drawn so far the reasons, by the run's name; kept up to date. A figure that fails
            does not cost the others; its reason says where in the code it failed.
    """
    for name, figure in FIGURES.items():
        if name in pictures:
            continue
        try:
            pictures[name] = picture(name, figure, tables)
        except NotApplicable as reason:
            undrawn.setdefault(name, {})[tables.name] = str(reason)
        except Exception as error:  # a figure that fails must not cost the page
            undrawn.setdefault(name, {})[tables.name] = failure(error)
        else:
            undrawn.pop(name, None)


def picture(name: str, figure: FigureModule, tables: Tables) -> Picture:
    """Draw a figure.

    Raises:
        NotApplicable: if the run does not have what it shows.
    """
    frame = figure.prepare(tables)
    data = png(figure.draw(frame))
    # a PNG begins with a signature, a length and "IHDR"; then come width and height
    width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
    title, look = described(figure)
    source = f"data:image/png;base64,{base64.b64encode(data).decode()}"
    caption = [Text(title), *([Text(look)] if look else []), Text([InlineCode(name), f", run {tables.name}"])]
    return Picture(name, source, f"{title} Run {tables.name}.", width, height, caption)


def described(figure: FigureModule) -> tuple[str, str]:
    """First paragraph of a figure's docstring and its advice on what to look at; "" if there is none."""
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", inspect.getdoc(figure) or "")]
    paragraphs = [part.replace("``", "") for part in paragraphs]
    return paragraphs[0], next((part for part in paragraphs[1:] if part.startswith("Look at")), "")


@style.journal()
def png(figure: Figure) -> bytes:
    """Encode a figure as PNG without the software's name, so that equal figures are equal bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()

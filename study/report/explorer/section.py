"""The section of the explorer: its block, its scripts, and the digests by which the page's policy knows them."""

import base64
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import ClassVar, NamedTuple

from markupsafe import Markup

from study.report.blocks import Block, Section
from study.report.explorer.packed import packed
from study.report.material import Material

_FOLDER = Path(__file__).parent
_SCRIPTS = ("rows.js", "chart.js", "table.js", "state.js", "explorer.js")
_LIBRARY = "plot.min.js"


class RunTable(NamedTuple):
    """A run's name, and its summary as `study.report.explorer.packed.packed` has it."""

    name: str
    text: str


@dataclass(frozen=True)
class Explorer(Block):
    """Controls, chart and table of runs.

    Attributes:
        tables: the runs' summaries.
        library, script: code of the chart's library with its licence, and of the explorer.
    """

    kind: ClassVar[str] = "explorer"
    tables: Sequence[RunTable]
    library: Markup
    script: Markup


def explorer_section(material: Material) -> Iterable[Section]:
    """Section in which every row of the runs' summaries can be searched and drawn."""
    tables = [RunTable(record.name, packed(record)) for record in material.records]
    yield Section("Explore every number", "explorer", [Explorer(tables, *map(Markup, scripts()))], printed=False)


@cache
def scripts() -> tuple[str, str]:
    """The library with its licence, and the explorer's own script."""
    licence = _part("plot.LICENSE.txt").strip()
    own = "\n".join(map(_part, _SCRIPTS))
    return f"/*\n{licence}\n*/\n{_part(_LIBRARY)}", f'"use strict";\n{{\n{own}}}\n'


def digests() -> str:
    """Digests of the scripts, as a page's policy names the only scripts that may run."""
    hashes = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts())
    return " ".join(f"'sha256-{text}'" for text in hashes)


def _part(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")

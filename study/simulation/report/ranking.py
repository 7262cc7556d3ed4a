"""The page of a ranking: the places of new methods, and every table of `study rank`."""

from collections.abc import Sequence

import pandas as pd

from study.simulation.analysis import rank
from study.simulation.report import html
from study.simulation.report.html import Section


def page(table: pd.DataFrame, by: str, level: float, names: Sequence[str] = ()) -> str:
    """Write the page of a ranking: one HTML document that needs no other file.

    Args:
        table: of `rank.ranked`.
        by: what the methods are ranked by.
        level: of the comparisons with the best.
        names: the methods whose places stand first.
    """
    sections, numeric = [], range(1, 1 + len(rank.TITLES))
    for number, name in enumerate(names):
        rows, head = rank.places(table, name), ["ranking", *rank.PLACES[1:]]
        part = html.table(f"Places of {name}", "", head, rows, range(1, len(head) - 1), "stacked")
        sections.append(Section(f"{name}, among the methods that are given the same", f"place-{number}", [part]))
    parts = []
    for title, rows in rank.tables(table):
        part = html.table(title, "", ["method", *rank.TITLES], rows, numeric)
        parts.append(html.folded(title, part) if names else html.joined([html.paragraph(title), part]))
    sections.append(Section("All rankings", "rankings", parts))
    title = f"Place of {', '.join(names)}" if names else "Ranking"
    return html.rendered("assets/ranking.html", title=title, words=rank.explained(by, level), sections=sections)

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
    sections = []
    for number, name in enumerate(names):
        numeric = range(1, len(rank.PLACES) - 1)
        rows = rank.places(table, name)
        part = html.table(f"Places of {name}", "", ["ranking", *rank.PLACES[1:]], rows, numeric, "stacked")
        sections.append(Section(f"{name}, among the methods that are given the same", f"place-{number}", [part]))
    for number, (title, rows) in enumerate(rank.tables(table)):
        head, numeric = ["method", *rank.TITLES], range(1, 1 + len(rank.TITLES))
        sections.append(Section(title, f"ranking-{number}", [html.table(title, "", head, rows, numeric, "stacked")]))
    title = f"Place of {', '.join(names)}" if names else "Ranking"
    return html.rendered("assets/ranking.html", title=title, words=rank.explained(by, level), sections=sections)

"""The coverage table in words: one row per N and cap, a column per κ; and what the whole table says."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.coverage.measure import INTERVAL
from study.text.columns import columns

_LITTLE, _MUCH = 0.2, 0.5


def printed(table: pd.DataFrame) -> Iterator[str]:
    """Lines: coverage of the radius by each method over all fits, of each cell; then a summary of each method."""
    methods = list(dict.fromkeys(table["method"]))
    head, *rows = by_cell(table, methods)
    yield f"Coverage of the radius over all fits: {' / '.join(methods)}"
    yield from columns(rows, head)
    yield ""
    yield from columns([summary(table, name) for name in methods], TITLES)


def by_cell(table: pd.DataFrame, methods: list[str]) -> list[list[str]]:
    """Coverage of the radius in every cell: a row of titles, then one per N and cap with a column per κ."""
    kappas = sorted(table["kappa"].unique())
    rows = [["N", "cap", *[f"κ={kappa:g}" for kappa in kappas]]]
    for (n, angle), part in table.groupby(["samples", "angle"]):
        cells = []
        for kappa in kappas:
            here = part[part["kappa"] == kappa].set_index("method")["radius"]
            cells.append("/".join(_share(here[name]) for name in methods) if len(here) else "-")
        rows.append([f"{n}", f"{angle:g}°", *cells])
    return rows


TITLES = [
    "method",
    "σ < .2 r: mean",
    "within .93-.97",
    "least",
    "σ ≤ .5 r: least",
    "centre: least",
    "ok fits: mean",
    "ok fits: least",
    "width at κ=100, N ≥ 40",
]


def summary(table: pd.DataFrame, name: str) -> list[str]:
    """Coverage by one method over the cells, in the order of `TITLES`."""
    part = table[table["method"] == name]
    little, some = part[part["sigma"] < _LITTLE], part[part["sigma"] <= _MUCH]
    inside = little["radius"].between(0.93, 0.97)
    often = part[(part["ok"] >= 0.2) & (part["sigma"] < 0.35)]
    clear = part[(part["kappa"] == 100.0) & (part["samples"] >= 40) & (part["sigma"] < _LITTLE)]["width_attainable"]
    center = np.minimum(some["axis"], some["across"])
    return [
        "interval" if name == INTERVAL else f"{name} ± t s.e.",
        _share(little["radius"].mean()),
        f"{100.0 * inside.mean():.0f} %",
        _share(little["radius"].min()),
        _share(some["radius"].min()),
        _share(center.min()),
        _share(often["radius_ok"].mean()),
        _share(often["radius_ok"].min()),
        f"{clear.min():.2f}-{clear.max():.2f}" if len(clear) else "-",
    ]


def _share(value: float) -> str:
    """Three digits without the leading zero."""
    return f"{value:.3f}".removeprefix("0")

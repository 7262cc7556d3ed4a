"""The explorer: chart and table of every row of the runs' summaries, within the page.

The numbers travel in the page as compressed columns (`packed`). The scripts beside this file unpack and show them;
Observable Plot, bundled with its licence, draws.
The page's policy names the scripts by their digests, so that no other may run.
"""

import base64
import gzip
import hashlib
import json
import math
import shlex
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pandas as pd
from markupsafe import Markup

from study import style
from study.fits import Status
from study.simulation.experiment.conditions import LABELS
from study.simulation.report import html, words
from study.simulation.report.html import Section
from study.simulation.report.material import Material, Record
from study.simulation.statistics import MEASURES, share

_DIGITS, _ERROR_DIGITS = 5, 3


def packed(record: Record) -> str:
    """Pack a run's summary for the explorer.

    Returns:
        JSON of columns, compressed by gzip, as base64. Numbers have five digits, Monte-Carlo errors three; a number
        that is not known is null. The same run gives the same text.
    """
    text = json.dumps(_columns(record), separators=(",", ":")).replace("Infinity", "1e999")  # too large to hold: ∞
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def _columns(record: Record) -> dict[str, object]:
    frame = record.summary
    codes, groups = pd.factorize(frame["group"].astype(str))
    by_decade = bool(frame["decade"].notna().any())
    varying, fixed = _conditions(frame, by_decade)
    names = pd.MultiIndex.from_frame(frame[["group", "estimator"]].astype(str))
    data: dict[str, object] = {
        "run": record.name,
        "by": "decade" if by_decade else "cell",
        "replay": f"study replay {shlex.quote(str(record.run.folder))}",
        "groups": list(groups),
        "group": codes.tolist(),
        "estimators": [{"name": n, "label": style.label(n), "color": style.color(n)} for n in record.estimators],
        "estimator": pd.Index(record.estimators).get_indexer(names.get_level_values(1)).tolist(),
        "conditions": varying,
        "fixed": fixed,
        "trials": frame["planned"].tolist(),
        "ok": frame["ok"].tolist(),
        "failed": _failed(frame),
        "measures": list(_measures(frame)),
    }
    if record.worst_of_groups is not None:
        rows = record.worst_of_groups.set_index(["group", "estimator"]).reindex(names)
        worst = zip(rows["cell"], rows["trial"], strict=True)
        trials = [f"{cell}/{trial:.0f}" if isinstance(cell, str) else None for cell, trial in worst]
        data |= {"worst": trials, "ratio": _rounded(rows["ratio"], _ERROR_DIGITS)}
    return data


def _conditions(frame: pd.DataFrame, by_decade: bool) -> tuple[list[dict[str, object]], str]:
    """The conditions that vary, each with its values and a code per row, and the others in words."""
    if by_decade:
        return [_condition("decade", "σ/r from", 10.0 ** frame["decade"].astype(float), "")], ""
    varying, fixed = [], []
    for condition in LABELS:
        if condition.stored and condition.name not in frame:
            continue
        values = pd.Series(condition.of(frame))
        # numbers that differ by rounding alone are one
        values = values.astype(str) if condition.kind is str else values.map(lambda value: float(f"{value:.6g}"))
        if values.nunique(dropna=False) > 1:
            varying.append(_condition(condition.name, condition.symbol, values, condition.mark))
        else:
            fixed.append(f"{condition.symbol} = {words.condition(condition, frame.iloc[0])}")
    return varying, ", ".join(fixed)


def _condition(name: str, symbol: str, values: pd.Series, mark: str) -> dict[str, object]:
    codes, possible = pd.factorize(values, sort=True)
    entry = {"name": name, "symbol": symbol, "number": not isinstance(possible[0], str), "mark": mark}
    return entry | {"values": possible.tolist(), "codes": codes.tolist()}


def _failed(frame: pd.DataFrame) -> list[dict[str, object]]:
    """Fits that are not ok, by status, without those that occur nowhere."""
    counts = {status.name.lower(): frame.get(status.name.lower()) for status in Status if status != Status.OK}
    return [
        {"words": name.replace("_", " "), "counts": column.tolist()}
        for name, column in counts.items()
        if column is not None and column.any()
    ]


def _measures(frame: pd.DataFrame) -> Iterable[dict[str, object]]:
    """Every measure with its Monte-Carlo errors, error over bound first, and the share of fits that are not ok."""
    for name in sorted(MEASURES, key=lambda name: not name.startswith("ratio")):
        if name in frame and frame[name].notna().any():
            title, meaning, _ = MEASURES[name]
            yield _measure(name, title, meaning, frame[name], frame[f"{name}_error"])
    shares = [share(int(p - k), int(p)) for p, k in zip(frame["planned"], frame["ok"], strict=True)]
    yield _measure("not_ok", "share not ok", "share of the fits that are not ok", *zip(*shares, strict=True))


def _measure(
    name: str, title: str, meaning: str, values: Iterable[float], errors: Iterable[float]
) -> dict[str, object]:
    entry = {"name": name, "title": _sentence(title), "meaning": _sentence(meaning)}
    return entry | {"values": _rounded(values, _DIGITS), "errors": _rounded(errors, _ERROR_DIGITS)}


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _rounded(values: Iterable[float], digits: int) -> list[float | None]:
    """Numbers of some digits; None for one that is not known."""
    return [None if math.isnan(value) else float(f"{value:.{digits}g}") for value in values]


_FOLDER = Path(__file__).parent / "assets"
_SCRIPTS = ("rows.js", "chart.js", "table.js", "state.js", "explorer.js")
_LIBRARY = "plot.min.js"


def explorer_section(material: Material) -> Iterable[Section]:
    """Section in which every row of the runs' summaries can be searched and drawn."""
    library, script = map(Markup, scripts())
    tables = {record.name: packed(record) for record in material.records}
    part = html.rendered("assets/part.html", tables=tables, library=library, script=script)
    yield Section("Explore every number", "explorer", [Markup(part)], printed=False)


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

"""The explorer: chart and table of every row of the runs' summaries, within the page.

The numbers travel in the page as compressed columns (`packed`). The scripts beside this file unpack and show them;
Observable Plot, bundled with its licence, draws.
The page's policy names the scripts by their digests, so that no other may run.
"""

import base64
import gzip
import hashlib
import json
import shlex
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from study import style
from study.arrays import Floats, Ints
from study.fits import Status
from study.simulation.experiment.conditions import LABELS, Condition
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
    text = "{" + ",".join(f"{json.dumps(key)}:{value}" for key, value in _entries(record)) + "}"
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def _entries(record: Record) -> Iterable[tuple[str, str]]:
    frame = record.summary
    groups, codes = _coded(frame["group"].astype(str))
    by_decade = bool(frame["decade"].notna().any())
    varying, fixed = _conditions(frame, by_decade)
    named = pd.Index(record.estimators)
    yield "run", json.dumps(record.name)
    yield "by", json.dumps("decade" if by_decade else "cell")
    yield "replay", json.dumps(f"study replay {shlex.quote(str(record.run.folder))}")
    yield "groups", json.dumps(groups)
    yield "group", _whole(codes)
    looks = [{"name": n, "label": style.label(n), "color": style.color(n)} for n in record.estimators]
    yield "estimators", json.dumps(looks)
    yield "estimator", _whole(named.get_indexer(pd.Index(frame["estimator"].astype(str))))
    yield "conditions", "[" + ",".join(varying) + "]"
    yield "fixed", json.dumps(fixed)
    yield "trials", _whole(frame["planned"])
    yield "ok", _whole(frame["ok"])
    yield "failed", "[" + ",".join(_failed(frame)) + "]"
    yield "measures", "[" + ",".join(_measures(frame)) + "]"
    if record.worst_of_groups is not None:
        worst = record.worst_of_groups.set_index(["group", "estimator"])
        rows = worst.reindex(pd.MultiIndex.from_frame(frame[["group", "estimator"]].astype(str)))
        names = [
            f"{c}/{int(t)}" if isinstance(c, str) else None for c, t in zip(rows["cell"], rows["trial"], strict=True)
        ]
        yield "worst", json.dumps(names)
        yield "ratio", _numbers(rows["ratio"], _ERROR_DIGITS)


def _coded(values: Sequence[Any] | pd.Series) -> tuple[list[Any], Ints]:
    """Values without repetition in the order in which they appear, and each row's place among them."""
    codes, result = pd.factorize(pd.Series(values))
    return list(result), codes


def _conditions(frame: pd.DataFrame, by_decade: bool) -> tuple[list[str], str]:
    """The conditions that vary, each with its values and a code per row, and the others in words."""
    if by_decade:
        lower = pd.Series(10.0 ** frame["decade"].to_numpy(dtype=float))
        return [_condition("decade", "σ/r from", lower, "")], ""
    varying, fixed = [], []
    for condition in LABELS:
        if condition.stored and condition.name not in frame:
            continue
        values = _given(condition, frame)
        if values.nunique(dropna=False) > 1:
            varying.append(_condition(condition.name, condition.symbol, values, condition.mark))
        else:
            fixed.append(f"{condition.symbol} = {words.condition(condition, frame.iloc[0])}")
    return varying, ", ".join(fixed)


def _given(condition: Condition, frame: pd.DataFrame) -> pd.Series:
    """A condition's value in each row; numbers that differ by rounding alone are one."""
    values = pd.Series(condition.of(frame))
    if condition.kind is str:
        return values.astype(str)
    return values.map({value: float(f"{value:.6g}") for value in values.unique()})


def _condition(name: str, symbol: str, values: pd.Series, mark: str) -> str:
    known = sorted(values.unique())
    codes = pd.Index(known).get_indexer(pd.Index(values))
    number = not isinstance(known[0], str)
    entry = {"name": name, "symbol": symbol, "number": number, "mark": mark, "values": known}
    return json.dumps(entry)[:-1] + f', "codes": {_whole(codes)}}}'


def _failed(frame: pd.DataFrame) -> Iterable[str]:
    """Fits that are not ok, by status, without those that occur nowhere."""
    for status in Status:
        name = status.name.lower()
        if name != "ok" and name in frame and frame[name].any():
            yield json.dumps({"words": name.replace("_", " ")})[:-1] + f', "counts": {_whole(frame[name])}}}'


def _measures(frame: pd.DataFrame) -> Iterable[str]:
    """Every measure with its Monte-Carlo errors, error over bound first, and the share of fits that are not ok."""
    names = sorted(MEASURES, key=lambda name: not name.startswith("ratio"))
    for name in names:
        if name in frame and frame[name].notna().any():
            title, meaning, _ = MEASURES[name]
            yield _measure(name, title, meaning, frame[name], frame[f"{name}_error"])
    result = [share(int(p - k), int(p)) for p, k in zip(frame["planned"], frame["ok"], strict=True)]
    meaning = "share of the fits that are not ok"
    yield _measure("not_ok", "share not ok", meaning, [m.value for m in result], [m.error for m in result])


def _measure(name: str, title: str, meaning: str, values: Iterable[float], errors: Iterable[float]) -> str:
    both = f'"values": {_numbers(values, _DIGITS)}, "errors": {_numbers(errors, _ERROR_DIGITS)}'
    return json.dumps({"name": name, "title": _sentence(title), "meaning": _sentence(meaning)})[:-1] + f", {both}}}"


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _numbers(values: Iterable[float], digits: int) -> str:
    """Numbers of some digits in JSON, where infinity is a number too large to hold."""
    array: Floats = np.asarray(values, dtype=float)
    texts = (f"{value:.{digits}g}" for value in array.tolist())
    return "[" + ",".join(_SPECIAL.get(text, text) for text in texts) + "]"


_SPECIAL = {"nan": "null", "inf": "1e999", "-inf": "-1e999"}


def _whole(values: Iterable[int]) -> str:
    return "[" + ",".join(map(str, np.asarray(values, dtype=int).tolist())) + "]"


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

"""The page: its sections in their order, with those of the claims, of speed and of figures.

A claim has its verdict, the numbers behind it, and the rule that joins them. Ratios of speed are those that
`make bench` stored, by group, with the machine's name.

The explorer: chart and table of every row of the runs' summaries, within the page.

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
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from study import style
from study.files import stored_csv
from study.fits import Status
from study.simulation.claims import Verdict, counted
from study.simulation.claims.claim import OTHER_CAUSE
from study.simulation.experiment.conditions import LABELS
from study.simulation.experiment.measures import MeasureColumn
from study.simulation.figures import Tables, gathered
from study.simulation.report import html, words
from study.simulation.report.html import Content, Section
from study.simulation.report.material import Material, answer
from study.simulation.report.runs import overview_section, posterior_section, run_id, run_section
from study.simulation.report.words import count, readable
from study.simulation.statistics import PERFORMANCE, of_column, share
from study.text import columns, one_line

_DIGITS, _ERROR_DIGITS = 5, 3


def packed(tables: Tables) -> str:
    """Pack a run's summary for the explorer.

    Returns:
        JSON of columns, compressed by gzip, as base64. Numbers have five digits, Monte-Carlo errors three; a number
        that is not known is null. The same run gives the same text.
    """
    text = json.dumps(_columns(tables), separators=(",", ":")).replace("Infinity", "1e999")  # too large to hold: ∞
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def _columns(tables: Tables) -> dict[str, object]:
    frame = tables.summary
    codes, groups = pd.factorize(frame["group"].astype(str))
    by_decade = bool(frame["decade"].notna().any())
    varying, fixed = _conditions(frame, by_decade)
    names = pd.MultiIndex.from_frame(frame[["group", "estimator"]].astype(str))
    data: dict[str, object] = {
        "run": tables.name,
        "by": "decade" if by_decade else "cell",
        "replay": f"study replay {shlex.quote(str(tables.run.folder))}",
        "groups": list(groups),
        "group": codes.tolist(),
        "estimators": [
            {"name": n, "label": style.label(n), "color": style.color(n), "marker": style.marker(n)}
            for n in tables.estimators
        ],
        "estimator": pd.Index(tables.estimators).get_indexer(names.get_level_values(1)).tolist(),
        "conditions": varying,
        "fixed": fixed,
        "trials": frame["planned"].tolist(),
        "ok": frame["ok"].tolist(),
        "failed": _failed(frame),
        "measures": list(_measures(frame, tables.run.study.measured())),
    }
    if "errors" in tables.stored:
        rows = tables.worst[1].set_index(["group", "estimator"]).reindex(names)
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


def _measures(frame: pd.DataFrame, further: Iterable[MeasureColumn]) -> Iterable[dict[str, object]]:
    """Every measure with its Monte-Carlo errors, error over bound first, and the share of fits that are not ok.

    Args:
        frame: the summary.
        further: columns of the study's own measures.
    """
    order = sorted(PERFORMANCE, key=lambda name: not name.startswith("ratio"))
    known = [(name, PERFORMANCE[name].title, PERFORMANCE[name].meaning) for name in order]
    for column in further:
        known += [(name, name.replace("_", " "), meaning) for name, (meaning, _) in of_column(column).items()]
    for name, title, meaning in known:
        if name in frame and frame[name].notna().any():
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
    columns = {tables.name: packed(tables) for tables in material.runs}
    part = html.rendered("assets/part.html", tables=columns, library=library, script=script)
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


_LOOKS = dict(zip(map(str, Verdict), ("good", "partly", "partly", "bad", "untested"), strict=True))
_SHORT = dict(zip(map(str, Verdict), ("yes", "mostly", "part", "no", "–"), strict=True))
_PROSE = "stacked prose"
_Claim = dict[Any, Any]
"""A row of the claims table."""


def claims_section(material: Material) -> Iterable[Section]:
    """Section of the claims: first those with a verdict, then those without, and why; none where none was judged."""
    if not material.of_paper:
        return
    judged, rest = _by_verdict(material)
    content = []
    if judged:
        head = ["No.", "§", "The paper says", "Found"]
        rows, ids = [_judged(claim, material) for claim in judged], [f"claim-{claim['number']}" for claim in judged]
        caption = one_line("""
            One rule for all: reproduced in .95 of a claim's conditions or more, mostly in .8, in part in .2, not
            reproduced in fewer; another cause stands beside it where the paper's reason fails.
        """)
        content.append(html.table("The paper's claims and what was found", caption, head, rows, look=_PROSE, ids=ids))
    if rest:
        rows = [[*_place(claim), html.coded(claim["finding"])] for claim in rest]
        table = html.table("Claims not evaluated", "", ["No.", "§", "Claim", "Why not"], rows, look=_PROSE)
        content += _missing(rest, judged, material)
        content.append(html.folded(f"{len(rows)} claim{'s' * (len(rows) > 1)} not evaluated, and why", table))
    yield Section("The paper's claims", "claims", content)


def unjudged_section(material: Material) -> Iterable[Section]:
    """Section that says what the paper's claims need, of a page on which none was judged."""
    if material.of_paper:
        return
    judged, rest = _by_verdict(material)
    words = "These runs can judge none of the claims."
    if not rest:
        words = "No claim of the paper was judged: that takes runs of the project's own configs, such as paper.toml."
    yield Section("The paper's claims", "claims", [html.paragraph(words), *_missing(rest, judged, material)])


def _by_verdict(material: Material) -> tuple[list[_Claim], list[_Claim]]:
    """The claims that were judged, and the others."""
    claims = material.claims.to_dict("records")
    judged = [claim for claim in claims if claim["verdict"] != Verdict.NOT_EVALUATED]
    return judged, [claim for claim in claims if claim["verdict"] == Verdict.NOT_EVALUATED]


def _place(claim: _Claim) -> list[str]:
    return [str(claim["number"]), claim["section"], claim["statement"]]


def tally(claims: pd.DataFrame) -> Markup:
    """The sentence that counts each verdict, in the order of the verdicts."""
    badges: list[str] = [f"{len(claims)} claim{'s' * (len(claims) > 1)}: "]
    for verdict, number in counted(claims).items():
        badges += [_badge(verdict, f"{number} {verdict}"), " "] if number else []
    return html.paragraph(badges[:-1])


def _badge(verdict: str, words: str) -> Markup:
    return html.badge(words, _LOOKS.get(verdict.removesuffix(OTHER_CAUSE), "untested"))


def _judged(claim: _Claim, material: Material) -> list[Content]:
    """A claim with a verdict."""
    name, verdict, figure = claim["name"], claim["verdict"], claim["figure"]
    places = {tables.name: run_id(tables) for tables in material.runs}
    runs: list[str] = []
    for run in filter(None, claim["runs"].split(", ")):
        runs += [", "] * bool(runs) + [html.link(run, places[run]) if run in places else run]
    facts: list[tuple[str, Content]] = [
        ("Measured", claim["quantity"]),
        ("Criterion", claim["criterion"]),
        ("Remark", claim["remark"]),
        ("Trials", f"at least {count(int(claim['trials']))} behind each number" if claim["trials"] else ""),
        ("Runs", runs),
        ("Tables", html.code(claim["reads"]) if claim["reads"] else ""),
        ("Figure", html.link(figure, figure) if figure in material.pictures else figure),
    ]
    numbers = html.items(list(map(readable, claim["finding"].splitlines())))
    rule = html.facts([(term, content) for term, content in facts if content])
    otherwise = material.readings.otherwise(name).partition("; ")[2] if material.readings else ""
    found = [
        html.paragraph([_badge(verdict, verdict)]),
        html.paragraph(html.coded(answer(name, verdict, claim["finding"]))),
        *([html.paragraph(["Read otherwise: ", otherwise, "."])] if otherwise else []),
        html.folded("Numbers and rule", [numbers, rule]),
    ]
    return [*_place(claim), found]


def readings_section(material: Material) -> Iterable[Section]:
    """Section of the choices that the paper leaves open, and of the verdicts under each reading; empty without them."""
    readings = material.readings
    if readings is None or material.claims.empty:
        return
    moved, stand = readings.changed["claim"].nunique(), len(readings.standing)
    said = one_line(f"""
        The paper leaves {len(readings.choices)} choices open. Each was read otherwise, one at a time: the studies that
        it changes were run, and the claims that it may change were judged again. {stand} verdicts stand under every
        reading, {moved} change under some.
    """)
    rows: list[list[Content]] = []
    for number, choice in enumerate(readings.choices, start=1):
        ways = [
            [readings.letters[choice.name, one.name], ": ", one.words, " (used)" * (one.name == choice.used)]
            for one in choice.reading
        ]
        facts = [html.note(choice.says), html.items(ways), html.note(["Used because: ", choice.why])]
        rows.append([str(number), choice.section, choice.issue, facts])
    caption = "Each choice with its readings; the letters are those of the table below."
    head = ["No.", "§", "Choice", "What the paper says, and the readings"]
    choices = html.table("Choices that the paper leaves open", caption, head, rows, look=_PROSE)
    lines: list[list[Content]] = []
    for row in material.claims.to_dict("records"):
        cells: list[Content] = []
        for key in readings.others:
            verdict = readings.verdict(row["name"], *key)
            short = _SHORT[verdict.removesuffix(OTHER_CAUSE)] if verdict else "·"
            cells.append(_badge(verdict, short) if verdict not in ("", row["verdict"]) else short)
        short = _SHORT.get(row["verdict"].removesuffix(OTHER_CAUSE), "–")
        lines.append([html.link(f"{row['number']} {row['name']}", f"claim-{row['number']}"), short, *cells])
    titles = ["Claim", "used", *(readings.letters[key] for key in readings.others)]
    caption = one_line("""
        Verdicts under each reading: reproduced (yes), mostly, in part (part), not reproduced (no), not evaluated (–); a
        dot where a reading cannot change it. A verdict that changes, or cannot be given, is framed.
    """)
    matrix = html.table("Claims under each reading", caption, titles, lines)
    told = [
        [
            html.link(f"Claim {row.number}", f"claim-{row.number}"),
            f", {row.used} as used, {row.verdict} {readings.reading(row).clause}: ",
            readable("; ".join(str(row.finding).split("; ")[:3])),
        ]
        for row in readings.changed.itertuples()
    ]
    numbers = html.folded(f"The {len(told)} verdicts that change, with their first numbers", html.items(told))
    yield Section("The paper read otherwise", "readings", [html.paragraph(said), choices, matrix, numbers])


def _missing(rest: list[_Claim], judged: list[_Claim], material: Material) -> Iterable[Markup]:
    """Sentence that names the runs or tables that the remaining claims need."""
    reads, had = ([read for claim in some for read in claim["reads"].split(", ")] for some in (rest, judged))
    given = {tables.run.study.name for tables in material.runs}
    configs = dict.fromkeys(config for config, _, table in (read.partition("/") for read in reads) if table)
    names = [f"configs/{name}.toml" for name in configs if name not in given]
    needed: list[str] = [f"runs of {', '.join(names)}"] * bool(names)
    for table, option in (("cost", "--cost"), ("case-study", "--recording")):
        if table in reads and table not in had:
            given_by = [html.code(f"study {table}"), " writes, given by ", html.code(option)]
            needed += [", and "] * bool(needed) + ["what ", *given_by]
    if needed:
        yield html.paragraph(["Missing are ", *needed, "."])


COLUMNS = ("group", "what", "cost", "measured", "ratio", "aim", "machine")

_TIMES = ((1e9, "s"), (1e6, "ms"), (1e3, "µs"))


def read_bench(path: Path) -> pd.DataFrame:
    """The table that `make bench` writes.

    Raises:
        RunError: if it cannot be read, or is no such table.
    """
    return stored_csv(path, COLUMNS, "table of ratios; make bench writes it", as_text=True)


def speed_section(material: Material) -> Iterable[Section]:
    """Section with a table per group of benchmarks; empty if there are none."""
    if material.bench is None:
        return
    machine = material.bench["machine"].iloc[0]
    said = one_line(f"""
        Measured on {machine}, in one run. A ratio compares a row with the row of its group whose ratio is 1, by the
        best of many rounds of each. A group without such a row has times alone.
    """)
    content = [html.paragraph(said)]
    for group, part in material.bench.groupby("group", sort=False):
        rows = []
        for what, cost, unit, ratio, aim in part[["what", "cost", "measured", "ratio", "aim"]].to_numpy(dtype=str):
            # a cost in the unit that suits it: 8.69e+06 ns are 8.69 ms
            size, name = next((t for t in _TIMES if unit == "ns" and float(cost) >= t[0]), (1.0, unit))
            spoken = words.timed(float(cost) / size) if unit == "ns" else cost
            rows.append([what, f"{spoken}{words.JOINED}{name}", words.readable(ratio), aim])
        head = ["What", "Cost", "Ratio", "Aim"]
        content.append(html.table(f"Speed: {group}", str(group), head, rows, numeric={1, 2}))
    yield Section("Speed", "speed", content)


def figures_section(material: Material) -> Iterable[Section]:
    """Section of figures, each once, with the reasons for those that are missing."""
    content: list[Markup] = list(material.pictures.values())
    if not content:
        content.append(html.paragraph("These runs can feed none of the figures."))
    if material.undrawn:
        runs = len(material.runs)
        reasons = [f"{name}: {gathered(reasons, runs)}" for name, reasons in material.undrawn.items()]
        title = f"{len(reasons)} figure{'s' * (len(reasons) > 1)} not drawn, and why"
        content.append(html.folded(title, html.items(reasons)))
    yield Section("Figures", "figures", content)


def run_sections(material: Material) -> Iterable[Section]:
    """Sections of each run: results and provenance."""
    return (run_section(tables) for tables in material.runs)


SECTIONS: list[Callable[[Material], Iterable[Section]]] = [
    claims_section,
    readings_section,
    explorer_section,
    figures_section,
    posterior_section,
    speed_section,
    overview_section,
    run_sections,
    unjudged_section,
]
"""The page, in order. Each entry gives one section, several, or none where the runs have nothing for it."""


def render(material: Material) -> str:
    """Write the page about runs: one HTML document that needs no other file.

    Args:
        material: the runs with their claims, figures and findings.

    Returns:
        The document. The same runs and claims give the same bytes.
    """
    claims = material.claims
    names, sets = ", ".join(tables.name for tables in material.runs), sum(tables.trials for tables in material.runs)
    parts: dict[str, object] = {name: getattr(material, name) for name in ("findings", "of_paper", "title", "opening")}
    parts["tally"] = tally(claims) if material.of_paper else None
    parts |= {"lead": material.lead, "sections": [section for make in SECTIONS for section in make(material)]}
    return html.rendered("template.html", names=names, sets=count(sets), digests=Markup(digests()), **parts)


def printed(material: Material) -> Iterator[str]:
    """The findings for a terminal, numbered, in lines of at most 100 characters."""
    words = [one_line(f"{finding.head} {finding.rest}").replace("`", "") for finding in material.findings]
    words = [line.replace(" %", "\N{NO-BREAK SPACE}%") for line in words]
    return columns(([str(number), line] for number, line in enumerate(words, start=1)), align="><", width=100)


def save(page: str, path: Path) -> Path:
    """Write a page to a file, whole or not at all.

    Returns:
        The path.

    Raises:
        RunError: if it cannot be written.
    """
    return style.save_bytes(path, page.encode("utf-8", "replace"))  # a folder's name may hold bytes that are not text

"""Section of a run: errors over the bound, statuses of the fits, the worst trials."""

import shlex
from collections.abc import Callable
from functools import partial

import pandas as pd

from study.analysis.medians_at_bounds import has_bounds, medians_at_bounds
from study.estimators import Status
from study.estimators.status import explain
from study.experiment.conditions import LABELS, SAMPLES, RowValues, bound_law, named_in
from study.figures import style
from study.report import words
from study.report.blocks import (
    Block,
    Content,
    Folded,
    Heading,
    InlineCode,
    Note,
    Row,
    Section,
    Table,
    Text,
)
from study.report.material import Record
from study.report.overview import run_id
from study.report.precision import precision
from study.report.provenance import provenance, times

_LONG = 40
_TOO_LONG = 1000


def run_section(record: Record) -> Section:
    """Section with all tables of a run."""
    shown = {
        "Error against the bound": ("efficiency", efficiency),
        **({"Trials by need": ("precision", precision)} if record.run.has("precision") else {}),
    }
    folded = {
        "How the fits ended": ("status", statuses),
        "The worst trials": ("worst", worst_trials),
        "Time": ("time", times),
        "Provenance": ("provenance", provenance),
    }
    content: list[Block] = []
    for title, (name, make) in shown.items():
        content += [Heading(title, f"{name}-{record.name}"), *make(record)]
    for title, (name, make) in folded.items():
        content.append(Folded(title, make(record), printed=False, id=f"{name}-{record.name}"))
    return Section(f"Run {record.name}", run_id(record), content, listed=False)


def efficiency(record: Record) -> list[Block]:
    """Median error over the bound: a row per group, a column per estimator."""
    frame = record.summary
    if frame["group"].nunique() > _TOO_LONG:
        return [Text(["There are too many conditions for a table; ", InlineCode("summary.parquet"), " has them."])]
    by_decade = bool(frame["decade"].notna().any())
    titles, conditions, fixed = _conditions(frame, by_decade)
    shown = [name for name in record.estimators if name in set(frame["estimator"])]
    bounded, rows = has_bounds(record.run.study), []
    groups: dict[object, list[RowValues]] = {}
    for row in frame.to_dict("records"):
        groups.setdefault(row["group"], []).append(row)
    for part in groups.values():
        found = {str(row["estimator"]): row for row in part}
        first = next(iter(found.values()))
        cells: list[Content] = [*(make(first) for make in conditions), words.count(int(first["planned"]))]
        if bounded:
            cells += [f"{value:.3g}" for value in medians_at_bounds(record.run.study, first)]
        rows.append(Row([*cells, *(_ratio(found[name]) if name in found else "–" for name in shown)]))
    least = words.count(int(frame["planned"].min()))
    law = f" ({name})" if (name := bound_law(frame)) else ""
    efficient = (
        "The columns CRLB and attainable have the medians of Gaussian errors at the Cramér-Rao bound, which treats the "
        "directions as known, and at the attainable bound, which does not. "
        if bounded
        else "An estimator with Gaussian errors at the bound has about 0.7 to 0.9. "
    )
    caption = (
        f"Distance of the estimated from the true centre over the bound √tr CRLB{law} of the same points: median of "
        "all trials, whatever the fit's status, ± its Monte-Carlo error (∞: too few trials for one), so that columns "
        "compare the same trials. A fit without a number counts as infinitely far. Below a median stands the share of "
        f"fits that are not ok. {efficient}"
        f"At least {least} trial{'s' * (least != '1')} a row{fixed}."
    )
    head = [*titles, "trials", *(["CRLB", "attainable"] if bounded else []), *(style.label(name) for name in shown)]
    table = Table(f"Error over the bound, {record.name}", caption, head, rows, numeric=frozenset(range(len(head))))
    if len(rows) <= _LONG:
        return [table]
    summary = f"The table of all {words.count(len(rows))} conditions"
    return [Text("There are many conditions; the figures show them better."), Folded(summary, table, printed=False)]


def _conditions(frame: pd.DataFrame, by_decade: bool) -> tuple[list[str], list[Callable[[RowValues], str]], str]:
    """Titles and formats of the columns that distinguish groups, and the conditions that all groups share."""
    if by_decade:
        return ["σ/r from"], [_decade], ""
    made = {c: partial(words.condition, c) for c in LABELS if not c.stored or c.name in frame}
    records = frame.drop_duplicates("group").to_dict("records")
    columns = {c: [make(row) for row in records] for c, make in made.items()}
    vary = [c for c, texts in columns.items() if len(set(texts)) > 1] or [SAMPLES]
    fixed = ", ".join(f"{c.symbol} = {texts[0]}" for c, texts in columns.items() if c not in vary)
    return [c.symbol for c in vary], [made[c] for c in vary], f", all at {fixed}" if fixed else ""


def _decade(row: RowValues) -> str:
    return words.power_of_ten(int(row["decade"]))


def _ratio(row: RowValues) -> Content:
    ok, planned = int(row["ok"]), int(row["planned"])
    text = words.measured(row["ratio_median"], row["ratio_median_error"])
    return [text, Note(f"{words.percent(planned - ok, planned)} not ok")] if ok < planned else text


def statuses(record: Record) -> list[Block]:
    """Table of counts: a row per status that occurs, a column per estimator."""
    known = ["planned", *(status.name.lower() for status in Status)]
    names = [name for name in known if name in record.summary]  # an older run may lack newer statuses
    counts = record.summary.groupby("estimator", observed=True, sort=False)[names].sum()
    rows = []
    for name in names:
        total = [int(counts[name][estimator]) for estimator in record.estimators]
        if name in ("planned", "ok") or any(total):
            text = "planned" if name == "planned" else Status[name.upper()].text
            rows.append(Row([text, *map(words.count, total)]))
    head = ["Fits", *(style.label(name) for name in record.estimators)]
    caption = "None is ever drawn again or left out."
    numeric = frozenset(range(1, len(head)))
    return [Table(f"How the fits ended, {record.name}", caption, head, rows, numeric=numeric)]


def worst_trials(record: Record) -> list[Block]:
    """Table of the trials with the largest errors over the bound, with the commands that replay them."""
    frame = record.worst
    if frame is None:
        return [Text('The study kept its summary alone (keep = "summary"): which trials were worst is not known.')]
    if frame.empty:
        return [Text("No fit is ok and has a finite bound.")]
    folder = shlex.quote(str(record.run.folder))
    conditions = named_in(frame)
    rows = [
        Row(
            [
                InlineCode(str(row["cell"])),
                str(row["trial"]),
                style.label(str(row["estimator"])),
                *(words.condition(condition, row) for condition in conditions),
                words.timed(row["ratio"]),
                explain(int(row["status"])),
                InlineCode(f"study replay {folder} {shlex.quote(str(row['cell']))} {row['trial']}"),
            ]
        )
        for _, row in frame.iterrows()
    ]
    symbols = [c.symbol for c in conditions]
    head = ["Cell", "Trial", "Estimator", *symbols, "Error over bound", "Status", "To see it again"]
    law = f" ({name})" if (name := bound_law(frame)) else ""
    caption = (
        f"Largest error over a finite bound{law} among the fits that are ok; a trial counts once, by its worst "
        "estimator. The command draws the same points again; the fits that it shows are those of the version installed."
    )
    label = f"The worst trials, {record.name}"
    return [Table(label, caption, head, rows, numeric=frozenset({1, *range(3, 4 + len(conditions))}), stacked=True)]

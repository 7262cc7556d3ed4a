"""Section of the posteriors: beside the fits and the bound, and their calibration."""

from collections.abc import Iterable

import pandas as pd
from markupsafe import Markup

from study import style
from study.simulation.experiment.conditions import named_in
from study.simulation.posterior import run
from study.simulation.report import html, words
from study.simulation.report.html import Section
from study.simulation.report.material import Material, Record

_LONG = 20


def posterior_section(material: Material) -> Iterable[Section]:
    """Section of the posteriors; empty if no run has them."""
    content: list[Markup] = []
    for record in material.records:
        if record.run.has("posterior"):
            posteriors, answers = record.run.table("posterior"), record.run.table("answers")
            if posteriors.empty:  # no chain was run; `study verify` tells of chains that are missing
                continue
            content += [
                html.heading(f"Run {record.name}", f"posterior-{record.name}"),
                *_said(record, posteriors, answers),
            ]
    if content:
        yield Section("Posteriors", "posteriors", content)


def _said(record: Record, posteriors: pd.DataFrame, answers: pd.DataFrame) -> list[Markup]:
    cells = run.by_cell(posteriors, answers)
    chains, ok = int(cells["chains"].sum()), int(cells["ok"].sum())
    curved = cells[(cells["flatness"] < run.FLAT) & (cells["likelihood"] == "geometric")]
    known = curved[curved["noise_is"] == "known"]
    said = f"{words.count(chains)} ensemble posteriors, of which {words.count(ok)} converged."
    if len(known) and known["ok"].sum():
        said += (
            f" With σ known and σ²/v < {run.FLAT:g} the posterior mean of no component of centre or radius "
            f"lies further than {known['shift'].max():.2f} posterior standard deviations from the maximum-likelihood "
            f"answer, and its standard deviations are {known['least'].min():.2f} to {known['most'].max():.2f} of the "
            "Cramér-Rao bound's."
        )
    table = _cells(record, cells)
    shown: Markup = (
        table if len(cells) <= _LONG else html.folded(f"All {len(cells)} kinds of chain", table, printed=False)
    )
    return [html.paragraph(said), *_coverage(record, posteriors, answers), shown]


def _cells(record: Record, cells: pd.DataFrame) -> Markup:
    conditions = named_in(cells)
    head = [*(c.symbol for c in conditions), "likelihood", "σ", "σ²/v", "ok", "shift from MLE", "sd over bound", "τ"]
    rows = []
    for row in cells.to_dict("records"):
        numbers = ["–", "–", "–"]
        if row["ok"]:
            shift = f"{row['shift']:.2f}" if pd.notna(row["shift"]) else "–"
            numbers = [shift, f"{row['least']:.2f} to {row['most']:.2f}", f"{row['tau']:.0f}"]
        rows.append(
            [
                *(words.condition(condition, row) for condition in conditions),
                str(row["likelihood"]).replace("_", " "),
                str(row["noise_is"]),
                words.number(row["flatness"]),
                f"{row['ok']} of {row['chains']}",
                *numbers,
            ]
        )
    caption = (
        "Per condition: chains that converged; the largest shift of the posterior mean from the MLE in any component, "
        "in posterior standard deviations; the range of those over the bound's (where σ is "
        "unknown they follow σ̂); the longest autocorrelation time, in steps."
    )
    words_at = {len(conditions), len(conditions) + 1}
    return html.table(f"Posteriors, {record.name}", caption, head, rows, numeric=frozenset(range(len(head))) - words_at)


def _coverage(record: Record, posteriors: pd.DataFrame, answers: pd.DataFrame) -> list[Markup]:
    """Table of coverage: share of sets of a nominal level that hold the truth."""
    if not record.run.study.independent():
        return [
            html.note("Coverage is not shown: cells of this run share draws, and so are not independent of each other.")
        ]
    everything = run.trials(posteriors, answers)
    curved = everything[everything["flatness"] < run.FLAT]
    if curved.empty:
        return []
    rows = []
    for keys, part in run.coverage(curved).groupby(["likelihood", "noise_is", "method"], sort=False):
        likelihood, noise_is, method = (str(key) for key in keys)
        chain = method == "posterior"
        name = f"posterior ({likelihood.replace('_', ' ')})" if chain else style.label(method)
        shares = [
            f"{100 * row['share']:.1f} % ({100 * row['low']:.1f} to {100 * row['high']:.1f})"
            for row in part.to_dict("records")
        ]
        first = part.iloc[0]
        rows.append([name, noise_is, words.count(int(first["trials"])), words.count(int(first["failed"])), *shares])
    caption = (
        "Share of trials whose true centre lies in sets of nominal level, with the exact binomial 95 % interval. What "
        f"is not ok counts as outside. Only conditions with σ²/v < {run.FLAT:g}."
    )
    head = [
        "sets of",
        "σ",
        "trials",
        "not ok",
        *(f"{level:.0%} sets".replace("%", " %") for level in run.LEVELS),
    ]
    table = html.table(f"Coverage, {record.name}", caption, head, rows, numeric={2, 3, 4, 5})
    note = "An estimator's sets are the ellipsoids of its own covariance, which does not know of a bias (GDKE)."
    return [table, html.note(note)]

"""Sections about runs: what was run on which machine, errors over the bound, statuses, worst trials, provenance.

An adaptive run has a table of cells by the reason why they got no more trials. Posteriors stand beside the fits and the
bound, with their calibration.
"""

import shlex
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
import pandas as pd
from markupsafe import Markup

from study import style
from study.fits import Status
from study.simulation.analysis.summary import has_bounds, medians_at_bounds
from study.simulation.experiment.conditions import LABELS, SAMPLES, RowValues, bound_law, named_in
from study.simulation.figures import Tables
from study.simulation.posterior import run as posterior
from study.simulation.report import html, words
from study.simulation.report.html import Content, Section
from study.simulation.report.material import Material
from study.simulation.statistics import PERFORMANCE
from study.text import one_line

_HEAD = ["Run", "Design", "Estimators", "Trials", "Samples", "Seed", "Computed on", "Seconds", "Workers"]


def overview_section(material: Material) -> Iterable[Section]:
    """A row per run."""
    caption = "Trials are data sets, over all cells; samples are the points in them, each fitted by every estimator."
    rows = [_row(tables) for tables in material.runs]
    table = html.table("The runs", caption, _HEAD, rows, numeric={3, 4, 5, 7, 8}, look="stacked")
    yield Section("What was run", "runs", [table])


def run_id(tables: Tables) -> str:
    """Anchor of a run's section."""
    return f"run-{tables.name}"


def _row(tables: Tables) -> list[Content]:
    study, manifest = tables.run.study, tables.run.facts()
    machine = manifest.machine
    cores = f", {machine.cores}\u00a0cores" if machine.cores else ""
    law = "" if study.noise_law.isotropic else f"; {study.noise_law.words}"
    return [
        [html.link(tables.name, run_id(tables)), html.note(["of the config ", html.code(study.name)])],
        f"{words.dimension(study)}; {words.design(study)}{law}",
        html.coded(", ".join(map(words.estimator, tables.estimators))),
        words.count(tables.trials),
        words.count(tables.samples) if tables.samples < 1_000_000 else words.number(tables.samples),
        str(study.seed),
        [f"{machine.processor}{cores}", html.note(words.moment(manifest.started))],
        words.timed(manifest.seconds),
        str(manifest.jobs),
    ]


_REASONS = {
    "target": "the target is reached",
    "cap": "the cap is reached, the target not",
    "budget": "the budget of time ended",
}


def precision(tables: Tables) -> list[Markup]:
    """Table with a row per reason why cells got no more trials."""
    asked, frame = tables.run.study.precision, tables.run.table("precision")
    assert asked is not None
    relative = f"{words.number(100.0 * (asked.relative_target or 0.0))} % of it"
    goal = f"at most {relative if asked.target is None else words.number(asked.target)}"
    whose = ", ".join(asked.estimators) if asked.estimators else "every estimator"
    rows = []
    for reason, meaning in _REASONS.items():
        part = frame[frame["reason"] == reason]
        if len(part):
            least, most = words.count(int(part["trials"].min())), words.count(int(part["trials"].max()))
            rows.append([meaning, words.count(len(part)), least if least == most else f"{least} to {most}"])
    caption = one_line("""
        A cell stops at the first checkpoint where the Monte-Carlo error is small enough. A cell stops early if that
        error is estimated too small, so quote the target instead: 2 targets on either side hold the truth in 97 % of
        the cells that reached theirs, 2 of the errors shown in 93 %.
    """)
    head = ["Why there are no more trials", "cells", "trials of each"]
    table = html.table(f"Trials by need, {tables.name}", caption, head, rows, numeric={1, 2})
    title = f"the {PERFORMANCE[asked.measure].title}" if asked.measure in PERFORMANCE else "this column of a measure"
    told: list[str] = [
        f"Trials were added until the Monte-Carlo error of {title} (",
        html.code(asked.measure),
        f") was {goal}, for {whose}.",
    ]
    return [html.paragraph(told), table]


_MANY_SAMPLES = 12
_STEPS = {
    "draw": "drawing directions and noise",
    "bound": "the Cramér-Rao bound",
    "points": "placing the points",
    "moments": "moments, shared by all estimators",
}


def times(tables: Tables) -> list[Markup]:
    """Seconds of each step, and nanoseconds per sample, in all and by the number of samples."""
    frame, facts = tables.run.table("timings"), tables.run.facts()
    frame = frame.assign(handled=frame["fits"] * frame["samples"])
    steps = [str(step) for step in frame["step"].unique()]
    rows = []
    for step, part in frame.groupby("step", sort=False, observed=True):
        seconds = words.timed(float(part["seconds"].sum()))
        rows.append([_step(str(step)), words.count(int(part["fits"].sum())), seconds, _per_sample(part)])
    caption = one_line(f"""
        Seconds are of all workers together ({facts.jobs}); the run took {words.timed(facts.seconds)} s by the clock,
        {words.timed(facts.seconds_computing)} s of them computing. An estimator's time is without the moments.
    """)
    head = ["Step", "Data sets", "Seconds", "ns per sample"]
    blocks: list[Markup] = [html.table(f"Time by step, {tables.name}", caption, head, rows, numeric={1, 2, 3})]
    if frame["samples"].nunique() > 1:
        table = _by_samples(frame, steps, tables.name)
        blocks.append(html.folded("Nanoseconds per sample, by the number of samples", table))
    return blocks


def _by_samples(frame: pd.DataFrame, steps: list[str], name: str) -> Markup:
    """Table whose columns are numbers of samples, or their decades if there are many."""
    text: Callable[[int], str]
    if frame["samples"].nunique() > _MANY_SAMPLES:
        frame = frame.assign(level=np.floor(np.log10(frame["samples"]) + 1e-9).astype(int))
        caption, text = "By the decade of the number of samples N, from its lower end.", words.power_of_ten
    else:
        frame = frame.assign(level=frame["samples"])
        caption, text = "By the number of samples N.", words.count
    levels = sorted(set(frame["level"]))
    rows = []
    for step in steps:
        part = frame[frame["step"] == step]
        rows.append([_step(step), *(_per_sample(part[part["level"] == level]) for level in levels)])
    head = ["Step", *(text(int(level)) for level in levels)]
    numeric = frozenset(range(1, len(head)))
    return html.table(f"Nanoseconds per sample, {name}", caption, head, rows, numeric=numeric)


def _per_sample(part: pd.DataFrame) -> str:
    handled = int(part["handled"].sum())
    return words.timed(1e9 * float(part["seconds"].sum()) / handled) if handled else "–"


def _step(name: str) -> str:
    return _STEPS.get(name, style.label(name))


def provenance(tables: Tables) -> list[Markup]:
    """Facts on a run's origin, and the command that reproduces it."""
    manifest, folder = tables.run.facts(), tables.run.folder
    software, machine, main = manifest.software, manifest.machine, tables.run.study.keep
    config = (folder / "config.toml").read_text(encoding="utf-8")
    commit: Content = "unknown: not run from a checkout"
    if software.commit:
        state = "with changes that were not committed" if software.dirty else "nothing uncommitted"
        commit = [html.code(software.commit), f", {state}"]
    packages = ", ".join(f"{name} {version}" for name, version in software.packages.items() if version)
    threads = ", ".join(f"{pool} {n}" for pool, n in machine.threads.items())
    facts: list[tuple[str, Content]] = [
        ("Version", f"sphere-fit-study {software.study}, Python {software.python}"),
        ("Commit", commit),
        *([("Software Heritage", html.code(software.directory))] if software.directory and not software.dirty else []),
        ("Packages", packages),
        ("Machine", f"{machine.processor}, {machine.cores or 'unknown number of'} cores, {machine.system}"),
        ("Code generated for", software.code_generated_for),
        ("Threads of libraries", threads or "no limits"),
        ("Workers", str(manifest.jobs)),
        ("Started", words.moment(manifest.started)),
        ("Seed", str(tables.run.study.seed)),
        ("Digest of the config", html.code(tables.run.study.digest())),
        (f"SHA-256 of {main}.parquet", html.code(tables.run.fingerprint(main) or "")),
    ]
    command = ["study", "run", str(folder / "config.toml"), "--jobs", str(manifest.jobs), *tables.run.plugins()]
    other = shlex.quote(f"{folder}-again")
    return [
        html.facts(facts),
        html.folded("The config, as it was given", html.verbatim(config, f"Config of {tables.name}")),
        html.paragraph(
            "To run it again, into another folder; with the same versions the error table is equal to the byte:"
        ),
        html.verbatim(f"{shlex.join(command)} --out {other}", f"Command that runs {tables.name} again"),
        *([html.paragraph("The commit above does not hold all of the code that ran.")] if software.dirty else []),
    ]


_LONG = 40
_TOO_LONG = 1000


def run_section(tables: Tables) -> Section:
    """Section with all tables of a run."""
    shown = {
        "Error against the bound": ("efficiency", efficiency),
        **({"Trials by need": ("precision", precision)} if tables.run.has("precision") else {}),
    }
    folded = {
        "How the fits ended": ("status", statuses),
        "The worst trials": ("worst", worst_trials),
        "Time": ("time", times),
        "Provenance": ("provenance", provenance),
    }
    content: list[Markup] = []
    for title, (name, make) in shown.items():
        content += [html.heading(title, f"{name}-{tables.name}"), *make(tables)]
    for title, (name, make) in folded.items():
        content.append(html.folded(title, make(tables), printed=False, id=f"{name}-{tables.name}"))
    return Section(f"Run {tables.name}", run_id(tables), content, listed=False)


def efficiency(tables: Tables) -> list[Markup]:
    """Median error over the bound: a row per group, a column per estimator."""
    frame = tables.summary
    if frame["group"].nunique() > _TOO_LONG:
        said = ["There are too many conditions for a table; ", html.code("summary.parquet"), " has them."]
        return [html.paragraph(said)]
    titles, conditions, fixed = _conditions(frame)
    bounded, rows = has_bounds(tables.run.study), []
    fits = {(row["group"], row["estimator"]): row for row in frame.to_dict("records")}
    for group in frame["group"].unique():
        mine = [fits.get((group, name)) for name in tables.estimators]
        first = next(filter(None, mine))
        cells: list[Content] = [*(make(first) for make in conditions), words.count(int(first["planned"]))]
        if bounded:
            cells += [f"{value:.3g}" for value in medians_at_bounds(tables.run.study, first)]
        rows.append([*cells, *(_ratio(row) if row else "–" for row in mine)])
    least = words.count(int(frame["planned"].min()))
    law = f" ({name})" if (name := bound_law(frame)) else ""
    efficient = (
        "The columns CRLB and attainable have the medians of Gaussian errors at the Cramér-Rao bound, which treats the "
        "directions as known, and at the attainable bound, which does not. "
        if bounded
        else "An estimator with Gaussian errors at the bound has about 0.7 to 0.9. "
    )
    caption = one_line(f"""
        Distance of the estimated from the true centre over the bound √tr CRLB{law} of the same points: median of all
        trials, whatever the fit's status, ± its Monte-Carlo error (∞: too few trials for one), so that columns compare
        the same trials. A fit without a number counts as infinitely far. Below a median stands the share of fits that
        are not ok. {efficient}At least {least} trial{"s" * (least != "1")} a row{fixed}.
    """)
    head = [*titles, "trials", *(["CRLB", "attainable"] if bounded else []), *map(style.label, tables.estimators)]
    table = html.table(f"Error over the bound, {tables.name}", caption, head, rows, numeric=range(len(head)))
    if len(rows) <= _LONG:
        return [table]
    folded = html.folded(f"The table of all {words.count(len(rows))} conditions", table, printed=False)
    return [html.paragraph("There are many conditions; the figures show them better."), folded]


def _conditions(frame: pd.DataFrame) -> tuple[list[str], list[Callable[[RowValues], str]], str]:
    """Titles and formats of the columns that distinguish groups, and the conditions that all groups share."""
    if frame["decade"].notna().any():
        return ["σ/r from"], [lambda row: words.power_of_ten(int(row["decade"]))], ""
    made = {c: partial(words.condition, c) for c in LABELS if not c.stored or c.name in frame}
    records = frame.drop_duplicates("group").to_dict("records")
    columns = {c: [make(row) for row in records] for c, make in made.items()}
    vary = [c for c, texts in columns.items() if len(set(texts)) > 1] or [SAMPLES]
    fixed = ", ".join(f"{c.symbol} = {texts[0]}" for c, texts in columns.items() if c not in vary)
    return [c.symbol for c in vary], [made[c] for c in vary], f", all at {fixed}" if fixed else ""


def _ratio(row: RowValues) -> Content:
    ok, planned = int(row["ok"]), int(row["planned"])
    text = words.measured(row["ratio_median"], row["ratio_median_error"])
    return [text, html.note(f"{words.percent(planned - ok, planned)} not ok")] if ok < planned else text


def statuses(tables: Tables) -> list[Markup]:
    """Table of counts: a row per status that occurs, a column per estimator."""
    known = ["planned", *(status.name.lower() for status in Status)]
    names = [name for name in known if name in tables.summary]  # an older run may lack newer statuses
    counts = tables.summary.groupby("estimator", observed=True, sort=False)[names].sum()
    rows = []
    for name in names:
        total = [int(counts[name][estimator]) for estimator in tables.estimators]
        if name in ("planned", "ok") or any(total):
            text = "planned" if name == "planned" else Status[name.upper()].text
            rows.append([text, *map(words.count, total)])
    head = ["Fits", *map(style.label, tables.estimators)]
    caption = "None is ever drawn again or left out."
    return [html.table(f"How the fits ended, {tables.name}", caption, head, rows, numeric=range(1, len(head)))]


def worst_trials(tables: Tables) -> list[Markup]:
    """Table of the trials with the largest errors over the bound, with the commands that replay them."""
    if "errors" not in tables.stored:
        words_of = 'The study kept its summary alone (keep = "summary"): which trials were worst is not known.'
        return [html.paragraph(words_of)]
    frame = tables.worst[0]
    if frame.empty:
        return [html.paragraph("No fit is ok and has a finite bound.")]
    folder = shlex.quote(str(tables.run.folder))
    conditions = named_in(frame)
    rows: list[list[Content]] = []
    for row in frame.to_dict("records"):
        cell, trial = str(row["cell"]), str(row["trial"])
        values = [words.condition(condition, row) for condition in conditions]
        again = html.code(f"study replay {folder} {shlex.quote(cell)} {trial}")
        rows.append([html.code(cell), trial, style.label(str(row["estimator"])), *values])
        rows[-1] += [words.timed(row["ratio"]), Status(int(row["status"])).text, again]
    symbols = [c.symbol for c in conditions]
    head = ["Cell", "Trial", "Estimator", *symbols, "Error over bound", "Status", "To see it again"]
    law = f" ({name})" if (name := bound_law(frame)) else ""
    caption = one_line(f"""
        Largest error over a finite bound{law} among the fits that are ok; a trial counts once, by its worst estimator.
        The command draws the same points again; the fits that it shows are those of the version installed.
    """)
    numeric = {1, *range(3, 4 + len(conditions))}
    return [html.table(f"The worst trials, {tables.name}", caption, head, rows, numeric=numeric, look="stacked")]


_LONG_CHAINS = 20


def posterior_section(material: Material) -> Iterable[Section]:
    """Section of the posteriors; empty if no run has them."""
    content: list[Markup] = []
    for tables in material.runs:
        if tables.run.has("posterior"):
            posteriors, answers = tables.run.table("posterior"), tables.run.table("answers")
            if posteriors.empty:  # no chain was run; `study verify` tells of chains that are missing
                continue
            content.append(html.heading(f"Run {tables.name}", f"posterior-{tables.name}"))
            content += _said(tables, posteriors, answers)
    if content:
        yield Section("Posteriors", "posteriors", content)


def _said(tables: Tables, posteriors: pd.DataFrame, answers: pd.DataFrame) -> list[Markup]:
    cells = posterior.by_cell(posteriors, answers)
    chains, ok = int(cells["chains"].sum()), int(cells["ok"].sum())
    curved = cells[(cells["flatness"] < posterior.FLAT) & (cells["likelihood"] == "geometric")]
    known = curved[curved["noise_is"] == "known"]
    said = f"{words.count(chains)} ensemble posteriors, of which {words.count(ok)} converged."
    if len(known) and known["ok"].sum():
        said += " " + one_line(f"""
            With σ known and σ²/v < {posterior.FLAT:g} the posterior mean of no component of centre or radius lies
            further than {known["shift"].max():.2f} posterior standard deviations from the maximum-likelihood answer,
            and its standard deviations are {known["least"].min():.2f} to {known["most"].max():.2f} of the Cramér-Rao
            bound's.
        """)
    table = _chain_kinds(tables, cells)
    if len(cells) > _LONG_CHAINS:
        table = html.folded(f"All {len(cells)} kinds of chain", table, printed=False)
    return [html.paragraph(said), *_coverage(tables, posteriors, answers), table]


def _chain_kinds(tables: Tables, cells: pd.DataFrame) -> Markup:
    conditions = named_in(cells)
    head = [*(c.symbol for c in conditions), "likelihood", "σ", "σ²/v", "ok", "shift from MLE", "sd over bound", "τ"]
    rows = []
    for row in cells.to_dict("records"):
        numbers = ["–", "–", "–"]
        if row["ok"]:
            shift = f"{row['shift']:.2f}" if pd.notna(row["shift"]) else "–"
            numbers = [shift, f"{row['least']:.2f} to {row['most']:.2f}", f"{row['tau']:.0f}"]
        kind = [str(row["likelihood"]).replace("_", " "), str(row["noise_is"]), words.number(row["flatness"])]
        values = [words.condition(condition, row) for condition in conditions]
        rows.append([*values, *kind, f"{row['ok']} of {row['chains']}", *numbers])
    caption = one_line("""
        Per condition: chains that converged; the largest shift of the posterior mean from the MLE in any component, in
        posterior standard deviations; the range of those over the bound's (where σ is unknown they follow σ̂); the
        longest autocorrelation time, in steps.
    """)
    words_at = {len(conditions), len(conditions) + 1}
    return html.table(f"Posteriors, {tables.name}", caption, head, rows, numeric=frozenset(range(len(head))) - words_at)


def _coverage(tables: Tables, posteriors: pd.DataFrame, answers: pd.DataFrame) -> list[Markup]:
    """Table of coverage: share of sets of a nominal level that hold the truth."""
    if not tables.run.study.independent():
        said = "Coverage is not shown: cells of this run share draws, and so are not independent of each other."
        return [html.note(said)]
    everything = posterior.trials(posteriors, answers)
    curved = everything[everything["flatness"] < posterior.FLAT]
    if curved.empty:
        return []
    rows = []
    for keys, part in posterior.coverage(curved).groupby(["likelihood", "noise_is", "method"], sort=False):
        likelihood, noise_is, method = (str(key) for key in keys)
        chain = method == "posterior"
        name = f"posterior ({likelihood.replace('_', ' ')})" if chain else style.label(method)
        shares = [
            f"{100 * row['share']:.1f} % ({100 * row['low']:.1f} to {100 * row['high']:.1f})"
            for row in part.to_dict("records")
        ]
        first = part.iloc[0]
        rows.append([name, noise_is, words.count(int(first["trials"])), words.count(int(first["failed"])), *shares])
    caption = one_line(f"""
        Share of trials whose true centre lies in sets of nominal level, with the exact binomial 95 % interval. What is
        not ok counts as outside. Only conditions with σ²/v < {posterior.FLAT:g}.
    """)
    head = ["sets of", "σ", "trials", "not ok", *(f"{level:.0%} sets".replace("%", " %") for level in posterior.LEVELS)]
    table = html.table(f"Coverage, {tables.name}", caption, head, rows, numeric={2, 3, 4, 5})
    note = "An estimator's sets are the ellipsoids of its own covariance, which does not know of a bias (GDKE)."
    return [table, html.note(note)]

"""Content of the page: each run's tables, read once, the figures that they can feed, and findings in plain sentences.

Every number in a sentence is one of the tables'; none is written here.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from study import style
from study.files import RunError
from study.fits.registry import ESTIMATORS
from study.simulation import figures
from study.simulation.analysis import regret
from study.simulation.claims import CLAIMS, Verdict, judged
from study.simulation.claims.claim import OTHER_CAUSE
from study.simulation.claims.readings import Readings
from study.simulation.experiment.conditions import distinguishing
from study.simulation.experiment.config import summary_line
from study.simulation.figures import Drawing, FigureModule, Gallery, Tables
from study.simulation.figures.figure import Frame, failure, log_axes, look
from study.simulation.report import html, words
from study.simulation.report.words import count
from study.simulation.runs.run_folder import Run
from study.text import one_line, paragraphs

_BEGINNINGS = {
    Verdict.REPRODUCED: "Yes",
    Verdict.MOSTLY: "Mostly",
    Verdict.IN_PART: "In part",
    Verdict.NOT_REPRODUCED: "No",
}
_CLAIMS = {claim.name: claim for claim in CLAIMS}


def _filled(sentence: str, finding: str) -> str:
    """A claim's sentence with the numbers of its finding, as the claims table has them.

    Raises:
        IndexError, ValueError: if it has other numbers than the sentence.
    """
    values = words.values(finding)
    return sentence.format(*values, last=values[-1])


def answer(name: str, verdict: str, finding: str) -> str:
    """Answer a claim in one sentence.

    Args:
        name: the claim's.
        verdict: its verdict.
        finding: the lines of its numbers, as the claims table has them.

    Returns:
        "Yes", "Mostly", "In part" or "No", perhaps of another cause, and the sentence; the verdict itself where it is
        another.
    """
    graded = verdict.removesuffix(OTHER_CAUSE)
    begin = _BEGINNINGS[Verdict(graded)] if graded in _BEGINNINGS else verdict.capitalize()
    if verdict.endswith(OTHER_CAUSE) and graded in _BEGINNINGS:
        begin += OTHER_CAUSE.replace("another", "of another")
    try:
        rest = _filled(_CLAIMS[name].answer, finding)
    except (KeyError, IndexError, ValueError):  # a claim of another version, or one whose numbers are fewer
        rest = words.readable(finding.partition("\n")[0])
    return f"{begin}: {rest}"


_CAP = 45.0
"""Half-angle of the cap that the findings and the picture at the top are about, in degrees."""
_NOISE = 0.3


@dataclass(frozen=True)
class Headline:
    """One of the findings.

    Attributes:
        head: the finding, in a few words; what stands between backticks is code.
        rest: the numbers behind it, likewise.
        claim: number of the claim that it is taken from; 0 for none.
    """

    head: str
    rest: str
    claim: int = 0


def findings(claims: pd.DataFrame, efficiency: Frame | None, readings: Readings | None = None) -> list[Headline]:
    """The findings that the tables allow; the paper's main claim and the estimator to use instead come first.

    Args:
        claims: the claims table; columns as `study.simulation.runs.schemas.CLAIMS`.
        efficiency: medians over the bound, if a run has them; see `study.simulation.figures.fig_efficiency`.
        readings: verdicts under other readings of the paper.
    """
    rows = {row["name"]: row for row in claims.to_dict("records")}
    told = []
    for name, claim in _CLAIMS.items():
        if (row := rows.get(name)) and (head := claim.head(row["verdict"])):
            head = head.format(otherwise=readings.otherwise(name) if readings else "")
            told.append(Headline(head, _filled(claim.story, row["finding"]), int(row["number"])))
    return [*told[:1], *_instead(efficiency), *_reached(efficiency), *told[1:]]


def mean_regret(curves: pd.DataFrame) -> "pd.Series[float]":
    """Each estimator's median error over the least of its cell, as a geometric mean over the cells, the least first."""
    wide = curves.pivot(index=["angle", "level"], columns="estimator", values="ratio")
    least: pd.Series[float] = np.exp(np.log(wide.div(wide.min(axis=1), axis=0)).mean()).sort_values()
    return least


def _instead(efficiency: Frame | None) -> Iterator[Headline]:
    if efficiency is None or efficiency.curves["estimator"].nunique() < 2:
        return
    curves = efficiency.curves[efficiency.curves["level"] < 1.0]  # beyond, the noise hides the sphere from all of them
    if curves.empty:
        return
    regrets = mean_regret(curves)
    first, *rest = [str(name) for name in regrets.index if name in ESTIMATORS and not ESTIMATORS[str(name)].needs]
    if not rest:
        return
    beside = [name for name in ("ugdk", "mle", "gdke") if name in regrets.index and name != first]
    cells = len(curves[["angle", "level"]].drop_duplicates())
    others = "".join(f", {words.estimator(name)}'s {_three(regrets[name])} times" for name in beside)
    yield Headline(
        f"Use the estimator {words.estimator(first)}{' instead' if 'ugdk' in regrets.index else ''}.",
        one_line(f"""
            It does not need the noise level. Over {cells} conditions with {words.count(efficiency.samples)} points and
            noise below the radius, its median error is on average {_three(regrets[first])} times the least of all
            estimators{others}.
        """),
    )


def _three(value: float) -> str:
    return words.number(value, zeros=True)


def nearest_cap(efficiency: Frame) -> float:
    """The half-angle, in degrees, that is nearest to the one that the top of the page is about."""
    return float(min(efficiency.marks["angle"], key=lambda angle: abs(angle - _CAP)))


def _reached(efficiency: Frame | None) -> Iterator[Headline]:
    if efficiency is None:
        return
    angle = nearest_cap(efficiency)
    of_cap = efficiency.attainable[efficiency.attainable["angle"] == angle]
    at = of_cap.iloc[int(np.argmin(np.abs(np.log(of_cap["level"] / _NOISE))))]
    if not math.isfinite(at["ratio"]):
        return
    curves = efficiency.curves
    here = curves[(curves["angle"] == angle) & (curves["level"] == at["level"])].set_index("estimator")["ratio"]
    beside = [name for name in ("corrected", "ugdk") if name in here.index]
    reaches = "".join(f"; {words.estimator(name)} reaches {words.times(here[name])}" for name in beside)
    yield Headline(
        "What can be reached lies above the Cramér-Rao bound where noise is large.",
        one_line(f"""
            On a cap of {angle:g}° with noise of {words.number(at["level"], 2)}\u00a0r the attainable bound, which does
            not take the directions as known, is {words.times(at["ratio"])} the Cramér-Rao bound{reaches}.
        """),
    )


_ALIKE = 2.0
"""Standard errors within which the regret of an estimator is not told from the least."""
_TITLE = "Sphere fits, put to the test"


_FEW = 4
"""Largest number of values of a condition at each of which the best estimators are named."""
_MANY = 6
"""Largest number of estimators that are named in a row."""


def best_where(tables: Tables) -> Iterator[Headline]:
    """The estimators that are best over the cells of a run, over all and by condition, and the fits that are not ok.

    Nothing is said of a random design, or of one estimator.
    """
    study = tables.run.study
    if study.design.kind != "grid" or len(study.estimators) < 2:
        return
    try:
        cells = regret.of_summary(tables.summary) if study.keep == "summary" else tables.regret
    except RunError:  # too few trials
        return
    whole = regret.regret(cells).query("samples == 0").sort_values("median", kind="stable")
    best, others = _told_apart(whole)
    least, told = whole.iloc[0], ", which these trials do not tell apart" * (len(best) > 1)
    named = [f"{words.estimator(name)} {words.measured(median, error)}" for name, median, error in others]
    if len(named) > _MANY:
        named = [*named[: _MANY - 1], f"{len(named) - _MANY + 1} more, up to {words.number(others[-1][1])} times"]
    rest = "".join(f"; {one}" for one in named)
    yield Headline(
        f"Best over all conditions: {_names(best)}{told}.",
        one_line(f"""
            Over {words.count(int(least["cells"]))} conditions, the median error of {words.estimator(best[0])} is on
            average {words.measured(least["median"], least["median_error"])} times the least of all estimators,
            {words.number(least["median_worst"])} times at worst{rest}.
        """),
    )
    first = tables.summary.drop_duplicates("group").set_index("group")
    where, same = list[str](), list[str]()
    for condition in distinguishing(first):
        labels = {str(group): condition.label(row) for group, row in first.iterrows()}
        values = list(dict.fromkeys(labels.values()))
        if not 1 < len(values) <= _FEW:
            continue
        at = cells["cell"].map(labels)
        parts = [regret.regret(cells[at == value]).query("samples == 0") for value in values]
        bests = [_told_apart(part)[0] for part in parts]
        if len(set(map(frozenset, bests))) == 1:
            same.append(condition.symbol)
        else:
            where.append("; ".join(f"{v}: {_names(names)}" for v, names in zip(values, bests, strict=True)))
    if where or same:
        rest = "".join(f"{one}. " for one in where) + f"The same at every {', '.join(same)}." * bool(same)
        yield Headline("By condition.", rest.strip())
    yield _not_ok(tables.summary)


def _not_ok(summary: pd.DataFrame) -> Headline:
    """The shares of fits that are not ok by their estimator's own status."""
    parts = []
    for name, rows in summary.groupby("estimator", sort=False, observed=True):
        share = 1.0 - rows["ok"] / rows["planned"]
        if (most := float(share.max())) > 0.0:
            mean = 1.0 - float(rows["ok"].sum() / rows["planned"].sum())
            parts.append(f"{words.estimator(str(name))} {mean:.1%} of all, {most:.1%} at most in a condition")
    return Headline("Not ok by their own status:", f"{'; '.join(parts) or 'no fit'}.")


def _told_apart(table: pd.DataFrame) -> tuple[list[str], list[tuple[str, float, float]]]:
    """The estimators of least regret that cannot be told apart, and the others with their regret and its error."""
    rows = table.sort_values("median", kind="stable")
    least, error = float(rows["median"].iloc[0]), float(rows["median_error"].iloc[0])
    near = (rows["median"] - least) <= _ALIKE * np.hypot(rows["median_error"], error)
    far = rows[~near]
    others = zip(far["estimator"], far["median"], far["median_error"], strict=True)
    return [str(name) for name in rows["estimator"][near]], [(str(n), float(m), float(e)) for n, m, e in others]


def _names(estimators: Sequence[str]) -> str:
    """Names of estimators that cannot be told apart."""
    *some, last = map(words.estimator, estimators)
    if len(some) >= _MANY:
        some, last = some[: _MANY - 1], f"{len(some) - _MANY + 2} more"
    return f"{', '.join(some)} or {last}" if some else last


_LEAD = "fig_efficiency"
"""Figure that the top of the page has a part of."""
_SHOWN = ("gdke", "lls", "ugdk", "mle", "als", "corrected")
"""Estimators of the paper, and those to use instead, in the order of drawing."""


def lead(efficiency: Frame) -> Markup:
    """The picture at the top of the page."""
    angle = nearest_cap(efficiency)
    at = f"Cap of {angle:g}°, N\u00a0=\u00a0{count(efficiency.samples)}."
    words = f"Median error of each estimator over the Cramér-Rao bound, against noise. {at}"
    advice = " The closer to the lines, the better. Only a biased estimator can lie below them."
    caption = [
        html.paragraph([words, advice]),
        html.paragraph([html.link("The whole figure", "fig_efficiency"), f", {efficiency.stamp}"]),
    ]
    return html.picture("lead", style.encode(draw_lead(efficiency), "png"), words, caption)


@style.journal()
def draw_lead(frame: Frame) -> Figure:
    """Draw the picture at the top of the page, one panel: few estimators, both bounds, the legend where no curve is."""
    angle = nearest_cap(frame)
    figure = Figure(figsize=(4.7, 3.7), layout="constrained")
    ax = figure.subplots()
    log_axes(ax)
    mine = frame.curves[frame.curves["angle"] == angle]
    names = [name for name in _SHOWN if name in set(mine["estimator"])] or list(dict.fromkeys(mine["estimator"]))[:6]
    for name in names:
        curve = mine[mine["estimator"] == name].sort_values("level")
        ax.plot(curve["level"], curve["ratio"], linewidth=1.3, label=style.label(name), **look(name, 4))
    reached = frame.attainable[frame.attainable["angle"] == angle].sort_values("level")
    (line,) = ax.plot(reached["level"], reached["ratio"], color="black", zorder=4, label="attainable bound")
    line.set(linewidth=1.3, linestyle=(0, (4, 2)))
    ax.axhline(1.0, color="black", linewidth=0.9, label="Cramér-Rao bound", zorder=1)
    shown = mine["ratio"][mine["estimator"].isin(names) & np.isfinite(mine["ratio"])]
    low, high = min(0.7, 0.8 * shown.min()), 1.5 * shown.max()
    ax.set_ylim(low, high)
    if high < 50.0 * low:  # powers of ten alone would be too few
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("noise over radius, $σ/r$")
    ax.set_ylabel("median error, Cramér-Rao bound = 1")
    ax.legend(loc="upper left", fontsize=8.0)
    return figure


def picture(name: str, figure: FigureModule, drawing: Drawing, run: str) -> Markup:
    """A figure with its title, its advice and the name of the run as caption."""
    title, advice = described(figure)
    of_run = html.paragraph([html.code(name), f", run {run}"])
    caption = [*(html.paragraph(html.coded(text)) for text in (title, advice) if text), of_run]
    return html.picture(name, drawing.pictures["png"], f"{title} Run {run}.".replace("`", ""), caption)


def described(figure: FigureModule) -> tuple[str, str]:
    """First paragraph of a figure's docstring and its advice on what to look at, "" if none; code in backticks."""
    title, *rest = [part.replace("``", "`") for part in paragraphs(figure)]
    return title, next((part for part in rest if part.startswith("Look at")), "")


class Material:
    """Input of all sections: runs, with their figures.

    Args:
        runs: finished runs.
        claims: the claims table; columns as `study.simulation.runs.schemas.CLAIMS`, perhaps without rows.
        bench: the table that `make bench` stores, if it is given.
        gallery: takes the figures, so that a caller can write them; with PNG among its formats.
        readings: verdicts under other readings of the paper, if they are given.

    Attributes:
        runs: the runs, in the order given, each with its summary in memory.
        pictures: each figure that some run can feed, by name.
        undrawn: for each other figure the runs' reasons, by the run's name.
        lead: the picture at the top of the page, if some run can feed it.
        findings: the findings at the top of the page.
        of_paper: true if a claim of the paper was judged, so that the page is about the paper.
        title: the page's heading: that of the project, or the names of the configs.
        opening: what the runs are about, where that is not the paper: the first comment of each config.

    Raises:
        RunError: if a run did not finish, or is given twice.
    """

    def __init__(
        self,
        runs: Sequence[Run],
        claims: pd.DataFrame,
        bench: pd.DataFrame | None = None,
        gallery: Gallery | None = None,
        readings: Readings | None = None,
    ) -> None:
        self.claims, self.bench, self.readings, self.runs = claims, bench, readings, list[Tables]()
        gallery = gallery or figures.gallery(kinds=["png"])
        for run in runs:
            tables = Tables(run)
            if tables.name in [other.name for other in self.runs]:
                raise RunError(f"{run.folder}: {tables.name} is given twice")
            self.runs.append(tables)
        gallery.draw(self.runs)
        drawings, self.undrawn = gallery.drawings, dict(gallery.undrawn)
        efficiency = drawings[_LEAD].frame if _LEAD in drawings else None
        self.lead: Markup | None = None
        if efficiency is not None:
            try:
                self.lead = lead(efficiency)
            except Exception as error:  # a picture that fails must not cost the page
                self.undrawn["lead"] = {self.runs[drawings[_LEAD].place].name: failure(error)}
        self.pictures = {
            name: picture(name, gallery.figures[name], one, self.runs[one.place].name) for name, one in drawings.items()
        }
        self.of_paper = judged(claims)
        self.title, self.opening = _TITLE, list[str]()
        if not self.of_paper:
            self.title = ", ".join(run.study.name for run in runs)
            self.opening = [words for run in runs if (words := summary_line(run.folder / "config.toml"))]
        best = [] if self.of_paper else [one for tables in self.runs for one in best_where(tables)]
        self.findings = best or findings(claims, efficiency, readings)

"""Content of the page: each run's tables, read once, and the figures that they can feed.

One sentence of answer to each claim, made from the numbers that its verdict was computed from.

The words of a sentence do not depend on the numbers: only its numbers and the verdict change. To answer a new claim,
write an entry in `ANSWERS`; a claim without one is answered by the first of its numbers.

Draw pictures in parallel with other work: in a second process if one is allowed, else at once.

Six findings of the study, in plain sentences; every number is one of the tables', none is written here.

Figures embedded in the page as PNG data URIs, with alternative text.
"""

import base64
import inspect
import math
import multiprocessing
import re
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple, ParamSpec, Self, TypeVar

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from study import style
from study.files import RunError
from study.fits.registry import ESTIMATORS
from study.simulation.analysis.summary import worst_of_run
from study.simulation.claims.claim import Verdict
from study.simulation.figures import FIGURES, FigureModule, KeptPictures, NotApplicable, Tables, failure
from study.simulation.figures.fig_efficiency import EfficiencyFrame
from study.simulation.report import words
from study.simulation.report.blocks import Content, InlineCode, Link, Picture, Text, coded
from study.simulation.report.words import count
from study.simulation.runs.run_folder import Finished, Run

Values = Sequence[float]
"""The values behind a claim, in the order of its finding."""

_BEGINNINGS = {Verdict.REPRODUCED: "Yes", Verdict.PARTLY: "In part", Verdict.NOT_REPRODUCED: "No"}


def parts(share: float) -> str:
    """Format a share as a reader says it: none, all, or per cent to two digits."""
    if math.isnan(share):
        return words.number(share)
    if share in {0.0, 1.0}:
        return "all" if share else "none"
    return f"{words.number(100.0 * share, 3 if share > 0.99 else 2)}\u00a0%"


def times(value: float) -> str:
    """Format a ratio to two digits, three above 100."""
    return f"{words.number(value, 2 if value < 100.0 else 3, zeros=bool(0.1 <= value < 10.0))}\u00a0times"


def power(value: float) -> str:
    """Format an exponent to two decimals."""
    return f"{value:.2f}".replace("-", "−")


ANSWERS: dict[str, Callable[[Values], str]] = {
    "one-line": lambda n: (
        f"over the paper's range MLE's median error grows as σ to the power {power(n[0])}; where GDKE's bias "
        f"dominates, GDKE's as σ to the power {power(n[4])}."
    ),
    "ugdk-closest": lambda n: (
        f"UGDK is clearly the closest in {parts(n[0])} of the decades of noise, and another method is clearly closer "
        f"in {parts(n[1])}."
    ),
    "gdke-on-par": lambda n: (
        f"GDKE's median error is up to {times(n[0])} MLE's; at the smallest noise it is {times(n[1])} MLE's."
    ),
    "mle-outliers": lambda n: (
        f"of the trials with noise around the radius, {parts(n[0])} are such outliers; the best of three starts mends "
        f"{parts(n[1])} of them."
    ),
    "lls-outliers-small": lambda n: (
        f"of LLS's fits there, {parts(n[0])} are outliers, and {parts(n[1])} if small singular values are cut."
    ),
    "lls-outliers-place": lambda n: (
        f"{parts(n[1])} of the outliers lie on the sphere if the design matrix is centred, {parts(n[3])} if it is not."
    ),
    "lls-outliers-large": lambda n: (
        f"of LLS's fits there, {parts(n[0])} are outliers or fail in double precision, {parts(n[1])} in single "
        "precision."
    ),
    "gdke-bias-order": lambda n: (
        f"the bias grows as σ to the power {power(n[0])}, {power(n[1])} and {power(n[2])} on three caps."
    ),
    "gdke-bias-stays": lambda n: (
        f"the bias is {times(n[0])} the scatter, {parts(n[1])} of the 95 % ellipses hold the true centre, and at the "
        f"largest number of samples the bias is {times(n[2])} that at the smallest."
    ),
    "ugdk-efficient": lambda n: (
        f"UGDK's variance along the axis is up to {times(n[0])} the bound's; at the smallest noise it is "
        f"{times(n[2])} the bound's."
    ),
    "bound-for-all": lambda n: (
        f"the least root mean square error is {times(n[0])} the bound; where the bias is not significant it is "
        f"{times(n[2])} the bound."
    ),
    "gdke-even-data": lambda n: (
        f"on the whole sphere GDKE errs up to {times(n[0])} as far as an efficient estimator; on the smallest cap its "
        f"error is up to {times(n[-1])} the bound."
    ),
    "ugdk-bias": lambda n: f"UGDK's bias goes as N to the power {power(n[0])}, GDKE's as N to the power {power(n[1])}.",
    "ugdk-error": lambda n: (
        f"at σ = .02 r the median error goes as N to the power {power(n[0])}; where σ ≥ r, as N to the power "
        f"{power(n[2])}."
    ),
    "figure-4-setting": lambda n: (
        f"{parts(n[0])} of the trials have a smaller ρ than the paper's, {parts(n[1])} have ρ < 1, and {parts(n[2])} "
        "of the ellipses hold the true centre."
    ),
    "noise-from-the-points": lambda n: (
        f"ALS's noise variance is {times(n[0])} the true one, and UGDK with a Σ estimated from the points errs up to "
        f"{times(n[1])} as far as with the true Σ."
    ),
    "markers-averaged": lambda n: (
        f"the fit to all markers errs {times(n[0])} as far as the best marker alone, and less than the worst in "
        f"{parts(n[1])} of the trials."
    ),
    "markers-positive-definite": lambda n: (
        f"the sum is positive definite in {parts(n[1])} of the trials, and in {parts(n[0])} at the worst noise."
    ),
    "same-cost": lambda n: (
        f"UGDK takes {times(n[0])} the operations of GDKE, and on this machine {times(n[1])} its time."
    ),
    "incremental-cost": lambda n: (
        f"IGDK takes {times(n[0])} the operations of GDKE, and on this machine {times(n[1])} its time."
    ),
    "speed": lambda n: f"LLS takes {times(n[0])} the operations of GDKE, MLE {times(n[1])}.",
    "power-law": lambda n: (
        f"the median error of UGDK falls as N to the power {power(n[0])}, GDKE's as N to the power {power(n[2])}."
    ),
    "recordings-within-1-cm": lambda n: f"above 200 samples {parts(n[0])} of the spreads are below 1 cm.",
}
"""Sentences by the name of their claim."""


def answer(name: str, verdict: str, finding: str) -> str:
    """Answer a claim in one sentence.

    Args:
        name: the claim's.
        verdict: its verdict.
        finding: the lines of its numbers, as the claims table has them.

    Returns:
        "Yes", "In part" or "No", and the sentence; the verdict itself where it is another.
    """
    begin = _BEGINNINGS.get(Verdict(verdict), verdict) if verdict in set(Verdict) else verdict.capitalize()
    try:
        rest = ANSWERS[name](words.values(finding))
    except (KeyError, IndexError, ValueError):  # a claim of another version, or one whose numbers are fewer
        rest = words.readable(finding.partition("\n")[0])
    return f"{begin}: {rest}"


P = ParamSpec("P")
T = TypeVar("T")


class Artist:
    """Call functions, in another process if there is one, and return their results later.

    Args:
        executor: another process; None to call each function at once.
    """

    def __init__(self, executor: Executor | None) -> None:
        self._executor = executor

    def begin(self, function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> Callable[[], T]:
        """Begin a call; the function that is returned waits for the result and returns it.

        For another process the function, its arguments and its result must be such that they can be pickled.
        """
        if self._executor is None:
            found = function(*arguments, **named)
            return lambda: found
        future = self._executor.submit(function, *arguments, **named)

        def wait() -> T:
            try:
                return future.result()
            except BrokenProcessPool:  # for want of memory, perhaps
                return function(*arguments, **named)

        return wait


@contextmanager
def artist(jobs: int) -> Iterator[Artist]:
    """An artist with a process of its own, if two are allowed; the process ends with the artist.

    The other process loads the libraries by itself; that takes as long as two figures.
    """
    if jobs < 2:
        yield Artist(None)
        return
    context = multiprocessing.get_context("spawn")  # a fork of a process with threads may wait for ever
    with ProcessPoolExecutor(1, context, _ignore_interrupt) as executor:
        try:
            yield Artist(executor)
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


def _ignore_interrupt() -> None:
    """Leave Ctrl-C, which a terminal sends to both processes, to the other one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


_CAP = 45.0
"""Half-angle of the cap that the findings and the picture at the top are about, in degrees."""
_NOISE = 0.3
_READ = {"ugdk-closest", "gdke-bias-stays", "gdke-bias-order", "lls-outliers-small", "mle-outliers"}
_HOLDS = {Verdict.REPRODUCED: "holds", Verdict.PARTLY: "holds in part", Verdict.NOT_REPRODUCED: "does not hold"}


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


@dataclass(frozen=True)
class _Judged:
    """A claim with a verdict."""

    number: int
    verdict: Verdict
    values: list[float]


class _Cause(NamedTuple):
    """The cause of a method's outliers, shown by two numbers of a claim: one that is above 0, and one that is 0."""

    claim: str
    outliers: str
    finding: str
    numbers: str
    some: int
    none: int


_CAUSES = (
    _Cause(
        "lls-outliers-small",
        "LLS's outliers",
        "come from a cut of small singular values",
        "On tiny caps with tiny noise {some} of its fits are outliers with the cut, {none} without.",
        some=1,
        none=0,
    ),
    _Cause(
        "mle-outliers",
        "MLE's outliers",
        "do not come from other minima",
        "With noise around the radius {some} of its fits are off by about the radius; the best of three starts mends "
        "{none} of them.",
        some=0,
        none=1,
    ),
)


def findings(claims: pd.DataFrame, efficiency: EfficiencyFrame | None) -> list[Headline]:
    """The findings that the tables allow; the paper's main claim and the estimator to use instead come first.

    Args:
        claims: the claims table; columns as `study.simulation.runs.schemas.CLAIMS`.
        efficiency: medians over the bound, if a run has them; see `study.simulation.figures.fig_efficiency`.
    """
    judged = {
        row["name"]: _Judged(int(row["number"]), Verdict(row["verdict"]), words.values(row["finding"]))
        for row in claims.to_dict("records")
        if row["name"] in _READ and row["verdict"] in set(_HOLDS)
    }
    return [*_main(judged), *_instead(efficiency), *_reached(efficiency), *_others(judged)]


def _main(judged: Mapping[str, _Judged]) -> Iterator[Headline]:
    if found := judged.get("ugdk-closest"):
        n = found.values
        yield Headline(
            f"The paper's main claim {_HOLDS[found.verdict]}.",
            f"It says that UGDK comes closest to the Cramér-Rao bound. UGDK is clearly the closest in {parts(n[0])} of "
            f"the decades of noise; another method is clearly closer in {parts(n[1])}. With noise above the radius it "
            f"errs {times(n[2])} as far as the best of the others.",
            found.number,
        )


def regret(curves: pd.DataFrame) -> "pd.Series[float]":
    """Each estimator's median error over the least of its cell, as a geometric mean over the cells, the least first."""
    wide = curves.pivot(index=["angle", "level"], columns="estimator", values="ratio")
    least: pd.Series[float] = np.exp(np.log(wide.div(wide.min(axis=1), axis=0)).mean()).sort_values()
    return least


def _instead(efficiency: EfficiencyFrame | None) -> Iterator[Headline]:
    if efficiency is None or efficiency.curves["estimator"].nunique() < 2:
        return
    curves = efficiency.curves[efficiency.curves["level"] < 1.0]  # beyond, the noise hides the sphere from all of them
    if curves.empty:
        return
    found = regret(curves)
    first, *others = [str(name) for name in found.index if name in ESTIMATORS and not ESTIMATORS[str(name)].needs]
    if not others:
        return
    beside = [name for name in ("ugdk", "mle", "gdke") if name in found.index and name != first]
    cells = len(curves[["angle", "level"]].drop_duplicates())
    yield Headline(
        f"Use the estimator {words.estimator(first)}{' instead' if 'ugdk' in found.index else ''}.",
        f"It does not need the noise level. Over {cells} conditions with {words.count(efficiency.samples)} points and "
        f"noise below the radius, its median error is on average {_three(found[first])} times the least of all "
        "estimators" + "".join(f", {words.estimator(name)}'s {_three(found[name])} times" for name in beside) + ".",
    )


def _three(value: float) -> str:
    return words.number(value, zeros=True)


def nearest_cap(efficiency: EfficiencyFrame) -> float:
    """The half-angle, in degrees, that is nearest to the one that the top of the page is about."""
    return float(min(efficiency.marks["angle"], key=lambda angle: abs(angle - _CAP)))


def _reached(efficiency: EfficiencyFrame | None) -> Iterator[Headline]:
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
    yield Headline(
        "What can be reached lies above the Cramér-Rao bound where noise is large.",
        f"On a cap of {angle:g}° with noise of {words.number(at['level'], 2)}\u00a0r the attainable bound, which does "
        f"not take the directions as known, is {times(at['ratio'])} the Cramér-Rao bound"
        + "".join(f"; {words.estimator(name)} reaches {times(here[name])}" for name in beside)
        + ".",
    )


def _others(judged: Mapping[str, _Judged]) -> Iterator[Headline]:
    if (stays := judged.get("gdke-bias-stays")) and (order := judged.get("gdke-bias-order")):
        powers = dict.fromkeys(power(value) for value in sorted(order.values[:3]))
        yield Headline(
            "GDKE is biased, and more points do not help." if stays.verdict == Verdict.REPRODUCED else "GDKE's bias.",
            f"The bias is {times(stays.values[0])} its scatter, and {parts(stays.values[1])} of its 95 % ellipses hold "
            f"the truth. It grows as σ to the power {' to '.join(powers)}.",
            stays.number,
        )
    for cause in _CAUSES:
        if found := judged.get(cause.claim):
            some, none = found.values[cause.some], found.values[cause.none]
            yield Headline(
                f"{cause.outliers} {cause.finding}." if some > 0.0 == none else f"{cause.outliers}.",
                cause.numbers.format(some=parts(some), none=parts(none)),
                found.number,
            )


_LEAD = "fig_efficiency"
"""Figure that the top of the page has a part of."""
_SHOWN = ("gdke", "lls", "ugdk", "mle", "als", "corrected")
"""Estimators of the paper, and those to use instead, in the order of drawing."""


class Gallery:
    """The figures that runs can feed, each drawn from the first run that can, unless its picture was kept.

    Args:
        artist: draws the pictures; see `study.simulation.report.material`.

    Attributes:
        undrawn: for each figure that no run could feed so far the reasons, by the run's name.
        efficiency: content of the figure that the top of the page has a part of; None where no run can feed it.
    """

    def __init__(self, artist: Artist) -> None:
        self._artist = artist
        self._begun: dict[str, tuple[str, Callable[[], bytes | str]]] = {}
        self._lead: Callable[[], bytes | str] | None = None
        self.undrawn: dict[str, dict[str, str]] = {}
        self.efficiency: EfficiencyFrame | None = None

    def add(self, tables: Tables, pictures: KeptPictures) -> None:
        """Begin to draw the figures that a run can feed and no earlier run could.

        Args:
            tables: the run's.
            pictures: those that were drawn from them before.
        """
        for name, figure in FIGURES.items():
            if name in self._begun:
                continue
            found = pictures.find(name, figure, ["png"])
            try:
                frame = figure.prepare(tables) if found is None or name == _LEAD else None
            except NotApplicable as reason:
                self.undrawn.setdefault(name, {})[tables.name] = str(reason)
            except Exception as error:  # a figure that fails must not cost the page
                self.undrawn.setdefault(name, {})[tables.name] = failure(error)
            else:
                self.undrawn.pop(name, None)
                self._begun[name] = (
                    tables.name,
                    (_given(found["png"]) if found is not None else self._begin(pictures, name, figure, frame)),
                )
                if isinstance(frame, EfficiencyFrame):
                    self.efficiency = frame
                    top = pictures.find("lead", figure, ["png"])
                    self._lead = _given(top["png"]) if top else self._begin(pictures, "lead", figure, frame)

    def _begin(self, pictures: KeptPictures, name: str, figure: FigureModule, frame: Any) -> Callable[[], bytes | str]:
        """Begin to draw a picture; the function returned waits for it, and keeps it."""
        drawing = self._artist.begin(_drawn, name, frame)

        def wait() -> bytes | str:
            if isinstance(drawn := drawing(), bytes):
                pictures.keep(name, figure, {"png": drawn})
            return drawn

        return wait

    def finish(self) -> tuple[dict[str, Picture], Picture | None]:
        """Wait for the pictures.

        Returns:
            The figures, by name and in their order, and the picture at the top of the page; None where no run can feed
            it. A figure that fails does not cost the others; ``undrawn`` has its reason, with its place in the code.
        """
        found = {}
        for name in (name for name in FIGURES if name in self._begun):
            run, drawing = self._begun[name]
            drawn = drawing()
            if isinstance(drawn, bytes):
                found[name] = picture(name, FIGURES[name], drawn, run)
            else:
                self.undrawn[name] = {run: drawn}
        top = self._lead() if self._lead is not None and _LEAD in found else None
        return found, lead(self.efficiency, top) if self.efficiency is not None and isinstance(top, bytes) else None


def _given(picture: bytes) -> Callable[[], bytes]:
    """A function that returns a picture that was kept."""
    return lambda: picture


def lead(efficiency: EfficiencyFrame, data: bytes) -> Picture:
    """The picture at the top of the page, given as PNG."""
    angle = nearest_cap(efficiency)
    at = f"Cap of {angle:g}°, N\u00a0=\u00a0{count(efficiency.samples)}."
    words = f"Median error of each estimator over the Cramér-Rao bound, against noise. {at}"
    advice = " The closer to the lines, the better. Only a biased estimator can lie below them."
    caption = [
        Text([words, advice]),
        Text([Link("The whole figure", "fig_efficiency"), f", {efficiency.stamp}"]),
    ]
    return embedded("lead", data, words, caption)


@style.journal()
def draw_lead(frame: EfficiencyFrame) -> Figure:
    """Draw the picture at the top of the page, one panel: few estimators, both bounds, the legend where no curve is."""
    angle = nearest_cap(frame)
    figure = Figure(figsize=(4.7, 3.7), layout="constrained")
    ax = figure.subplots()
    ax.set_xscale("log")
    ax.set_yscale("log")
    mine = frame.curves[frame.curves["angle"] == angle]
    names = [name for name in _SHOWN if name in set(mine["estimator"])] or list(dict.fromkeys(mine["estimator"]))[:6]
    for name in names:
        curve = mine[mine["estimator"] == name].sort_values("level")
        (line,) = ax.plot(curve["level"], curve["ratio"], linewidth=1.3, label=style.label(name))
        line.set(color=style.color(name), marker=style.marker(name), markersize=4, markeredgewidth=0.0)
    reached = frame.attainable[frame.attainable["angle"] == angle].sort_values("level")
    (line,) = ax.plot(reached["level"], reached["ratio"], color="black", zorder=4, label="attainable bound")
    line.set(linewidth=1.3, linestyle=(0, (4, 2)))
    ax.axhline(1.0, color="black", linewidth=0.9, label="Cramér-Rao bound", zorder=1)
    shown = mine["ratio"][mine["estimator"].isin(names) & np.isfinite(mine["ratio"])]
    ax.set_ylim(min(0.7, 0.8 * shown.min()), 1.5 * shown.max())
    ax.set_xlabel("noise over radius, $σ/r$")
    ax.set_ylabel("median error, Cramér-Rao bound = 1")
    ax.legend(loc="upper left", fontsize=8.0)
    return figure


def _drawn(name: str, frame: Any) -> bytes | str:
    """Draw a figure as PNG; its failure in words if it fails."""
    try:
        return style.encode(draw_lead(frame) if name == "lead" else FIGURES[name].draw(frame), "png")
    except Exception as error:  # a figure that fails must not cost the page
        return failure(error)


def picture(name: str, figure: FigureModule, data: bytes, run: str) -> Picture:
    """A figure's PNG with its title, its advice and the name of the run as caption."""
    title, look = described(figure)
    caption = [Text(coded(title)), *([Text(coded(look))] if look else []), Text([InlineCode(name), f", run {run}"])]
    return embedded(name, data, f"{title} Run {run}.".replace("`", ""), caption)


def embedded(name: str, data: bytes, alt: str, caption: Content) -> Picture:
    """A PNG as a picture that needs no other file."""
    # a PNG begins with a signature, a length and "IHDR"; then come width and height
    width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
    return Picture(name, f"data:image/png;base64,{base64.b64encode(data).decode()}", alt, width, height, caption)


def described(figure: FigureModule) -> tuple[str, str]:
    """First paragraph of a figure's docstring and its advice on what to look at, "" if none; code in backticks."""
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n", inspect.getdoc(figure) or "")]
    paragraphs = [part.replace("``", "`") for part in paragraphs]
    return paragraphs[0], next((part for part in paragraphs[1:] if part.startswith("Look at")), "")


@dataclass(frozen=True)
class Record:
    """One run's tables and facts for the page.

    Attributes:
        run: the folder; what else is stored in it can be read from there.
        name: its name.
        manifest: what ran on what.
        config: the config, as it was given.
        estimators: names, in the config's order.
        trials, samples: data sets of all cells, and the points in them.
        summary, timings: the stored tables.
        worst: the worst trials; see `study.simulation.analysis.summary`. None where the study kept its summary alone.
        worst_of_groups: the worst trial of each group of the summary and estimator, likewise.
        main: name of the table that the study kept: errors, or else summary.
        fingerprint: SHA-256 of that table's file, which equal runs have in common.
    """

    run: Run
    name: str
    manifest: Finished
    config: str
    estimators: list[str]
    trials: int
    samples: int
    summary: pd.DataFrame
    timings: pd.DataFrame
    worst: pd.DataFrame | None
    worst_of_groups: pd.DataFrame | None
    main: str
    fingerprint: str

    @classmethod
    def of(cls, run: Run, tables: Tables) -> Self:
        """Read what else is stored of a run whose tables are loaded.

        Raises:
            RunError: if something is missing.
        """
        one = tables.summary[tables.summary["estimator"] == tables.estimators[0]]
        samples = int((one["planned"] * one["samples"]).sum())
        if tables.design == "random" and "errors" in tables.stored:  # a row of the summary has many numbers of samples
            samples = int(tables.some_errors(["samples"], tables.estimators[:1])["samples"].sum())
        main, found = run.study.keep, worst_of_run(run) if "errors" in tables.stored else None
        return cls(
            run=run,
            name=tables.name,
            manifest=run.facts(),
            config=(run.folder / "config.toml").read_text(encoding="utf-8"),
            estimators=tables.estimators,
            trials=int(one["planned"].sum()),
            samples=samples,
            summary=tables.summary,
            timings=run.table("timings"),
            worst=None if found is None else found.trials,
            worst_of_groups=None if found is None else found.of_groups,
            main=main,
            fingerprint=run.fingerprint(main) or "",
        )


@dataclass(frozen=True)
class Material:
    """Input of all sections.

    Attributes:
        records: the runs, in the order given.
        claims: the claims table; columns as `study.simulation.runs.schemas.CLAIMS`, perhaps without rows.
        pictures: each figure that some run can feed, by name.
        undrawn: for each other figure the runs' reasons, by the run's name.
        lead: the picture at the top of the page, if some run can feed it.
        findings: the findings at the top of the page.
        bench: the table that `make bench` stores, if it is given.
    """

    records: list[Record]
    claims: pd.DataFrame
    pictures: dict[str, Picture]
    undrawn: dict[str, dict[str, str]]
    lead: Picture | None
    findings: list[Headline]
    bench: pd.DataFrame | None = None

    @classmethod
    def of(cls, runs: Sequence[Run], claims: pd.DataFrame, bench: pd.DataFrame | None = None, jobs: int = 1) -> Self:
        """Read runs, one after the other, so that no two error tables are in memory together.

        With two jobs, and runs, figures are drawn in a second process meanwhile.

        Raises:
            RunError: if a run did not finish, or is given twice.
        """
        records: list[Record] = []
        with artist(min(jobs, len(runs))) as drawn_by:
            gallery = Gallery(drawn_by)
            for run in runs:
                tables = Tables.of(run)
                if tables.name in {record.name for record in records}:
                    raise RunError(f"{run.folder}: {tables.name} is given twice")
                gallery.add(tables, KeptPictures(run))
                records.append(Record.of(run, tables))
            found = findings(claims, gallery.efficiency)
            pictures, lead = gallery.finish()
        return cls(records, claims, pictures, gallery.undrawn, lead, found, bench)

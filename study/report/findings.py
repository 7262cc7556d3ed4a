"""Six findings of the study, in plain sentences; every number is one of the tables', none is written here."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.analysis.claims.claim import Verdict
from study.estimators.registry import ESTIMATORS
from study.figures.fig_efficiency import EfficiencyFrame
from study.report import words
from study.report.answers import parts, power, times

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
        claims: the claims table; columns as `study.runs.storage.schemas.CLAIMS`.
        efficiency: medians over the bound, if a run has them; see `study.figures.fig_efficiency`.
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

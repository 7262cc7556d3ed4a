"""Claims of sections 4.1 and 4.4 on outliers: those of MLE and those of LLS, where they are and where they come from.

An outlier is a fit whose error is beyond ten times √tr CRLB, as in figure 2; for LLS also one without a number, and
only where GDKE, which is the same fit in exact arithmetic, errs by less from the same points: what is left is numerics.
"""

import math

import numpy as np
import pandas as pd

from study.analysis.claims.claim import Claim, Evidence, Number, Verdict
from study.analysis.claims.shared_measures import LEAST, beside, level, median, over, with_all
from study.estimators import Status
from study.statistics.measures import UNKNOWN, share
from study.statistics.performance import FAR

_ABOUT_RADIUS = (0.3, 3.0)
_NOISE_ABOUT_RADIUS = (0.1, 10.0)
_MUCH_BETTER = 1.0 / 3.0
_ELSEWHERE = 1e-3
"""Two minima are two if their errors differ by more than this share."""
_SMALL, _ROUNDING, _LARGE = 1e-6, 1e-12, 1e10
"""Relative noise: the paper's two limits, and where the rounding of the points themselves begins to show."""
_ON_SPHERE = 0.1
_CLEAR = 3
"""Outliers that are no accident."""
_FEW = 5
"""Outliers from which their median may be shown; outliers are few by nature."""


def _count(words: str, flags: "pd.Series[bool]") -> Number:
    """Share of data sets for which something holds; unknown if they are too few."""
    total = len(flags)
    return Number.of(words, share(int(flags.sum()), total) if total >= LEAST else UNKNOWN, total)


def _clear(number: Number) -> bool:
    """Whether a share is that of so many data sets that it is no accident."""
    return round(number.value * number.trials) >= _CLEAR


# MLE -----------------------------------------------------------------------------------------------------------------


def _mle_outliers(errors: pd.DataFrame) -> tuple["pd.Series[bool]", pd.DataFrame, "pd.Series[float]"]:
    """Which data sets with noise about the radius have an MLE outlier about the radius, all their errors, and σ/r."""
    relative, ratio = beside(errors, over(errors, "radius")), beside(errors, over(errors, "bound"))
    noise = beside(errors, level(errors))["mle"]
    low, high = _ABOUT_RADIUS
    outliers = (ratio["mle"] > FAR) & (relative["mle"] >= low) & (relative["mle"] <= high)
    return outliers, relative, noise


def _measure_mle(evidence: Evidence) -> list[Number]:
    errors = evidence.table("starts", "errors")
    words = "share of trials, .1 r ≤ σ ≤ 10 r, in which MLE errs by .3 to 3 r and by more than 10 bounds"
    starts = ("mle", "mle_centroid", "mle_mirror")
    if not with_all(errors, *starts, "gdke"):
        return [Number.unknown(words)]
    outliers, relative, noise = _mle_outliers(errors)
    low, high = _NOISE_ABOUT_RADIUS
    found = _count(words, outliers[(noise >= low) & (noise <= high)])
    if math.isnan(found.value) or found.value == 0.0:
        return [found]
    residual = beside(errors, errors["noise_variance"])[list(starts)][outliers].fillna(math.inf)
    least = residual.to_numpy().argmin(axis=1)
    best = np.take_along_axis(relative[list(starts)][outliers].to_numpy(), least[:, None], axis=1)[:, 0]
    of_mle, of_gdke = relative["mle"][outliers], relative["gdke"][outliers]
    cured = best < _MUCH_BETTER * of_mle
    quiet = relative[noise < 0.01]
    other = (quiet["mle_mirror"] - quiet["mle"]).abs() > _ELSEWHERE * quiet["mle"]
    return [
        found,
        Number.of(
            "share of these that the best minimum from three starts cures, to a third of the error or less",
            share(int(cured.sum()), len(cured)) if len(cured) >= _FEW else UNKNOWN,
            len(cured),
        ),
        Number.of("GDKE's error over MLE's in these, median", median(of_gdke / of_mle, _FEW), len(cured)),
        Number.of("σ/r of these, median", median(noise[outliers], _FEW), len(cured)),
        _count("share of trials, σ < .01 r, in which a start on the wrong side ends elsewhere than MLE", other),
        _runaways(relative, beside(errors, errors["status"])),
    ]


def _runaways(relative: pd.DataFrame, status: pd.DataFrame) -> Number:
    """MLE fits that are so far off that their sphere is a plane."""
    return _count(
        "share of all trials in which MLE errs by more than 10⁴ r with status ok",
        (relative["mle"] > 1e4) & (status["mle"] == Status.OK),
    )


def _judge_mle(numbers: list[Number]) -> Verdict:
    if not _clear(numbers[0]):
        return Verdict.NOT_REPRODUCED
    cured = numbers[1]
    return Verdict.REPRODUCED if cured.value - 2.0 * cured.error > 0.5 else Verdict.PARTLY


# LLS -----------------------------------------------------------------------------------------------------------------

_VERSIONS = {
    "lls": "no singular value cut",
    "lls_nr_raw": "cut at 1e-6",
    "lls_nr": "centred, cut at 1e-5",
    "lls_single": "single precision",
}


def _numerical(errors: pd.DataFrame, estimator: str) -> "pd.Series[bool]":
    """Which data sets have an outlier of this estimator that GDKE does not have."""
    ratio = beside(errors, over(errors, "bound"))
    return (ratio[estimator] > FAR) & (ratio["gdke"] <= FAR)


def _measure_small(evidence: Evidence) -> list[Number]:
    errors, paper = evidence.table("outliers", "errors"), evidence.table("paper", "errors")
    if not (with_all(errors, *_VERSIONS, "gdke") and with_all(paper, "lls", "gdke")):
        return [Number.unknown("outliers of LLS")]
    noise = beside(errors, level(errors))["gdke"]
    small, middle = (noise > _ROUNDING) & (noise < _SMALL), (noise >= 10.0 * _SMALL) & (noise < _LARGE)
    numbers = [
        _count(f"share of LLS outliers, 1e-12 r < σ < 1e-6 r, {words}", _numerical(errors, name)[small])
        for name, words in _VERSIONS.items()
    ]
    above = pd.concat([_numerical(errors, name)[middle] for name in ("lls_nr_raw", "lls_nr")])
    numbers.append(_count("share of LLS outliers, 1e-5 r ≤ σ < 1e10 r, either cut", above))
    below = beside(paper, level(paper))["gdke"] < _SMALL
    numbers.append(_count("in the paper's own design, σ < 1e-6 r, no cut", _numerical(paper, "lls")[below]))
    return numbers


def _judge_small(numbers: list[Number]) -> Verdict:
    uncut, raw, centred, _, above = numbers[:5]
    if _clear(uncut):
        return Verdict.REPRODUCED
    cut = max(raw, centred, key=lambda n: n.value)
    return Verdict.PARTLY if _clear(cut) and above.value < 0.1 * cut.value else Verdict.NOT_REPRODUCED


def _measure_place(evidence: Evidence) -> list[Number]:
    errors = evidence.table("outliers", "errors")
    if not with_all(errors, "lls_nr", "lls_nr_raw", "gdke"):
        return [Number.unknown("error of LLS outliers over the radius")]
    relative, noise = beside(errors, over(errors, "radius")), beside(errors, level(errors))["gdke"]
    numbers = []
    for name in ("lls_nr", "lls_nr_raw"):
        found = relative[name][_numerical(errors, name) & (noise > _ROUNDING) & (noise < _SMALL)].to_numpy()
        near = share(int(np.sum(np.abs(found - 1.0) <= _ON_SPHERE)), len(found)) if len(found) >= _FEW else UNKNOWN
        words = _VERSIONS[name]
        numbers.append(Number.of(f"error over r of the outliers, {words}, median", median(found, _FEW), len(found)))
        numbers.append(Number.of(f"share of these within a tenth of r of the sphere, {words}", near, len(found)))
    return numbers


def _judge_place(numbers: list[Number]) -> Verdict:
    on = [number.value - 2.0 * number.error > 0.5 for number in numbers[1::2]]
    if all(on):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if any(on) else Verdict.NOT_REPRODUCED


def _measure_large(evidence: Evidence) -> list[Number]:
    errors, paper = evidence.table("outliers", "errors"), evidence.table("paper", "errors")
    if not (with_all(errors, "lls", "lls_single", "gdke") and with_all(paper, "lls", "gdke")):
        return [Number.unknown("outliers of LLS")]
    noise = beside(errors, level(errors))["gdke"]
    large = noise > _LARGE
    single = _numerical(errors, "lls_single")
    overflown = beside(errors, errors["status"])["lls_single"] == Status.NOT_FINITE
    first = noise[overflown & (noise > 1.0)].to_numpy()
    beyond = beside(paper, level(paper))["gdke"] > _LARGE
    edge = float(np.min(first)) if len(first) else math.inf
    return [
        _count("share of LLS outliers or failures, σ > 1e10 r, double precision", _numerical(errors, "lls")[large]),
        _count("share of LLS outliers or failures, σ > 1e10 r, single precision", single[large]),
        _count(
            "share of LLS outliers or failures, r ≤ σ ≤ 1e9 r, single precision",
            single[(noise >= 1.0) & (noise <= 1e9)],
        ),
        Number("least σ/r at which sums in single precision overflow", edge, 0.0, len(noise)),
        _count("in the paper's own design, σ > 1e10 r, double precision", _numerical(paper, "lls")[beyond]),
    ]


def _judge_large(numbers: list[Number]) -> Verdict:
    double, single, between = numbers[:3]
    if _clear(double):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if _clear(single) and between.value < 0.1 * single.value else Verdict.NOT_REPRODUCED


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="mle-outliers",
        section="4.1",
        statement="MLE has outliers where the error equals the radius, because there it has multiple solutions.",
        quantity="MLE's outliers about the radius, and what the best minimum from three starts makes of them",
        criterion="Reproduced if there are such outliers (three or more) and, by two standard errors, another of three "
        "starts cures more than half of them; partly if it does not; not reproduced if there are none. All fits count.",
        reads=("starts/errors",),
        measure=_measure_mle,
        judge=_judge_mle,
        figure="fig2_error",
        remark="Outliers need many samples, for only then is an error of a radius ten bounds. All three starts end at "
        "the same centre, and GDKE's is as far off: the one minimum is itself pulled to the points by the noise. Other "
        "solutions are met at small noise, from a start beyond the points, where the sphere runs off to a plane.",
    ),
    Claim(
        name="lls-outliers-small",
        section="4.1",
        statement="LLS has outliers where the noise is below about 1e-6 of the radius, by the finite representation of "
        "numbers.",
        quantity="outliers of LLS that GDKE does not have on the same points, caps of up to 5°",
        criterion="Reproduced if LLS without a cut has them below 1e-6 r (three or more); partly if only with small "
        "singular values cut, and less than a tenth as often from 1e-5 r on; not reproduced otherwise. Failures count.",
        reads=("outliers/errors", "paper/errors"),
        measure=_measure_small,
        judge=_judge_small,
        figure="fig2_error",
        remark="A cut of small singular values, as in the paper's source of programs, makes outliers of tiny caps up "
        "to just this noise; beyond, the bound itself reaches the radius. A 36th of the paper's angles is so "
        "small. Single precision makes them, too, the more the smaller the noise is, and so at both of the paper's "
        "limits.",
    ),
    Claim(
        name="lls-outliers-place",
        section="4.4",
        statement="In LLS's outliers the estimated centre erroneously lies on the sphere.",
        quantity="error over radius of the outliers that a cut of small singular values makes",
        criterion="Reproduced if with either cut more than half of the outliers, by two standard errors, have an error "
        "within a tenth of r; partly with one of them; not reproduced with none.",
        reads=("outliers/errors",),
        measure=_measure_place,
        judge=_judge_place,
        remark="Cut, a centred design leaves the centre at the points' centroid, on the sphere; one that is not "
        "centred at ½p|p|²/(|p|² + 1), p being where the points are: half way for a large sphere near the origin.",
    ),
    Claim(
        name="lls-outliers-large",
        section="4.1",
        statement="LLS has outliers where the noise is above 1e10 times the radius, by the finite representation of "
        "numbers.",
        quantity="outliers of LLS that GDKE in double precision does not have on the same points, and failures",
        criterion="Reproduced if LLS in double precision has them above 1e10 r (three or more); partly if only in "
        "single precision, and less than a tenth as often between r and 1e9 r; not reproduced otherwise.",
        reads=("outliers/errors", "paper/errors"),
        measure=_measure_large,
        judge=_judge_large,
        figure="fig2_error",
        remark="Sums of third powers overflow single precision (3.4e38) where the points are some 1e12 units apart: at "
        "1e10 to 1e11 r for the paper's radii. GDKE in single precision would overflow with them.",
    ),
)

"""Claims of sections 4.1 and 4.4 on outliers of MLE and of LLS: their places and their causes.

An outlier is a fit whose error exceeds ten times √tr CRLB, as in figure 2. For LLS a fit without a number counts as
well, and only data sets count on which GDKE has no outlier: GDKE is the same fit in exact arithmetic, so these outliers
are numerical.
"""

import math

import numpy as np
import pandas as pd

from study.fits import Status
from study.simulation.claims.claim import (
    LEAST,
    Claim,
    Evidence,
    Number,
    Verdict,
    by_estimator,
    error_over,
    has_estimators,
    median,
    relative_noise,
)

_ABOUT_RADIUS = (0.3, 3.0)
"""Errors over r that count as equal to the radius."""
_NOISE_ABOUT_RADIUS = (0.1, 10.0)
"""Relative noise in the claim's range."""
_CURED = 1.0 / 3.0
"""Share of the error that is left, at most, where another minimum cures an outlier."""
_TWO_MINIMA = 1e-3
"""Relative difference of errors above which two fits are at different minima."""
_ROUNDING, _SMALL, _LARGE = 1e-12, 1e-6, 1e10
"""Relative noise: below the first, rounding of the points themselves matters; the others are the paper's limits."""
_ON_SPHERE = 0.1
"""Distance to the sphere over r up to which a centre lies on it."""
_CLEAR = 3
"""Least number of outliers that is no accident."""
_FEW = 5
"""Least number of outliers behind a median; there are fewer of them than of other fits."""


def _clear(number: Number) -> bool:
    """True if a share stands for three data sets or more."""
    return round(number.value * number.trials) >= _CLEAR


# MLE -----------------------------------------------------------------------------------------------------------------


def _mle_outliers(errors: pd.DataFrame, far: float) -> tuple["pd.Series[bool]", pd.DataFrame, "pd.Series[float]"]:
    """MLE's outliers whose error is about the radius, errors over r by estimator, and σ/r; a row per data set."""
    relative = by_estimator(errors, error_over(errors, "radius"))
    ratio = by_estimator(errors, error_over(errors, "bound"))
    noise = by_estimator(errors, relative_noise(errors))["mle"]
    low, high = _ABOUT_RADIUS
    outliers = (ratio["mle"] > far) & (relative["mle"] >= low) & (relative["mle"] <= high)
    return outliers, relative, noise


def _measure_mle(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("starts", "error", "bound", "noise_variance")
    far = evidence.rules.far
    words = f"share of trials, .1 r ≤ σ ≤ 10 r, in which MLE's error is .3 r to 3 r and above {far:g} bounds"
    starts = ("mle", "mle_centroid", "mle_mirror")
    if not has_estimators(errors, *starts, "gdke"):
        return [Number.unknown(words)]
    outliers, relative, noise = _mle_outliers(errors, far)
    low, high = _NOISE_ABOUT_RADIUS
    result = Number.share(words, outliers[(noise >= low) & (noise <= high)], LEAST)
    if math.isnan(result.value) or result.value == 0.0:
        return [result]
    residual = by_estimator(errors, errors["noise_variance"])[list(starts)][outliers].fillna(math.inf)
    least = residual.to_numpy().argmin(axis=1)
    best = np.take_along_axis(relative[list(starts)][outliers].to_numpy(), least[:, None], axis=1)[:, 0]
    of_mle, of_gdke = relative["mle"][outliers], relative["gdke"][outliers]
    cured = best < _CURED * of_mle
    quiet = relative[noise < 0.01]
    other = (quiet["mle_mirror"] - quiet["mle"]).abs() > _TWO_MINIMA * quiet["mle"]
    return [
        result,
        Number.share(
            "share of these outliers whose error the best minimum from three starts reduces to a third or less",
            cured,
            _FEW,
        ),
        Number.of("GDKE's error over MLE's in these outliers, median", median(of_gdke / of_mle, _FEW), len(cured)),
        Number.of("σ/r of these outliers, median", median(noise[outliers], _FEW), len(cured)),
        Number.share(
            "share of trials, σ < .01 r, in which a start beyond the points ends at another minimum", other, LEAST
        ),
        _runaways(relative, by_estimator(errors, errors["status"])),
    ]


def _runaways(relative: pd.DataFrame, status: pd.DataFrame) -> Number:
    """Share of MLE fits that are ok and yet so far off that their sphere is a plane."""
    return Number.share(
        "share of all trials in which MLE's error exceeds 10⁴ r and its status is ok",
        (relative["mle"] > 1e4) & (status["mle"] == Status.OK),
        LEAST,
    )


def _judge_mle(numbers: list[Number]) -> Verdict:
    if not _clear(numbers[0]):
        return Verdict.NOT_REPRODUCED
    cured = numbers[1]
    return Verdict.REPRODUCED if cured.value - 2.0 * cured.error > 0.5 else Verdict.PARTLY


# LLS -----------------------------------------------------------------------------------------------------------------

_VERSIONS = {
    "lls": "no singular values cut",
    "lls_nr_raw": "singular values cut at 1e-6",
    "lls_nr": "centred, singular values cut at 1e-5",
    "lls_single": "single precision",
}


def _numerical(errors: pd.DataFrame, estimator: str, far: float) -> "pd.Series[bool]":
    """True for data sets with an outlier of this estimator and none of GDKE."""
    ratio = by_estimator(errors, error_over(errors, "bound"))
    return (ratio[estimator] > far) & (ratio["gdke"] <= far)


def _measure_small(evidence: Evidence) -> list[Number]:
    far = evidence.rules.far
    errors, paper = (evidence.errors(config, "error", "bound") for config in ("outliers", "paper"))
    if not (has_estimators(errors, *_VERSIONS, "gdke") and has_estimators(paper, "lls", "gdke")):
        return [Number.unknown("outliers of LLS")]
    noise = by_estimator(errors, relative_noise(errors))["gdke"]
    small, middle = (noise > _ROUNDING) & (noise < _SMALL), (noise >= 10.0 * _SMALL) & (noise < _LARGE)
    numbers = [
        Number.share(
            f"share of outliers of LLS, 1e-12 r < σ < 1e-6 r, {words}", _numerical(errors, name, far)[small], LEAST
        )
        for name, words in _VERSIONS.items()
    ]
    above = pd.concat([_numerical(errors, name, far)[middle] for name in ("lls_nr_raw", "lls_nr")])
    numbers.append(Number.share("share of outliers of LLS, 1e-5 r ≤ σ < 1e10 r, both cuts", above, LEAST))
    below = by_estimator(paper, relative_noise(paper))["gdke"] < _SMALL
    numbers.append(
        Number.share(
            "share of outliers of LLS, paper's design, σ < 1e-6 r, no singular values cut",
            _numerical(paper, "lls", far)[below],
            LEAST,
        )
    )
    return numbers


def _judge_small(numbers: list[Number]) -> Verdict:
    uncut, raw, centred, single, above = numbers[:5]
    cut = max(raw, centred, key=lambda n: n.value)
    if _clear(cut) and above.value < 0.1 * cut.value:
        return Verdict.REPRODUCED
    return Verdict.PARTLY if any(map(_clear, (uncut, cut, single))) else Verdict.NOT_REPRODUCED


def _measure_place(evidence: Evidence) -> list[Number]:
    far = evidence.rules.far
    errors = evidence.errors("outliers", "error", "bound")
    if not has_estimators(errors, "lls_nr", "lls_nr_raw", "gdke"):
        return [Number.unknown("error of LLS outliers over the radius")]
    relative = by_estimator(errors, error_over(errors, "radius"))
    noise = by_estimator(errors, relative_noise(errors))["gdke"]
    numbers = []
    for name in ("lls_nr", "lls_nr_raw"):
        result = relative[name][_numerical(errors, name, far) & (noise > _ROUNDING) & (noise < _SMALL)].to_numpy()
        near, words = np.abs(result - 1.0) <= _ON_SPHERE, _VERSIONS[name]
        numbers.append(Number.of(f"median error over r of LLS's outliers, {words}", median(result, _FEW), len(result)))
        numbers.append(Number.share(f"share of these outliers within r/10 of the sphere, {words}", near, _FEW))
    return numbers


def _judge_place(numbers: list[Number]) -> Verdict:
    on = [number.value - 2.0 * number.error > 0.5 for number in numbers[1::2]]
    if all(on):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if any(on) else Verdict.NOT_REPRODUCED


def _measure_large(evidence: Evidence) -> list[Number]:
    far = evidence.rules.far
    errors, paper = (evidence.errors(config, "error", "bound") for config in ("outliers", "paper"))
    if not (has_estimators(errors, "lls", "lls_single", "gdke") and has_estimators(paper, "lls", "gdke")):
        return [Number.unknown("outliers of LLS")]
    noise = by_estimator(errors, relative_noise(errors))["gdke"]
    large = noise > _LARGE
    single = _numerical(errors, "lls_single", far)
    overflown = by_estimator(errors, errors["status"])["lls_single"] == Status.NOT_FINITE
    first = noise[overflown & (noise > 1.0)].to_numpy()
    beyond = by_estimator(paper, relative_noise(paper))["gdke"] > _LARGE
    edge = float(np.min(first)) if len(first) else math.inf
    return [
        Number.share(
            "share of outliers or failures of LLS, σ > 1e10 r, double precision",
            _numerical(errors, "lls", far)[large],
            LEAST,
        ),
        Number.share("share of outliers or failures of LLS, σ > 1e10 r, single precision", single[large], LEAST),
        Number.share(
            "share of outliers or failures of LLS, r ≤ σ ≤ 1e9 r, single precision",
            single[(noise >= 1.0) & (noise <= 1e9)],
            LEAST,
        ),
        Number("smallest σ/r at which sums in single precision overflow", edge, 0.0, len(noise)),
        Number.share(
            "share of outliers or failures of LLS, paper's design, σ > 1e10 r, double precision",
            _numerical(paper, "lls", far)[beyond],
            LEAST,
        ),
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
        statement="MLE has outliers whose error equals the radius, because it has multiple solutions there.",
        quantity="MLE's outliers with an error of about the radius, and the error at the best minimum from three "
        "starts",
        criterion="Reproduced if there are such outliers (three or more) and the best minimum from three starts "
        "reduces the error of more than half of them to a third or less, by two standard errors; partly if there are "
        "outliers and it does not; not reproduced if there are none. All fits count.",
        answer="of the trials with noise around the radius, {0:share} are such outliers; the best of three starts "
        "mends {1:share} of them.",
        reads=("starts/errors",),
        measure=_measure_mle,
        judge=_judge_mle,
        figure="fig2_error",
        remark="Such outliers need many samples: only then is an error of one radius ten times the bound. All three "
        "starts end at the same centre, and GDKE's centre is as far off: the noise pulls the only minimum towards the "
        "points. Multiple solutions exist at small noise: from a start beyond the points the sphere tends to a plane.",
        heads={
            Verdict.REPRODUCED: "MLE's outliers come from other minima.",
            Verdict.PARTLY: "Most of MLE's outliers do not come from other minima.",
        },
        story="With noise around the radius {0:share} of its fits are off by about the radius; the best of three "
        "starts mends {1:share} of them.",
    ),
    Claim(
        name="lls-outliers-small",
        section="4.1",
        statement="LLS has outliers where the noise is below about 1e-6 of the radius, because of the finite "
        "representation of numbers.",
        quantity="outliers of LLS that GDKE does not have on the same points, caps of up to 5°",
        criterion="Reproduced if LLS with small singular values cut, as in the book that the paper takes its programs "
        "from, has such outliers for σ < 1e-6 r (three or more), and less than a tenth as often for σ ≥ 1e-5 r; partly "
        "if it has them elsewhere too, or only LLS without a cut or in single precision has them; not reproduced "
        "otherwise. Failures count.",
        answer="of LLS's fits there, {1:share} are outliers if small singular values are cut, as in Numerical Recipes, "
        "and {0:share} if not.",
        reads=("outliers/errors", "paper/errors"),
        measure=_measure_small,
        judge=_judge_small,
        figure="fig2_error",
        remark="The paper takes its programs from Numerical Recipes. The cut makes outliers on tiny caps up to just "
        "this noise; above it, the bound itself reaches the radius. One in 36 of the paper's "
        "angles is so small. Single precision makes outliers too, the more the smaller the noise is, and it fails at "
        "both of the paper's limits.",
        heads={
            Verdict.REPRODUCED: "LLS's outliers come from a cut of small singular values.",
            Verdict.PARTLY: "LLS's outliers.",
        },
        story="On tiny caps with tiny noise {1:share} of its fits are outliers with the cut, {0:share} without.",
    ),
    Claim(
        name="lls-outliers-place",
        section="4.4",
        statement="In LLS's outliers the estimated centre erroneously lies on the sphere.",
        quantity="error over radius of the outliers that a cut of small singular values makes",
        criterion="Reproduced if with both cuts more than half of the outliers, by two standard errors, have their "
        "centre within r/10 of the sphere; partly if with one of the cuts; not reproduced if with none.",
        answer="{1:share} of the outliers lie on the sphere if the design matrix is centred, {3:share} if it is not.",
        reads=("outliers/errors",),
        measure=_measure_place,
        judge=_judge_place,
        remark="With the cut, a centred design matrix leaves the centre at the points' centroid, on the sphere. A "
        "design matrix that is not centred leaves it at ½p|p|²/(|p|² + 1) with the points at p: half way to the points "
        "for a large sphere near the origin.",
    ),
    Claim(
        name="lls-outliers-large",
        section="4.1",
        statement="LLS has outliers where the noise is above 1e10 times the radius, because of the finite "
        "representation of numbers.",
        quantity="outliers of LLS that GDKE in double precision does not have on the same points, and failures",
        criterion="Reproduced if LLS in double precision has them for σ > 1e10 r (three or more); partly if only LLS "
        "in single precision has them, and less than a tenth as often for r ≤ σ ≤ 1e9 r; not reproduced otherwise.",
        answer="of LLS's fits there, {0:share} are outliers or fail in double precision, {1:share} in single "
        "precision.",
        reads=("outliers/errors", "paper/errors"),
        measure=_measure_large,
        judge=_judge_large,
        figure="fig2_error",
        remark="Sums of third powers overflow in single precision (above 3.4e38) if the points are about 1e12 units "
        "apart, which is σ of 1e10 r to 1e11 r for the paper's radii. GDKE in single precision would overflow as well.",
    ),
)

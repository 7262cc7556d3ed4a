"""Claims of sections 4.1 and 4.4 on outliers of MLE and of LLS: their places and their causes.

An outlier is a fit whose error exceeds ten times √tr CRLB, as in figure 2. For LLS a fit without a number counts as
well, and only data sets count on which GDKE has no outlier: GDKE is the same fit in exact arithmetic, so these outliers
are numerical.
"""

import math
from collections.abc import Iterable

import numpy as np
import pandas as pd

from study.arrays import Bools
from study.fits import Status
from study.simulation.claims import claim as shared
from study.simulation.claims.claim import Claim, Evidence, Number
from study.simulation.statistics import Measure, share

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


def _placed(words: str, programs: "Iterable[pd.Series[bool]]") -> Number:
    """Share of outliers that are as the paper says, as a mean over programs of equal weight.

    Args:
        words: the criterion.
        programs: for the outliers of each program, whether they are so; fewer than three count as not so.
    """
    every = list(programs)
    parts = [share(int(so.sum()), len(so)) if len(so) >= _CLEAR else Measure(0.0, 0.0) for so in every]
    error = math.hypot(*(part.error for part in parts)) / len(parts)
    return Number(words, sum(part.value for part in parts) / len(parts), error, sum(map(len, every)))


# MLE -----------------------------------------------------------------------------------------------------------------


def _over(errors: pd.DataFrame, unit: str) -> pd.DataFrame:
    """Errors over the radius or the bound: a row per data set, a column per estimator."""
    return shared.by_estimator(errors, shared.error_over(errors, unit))


def _noise(errors: pd.DataFrame, estimator: str = "gdke") -> "pd.Series[float]":
    """Relative noise of each data set; the estimator is one that the run has."""
    return shared.by_estimator(errors, shared.relative_noise(errors))[estimator]


def _share(words: str, values: "Bools | pd.Series[bool]", least: int = shared.LEAST) -> Number:
    return Number.share(f"share of {words}", values, least)


class MleOutliers(Claim):
    """MLE has outliers whose error equals the radius, because it has multiple solutions there.

    Such outliers need many samples: only then is an error of one radius ten times the bound. All three starts end
    at the same centre, and GDKE's centre is as far off: the noise pulls the only minimum towards the points.
    Multiple solutions exist at small noise: from a start beyond the points the sphere tends to a plane.
    """

    number, name, section, figure = 4, "mle-outliers", "4.1", "fig2_error"
    reads = ("starts/errors",)
    quantity = "MLE's outliers with an error of about the radius, and the error at the best minimum from three starts"
    criterion = """
        share of MLE's outliers, .1 r ≤ σ ≤ 10 r, whose error is .3 r to 3 r; another cause unless the best minimum from
        three starts reduces the error of more than half of these to a third or less
    """
    answer = """
        {0:share} of the outliers are about a radius off, in {1:share} of the trials with noise around the radius; the
        best of three starts mends {2:share} of them.
    """
    heads = ("MLE's outliers come from other minima.", "Most of MLE's outliers do not come from other minima.", "")
    story = """
        With noise around the radius {1:share} of its fits are off by about the radius; the best of three starts mends
        {2:share} of them.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("starts")
        far = evidence.rules.far
        words = f"trials, .1 r ≤ σ ≤ 10 r, in which MLE's error is .3 r to 3 r and above {far:g} bounds"
        starts = ("mle", "mle_centroid", "mle_mirror")
        if not shared.has_estimators(errors, *starts, "gdke"):
            return [Number.unknown(f"share of {words}")]
        relative, noise = _over(errors, "radius"), _noise(errors, "mle")
        beyond, inside = _over(errors, "bound")["mle"] > far, noise.between(*_NOISE_ABOUT_RADIUS)
        about = relative["mle"].between(*_ABOUT_RADIUS)
        outliers, result = beyond & about, _share(words, (beyond & about)[inside])
        place = _placed(self.criterion, [about[beyond & inside]])
        if math.isnan(result.value) or result.value == 0.0:
            return [place, result]
        residual = shared.by_estimator(errors, errors["noise_variance"])[list(starts)][outliers].fillna(math.inf)
        least = residual.to_numpy().argmin(axis=1)
        best = np.take_along_axis(relative[list(starts)][outliers].to_numpy(), least[:, None], axis=1)[:, 0]
        of_mle, of_gdke = relative["mle"][outliers], relative["gdke"][outliers]
        cured = best < _CURED * of_mle
        quiet = relative[noise < 0.01]
        other = (quiet["mle_mirror"] - quiet["mle"]).abs() > _TWO_MINIMA * quiet["mle"]
        status = shared.by_estimator(errors, errors["status"])["mle"]
        plane = (relative["mle"] > 1e4) & (status == Status.OK)
        of_these, mends = "error over MLE's in these outliers, median", "from three starts reduces to a third or less"
        return [
            place,
            result,
            _share(f"these outliers whose error the best minimum {mends}", cured, _FEW),
            Number.of(f"GDKE's {of_these}", shared.median(of_gdke / of_mle, _FEW), len(cured)),
            Number.of("σ/r of these outliers, median", shared.median(noise[outliers], _FEW), len(cured)),
            _share("trials, σ < .01 r, in which a start beyond the points ends at another minimum", other),
            _share("all trials in which MLE's error exceeds 10⁴ r and its status is ok", plane),
        ]

    def other_cause(self, numbers: list[Number]) -> bool:
        """True unless another minimum mends more than half of the outliers."""
        return len(numbers) > 2 and numbers[2].value <= 0.5


# LLS -----------------------------------------------------------------------------------------------------------------

_VERSIONS = {
    "lls": "no singular values cut",
    "lls_nr_raw": "singular values cut at 1e-6",
    "lls_nr": "centred, singular values cut at 1e-5",
    "lls_single": "single precision",
}


def _numerical(errors: pd.DataFrame, estimator: str, far: float) -> "pd.Series[bool]":
    """True for data sets with an outlier of this estimator and none of GDKE."""
    ratio = _over(errors, "bound")
    return (ratio[estimator] > far) & (ratio["gdke"] <= far)


class LlsOutliersSmall(Claim):
    """LLS has outliers where the noise is below about 1e-6 of the radius, because of the finite representation of
    numbers.

    The paper takes its programs from Numerical Recipes. The cut makes outliers on tiny caps up to just this noise;
    above it, the bound itself reaches the radius. One in 36 of the paper's angles is so small. Single precision
    makes outliers too, the more the smaller the noise is, and it fails at both of the paper's limits.
    """

    number, name, section, figure = 5, "lls-outliers-small", "4.1", "fig2_error"
    reads = ("outliers/errors", "paper/errors")
    quantity = "outliers of LLS that GDKE does not have on the same points, caps of up to 5°"
    criterion = """
        share of the outliers of LLS with small singular values cut, as in the book that the paper takes its programs
        from, that have σ < 1e-6 r, of those with 1e-12 r < σ < 1e10 r; the mean over both cuts
    """
    answer = """
        {0:share} of such outliers are there; of LLS's fits there, {2:share} are outliers if small singular values are
        cut, as in Numerical Recipes, and {1:share} if not.
    """
    heads = ("LLS's outliers come from a cut of small singular values.", "LLS's outliers.", "")
    story = "On tiny caps with tiny noise {2:share} of its fits are outliers with the cut, {1:share} without."

    def measure(self, evidence: Evidence) -> list[Number]:
        far = evidence.rules.far
        errors, paper = (evidence.errors(config) for config in ("outliers", "paper"))
        if not (shared.has_estimators(errors, *_VERSIONS, "gdke") and shared.has_estimators(paper, "lls", "gdke")):
            return [Number.unknown("outliers of LLS")]
        noise = _noise(errors)
        small, middle = (noise > _ROUNDING) & (noise < _SMALL), (noise >= 10.0 * _SMALL) & (noise < _LARGE)
        words = "outliers of LLS, 1e-12 r < σ < 1e-6 r,"
        cut = [_numerical(errors, name, far) for name in ("lls_nr_raw", "lls_nr")]
        above, whole = pd.concat([one[middle] for one in cut]), (noise > _ROUNDING) & (noise < _LARGE)
        of_paper = _numerical(paper, "lls", far)[_noise(paper) < _SMALL]
        numbers = [_placed(self.criterion, [small[one & whole] for one in cut])]
        for name, program in _VERSIONS.items():
            numbers.append(_share(f"{words} {program}", _numerical(errors, name, far)[small]))
        numbers.append(_share("outliers of LLS, 1e-5 r ≤ σ < 1e10 r, both cuts", above))
        numbers.append(_share("outliers of LLS, paper's design, σ < 1e-6 r, no singular values cut", of_paper))
        return numbers


class LlsOutliersPlace(Claim):
    """In LLS's outliers the estimated centre erroneously lies on the sphere.

    With the cut, a centred design matrix leaves the centre at the points' centroid, on the sphere. A design matrix
    that is not centred leaves it at ½p|p|²/(|p|² + 1) with the points at p: half way to the points for a large
    sphere near the origin.
    """

    number, name, section = 6, "lls-outliers-place", "4.4"
    reads = ("outliers/errors",)
    quantity = "error over radius of the outliers that a cut of small singular values makes"
    criterion = """
        share of the outliers of LLS with small singular values cut, 1e-12 r < σ < 1e-6 r, whose centre is within r/10
        of the sphere; the mean over both cuts
    """
    answer = "{2:share} of the outliers lie on the sphere if the design matrix is centred, {4:share} if it is not."

    def measure(self, evidence: Evidence) -> list[Number]:
        far = evidence.rules.far
        errors = evidence.errors("outliers")
        if not shared.has_estimators(errors, "lls_nr", "lls_nr_raw", "gdke"):
            return [Number.unknown("error of LLS outliers over the radius")]
        relative = _over(errors, "radius")
        noise = _noise(errors)
        numbers, on = list[Number](), list["pd.Series[bool]"]()
        for name in ("lls_nr", "lls_nr_raw"):
            result = relative[name][_numerical(errors, name, far) & (noise > _ROUNDING) & (noise < _SMALL)]
            near, words = (result - 1.0).abs() <= _ON_SPHERE, _VERSIONS[name]
            on.append(near)
            median = shared.median(result, _FEW)
            numbers.append(Number.of(f"median error over r of LLS's outliers, {words}", median, len(result)))
            numbers.append(_share(f"these outliers within r/10 of the sphere, {words}", near, _FEW))
        return [_placed(self.criterion, on), *numbers]


class LlsOutliersLarge(Claim):
    """LLS has outliers where the noise is above 1e10 times the radius, because of the finite representation of
    numbers.

    Sums of third powers overflow in single precision (above 3.4e38) if the points are about 1e12 units apart, which
    is σ of 1e10 r to 1e11 r for the paper's radii. GDKE in single precision would overflow as well.
    """

    number, name, section, figure = 7, "lls-outliers-large", "4.1", "fig2_error"
    reads = ("outliers/errors", "paper/errors")
    quantity = "outliers of LLS that GDKE in double precision does not have on the same points, and failures"
    criterion = """
        share of the outliers and failures of LLS with σ ≥ r that have σ > 1e10 r; the mean over double and single
        precision, of which one without such outliers counts as none
    """
    answer = "of LLS's fits there, {1:share} are outliers or fail in double precision, {2:share} in single precision."

    def measure(self, evidence: Evidence) -> list[Number]:
        far = evidence.rules.far
        errors, paper = (evidence.errors(config) for config in ("outliers", "paper"))
        ours = shared.has_estimators(errors, "lls", "lls_single", "gdke")
        if not (ours and shared.has_estimators(paper, "lls", "gdke")):
            return [Number.unknown("outliers of LLS")]
        noise = _noise(errors)
        large = noise > _LARGE
        single = _numerical(errors, "lls_single", far)
        overflown = shared.by_estimator(errors, errors["status"])["lls_single"] == Status.NOT_FINITE
        first = noise[overflown & (noise > 1.0)].to_numpy()
        edge = float(np.min(first)) if len(first) else math.inf
        words, between = "outliers or failures of LLS,", (noise >= 1.0) & (noise <= 1e9)
        of_paper = _numerical(paper, "lls", far)[_noise(paper) > _LARGE]
        both = (_numerical(errors, "lls", far), single)
        return [
            _placed(self.criterion, [large[one & (noise >= 1.0)] for one in both]),
            _share(f"{words} σ > 1e10 r, double precision", both[0][large]),
            _share(f"{words} σ > 1e10 r, single precision", single[large]),
            _share(f"{words} r ≤ σ ≤ 1e9 r, single precision", single[between]),
            Number("smallest σ/r at which sums in single precision overflow", edge, 0.0, len(noise)),
            _share(f"{words} paper's design, σ > 1e10 r, double precision", of_paper),
        ]

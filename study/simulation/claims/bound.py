"""Claims on GDKE's bias, section 4.4: its order in the noise, and its limit for many samples.

Claims on the Cramér-Rao bound: efficiency, also below the radius, errors below it, GDKE on the whole sphere.

Cells of the efficiency grid that differ only in the noise share their draws, so their results at small noise are
nearly equal. If a claim's number is the extreme over many cells, its criterion allows for that selection.
"""

import math
from itertools import pairwise
from statistics import NormalDist

import numpy as np
import pandas as pd
import scipy

from study.arrays import Floats
from study.fits.points.cap import cap_moments
from study.simulation.analysis.theory import bound_shares, kappa, median_at_bound, median_attainable, ugdk_variance
from study.simulation.claims import claim as shared
from study.simulation.claims.claim import Claim, Evidence, Number
from study.simulation.statistics import UNKNOWN, Measure, mean, moments_exist, quantile, root_mean_square, share

_BEFORE_SATURATION = 0.15
"""GDKE's bias is proportional to σ²/v to 2 % for σ below this share of √v, v being the variance along the axis."""
_LEVEL = 0.95


def _order(errors: pd.DataFrame, angle: float) -> Number:
    """Exponent of σ in GDKE's bias on a cap, before it saturates.

    The bias is the median over data sets of the axis error of GDKE minus that of MLE, which has no bias of this order;
    the difference cancels most of the scatter. The noise levels share their draws, so the deviations of the medians
    from the law are alike, and the exponent's true error is below the one given.
    """
    words = f"exponent of σ in GDKE's bias, cap of {angle:g}°"
    along = cap_moments(math.radians(angle), 3).along
    part = errors[(errors["angle"] == angle) & (shared.relative_noise(errors) <= _BEFORE_SATURATION * math.sqrt(along))]
    if part.empty:
        return Number.unknown(words)
    axis = shared.by_estimator(part, part["error_1"] / part["radius"])
    at = shared.by_estimator(part, shared.relative_noise(part))["gdke"].to_numpy()
    enough = shared.in_large_groups(at)
    return shared.exponent(
        words, at[enough], (axis["gdke"] - axis["mle"]).fillna(math.inf).to_numpy()[enough], at[enough]
    )


class GdkeBiasOrder(Claim):
    """GDKE's bias is of the order of the standard deviation of the measurements, O(σ).

    The bias is (C₀ + Σ)⁻¹Σ(c₀ - μ̄). It is of order σ² until it saturates at the distance of the centroid. Section
    5 of the paper agrees: it calls the bias proportional to the variance.
    """

    number, name, section, figure = 8, "gdke-bias-order", "4.4, 10", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "exponent of σ in GDKE's bias along the cap's axis, before it saturates"
    criterion = "share of the caps of 20°, 45° and 90° on which the exponent of σ in GDKE's bias is within .1 of 1"
    answer = """
        the bias grows as σ to the power {1:power}, {2:power} and {3:power} on three caps, which is of the order of the
        variance; so O(σ) is only an upper bound.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("efficiency")
        angles = sorted({float(angle) for angle in errors["angle"].unique()} - {shared.WHOLE})
        if not (angles and shared.has_estimators(errors, "gdke", "mle")):
            return [Number.unknown("exponent of σ in GDKE's bias")]
        orders = [_order(errors, angle) for angle in angles]
        return [shared.holding(self.criterion, (shared.apart(one.measure, 1.0, 0.1) for one in orders)), *orders]


def _covered(vectors: Floats, trials: int) -> Measure:
    """Share of trials whose 95 % ellipse contains the truth; the ellipse has the scatter's covariance.

    Args:
        vectors: errors of the estimates that have a number; of the other trials no ellipse contains the truth.
        trials: number of all trials.
    """
    if len(vectors) < shared.LEAST:
        return UNKNOWN
    inverse = np.linalg.inv(np.cov(vectors.T))
    distance = np.einsum("ti,ij,tj->t", vectors, inverse, vectors)
    return share(int(np.sum(distance <= scipy.special.chdtri(vectors.shape[1], 1.0 - _LEVEL))), trials)


def _axis_bias(rows: pd.DataFrame) -> Measure:
    """Mean error along the axis; unknown if the errors' tail is too heavy for a mean."""
    return mean(rows["error_1"].to_numpy()) if moments_exist(rows["error"].dropna().to_numpy()) else UNKNOWN


class GdkeBiasStays(Claim):
    """GDKE's bias can be significant and does not vanish with more samples; in figure 3 the true centre is outside
    the estimate's error ellipse, because of the bias alone.

    Each ellipse is centred on an estimate and has the size of the scatter over all trials. Without the bias 95 % of
    the ellipses would contain the truth.
    """

    number, name, section, figure = 9, "gdke-bias-stays", "4.4", "fig3_gdke_ellipse"
    reads = ("ellipse/errors", "power-law/errors")
    quantity = """
        GDKE's bias over its scatter and the coverage of its ellipses in the setting of figure 3; its bias against N
    """
    criterion = """
        share of the numbers of samples, from 30 to 100 000, at which GDKE's median bias is at least half of that at the
        smallest, and of the setting of figure 3, where fewer than half of the 95 % ellipses may hold the truth
    """
    answer = """
        the bias is {1:times} the scatter, {2:share} of the 95 % ellipses hold the true centre, and at the largest
        number of samples the bias is {3:times} that at the smallest.
    """
    heads = ("GDKE is biased, and more points do not help.", "GDKE's bias.", "GDKE's bias.")
    story = "The bias is {1:times} its scatter, and {2:share} of its 95 % ellipses hold the truth."

    def measure(self, evidence: Evidence) -> list[Number]:
        ellipse = evidence.errors("ellipse")
        grid = shared.rows_of(evidence.errors("power-law"), "gdke")
        cell = shared.rows_of(ellipse, "gdke")
        of_mle = shared.rows_of(ellipse, "mle")
        bias, held = _axis_bias(cell), [_covered(shared.center_errors(rows), len(rows)) for rows in (cell, of_mle)]
        spread = float(np.std(cell["error_1"], ddof=1)) if len(cell) >= shared.LEAST else math.nan
        of_spread = spread / math.sqrt(2.0 * max(len(cell) - 1, 1))  # the standard error for Gaussian errors
        medians = [shared.median(part["error_1"] / part["radius"]) for _, part in grid.groupby("samples")]
        kept = [shared.ratio(one, medians[0]) for one in medians[1:]]
        growth = f"from N = {grid['samples'].min():g} to {grid['samples'].max():g}"
        left, few = kept[-1] if kept else UNKNOWN, int(grid.groupby("samples").size().min()) if len(grid) else 0
        relative = shared.ratio(bias, Measure(spread, of_spread))
        off = [*(Measure(0.5 - one.value, one.error) for one in kept), shared.above(held[0], 0.5)]
        return [
            shared.holding(self.criterion, off),
            Number.of("GDKE's bias over its standard deviation", relative, len(cell)),
            Number.of("share of GDKE's 95 % ellipses that contain the true centre", held[0], len(cell)),
            Number.of(f"share of GDKE's bias that remains {growth}, by medians", left, few),
            Number.of("for comparison, share of MLE's 95 % ellipses that contain it", held[1], len(of_mle)),
        ]


_NORMAL_MEDIAN = NormalDist().inv_cdf(0.75)
"""Median of the absolute value of a standard normal deviate."""

# UGDK attains the bound ----------------------------------------------------------------------------------------------

_SAFE = 20.0
"""Least κ = (v/σ²) √(N/2) for which the large-sample formula of theory (5.3) is compared."""


def _variance_ratio(part: pd.DataFrame, angle: float, _: float) -> Measure:
    """Variance of the axis error over its bound, from the median of the absolute error: no mean need exist."""
    axis, _ = bound_shares(cap_moments(math.radians(angle), 3), 3)
    scaled = (part["error_1"].abs() / (part["bound"] * math.sqrt(axis))).fillna(math.inf)
    root = shared.median(scaled)
    value = (root.value / _NORMAL_MEDIAN) ** 2
    return Measure(value, 2.0 * value * root.error / root.value)


def _kappa(at: shared.CellMeasure, samples: float) -> float:
    return kappa(at.relative_noise, samples, cap_moments(math.radians(at.angle), 3))


class UgdkEfficient(Claim):
    """UGDK has the same efficiency with respect to the Cramér-Rao bound as slower methods: it attains it.

    UGDK is efficient only for σ² ≪ v/2. It subtracts σ² and not the variance that the noise has in the sample; on
    small caps this raises its variance by the factor 1 + 96 σ²/(r²φ⁴). Estimators that measure the noise in the
    same points avoid this.
    """

    number, name, section, figure = 10, "ugdk-efficient", "10.1", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "UGDK's variance along the cap's axis over the bound's, by medians, N = 1000"
    criterion = """
        share of the cells of the grid (σ/r from 1e-4 to 3.2, caps of 20° to 180°) in which UGDK's variance along the
        axis is at most 1.1 times the bound's
    """
    answer = """
        UGDK's variance along the axis is at most 1.1 times the bound's in {0:share} of the cells; where the formula for
        many samples holds it is up to {1:times} the bound's.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("efficiency")
        results = shared.in_cells(errors, "ugdk", _variance_ratio)
        samples = float(errors["samples"].max())
        safe = [at for at in results if at.angle != shared.WHOLE and _kappa(at, samples) >= _SAFE]
        if not safe:
            return [Number.unknown("UGDK's variance over the bound")]
        most = shared.greatest(safe)
        theory = ugdk_variance(most.relative_noise, cap_moments(math.radians(most.angle), 3), 3)
        words = "UGDK's variance along the axis over the bound's"
        return [
            shared.holding(self.criterion, (shared.above(at.measure, 1.1) for at in results)),
            most.number(f"{words}, greatest with κ ≥ 20 ({most})"),
            Number(f"{words} by theory (5.3), {most}", theory, 0.0, 0),
            shared.furthest_from_one(words, results),
        ]


# no error is below the bound -----------------------------------------------------------------------------------------

_COMPARED = ("mle", "gdke", "ugdk")
_SIGNIFICANT = 3.0
"""Standard errors above which a mean error is a significant bias."""


class BoundForAll(Claim):
    """The error of every estimator is at least the Cramér-Rao bound.

    The bound holds for unbiased estimators. For σ ≥ r, GDKE and MLE stay near the points with an error of about r,
    while the bound grows in proportion to σ.
    """

    number, name, section, figure = 11, "bound-for-all", "4.2", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "least root mean square error over √tr CRLB among MLE, GDKE and UGDK, in cells where it exists"
    criterion = """
        share of the cells of the grid (σ/r from 1e-4 to 3.2, caps of 20° to 180°), for MLE, GDKE and UGDK together, in
        which the root mean square error is at least .9 √tr CRLB; cells without a mean are left out
    """
    answer = """
        the least root mean square error is {1:times} the bound; where the bias is not significant it is {3:times} the
        bound.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("efficiency")
        results: list[tuple[Measure, str, int, float]] = []
        for name in _COMPARED:
            for angle, noise, part in shared.cells(errors, name):
                over_bound = shared.error_over(part, "bound")
                if np.isfinite(over_bound).all() and moments_exist(part["error"].to_numpy()):
                    root, bias = root_mean_square(over_bound), mean(part["error_1"].to_numpy())
                    where = f"{name.upper()}, φ = {angle:g}°, σ = {noise:.2g} r"
                    results.append((root, where, len(part), abs(bias.value) / bias.error))
        words = "least root mean square error over √tr CRLB"
        unbiased = [entry for entry in results if entry[3] <= _SIGNIFICANT]
        if not unbiased:
            return [Number.unknown(words)]
        least, where, trials, pull = min(results)
        of_unbiased, elsewhere, few, _ = min(unbiased)
        return [
            shared.holding(self.criterion, (Measure(0.9 - one.value, one.error) for one, *_ in results)),
            Number.of(f"{words} ({where})", least, trials),
            Number("mean error along the axis there over its standard error", pull, 1.0, trials),
            Number.of(f"{words} without significant bias ({elsewhere})", of_unbiased, few),
        ]


# GDKE on evenly distributed data -------------------------------------------------------------------------------------


def _pull(part: pd.DataFrame) -> float:
    """Median axis error over its Monte-Carlo error."""
    results = quantile(part["error_1"].fillna(math.inf).to_numpy(), 0.5)
    return results.value / results.error


class GdkeEvenData(Claim):
    """GDKE estimates well if the data are evenly distributed over the whole sphere, and the worse the more they are
    clumped to one side.

    On the whole sphere the bias vanishes by symmetry.
    """

    number, name, section, figure = 12, "gdke-even-data", "5", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "GDKE's median error over bound for σ ≤ .3 r, by cap"
    criterion = """
        share of the cells of the grid, σ ≤ .3 r, in which GDKE's median error on the whole sphere is at most 1.1 times
        that of an efficient estimator, or on a cap is above that on the next larger cap
    """
    answer = """
        on the whole sphere GDKE errs up to {1:times} as far as an efficient estimator; on the smallest cap its error is
        up to {last:times} the bound.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        efficient = math.sqrt(scipy.special.chdtri(3, 0.5) / 3.0)  # three equal variances, as on the whole sphere
        rows = shared.rows_of(evidence.errors("efficiency"), "gdke")
        rows = rows[shared.relative_noise(rows) <= 0.32]
        results = shared.in_cells(rows, "gdke", lambda part, *_: shared.median(shared.error_over(part, "bound")))
        words = "GDKE's median error over that of an efficient estimator, greatest for σ ≤ .3 r"
        sphere = [at for at in results if at.angle == shared.WHOLE]
        if not sphere:
            return [Number.unknown(f"{words}, whole sphere")]
        pull = max((_pull(part) for angle, _, part in shared.cells(rows, "gdke") if angle == shared.WHOLE), key=abs)
        few, most = min(at.trials for at in sphere), shared.greatest(sphere).measure
        good = [Measure(*(v / efficient for v in at.measure)) for at in sphere]
        at_radius = shared.in_cells(rows, "gdke", lambda part, *_: shared.median(shared.error_over(part, "radius")))
        of_cell = {(at.angle, at.relative_noise): at.measure for at in at_radius}
        angles = sorted({at.angle for at in results})
        steps = [
            Measure(wide.value - of_cell[small, noise].value, math.hypot(wide.error, of_cell[small, noise].error))
            for small, large in pairwise(angles)
            for (angle, noise), wide in of_cell.items()
            if angle == large and (small, noise) in of_cell
        ]
        numbers = [
            shared.holding(self.criterion, [*(shared.above(one, 1.1) for one in good), *steps]),
            Number.of(f"{words}, whole sphere", Measure(*(v / efficient for v in most)), few),
            Number("GDKE's bias there over its Monte-Carlo error, furthest from 0", pull, 1.0, few),
        ]
        for angle in sorted({at.angle for at in results} - {shared.WHOLE}, reverse=True):
            worst = shared.greatest(at for at in results if at.angle == angle)
            numbers.append(worst.number(f"GDKE's median error over bound, greatest for φ = {angle:g}°"))
        return numbers


# efficient where the noise is below the radius -----------------------------------------------------------------------


def _over_attainable(part: pd.DataFrame, angle: float, noise: float) -> Measure:
    """Median error over that of a Gaussian at the attainable bound; unknown unless σ < r."""
    if noise >= 1.0:
        return UNKNOWN
    unit = median_attainable(angle, noise, 3)
    if math.isnan(unit):  # the noise hides the cap, and the attainable bound cannot be formed
        unit = median_at_bound(cap_moments(math.radians(angle), 3), 3)
    return shared.ratio(shared.median(shared.error_over(part, "bound")), Measure(unit, 0.0))


class EfficientBelowDistance(Claim):
    """The methods are statistically efficient when the measurement error is smaller than the distance from joint to
    marker.

    What counts is not σ/r alone: on a cap the noise must be small against the extent along its axis, σ² ≪ v/2, and
    that extent is r²φ⁴/48 on small caps.
    """

    number, name, section, figure = 24, "efficient-below-distance", "abstract", "fig_efficiency"
    reads = ("efficiency/errors",)
    quantity = "UGDK's median error over that of a Gaussian at the attainable bound, for σ < r, N = 1000"
    criterion = """
        share of the cells of the grid with σ < r (σ/r from 1e-4, caps of 20° to 180°) in which UGDK's median error is
        at most 1.1 times that of a Gaussian at the attainable bound
    """
    answer = """
        with noise below the radius UGDK is efficient in {0:share} of the conditions; its median error is up to
        {1:times} that of an efficient estimator.
    """

    def measure(self, evidence: Evidence) -> list[Number]:
        errors = evidence.errors("efficiency")
        results, of_mle = (shared.in_cells(errors, name, _over_attainable) for name in ("ugdk", "mle"))
        words = "UGDK's median error over that at the attainable bound"
        if not (results and of_mle):
            return [Number.unknown(words)]
        most, best = shared.greatest(results), shared.greatest(of_mle)
        return [
            shared.holding(self.criterion, (shared.above(at.measure, 1.1) for at in results)),
            most.number(f"{words}, greatest with σ < r ({most})"),
            shared.furthest_from_one(words, results),
            best.number(f"the same of MLE, greatest with σ < r ({best})"),
        ]

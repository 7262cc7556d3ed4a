"""Outliers among the points of a sphere, by a rule with a stated rate of false alarms."""

import numpy as np

from study.estimators.geometric.mle import mle
from study.estimators.robust.concentration import FINALISTS, concentrate, elemental_spheres
from study.estimators.robust.copies import repeated
from study.estimators.robust.curvature import extra_parameters
from study.estimators.robust.forward import Limits, grow
from study.estimators.robust.limits import limits_of
from study.estimators.robust.subsets import SUBSAMPLE, elemental, spread_out
from study.estimators.samples import Samples
from study.sphere.types import Bools, Floats

_BATCH = 1 << 16
"""Elemental spheres that are formed together."""
_LARGEST = 1e8
"""Largest coordinate in units of a set's size, where its rounding is small; what is further is taken to be there."""
_ROUNDING = 2.0**-48


def outliers(samples: Samples) -> Bools:
    """Find the points that do not belong to the sphere of the majority.

    More than half of the points are taken to lie on one sphere with Gaussian noise of unknown size. They are found by
    least trimmed squares and a forward search. In data without outliers some point is named in about 1 % of the
    data sets, whatever their number of points.

    Copies of a point count once, and are outliers together.

    Args:
        samples: the batch. Missing samples (NaN) are no outliers. A noise level given with them is not used.

    Returns:
        True for outliers (b, n). A set with fewer than d + 3 different points, in a plane, or with a coordinate that is
        not finite, has none.

    Source: Rousseeuw & Van Driessen 2006; Hadi & Simonoff 1993; theory §11.
    """
    x = samples.x
    found = np.zeros((x.shape[0], x.shape[2]), dtype=np.bool_)
    apart = np.isnan(x).any(axis=(1, 2))
    again = repeated(x)
    apart |= again.any(axis=1)
    whole = np.flatnonzero(~apart)
    found[whole] = _among(np.ascontiguousarray(x[whole]))
    for t in np.flatnonzero(apart):
        kept = np.flatnonzero(~np.isnan(x[t]).any(axis=0) & ~again[t])
        named = kept[_among(np.ascontiguousarray(x[t][:, kept])[None])[0]]
        for k in named:
            found[t] |= (x[t] == x[t][:, k : k + 1]).all(axis=0)
    return found


def _among(x: Floats) -> Bools:
    """Outliers of sets (b, d, n) without missing samples or copies."""
    b, d, n = x.shape
    found = np.zeros((b, n), dtype=np.bool_)
    if n < d + 3:
        return found
    sample = spread_out(n)
    subsets = elemental(len(sample), d + 1)
    size = max(_BATCH // len(subsets), 1)
    usable = np.flatnonzero(np.isfinite(x).all(axis=(1, 2)))
    for begun in range(0, len(usable), size):
        sets = usable[begun : begun + size]
        y, floor = _scaled(x[sets])
        spheres = np.empty((len(sets), len(subsets), d + 1))
        part = np.ascontiguousarray(y[:, :, sample]) if n > SUBSAMPLE else y
        elemental_spheres(part, subsets, spheres)
        spheres = _best(part, spheres)
        if n > SUBSAMPLE:
            spheres = _best(y, np.ascontiguousarray(spheres[:, :2]))
        found[sets] = _search(y, spheres[:, 0], floor)
    return found


def _search(y: Floats, spheres: Floats, floor: Floats) -> Bools:
    """Outliers of sets (b, d, n) by forward searches.

    The first starts from the spheres of least trimmed squares. Where it finds outliers, a second one starts from the
    geometric fit of all points, and the more likely result is taken: if more than half of the points lie close
    together, the first search may find a small sphere among those, and take all others for outliers.

    False alarms are promised for points that are all clean, so how far the sphere is from linear is taken from the fit
    of all points: a few that were chosen for being near one sphere show less noise than there is.
    """
    b, d, n = y.shape
    whole = mle(Samples(y))
    extra = np.empty(b)
    extra_parameters(y, whole.center, whole.radius, extra)
    with np.errstate(all="ignore"):
        share = whole.noise_variance * (n - d - 1) / np.maximum(n - d - 1 - extra, 1.0) / whole.radius**2
    share[~(share < np.inf)] = 0.0
    limits = Limits(limits_of(n, d), floor, extra, share)
    outside, cost = np.empty((b, n), dtype=np.bool_), np.empty(b)
    grow(y, np.ascontiguousarray(spheres), _half(n, d), limits, outside, cost)
    again = np.flatnonzero(outside.any(axis=1))
    if len(again):
        starts = np.concatenate([whole.center, whole.radius[:, None]], axis=1)[again]
        limits = Limits(limits.quantiles, floor[again], extra[again], share[again])
        other, other_cost = np.empty((len(again), n), dtype=np.bool_), np.empty(len(again))
        grow(y[again], starts, _half(n, d), limits, other, other_cost)
        better = other_cost < cost[again]
        outside[again[better]] = other[better]
    return outside


def _half(n: int, d: int) -> int:
    """Number of points that least trimmed squares fits, which resists the most outliers."""
    return (n + d + 2) // 2


def _best(y: Floats, starts: Floats) -> Floats:
    """Spheres (b, FINALISTS, d + 1) of least trimmed squares, the best first; NaN where there is none."""
    b, d, n = y.shape
    spheres, sums = np.full((b, FINALISTS, d + 1), np.nan), np.empty((b, FINALISTS))
    concentrate(y, starts, _half(n, d), spheres, sums)
    return spheres


def _scaled(x: Floats) -> tuple[Floats, Floats]:
    """Sets (b, d, n) about their median and in units of their size, and the rounding of their coordinates (b,)."""
    with np.errstate(all="ignore"):
        middle = np.median(x, axis=2)[:, :, None]
        away = np.abs(x - middle).max(axis=1)
        size = np.median(away, axis=1)
        size = np.where(size > 0.0, size, away.max(axis=1))[:, None, None]
        size = np.where(size > 0.0, size, 1.0)
        y = np.clip((x - middle) / size, -_LARGEST, _LARGEST)
        floor = _ROUNDING * (1.0 + np.abs(middle / size).max(axis=1)[:, 0])
    return np.ascontiguousarray(y), floor

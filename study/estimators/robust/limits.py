"""Limits of deleted residuals, beyond which points are outliers.

Quantiles are computed here, because loading SciPy's takes as long as the rest of the library.
"""

import math
from functools import cache, lru_cache
from statistics import NormalDist

import numpy as np

from study.sphere.types import Floats

FALSE_ALARMS = 0.01
"""Share α of data sets without outliers in which one is found."""
_EXACT = 2000
"""Limits of larger point sets are interpolated between this many set sizes."""
_FEW = 40
"""Degrees of freedom beyond which the choice of the clean points does not matter, and quantiles have a series."""
_CHOICE = 0.01
"""Share of α for each number of outliers but one."""
_FURTHEST = 37.0
"""Standard deviations beyond which the normal tail is its asymptote."""


@lru_cache(maxsize=32)
def limits_of(n: int, d: int) -> Floats:
    """Largest deleted residual of the nearest of n - m points outside, beside m clean ones (n,).

    It is the quantile of Student's t at level α/(2(m + 1)) on either side with m - d - 1 degrees of freedom. Where
    these are few, the m points can have been chosen for the small distances that they have by chance; then the limit is
    raised to where the union over all choices of the n - m others has a probability below .01 α.

    Returns:
        The limit beside m points at place m; NaN where m < d + 2.

    Source: Hadi & Simonoff 1993; theory §11.
    """
    m, first = np.arange(n, dtype=float), d + 2
    nodes = np.arange(first, n) if n <= _EXACT else np.unique(np.geomspace(first, n - 1, _EXACT).astype(int))
    freedom = np.asarray(nodes - (d + 1), dtype=np.float64)
    levels = FALSE_ALARMS / (nodes + 1.0)
    few = freedom <= _FEW
    limits = np.empty(len(nodes))
    limits[~few] = [_series(f, level) for f, level in zip(freedom[~few], levels[~few], strict=True)]
    limits[few] = _beyond(freedom[few], np.ones(few.sum()), np.log(levels[few]))
    chosen = few & (nodes < n - 1) & (2 * nodes >= n)
    ways = [math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0) for k in nodes[chosen]]
    raised = _beyond(
        freedom[chosen], n - nodes[chosen].astype(float), math.log(_CHOICE * FALSE_ALARMS) - np.array(ways)
    )
    limits[chosen] = np.maximum(limits[chosen], raised)
    return np.asarray(np.where(m >= first, np.interp(np.log(m + 1.0), np.log(nodes + 1.0), limits), np.nan))


def _series(freedom: float, level: float) -> float:
    """Quantile of Student's t at a level on both sides together, by Cornish & Fisher's series in 1/freedom."""
    x = -NormalDist().inv_cdf(0.5 * level)
    terms = [
        (x**3 + x) / 4.0,
        (5.0 * x**5 + 16.0 * x**3 + 3.0 * x) / 96.0,
        (3.0 * x**7 + 19.0 * x**5 + 17.0 * x**3 - 15.0 * x) / 384.0,
        (79.0 * x**9 + 776.0 * x**7 + 1482.0 * x**5 - 1920.0 * x**3 - 945.0 * x) / 92160.0,
    ]
    return x + sum(term / freedom ** (k + 1) for k, term in enumerate(terms))


def _beyond(freedom: Floats, count: Floats, wanted: Floats) -> Floats:
    """Limits q at which log P(|z| > q s for all of ``count`` normal z) has the wanted values, s² ~ χ²/freedom."""
    log_s = np.linspace(-20.0, 2.0, 441)
    density = freedom[:, None] * log_s - 0.5 * freedom[:, None] * np.exp(2.0 * log_s)
    density -= _log_sum(density)[:, None]
    low, high = np.zeros(len(count)), np.full(len(count), 20.0)  # of log q
    for _ in range(40):
        middle = 0.5 * (low + high)
        found = _log_sum(density + count[:, None] * _log_tail(np.exp(middle[:, None] + log_s)))
        low, high = np.where(found > wanted, middle, low), np.where(found > wanted, high, middle)
    return np.asarray(np.exp(0.5 * (low + high)))


def _log_sum(values: Floats) -> Floats:
    """Logarithm of the sum of exponentials, row by row."""
    largest = values.max(axis=1)
    return np.asarray(largest + np.log(np.exp(values - largest[:, None]).sum(axis=1)))


def _log_tail(z: Floats) -> Floats:
    """Log P(|normal| > z), interpolated."""
    nodes, values = _tail()
    near = np.interp(np.minimum(z, _FURTHEST), nodes, values)
    return np.asarray(near - 0.5 * (np.maximum(z, _FURTHEST) ** 2 - _FURTHEST**2))


@cache
def _tail() -> tuple[Floats, Floats]:
    nodes = np.linspace(0.0, _FURTHEST, 3701)
    return nodes, np.array([math.log(math.erfc(z / math.sqrt(2.0))) for z in nodes])

"""Limits of deleted residuals, beyond which points are outliers."""

from functools import lru_cache

import numpy as np
from scipy.special import gammaln, log_ndtr, logsumexp, stdtrit

from study.sphere.types import Floats

FALSE_ALARMS = 0.01
"""Share α of data sets without outliers in which one is found."""
_EXACT = 2000
"""Limits of larger point sets are interpolated between this many set sizes."""
_FEW = 40
"""Degrees of freedom beyond which the choice of the clean points does not matter."""
_CHOICE = 0.03
"""Share of α for each number of outliers but one."""


@lru_cache(maxsize=32)
def limits_of(n: int, d: int) -> Floats:
    """Largest deleted residual of the nearest of n - m points outside, beside m clean ones (n,).

    It is the quantile of Student's t at level α/(2(m + 1)) on either side with m - d - 1 degrees of freedom. Where
    these are few, the m points can have been chosen for the small distances that they have by chance; then the limit is
    raised to where the union over all choices of the n - m others has a probability below .03 α.

    Returns:
        The limit beside m points at place m; NaN where m < d + 2.

    Source: Hadi & Simonoff 1993; theory §11.
    """
    m = np.arange(n, dtype=float)
    first = d + 2
    nodes = np.arange(first, n) if n <= _EXACT else np.unique(np.geomspace(first, n - 1, _EXACT).astype(int))
    limits = -stdtrit(nodes - d - 1.0, FALSE_ALARMS / (2.0 * (nodes + 1.0)))
    few = (nodes - d - 1 <= _FEW) & (nodes < n - 1) & (2 * nodes >= n)
    limits[few] = np.maximum(limits[few], _beyond_choice(n, nodes[few].astype(float), d))
    return np.asarray(np.where(m >= first, np.interp(np.log(m + 1.0), np.log(nodes + 1.0), limits), np.nan))


def _beyond_choice(n: int, m: Floats, d: int) -> Floats:
    """Limits q with C(n, m) P(|z| > q s for all n - m points outside) = .03 α, s² ~ χ²/f with f = m - d - 1."""
    freedom = (m - d - 1.0)[:, None]
    wanted = np.log(_CHOICE * FALSE_ALARMS) - (gammaln(n + 1.0) - gammaln(m + 1.0) - gammaln(n - m + 1.0))
    log_s = np.linspace(-20.0, 2.0, 1101)[None, :]
    density = freedom * log_s - 0.5 * freedom * np.exp(2.0 * log_s)
    density = density - logsumexp(density, axis=1, keepdims=True)
    low, high = np.zeros(len(m)), np.full(len(m), 20.0)  # of log q
    for _ in range(50):
        middle = 0.5 * (low + high)
        tail = np.log(2.0) + log_ndtr(-np.exp(np.minimum(middle[:, None] + log_s, 20.0)))
        found = logsumexp(density + (n - m)[:, None] * tail, axis=1)
        low, high = np.where(found > wanted, middle, low), np.where(found > wanted, high, middle)
    return np.asarray(np.exp(0.5 * (low + high)))

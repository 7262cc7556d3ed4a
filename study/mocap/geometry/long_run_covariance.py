"""Long-run covariance of a sum over correlated video frames, and the autocorrelation time of a series.

Frames of a recording follow each other within milliseconds, and soft tissue that is displaced in one still is in the
next. So the covariance of a fit must count effectively independent frames. The score of a frame, which is its part of
the estimating equations, carries what is needed: errors common to markers, unequal noise, correlation in time. The
variance of the sum of scores is their spectrum at frequency zero. It is estimated by the mean over the lowest
frequencies, up to a fraction of 1/τ, with τ = 1 + 2 Σ ρ(k) summed up to the first lag of at least 5τ.

Source: Sokal 1997 (τ); Lazarus, Lewis, Stock & Watson 2018 (equal weights on the lowest frequencies).
"""

import numpy as np
from scipy import fft

from study.sphere.jit import compiled
from study.sphere.types import Floats

_WINDOW = 5.0
"""Autocorrelations are summed up to a lag of this many τ."""
_WIDTH = 10.0
"""The spectrum is averaged up to the frequency 1/(10 τ)..."""
_FEWEST = 8
"""...but over no fewer frequencies than these."""


def autocorrelation_time(series: Floats) -> Floats:
    """Integrated autocorrelation times of series of mean 0.

    Args:
        series: (k, frames). A frame without a value is 0 in it and adds nothing to the sum.

    Returns:
        Times (k,), in frames; at least 1, and 1 for a series of zeros.
    """
    n = series.shape[1]
    if n < 2:
        return np.ones(len(series))
    size = fft.next_fast_len(2 * n, real=True)
    spectrum = fft.rfft(series, size, axis=1)
    covariance = fft.irfft(spectrum.real**2 + spectrum.imag**2, size, axis=1)
    tau = np.empty(len(series))
    _sum_autocorrelations(covariance, n, tau)
    return tau


@compiled
def _sum_autocorrelations(covariance: Floats, n: int, tau: Floats) -> None:
    """Put autocorrelation times into ``tau`` (k,), from autocovariances (k, n or more) of lags from 0."""
    for row in range(len(tau)):
        tau[row] = 1.0
        if not covariance[row, 0] > 0.0:
            continue
        for lag in range(1, n):
            tau[row] += 2.0 * covariance[row, lag] / covariance[row, 0]
            if lag >= _WINDOW * tau[row]:
                break
        tau[row] = max(tau[row], 1.0)


def long_run_covariance(scores: Floats) -> tuple[Floats, Floats]:
    """Estimate the covariance of a sum over correlated frames.

    Args:
        scores: contribution of each frame to the sums (k, frames), of mean 0.

    Returns:
        Covariance of the sums (k, k), in no direction less than for independent frames; and the covariance for
        independent frames (k, k).
    """
    n = scores.shape[1]
    independent = scores @ scores.T
    scale = np.sqrt(np.maximum(np.diag(independent), 1e-300))
    scaled = scores / scale[:, None]
    tau = float(autocorrelation_time(scaled).max())
    count = int(min(max(n / (_WIDTH * tau), _FEWEST), (n - 1) // 2))
    if count < 1:
        return independent, independent
    lowest = fft.rfft(scaled, axis=1)[:, 1 : count + 1]
    spectrum = (lowest @ lowest.conj().T).real / count
    # ratio to the covariance for independent frames, direction by direction
    values, vectors = np.linalg.eigh(independent / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    inverse = np.linalg.pinv(root)
    ratios, axes = np.linalg.eigh(inverse @ spectrum @ inverse.T)
    inflated = root @ (axes * np.maximum(ratios, 1.0)) @ axes.T @ root.T
    return inflated * np.outer(scale, scale), independent

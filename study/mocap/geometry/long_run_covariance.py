"""How much a series that is correlated in time is worth: the long-run covariance of its sum, and its memory.

Frames of a recording follow each other within milliseconds, and skin that has slipped in one is still off in the next.
A fit's covariance must count what the frames are worth, not how many they are. The score of each frame - its part of
the estimating equations - holds all of that: frames' and markers' common errors, uneven noise, and correlation in
time. The variance of a sum is the spectrum at frequency zero, taken as the mean over the lowest frequencies, over so
many that they lie well below the one at which the series forgets: τ = 1 + 2 Σ ρ(k), summed up to the first lag of 5τ.

Source: Sokal 1997 (τ); Lazarus, Lewis, Stock & Watson 2018 (equal weights on the lowest frequencies).
"""

from typing import Any

import numpy as np
from scipy import fft

from study.sphere.jit import compiled
from study.sphere.types import Floats

_WINDOW = 5.0
_WIDTH = 10.0
"""The spectrum is averaged up to the frequency 1/(10 τ)..."""
_FEWEST = 8
"""...but over no fewer frequencies than these."""


def autocorrelation_time(series: Floats) -> Floats:
    """Integrated autocorrelation times (k,), in frames, of series (k, frames) of mean 0; at least 1.

    A series of zeros has 1. A frame without a value is 0 in the series: it adds nothing to the sum.
    """
    n = series.shape[1]
    if n < 2:
        return np.ones(len(series))
    size = fft.next_fast_len(2 * n, real=True)
    spectrum = fft.rfft(series, size, axis=1)
    covariance = fft.irfft(spectrum.real**2 + spectrum.imag**2, size, axis=1)
    tau = np.empty(len(series))
    _summed(covariance, n, tau)
    return tau


@compiled
def _summed(covariance: Any, n: int, tau: Any) -> None:
    """Autocorrelation times (k,) from autocovariances (k, n or more) of lags from 0."""
    for row in range(len(tau)):
        tau[row] = 1.0
        if not covariance[row, 0] > 0.0:
            continue
        for lag in range(1, n):
            tau[row] += 2.0 * covariance[row, lag] / covariance[row, 0]
            if lag >= _WINDOW * tau[row]:
                break
        tau[row] = max(tau[row], 1.0)


def long_run(scores: Floats) -> tuple[Floats, Floats]:
    """Covariance of a sum over correlated frames.

    Args:
        scores: what each frame adds (k, frames), of mean 0.

    Returns:
        Covariance of the sum (k, k), in no direction less than without correlation in time; and what it would be
        without (k, k).
    """
    n = scores.shape[1]
    instant = scores @ scores.T
    scale = np.sqrt(np.maximum(np.diag(instant), 1e-300))
    scaled = scores / scale[:, None]
    tau = float(autocorrelation_time(scaled).max())
    count = int(min(max(n / (_WIDTH * tau), _FEWEST), (n - 1) // 2))
    if count < 1:
        return instant, instant
    lowest = fft.rfft(scaled, axis=1)[:, 1 : count + 1]
    spectrum = (lowest @ lowest.conj().T).real / count
    # relative to what it would be without correlation, direction by direction
    values, vectors = np.linalg.eigh(instant / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    inverse = np.linalg.pinv(root)
    ratios, axes = np.linalg.eigh(inverse @ spectrum @ inverse.T)
    inflated = root @ (axes * np.maximum(ratios, 1.0)) @ axes.T @ root.T
    return inflated * np.outer(scale, scale), instant

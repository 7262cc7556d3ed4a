"""The newest named competitor as an estimator of one's own: EM with a von Mises-Fisher law of the directions.

The points are x = c + r u + σ z with u from a von Mises-Fisher law of unknown mean direction and concentration. Given
the points, each u has such a law again, of the natural parameter κμ + r (x - c)/σ²; with its mean m in place of u all
updates are in closed form. It is biased where the directions have another law, a cap's with its sharp rim among them.

    study run benchmarks/em_vmf.toml --plugin benchmarks/em_vmf.py

The published method is *given* the mean direction and the concentration; here both are estimated, so this is a variant
of it, and its errors are not those of the published one.

Source: Lesouple, Pilastre, Altmann & Tourneret, IEEE Signal Processing Letters 28 (2021) 314-318.
"""

import numpy as np
from scipy.special import ive

import study
from study.fits.registry import fit_samples
from study.fits.samples import blank

STEPS = 2000
"""Largest number of EM steps."""
ENOUGH = 1e-9
"""Change of centre and radius, relative to the radius, that ends the iteration."""


def mean_length(kappa, dimension):
    """Length of the mean of a von Mises-Fisher law: I_{d/2}(κ)/I_{d/2-1}(κ); its expansion where both overflow."""
    order = 0.5 * dimension
    with np.errstate(all="ignore"):
        ratio = ive(order, kappa) / ive(order - 1.0, kappa)
    far = 1.0 - 0.5 * (dimension - 1) / np.maximum(kappa, 1.0)
    return np.where(kappa > 1e4, far, np.where(kappa > 0.0, ratio, 0.0))


def concentration(length, dimension):
    """Concentration whose mean has this length: the approximation of Banerjee et al. 2005, and two Newton steps."""
    kappa = length * (dimension - length**2) / np.maximum(1.0 - length**2, 1e-12)
    for _ in range(2):
        mean = mean_length(kappa, dimension)
        slope = 1.0 - mean**2 - (dimension - 1) * mean / np.maximum(kappa, 1e-12)
        kappa = np.maximum(kappa - (mean - length) / np.maximum(slope, 1e-12), 1e-9)
    return kappa


def em_vmf(samples):
    """Expectation maximisation from the answer of `als`, for each set of a batch."""
    start, result = fit_samples(samples, "als"), blank(*samples.shape[:2])
    for t, x in enumerate(samples.points):
        center, radius, variance = start.center[t], float(start.radius[t]), float(start.noise_variance[t])
        result.status[t] = start.own_status[t]
        if not (np.isfinite(center).all() and radius > 0.0 and variance > 0.0):
            center, radius, variance = x.mean(axis=0), float(np.sqrt(x.var(axis=0).sum())), float(x.var())
        mu, kappa, d = (x - center).mean(axis=0), 0.0, x.shape[1]
        for _ in range(STEPS):
            result.iterations[t] += 1
            natural = kappa * mu + radius * (x - center) / variance
            size = np.linalg.norm(natural, axis=1)
            means = natural * (mean_length(size, d) / np.maximum(size, 1e-300))[:, None]
            mean = means.mean(axis=0)
            length, last, before = float(np.linalg.norm(mean)), center, radius
            radius = float(np.mean(means * (x - x.mean(axis=0)) @ np.ones(d))) / max(1.0 - length**2, 1e-300)
            center = x.mean(axis=0) - radius * mean
            away = x - center
            square, along = np.mean(away**2 @ np.ones(d)), np.mean(means * away @ np.ones(d))
            variance = max(float(square - 2.0 * radius * along + radius**2) / d, 1e-30 * radius**2)
            mu, kappa = mean / max(length, 1e-300), float(concentration(np.array(length), d))
            if np.linalg.norm(center - last) + abs(radius - before) < ENOUGH * abs(radius):
                break
        else:
            result.status[t] = study.Status.NOT_CONVERGED
        result.center[t], result.radius[t], result.noise_variance[t] = center, radius, variance
    return result


study.register("em_vmf", em_vmf, batched=True, reference="Lesouple et al. 2021: EM, von Mises-Fisher directions")

"""The newest named competitor as estimators of one's own: EM with a von Mises-Fisher law of the directions.

The points are x = c + r u + σ z with u from a von Mises-Fisher law of mean direction μ and concentration κ. Given the
points, each u has such a law again, of the natural parameter κμ + r (x - c)/σ²; with its mean m in place of u all
updates are in closed form. It is biased where the directions have another law, a cap's with its sharp rim among them.

    study run benchmarks/em_vmf.toml --plugin benchmarks/em_vmf.py
    python benchmarks/em_vmf.py     # the published setting; stored in docs/assets/tables/em-vmf-published.csv

The published method is *given* κ and μ. `em_vmf_given` is that method with κ = 0, a whole sphere, which needs no μ,
`em_vmf_given_2` with κ = 2 about the first axis; `given` makes one for any κ and μ. `em_vmf` estimates both from the
points: it is a variant, and its errors are not those of the published method.

Source: Lesouple, Pilastre, Altmann & Tourneret, IEEE Signal Processing Letters 28 (2021) 314-318. The setting is that
of its authors' program (github.com/Julien-Lesouple/Hypersphere-fitting, main_3D.m): 100 points, 500 sets, radii of 1 to
10 and coordinates of the centre of -4 to 5, all whole numbers; the error is the mean of |ĉ - c|² + (r̂ - r)². They end
after 40 steps from the mean of the points; here EM begins with `als` and ends where it stands still.
"""

import numpy as np
from scipy.special import ive
from scipy.stats import vonmises_fisher

import study
from study.fits.points.samples import Samples, blank
from study.fits.registry import fit_samples

STEPS = 2000
"""Largest number of EM steps."""
ENOUGH = 1e-9
"""Change of centre and radius, relative to the radius, that ends the iteration."""
DIRECTION = np.array([np.sin(np.pi / 4) * np.cos(np.pi / 3), np.sin(np.pi / 4) * np.sin(np.pi / 3), np.cos(np.pi / 4)])
"""Mean direction of the published setting."""
SETS, POINTS = 500, 100
VARIANCES = 10.0 ** np.arange(-2.0, 1.1, 0.5)


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


def em_vmf(samples, known=None):
    """Expectation maximisation from the answer of `als`, for each set of a batch.

    Args:
        samples: the points.
        known: κ μ (d,), if it is known; else κ and μ are found with the rest.
    """
    start, result = fit_samples(samples, "als"), blank(*samples.shape[:2])
    for t, x in enumerate(samples.points):
        center, radius, variance = start.center[t], float(start.radius[t]), float(start.estimates.noise_variance[t])
        result.status[t] = start.estimates.status[t]
        if not (np.isfinite(center).all() and radius > 0.0 and variance > 0.0):
            center, radius, variance = x.mean(axis=0), float(np.sqrt(x.var(axis=0).sum())), float(x.var())
        d, middle = x.shape[1], x.mean(axis=0)
        prior = np.zeros(d) if known is None else known
        for _ in range(STEPS):
            result.iterations[t] += 1
            natural = prior + radius * (x - center) / variance
            size = np.linalg.norm(natural, axis=1)
            means = natural * (mean_length(size, d) / np.maximum(size, 1e-300))[:, None]
            mean = means.mean(axis=0)
            length, last, before = float(np.linalg.norm(mean)), center, radius
            radius = float(np.mean(means * (x - middle) @ np.ones(d))) / max(1.0 - length**2, 1e-300)
            center = middle - radius * mean
            away = x - center
            square, along = np.mean(away**2 @ np.ones(d)), np.mean(means * away @ np.ones(d))
            variance = max(float(square - 2.0 * radius * along + radius**2) / d, 1e-30 * radius**2)
            if known is None:
                prior = float(concentration(np.array(length), d)) * (mean / max(length, 1e-300))
            if np.linalg.norm(center - last) + abs(radius - before) < ENOUGH * abs(radius):
                break
        else:
            result.status[t] = study.Status.NOT_CONVERGED
        result.center[t], result.radius[t], result.noise_variance[t] = center, radius, variance
    return result


def given(kappa, mu=DIRECTION):
    """The published method: an estimator that is given the concentration κ and the mean direction μ (d,)."""
    return lambda samples: em_vmf(samples, kappa * np.asarray(mu))


def whole_sphere(samples):
    """The published method, given κ = 0, in any dimension."""
    return em_vmf(samples, np.zeros(samples.shape[1]))


def one_sided(samples):
    """The published method, given κ = 2 about the first axis, in any dimension."""
    return em_vmf(samples, 2.0 * np.eye(samples.shape[1])[0])


study.register("em_vmf", em_vmf, batched=True, reference="Lesouple et al. 2021, but κ and μ are estimated")
study.register("em_vmf_given", whole_sphere, batched=True, reference="Lesouple et al. 2021, given κ = 0")
study.register("em_vmf_given_2", one_sided, batched=True, reference="Lesouple et al. 2021, given κ = 2 and μ")


def published_points(rng, kappa, variance, sets=SETS):
    """Points (sets, n, 3) of the published setting, and their centres and radii (sets, 4)."""
    truth = np.column_stack([rng.integers(-4, 6, (sets, 3)), rng.integers(1, 11, sets)]).astype(float)
    u = rng.standard_normal((sets, POINTS, 3))
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    if kappa > 0.0:
        u = vonmises_fisher(DIRECTION, kappa).rvs((sets, POINTS), random_state=rng)
    noise = np.sqrt(variance) * rng.standard_normal(u.shape)
    return truth[:, None, :3] + truth[:, None, 3:] * u + noise, truth


def rows(sets=SETS):
    """A row per concentration, variance and estimator: the mean squared error of centre and radius, and its error."""
    for kappa in (0.0, 2.0):
        methods = {"em_given": given(kappa), "em_estimated": em_vmf}
        methods |= {name: lambda samples, name=name: fit_samples(samples, name) for name in ("mle", "corrected")}
        for variance in VARIANCES:
            points, truth = published_points(np.random.default_rng(int(kappa)), kappa, variance, sets)
            for name, method in methods.items():
                answer = method(Samples(np.ascontiguousarray(points.swapaxes(1, 2))))
                square = ((np.column_stack([answer.center, answer.radius]) - truth) ** 2).sum(axis=1)
                square[~np.isfinite(square)] = np.inf
                error = square.std() / np.sqrt(sets) if np.isfinite(square).all() else np.nan
                row = {"kappa": kappa, "variance": variance, "estimator": name, "sets": sets}
                yield row | {"mse": square.mean(), "mse_error": error, "median": np.median(square)}


if __name__ == "__main__":
    from studies import store

    store("em-vmf-published", rows())

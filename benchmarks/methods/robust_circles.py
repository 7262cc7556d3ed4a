"""Five robust fits of circles that arXiv 2507.11476 compares, written again from what its authors' program does.

Settings are theirs. On the sets of points of their experiment B1 these functions give their numbers to four digits, but
for `nurunnabi`, which draws at random (benchmarks/ranking.py). The fits of `guo` and `qi` depend on where the origin of
the coordinates is. As there, equal points count once.
"""

import numpy as np
from scipy.optimize import minimize

import study

CIRCLE = np.array([[0.0, 0, 0, -2], [0, 1, 0, 0], [0, 0, 1, 0], [-2, 0, 0, 0]])
"""Pratt's constraint on the coefficients of x² + y², x, y and 1."""


def design(points):
    """Rows x² + y², x, y, 1."""
    return np.column_stack([(points**2).sum(axis=1), points, np.ones(len(points))])


def circle(coefficients):
    """The circle of coefficients of x² + y², x, y and 1."""
    b, c, d = coefficients[1:] / coefficients[0]
    return np.array([-0.5 * b, -0.5 * c]), np.sqrt(0.25 * (b * b + c * c) - d)


def away(points, center, radius):
    """Signed distances from a circle."""
    return np.hypot(*(points - center).T) - radius


def guo(points):
    """Least algebraic residual of coefficients of length 1; points beyond three median deviations go, ten times."""
    for _ in range(10):
        center, radius = circle(np.linalg.eigh(design(points).T @ design(points))[1][:, 0])
        distance = away(points, center, radius)
        distance -= np.median(distance)
        kept = np.abs(distance) < 3.0 * np.median(np.abs(distance)) / 0.6745
        if kept.all():
            break
        points = points[kept]
    return center, radius


def greco(points):
    """Least sum of the smallest 75 % of the squared distances, by simplices that begin where the last one ended."""
    count = max(int(0.75 * len(points)), 3)
    place = points.mean(axis=0)
    found = np.array([*place, away(points, place, 0.0).mean()])

    def trimmed(p):
        return float(np.sum(np.sort(np.abs(away(points, p[:2], p[2])))[:count] ** 2))

    for _ in range(100):
        last, found = found, minimize(trimmed, found, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-6}).x
        if np.abs(found - last).max() < 1e-6:
            break
    return found[:2], found[2]


def qi(points):
    """Hyper fit with weights by algebraic residuals, up to 500 times; beyond 2.5 robust σ they are 0."""
    rows, weights, last = design(points), np.ones(len(points)), np.zeros(4)
    z, x, y, _ = rows.mean(axis=0)
    taubin = np.array([[4 * z, 2 * x, 2 * y, 0], [2 * x, 1, 0, 0], [2 * y, 0, 1, 0], [0, 0, 0, 0]])
    for _ in range(500):
        values, vectors = np.linalg.eig(np.linalg.solve(2 * taubin - CIRCLE, (rows.T * weights) @ rows))
        found = vectors[:, np.argmin(np.where(values.real > 0, values.real, np.inf))].real
        found = found / found[0]
        size = np.abs(rows @ found)
        size /= 1.4826 * np.median(size)
        weights = np.where(size < 1.5, 1.0, 1.5 / np.maximum(size, 1.5) * np.maximum(2.5 - size, 0.0) ** 2)
        if np.linalg.norm(found - last) < 1e-6:
            break
        last = found
    return circle(found)


def algebraic(points):
    """Least algebraic residual; the radius is the root of the mean squared distance from the centre."""
    rows = np.column_stack([2.0 * points, np.ones(len(points))])
    center = np.linalg.lstsq(rows, (points**2).sum(axis=1), rcond=None)[0][:2]
    return center, np.sqrt(np.mean(away(points, center, 0.0) ** 2))


def nurunnabi(points):
    """Of 25 circles through three points, fitted to the nearest 70 % each, that of the least squares of all points."""
    rng, fits = np.random.default_rng(1), []
    for _ in range(25):
        start = algebraic(points[rng.choice(len(points), 3, replace=False)])
        near = np.argsort(np.abs(away(points, *start)))[: int(np.ceil(0.7 * len(points)))]
        fits.append(algebraic(points[near]))
    return min(fits, key=lambda fit: np.sum(away(points, *fit) ** 2))


def rfca(points):
    """Least sum of absolute distances by steps of a length that grows and shrinks, from the mean of the points."""
    center, step = points.mean(axis=0), 0.5
    distance = away(points, center, 0.0)
    radius = np.median(distance)
    error = np.abs(distance - radius).sum()
    for _ in range(1000):
        slopes = (points - center) / distance[:, None]
        inside, on = np.sign(radius - distance), np.abs(slopes[distance == radius]).sum(axis=0)
        slope = inside @ slopes
        down = np.where(slope >= on, on - slope, np.where(slope <= -on, -slope - on, -slope))
        trial = center + step * down
        near = away(points, trial, 0.0)
        middle = np.median(near)
        better = np.abs(near - middle).sum()
        if better < error:
            center, distance, radius, error, step = trial, near, middle, better, min(1.2 * step, 0.5)
        else:
            step *= 0.9
        if step < 0.001:
            break
    return center, radius


def once(function):
    """The same fit of points that are equal once."""
    return lambda points: function(np.unique(points, axis=0))


SOURCES = {
    guo: "Guo & Yang 2019",
    greco: "Greco et al. 2023",
    qi: "Qi et al. 2024",
    nurunnabi: "Nurunnabi et al. 2018",
    rfca: "Ladrón de Guevara et al. 2011",
}
for function, source in SOURCES.items():
    study.register(function.__name__, once(function), reference=f"{source}, as arXiv 2507.11476 has it")

"""The inner loop as one would first write it: a Python loop over trials, NumPy arrays (n, d), no compiled code."""

import numpy as np


def directions(rng, n, half_angle):
    """Uniform on a cap about the first axis, by cosine and azimuth."""
    cosine = 1.0 - rng.random(n) * (1.0 - np.cos(half_angle))
    azimuth = 2.0 * np.pi * rng.random(n)
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([cosine, sine * np.cos(azimuth), sine * np.sin(azimuth)], axis=1)


def bound(u, sigma):
    """√tr CRLB of the centre."""
    w = np.hstack([u, np.ones((len(u), 1))])
    return sigma * np.sqrt(np.trace(np.linalg.inv(w.T @ w)[:3, :3]))


def gdke(x, noise_variance=0.0):
    """Paper eqs 2-6, and 15-21 with a noise variance."""
    n = len(x)
    y = x - x.mean(axis=0)
    c = y.T @ y / (n - 1) - noise_variance * np.eye(3)
    s = (y * (y**2).sum(axis=1)[:, None]).sum(axis=0) / (n - 1)
    offset = 0.5 * np.linalg.solve(c, s)
    return x.mean(axis=0) + offset, np.sqrt((n - 1) / n * np.trace(c) + offset @ offset)


def lls(x):
    """The four-column linear system."""
    design = np.hstack([2.0 * x, np.ones((len(x), 1))])
    beta = np.linalg.lstsq(design, (x**2).sum(axis=1), rcond=None)[0]
    return beta[:3], np.sqrt(beta[3] + beta[:3] @ beta[:3])


def mle(x, start, steps=100):
    """Gauss-Newton from GDKE's answer."""
    c, r = start
    for _ in range(steps):
        y = x - c
        distance = np.sqrt((y**2).sum(axis=1))
        jacobian = np.hstack([-y / distance[:, None], -np.ones((len(x), 1))])
        step = np.linalg.lstsq(jacobian, -(distance - r), rcond=None)[0]
        c, r = c + step[:3], r + step[3]
        if np.linalg.norm(step) <= 1e-9 * r:
            break
    return c, r


def study(rng, trials, n, half_angle, sigma):
    """Errors of the four estimators and the bound, for so many trials."""
    rows = np.empty((trials, 5))
    for t in range(trials):
        u = directions(rng, n, half_angle)
        x = u + sigma * rng.standard_normal((n, 3))
        start = gdke(x)
        fits = (mle(x, start), lls(x), start, gdke(x, sigma**2))
        rows[t] = [*(np.linalg.norm(c) for c, _ in fits), bound(u, sigma)]
    return rows

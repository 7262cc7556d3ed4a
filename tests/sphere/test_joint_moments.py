"""Joint moments against the points themselves, and against arithmetic of 60 digits."""

import math

import mpmath
import numpy as np
import pytest

from study.estimators import ESTIMATORS, Samples
from study.sphere.cap import draw
from study.sphere.joint_moments import JointMoments
from study.sphere.random.sfc64 import WORDS, seeded

CLOSED = ["gdke", "ugdk", "als", "taubin", "pratt", "hyper"]
EPS = 2.0**-52


def stream(seed):
    return np.random.Generator(np.random.SFC64(seed))


def drawn(rng, trials, n, angle, d=3):
    """Directions with heights in place of their first component, and noise of unit size, (trials, d, n) each."""
    directions, noise = np.empty((trials, d, n)), np.empty((trials, d, n))
    draw(seeded(rng.integers(0, 2**64, WORDS, dtype=np.uint64)), math.radians(angle), directions, noise)
    return directions, noise


def errors(name, directions, noise, sigma, radius):
    """Errors (b, d + 1) of centre and radius, by joint moments."""
    joint = JointMoments.of(directions, noise).regression(np.array([sigma]), np.array([radius]))
    fit = ESTIMATORS[name](Samples.of_regression(joint, sigma))
    return np.concatenate([fit.center, fit.radius[:, None]], axis=1)


@pytest.mark.parametrize("name", CLOSED)
@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("angle", [20.0, 90.0, 180.0])
def test_both_routes_agree(name, d, angle):
    """Fits of joint moments and of points agree from σ/r = 1e-6 to 0.1, to 1e-9 of the error and rounding, ε r / φ²."""
    directions, noise = drawn(stream(7), 50, 60, angle, d)
    u = directions.copy()
    u[:, 0] = 1.0 - u[:, 0]
    for sigma in (1e-6, 1e-4, 1e-2, 0.1):
        radius = 2.0
        fit = ESTIMATORS[name](Samples(radius * u + radius * sigma * noise, radius * sigma))
        direct = np.concatenate([fit.center, fit.radius[:, None] - radius], axis=1)
        joint = errors(name, directions, noise, radius * sigma, radius)
        size = np.linalg.norm(joint, axis=1)
        floor = 30.0 * EPS * radius / math.radians(min(angle, 90.0)) ** 2
        apart = np.linalg.norm(direct - joint, axis=1)
        regular = np.isfinite(size) & np.isfinite(apart)
        assert regular.mean() > 0.9
        # an error far beyond the radius comes from a nearly singular matrix, and is as uncertain either way
        tame = regular & (size < radius)
        assert np.all(apart[tame] < 1e-9 * size[tame] + floor), (apart[tame] / (1e-9 * size[tame] + floor)).max()


def exact(directions, noise, sigma, radius, eta):
    """ĉ - c = ½ (C - ηI)⁻¹ s of one set, in sixty digits; C and s in weights of 1/(n-1)."""
    with mpmath.workdps(60):
        d, n = directions.shape
        u = [[mpmath.mpf(float(v)) for v in row] for row in directions]
        u[0] = [1 - t for t in u[0]]
        # the directions have unit length to a rounding only; make it so by their height, which is what was drawn
        for k in range(n):
            across = mpmath.sqrt(sum(u[i][k] ** 2 for i in range(1, d)))
            scale = mpmath.sqrt(1 - u[0][k] ** 2) / across
            for i in range(1, d):
                u[i][k] *= scale
        x = [[radius * u[i][k] + sigma * mpmath.mpf(float(noise[i, k])) for k in range(n)] for i in range(d)]
        mean = [mpmath.fsum(row) / n for row in x]
        y = [[v - mean[i] for v in x[i]] for i in range(d)]
        square = [sum(y[i][k] ** 2 for i in range(d)) for k in range(n)]
        c, s = mpmath.matrix(d), mpmath.matrix(d, 1)
        for i in range(d):
            s[i] = mpmath.fsum(y[i][k] * square[k] for k in range(n)) / (n - 1)
            for j in range(d):
                c[i, j] = mpmath.fsum(y[i][k] * y[j][k] for k in range(n)) / (n - 1) - (eta if i == j else 0)
        offset = mpmath.lu_solve(c, s / 2)
        return [float(mean[i] + offset[i]) for i in range(d)]


@pytest.mark.parametrize("angle", [1.0, 5.0, 90.0])
def test_sixty_digits_at_the_smallest_noise(angle):
    """At σ/r = 1e-13, where points show rounding alone, GDKE's and UGDK's errors have ten digits."""
    directions, noise = drawn(stream(11), 4, 200, angle)
    for name, eta in (("gdke", 0.0), ("ugdk", 1e-26)):
        found = errors(name, directions, noise, 1e-13, 1.0)
        for t in range(len(found)):
            true = np.array(exact(directions[t], noise[t], mpmath.mpf(1e-13), 1, mpmath.mpf(eta)))
            assert np.linalg.norm(found[t, :3] - true) < 1e-10 * np.linalg.norm(true)

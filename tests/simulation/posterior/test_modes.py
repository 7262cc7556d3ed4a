"""Coordinates along rays: there and back, and their volumes.

Log-likelihoods of a sphere: against their definitions by quadrature, direct formulas, and 60-digit arithmetic.
"""

import math

import mpmath
import numpy as np
import pytest
from scipy import integrate

from study.simulation.posterior.sampler import Reference, distances, geometric, whole_sphere


def test_there_and_back(rays):
    """Each is the other's inverse, with the same volume, near and far (to roundings times e⁶).

    Volumes are the Jacobian's determinants, by central differences, up to one constant.
    """
    walkers = np.random.default_rng(4).standard_normal((50, len(rays.origin))) * np.geomspace(0.1, 100.0, 50)[:, None]
    places, volume = rays.coordinates(walkers)
    back, same = rays.walkers(places)
    np.testing.assert_allclose(back, walkers, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(same, volume, atol=1e-9)
    places = np.random.default_rng(5).standard_normal((20, len(rays.origin)))
    _, volume = rays.walkers(places)
    step = 1e-5 * np.eye(len(rays.origin))
    columns = [(rays.walkers(places + s)[0] - rays.walkers(places - s)[0]) / 2e-5 for s in step]
    excess = np.linalg.slogdet(np.stack(columns, axis=2))[1] - volume
    np.testing.assert_allclose(excess, excess[0], atol=1e-5)


def test_centers_alone(rays):
    """Centres at places are those of walkers there; the volume is the Jacobian's determinant, by central differences.

    Mean distances and their sums of squares are those by NumPy.
    """
    d = len(rays.points)
    places = np.random.default_rng(5).standard_normal((20, len(rays.origin)))
    center, volume = rays.centers(places[:, :d])
    walkers, _ = rays.walkers(places)
    np.testing.assert_allclose(center, (rays.origin + walkers @ rays.spread.T)[:, :d], rtol=1e-9, atol=1e-12)
    step = 1e-5 * np.eye(d)
    columns = [(rays.centers(places[:, :d] + s)[0] - rays.centers(places[:, :d] - s)[0]) / 2e-5 for s in step]
    np.testing.assert_allclose(np.linalg.slogdet(np.stack(columns, axis=2))[1], volume, atol=1e-5)
    mean, squares = distances(Reference.of(rays.points, rays.origin[:d], 1.0), center - rays.origin[:d])
    length = np.linalg.norm(rays.points.T - center[:, None], axis=2)
    np.testing.assert_allclose(mean, length.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(squares, length.var(axis=1) * length.shape[1], rtol=1e-9)


@pytest.fixture(params=[2, 3, 5])
def d(request):
    """Two, three and five dimensions; in three the code has a formula of its own."""
    return request.param


def scene(rng, d, n=7, spheres=5, noise=0.3):
    """Points (d, n) about a sphere of radius 1.5 at (2, 2, …), a reference near it, and spheres near that."""
    direction = rng.standard_normal((d, n))
    points = 2.0 + 1.5 * direction / np.linalg.norm(direction, axis=0) + noise * rng.standard_normal((d, n))
    center, radius = np.full(d, 2.1), 1.4
    offsets = 0.2 * rng.standard_normal((spheres, d + 1))
    return points, center, radius, offsets, np.log(noise * rng.uniform(0.5, 2.0, spheres))


def log_density(distance, radius, noise, d):
    """Log-density of a point, from its definition: a Gaussian about r u, averaged over u on the sphere."""
    peak = (distance - radius) ** 2

    def spread(angle, power):
        square = distance**2 + radius**2 - 2.0 * distance * radius * math.cos(angle) - peak
        return math.exp(-power * square / (2.0 * noise**2)) * math.sin(angle) ** (d - 2)

    above, below = (integrate.quad(spread, 0.0, math.pi, (power,), epsabs=0, epsrel=1e-12)[0] for power in (1, 0))
    return math.log(above / below) - peak / (2.0 * noise**2) - 0.5 * d * math.log(2.0 * math.pi * noise**2)


def test_likelihoods(rng, d):
    """The geometric one is -N log σ - Σ(|x - c| - r)²/2σ², with c and r the reference's plus the offset.

    That of the whole sphere is the sum of the points' log-densities, but for (d/2) log 2π each; k is from .1 to 200.
    """
    points, center, radius, offsets, log_noise = scene(rng, d)
    reference = Reference.of(points, center, radius)
    found = zip(geometric(reference, offsets, log_noise), whole_sphere(reference, offsets, log_noise), strict=True)
    for (plain, whole), offset, log_sigma in zip(found, offsets, log_noise, strict=True):
        distance, noise = np.linalg.norm(points - (center + offset[:d])[:, None], axis=0), math.exp(log_sigma)
        squares = np.sum((distance - radius - offset[d]) ** 2)
        assert plain == pytest.approx(-len(distance) * log_sigma - squares / (2.0 * noise**2), rel=1e-12)
        logs = [log_density(x, radius + offset[d], noise, d) for x in distance]
        assert whole == pytest.approx(sum(logs) + 0.5 * d * points.shape[1] * math.log(2.0 * math.pi), rel=1e-9)


@pytest.mark.parametrize("radius", [1e-5, 1e-100])
def test_whole_sphere_of_no_radius_is_a_ball_of_noise(rng, d, radius):
    """As k → 0, the density is a Gaussian about the centre, to the order of k² and (r/σ)²."""
    points = rng.standard_normal((d, 6))
    found = whole_sphere(Reference.of(points, np.zeros(d), radius), np.zeros((1, d + 1)), np.zeros(1))
    assert found[0] == pytest.approx(-0.5 * np.sum(points**2), rel=1e-9)


def test_whole_sphere_at_a_point_in_its_centre(d):
    """At k = 0 and R = 0 the density is (2πσ²)^(-d/2) exp(-r²/2σ²), a number like others."""
    points = np.zeros((d, 1))
    found = whole_sphere(Reference.of(points, np.zeros(d), 1.5), np.zeros((1, d + 1)), np.array([math.log(0.5)]))
    assert found[0] == pytest.approx(-0.5 * (1.5 / 0.5) ** 2 - d * math.log(0.5), rel=1e-12)


def exact(points, excess, offsets, log_noise, name):
    """The log-likelihood in 60 digits, from residuals excess + |y - δ| - |y| - ρ; the reference is at the origin."""
    d, n = points.shape
    with mpmath.workdps(60):
        log_noise, order = mpmath.mpf(log_noise), mpmath.mpf(d) / 2 - 1
        precision, total = mpmath.exp(-2 * log_noise), mpmath.mpf(0)
        for i in range(n):
            y = [mpmath.mpf(v) for v in points[:, i]]
            away = [v - mpmath.mpf(o) for v, o in zip(y, offsets[:d], strict=True)]
            length = mpmath.norm(away)
            radius = 1 + mpmath.mpf(offsets[d])
            distance = mpmath.norm(y) if excess is None else 1 + mpmath.mpf(excess[i])
            residual = length - mpmath.norm(y) + distance - radius
            total -= residual**2 * precision / 2
            if name == "whole_sphere":
                k = (residual + radius) * radius * precision
                scaled = sum(  # e^-k I_ν(k) of a large k (Abramowitz & Stegun 9.7.1), terms below 10⁻⁶⁰ left out
                    (-1) ** j
                    * mpmath.fprod(4 * order**2 - (2 * m - 1) ** 2 for m in range(1, j + 1))
                    / (mpmath.factorial(j) * (8 * k) ** j)
                    for j in range(6)
                ) / mpmath.sqrt(2 * mpmath.pi * k)
                total += mpmath.log(mpmath.gamma(order + 1) * (2 / k) ** order * scaled)
        return total - n * log_noise * (d if name == "whole_sphere" else 1)


@pytest.mark.parametrize("name", ["geometric", "whole_sphere"])
@pytest.mark.parametrize("size", [1.0, 1e-3])
@pytest.mark.parametrize("noise", [3e-3, 1e-4, 1e-6, 1e-12])
def test_nothing_cancels_at_a_trillionth_of_the_radius(rng, d, name, size, noise):
    """Down to σ = 10⁻¹² r, with spheres a thousandth to one σ apart, it is that of 60 digits, to 10⁻¹².

    That is from the stored residuals. From the points themselves the differences between spheres are right to the 10⁻³
    that rounding the distances to 10⁻¹⁶ costs. Distances computed anew for each sphere would lose all of their digits
    at a thousandth of σ.
    """
    n = 12
    direction = rng.standard_normal((d, n))
    points = direction / np.linalg.norm(direction, axis=0) + noise * rng.standard_normal((d, n))
    reference = Reference.of(points, np.zeros(d), 1.0)
    offsets = size * noise * rng.standard_normal((2, d + 1))
    log_noise = np.full(2, math.log(noise))
    found = (geometric if name == "geometric" else whole_sphere)(reference, offsets, log_noise)
    stored = [exact(points, reference.excess, offset, log_noise[0], name) for offset in offsets]
    np.testing.assert_allclose(found, [float(value) for value in stored], rtol=1e-12)
    from_points = [exact(points, None, offset, log_noise[0], name) for offset in offsets]
    assert found[0] - found[1] == pytest.approx(float(from_points[0] - from_points[1]), rel=1e-3)


@pytest.mark.parametrize("likelihood", [geometric, whole_sphere])
def test_many_spheres_at_once(rng, d, likelihood):
    """Many spheres have the bits of each alone, so a chain does not depend on how its walkers are grouped."""
    points, center, radius, offsets, log_noise = scene(rng, d, n=33, spheres=40)
    reference = Reference.of(points, center, radius)
    found = likelihood(reference, offsets, log_noise)
    assert found.shape == (40,)
    each = [likelihood(reference, offsets[i : i + 1], log_noise[i : i + 1])[0] for i in range(40)]
    np.testing.assert_array_equal(found, each)

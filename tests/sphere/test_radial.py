"""Means of a noisy radius against confluent hypergeometric functions of 60 digits."""

import mpmath
import numpy as np
import pytest
from scipy import special

from study.sphere.radial import RadialMeans, angle_means, radial_means

RADIUS = 1.7


def mean_power(k, r, s, d):
    """E Rᵏ by its closed form."""
    half = mpmath.mpf(d) / 2
    scale = (2 * s) ** (mpmath.mpf(k) / 2) * mpmath.gamma(half + mpmath.mpf(k) / 2) / mpmath.gamma(half)
    return scale * mpmath.hyp1f1(-mpmath.mpf(k) / 2, half, -r * r / (2 * s))


def mean_direction(r, s, d):
    """E e·u = ∂E R/∂r, by its closed form."""
    half = mpmath.mpf(d) / 2
    scale = r / mpmath.sqrt(2 * s) * mpmath.gamma(half + mpmath.mpf(1) / 2) / mpmath.gamma(half + 1)
    return scale * mpmath.hyp1f1(mpmath.mpf(1) / 2, half + 1, -r * r / (2 * s))


def exact(r, s, d):
    """All fields of `RadialMeans`, with derivatives by differences of 25 digits."""
    r, s = mpmath.mpf(r), mpmath.mpf(s)
    mean = lambda r, s: mean_power(1, r, s, d)  # noqa: E731
    direction = lambda r, s: mean_direction(r, s, d)  # noqa: E731
    variance = lambda r, s: r * r + d * s - mean(r, s) ** 2  # noqa: E731
    first = lambda r, s: r / direction(r, s)  # noqa: E731
    second = lambda r, s: (r * mean(r, s) + s * direction(r, s)) / r  # noqa: E731
    by_r = lambda f: mpmath.diff(lambda q: f(q, s), r, h=r * mpmath.mpf(10) ** -25)  # noqa: E731
    by_s = lambda f: mpmath.diff(lambda q: f(r, q), s, h=s * mpmath.mpf(10) ** -25)  # noqa: E731
    return RadialMeans(
        mean(r, s) - r,
        direction(r, s) - 1,
        variance(r, s),
        first(r, s) - r,
        second(r, s) - r,
        by_s(mean),
        by_r(variance),
        by_s(variance),
        by_r(first) - 1,
        by_s(first),
        by_r(second) - 1,
        by_s(second),
    )


@pytest.mark.parametrize("dimension", [2, 3, 4, 20])
@pytest.mark.parametrize("noise", [1e-6, 1e-3, 0.05, 0.111, 0.113, 0.5, 1.0, 30.0])
def test_against_closed_forms(dimension, noise):
    """All means and derivatives have 11 digits, from σ far below r to far above it."""
    with mpmath.workdps(60):
        wanted = exact(RADIUS, (RADIUS * noise) ** 2, dimension)
    found = radial_means(RADIUS, (RADIUS * noise) ** 2, dimension)
    for name, value, truth in zip(RadialMeans._fields, found, wanted, strict=True):
        floor = 1e-15 * noise if name == "variance_by_r" else 0.0  # of order σ²/r, from terms of order σ
        np.testing.assert_allclose(value, float(truth), rtol=1e-11, atol=floor, err_msg=name)


@pytest.mark.parametrize("dimension", [2, 3, 4])
def test_without_noise(dimension):
    """At σ = 0 a radius is not lengthened, and no variance is left."""
    found = radial_means(RADIUS, 0.0, dimension)
    assert [found.lengthening, found.shortening, found.variance, found.excess01, found.excess12] == [0.0] * 5
    assert found.variance_by_s == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("dimension", [2, 3, 5])
@pytest.mark.parametrize("noise", [0.05, 0.3, 1.0])
def test_by_draws(dimension, noise):
    """Means of 2·10⁵ draws agree within 4.5 standard errors; false alarms of the whole file: 3e-4."""
    rng = np.random.default_rng(7)
    y = noise * rng.standard_normal((200_000, dimension))
    y[:, 0] += 1.0
    distance = np.linalg.norm(y, axis=1)
    along = y[:, 0] / distance
    found = radial_means(1.0, noise**2, dimension)
    for draws in [
        distance - 1.0 - found.lengthening,
        along - 1.0 - found.shortening,
        (distance - 1.0 - found.lengthening) ** 2 - found.variance,
        (distance - 1.0 - found.excess01) * along,
        (distance - 1.0 - found.excess12) * distance * along,
    ]:
        assert abs(draws.mean()) < 4.5 * draws.std() / np.sqrt(len(draws))


@pytest.mark.parametrize("d", [2, 3, 4, 9])
def test_angle_given_the_radius(d):
    """The Bessel functions of the angle's law are those of SciPy; at large κ, beyond its range, the series' limit."""
    kappa = np.array([np.logspace(-8, 8, 200)])
    density, cosine = np.empty_like(kappa), np.empty_like(kappa)
    angle_means(kappa, d, density, cosine)
    order = 0.5 * d - 1.0
    np.testing.assert_allclose(density, np.sqrt(kappa) * special.ive(order, kappa), rtol=1e-12)
    np.testing.assert_allclose(cosine, special.ive(order + 1.0, kappa) / special.ive(order, kappa), rtol=1e-12)
    angle_means(np.full((1, 200), 1e20), d, density, cosine)
    np.testing.assert_allclose(density, 1.0 / np.sqrt(2.0 * np.pi), rtol=1e-15)
    np.testing.assert_allclose(cosine, 1.0, rtol=1e-15)

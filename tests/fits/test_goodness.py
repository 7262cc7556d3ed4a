"""The test of fit: its moments, its level, what it sees, and the errors that allow for what it sees.

Circles in space: they are named, fitted with errors, and their intervals are open along the axis.
"""

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

import study
from study import Status
from study.fits import Samples
from study.fits import goodness as module
from study.fits.cap import sample_cap
from study.fits.goodness import (
    _memory,
    columns,
    evenly_thinned,
    f_tail,
    goodness,
    harmonics,
    lengths,
    normal_scores,
    wave_moments,
)


def directions(rng, shape, degrees=180.0, d=3):
    """Directions (…, n, d), uniform on caps."""
    return sample_cap(rng, math.prod(shape), math.radians(degrees), d).reshape(*shape, d)


def remembering(z, memory):
    """AR(1) noise of unit variance, of white noise (b, n, …)."""
    return lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], z, axis=1)


def answer_of(points):
    """The test of points (b, n, d)."""
    return goodness(Samples(np.ascontiguousarray(points.swapaxes(1, 2))))


@pytest.mark.parametrize("d", [2, 3, 5])
def test_columns_are_harmonics(d):
    """Columns of one degree are orthogonal to those of others over the sphere, and as many as theory says."""
    basis = harmonics(d, 4)
    count = [1] + [round((2 * k + d - 2) / k * math.comb(k + d - 3, k - 1)) for k in range(1, 5)]
    assert np.bincount(basis.degree).tolist() == count
    u = directions(np.random.default_rng(1), (1, 400_000), d=d).swapaxes(1, 2)
    Y = columns(u, basis)[0]
    Y /= np.sqrt((Y**2).mean(axis=1, keepdims=True))
    gram = Y @ Y.T / Y.shape[1]
    other = basis.degree[:, None] != basis.degree
    assert np.abs(gram[other]).max() < 6.0 * 3.0 / math.sqrt(Y.shape[1])  # products have a variance below 9


def about_a_direction(sigma):
    """R, cosine of the angle from u, and weight of y = u + noise in space, by a product rule along and across u."""
    x, w = np.polynomial.hermite_e.hermegauss(80)
    q, v = np.polynomial.laguerre.laggauss(80)
    along, across = 1.0 + sigma * x[:, None], sigma * np.sqrt(2.0 * q)[None]
    R = np.hypot(along, across)
    return R, along / R, (w[:, None] * v[None]) / w.sum()


@pytest.mark.parametrize("sigma", [0.02, 0.1, 0.2])
def test_lengths_agree_with_a_quadrature(sigma):
    R, cosine, weight = about_a_direction(sigma)
    for degree in range(5):
        P = np.polynomial.legendre.legval(cosine, np.eye(5)[degree])
        expected = (weight * R * P).sum() / (weight * P).sum()
        assert lengths(np.array([sigma**2]), 3, 4)[0, degree] == pytest.approx(expected, abs=1e-3 * sigma**2)


@pytest.mark.parametrize("tau", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("degree", range(5))
def test_waves_have_no_mean_about_any_direction(degree, tau):
    """E[f(R) P_l(e·u)] = 0 by a quadrature, for noise of .3 r: other harmonics of degree l vanish, turned about u."""
    R, cosine, weight = about_a_direction(0.3)
    basis = harmonics(3, 4)
    e = np.stack([cosine, np.sqrt(1.0 - cosine**2), np.zeros_like(R)]).reshape(1, 3, -1)
    Y = columns(e, basis)
    P = np.polynomial.legendre.legval(cosine.ravel(), np.eye(5)[degree])
    zonal = np.linalg.lstsq(Y[0, basis.degree == degree].T, P)[0]
    terms, _ = wave_moments(R.reshape(1, -1), Y, np.array([0.09]), basis, tau, degree)
    weighted = zonal @ terms[0] * weight.ravel()
    assert abs(weighted.sum()) < 1e-8 * np.abs(weighted).sum()


@pytest.mark.parametrize("d", [2, 3, 4])
@pytest.mark.parametrize("degree", range(5))
def test_slopes_of_waves(d, degree):
    """Minus the slopes by centre, radius and noise, by central differences; τ is a number in inverse lengths."""
    rng, tau, h = np.random.default_rng(4), 2.0, 1e-5
    x = directions(rng, (1, 500), 100.0, d).swapaxes(1, 2) + 0.2 * rng.normal(size=(1, d, 500))
    basis = harmonics(d, 4)

    def means(parameters):
        center, r, s = parameters[:d], parameters[d], parameters[d + 1]
        y = (x - center[:, None]) / r
        R = np.linalg.norm(y, axis=1)
        return wave_moments(R, columns(y / R[:, None], basis), np.array([s / r**2]), basis, tau * r, degree)

    at = np.array([0.1] * d + [1.1, 0.05])
    slopes = means(at)[1][0]
    for j, step in enumerate(h * np.eye(d + 2)):
        up, down = ((at + sign * step)[d] ** 2 * means(at + sign * step)[0][0].mean(axis=1) for sign in (1.0, -1.0))
        scale = at[d] ** 2 / (at[d] if j <= d else at[d] ** 2)
        assert -(up - down) / (2.0 * h) == pytest.approx(scale * slopes[:, j], rel=1e-5, abs=1e-8)


@pytest.mark.parametrize(
    ("d", "n", "angle", "sigma"),
    [
        (3, 10, 45, 0.01),
        (3, 40, 20, 0.005),
        (3, 200, 90, 0.1),
        (3, 400, 90, 0.3),
        (3, 12, 180, 0.3),
        (3, 1000, 180, 0.35),
        (3, 200, 180, 0.25),
        (2, 60, 180, 0.05),
        (4, 60, 180, 0.1),
    ],
)
def test_level_on_clean_points(d, n, angle, sigma):
    """At most as many rejections in 1000 sets as a level of 1.4 % gives in all but 1e-4 of runs."""
    rng = np.random.default_rng(n + d)
    u = directions(rng, (1000, n), angle, d)
    answer = answer_of(u + sigma * rng.normal(size=u.shape))
    assert np.isfinite(answer.p).all()
    assert (answer.p < 0.01).sum() <= binom.isf(1e-4, 1000, 0.014)
    assert (answer.p < 0.2).sum() >= binom.ppf(1e-4, 1000, 0.1)  # it can speak


@pytest.mark.parametrize(("d", "sigma"), [(2, 0.04), (3, 0.04), (3, 0.06), (3, 0.7), (5, 0.3)])
def test_scores_of_distances_are_normal(d, sigma):
    """Mean, variance, skewness and kurtosis of 10⁶ scores, each within 4.5 standard errors and what σ⁴ leaves."""
    rng = np.random.default_rng(3)
    away = sigma * rng.normal(size=(1_000_000, d))
    away[:, 0] += 1.0
    z = normal_scores(np.linalg.norm(away, axis=1)[None], np.array([sigma**2]), d)[0]
    moments = [z.mean(), (z**2).mean() - 1.0, (z**3).mean(), (z**4).mean() - 3.0]
    assert (np.abs(moments) < 4.5e-3 * np.sqrt([1.0, 2.0, 15.0, 96.0])).all()


def test_every_misfit_is_named():
    """Shapes and laws of noise that fits do not show, each named by its block in at least 90 of 100 sets."""
    rng = np.random.default_rng(5)
    u, z = directions(rng, (100, 200)), rng.normal(size=(100, 200, 3))
    cases = {
        "shape": u * [1.0, 0.9, 0.8] + 0.01 * z,
        "unequal noise": u + 0.02 * z * np.where(u[..., :1] > 0.3, 4.0, 1.0),
        "tails": u * rng.choice([1.0, 0.9], (100, 200, 1)) + 0.01 * z,
        "memory": u * (1.0 + 0.02 * remembering(z[..., :1], 0.8)),
    }
    for name, points in cases.items():
        assert (answer_of(points).first() == name).mean() >= 0.9, name


def test_a_misfit_larger_than_noise_explains_speaks():
    """A cylinder without its ends: a sphere leaves residuals of .1 r, and the harmonics explain all of them."""
    rng, n = np.random.default_rng(12), 200
    angle = rng.uniform(0.0, 2.0 * math.pi, (20, n))
    wall = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-1.0, 1.0, (20, n))], axis=-1)
    assert (answer_of(wall + 0.01 * rng.normal(size=wall.shape)).first() == "shape").all()


def test_a_filled_cube_is_no_sphere():
    """Uniform in a cube, N = 200: low moments see .38 of them; a sphere is rejected in at least 185 of 200."""
    rng = np.random.default_rng(13)
    answer = answer_of(rng.uniform(-1.0, 1.0, (200, 200, 3)) + 0.01 * rng.normal(size=(200, 200, 3)))
    assert (answer.first() == "shape").sum() >= 185


def test_moving_turning_and_scaling_change_nothing():
    rng = np.random.default_rng(6)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    u = directions(rng, (5, 60), 60.0)
    points = u + 0.05 * rng.normal(size=u.shape)
    first = np.stack(answer_of(points))
    for other in (points @ turn.T, 1e30 * points, points + np.array([3.0, -2.0, 5.0])):
        assert np.stack(answer_of(other)) == pytest.approx(first, rel=1e-5, nan_ok=True)


def test_nothing_is_said_without_freedom_or_noise():
    rng = np.random.default_rng(8)
    u = directions(rng, (3, 12))
    assert np.isnan(np.stack(answer_of(u))).all()
    assert np.isnan(np.stack(answer_of(u[:, :6]))).all()
    few = answer_of(u + 0.01 * rng.normal(size=u.shape))
    assert np.isfinite(few.shape).all()
    assert np.isfinite(few.memory).all()
    assert np.isnan(few.tails).all()
    flat = np.zeros((1, 30, 3))
    flat[0, :, :2] = directions(rng, (30,), d=2)
    assert np.isnan(answer_of(flat).p).all()
    assert set(few.first(1e-12)) == {""}
    assert set(answer_of(u + 0.01).first()) <= {"", *module.BLOCKS}


def test_memory_has_its_exact_mean_and_variance():
    """The p value by moments of the ratio of quadratic forms that NumPy forms from whole matrices."""
    rng = np.random.default_rng(9)
    n, Q = 15, np.linalg.qr(rng.normal(size=(15, 4)))[0]
    rho = rng.normal(size=n)
    rho -= Q @ (Q.T @ rho)
    shift = 0.5 * (np.eye(n, k=1) + np.eye(n, k=-1))
    projected = (np.eye(n) - Q @ Q.T) @ shift
    free, trace = n - 4, np.trace(projected)
    variance = 2.0 * (free * np.trace(projected @ projected) - trace**2) / (free**2 * (free + 2.0))
    share = (rho @ shift @ rho / (rho @ rho) - trace / free) ** 2
    rest = np.array([1.0 / variance - 1.0])
    expected = f_tail(share * rest / (1.0 - share), np.ones(1), rest)
    assert _memory(rho[None], Q.T[None], np.array([rho @ rho])) == pytest.approx(expected)


def test_memory_is_named_where_it_explains_more_than_a_form():
    """Noise with memory on a path looks like a form, and an ellipsoid along a path like memory: each has its name."""
    rng, n = np.random.default_rng(13), 400
    t = np.linspace(0.0, 6.0 * math.pi, n)
    a, b = 0.6 * np.sin(t), 0.6 * np.sin(1.31 * t + 0.4)
    u = np.column_stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
    z = rng.normal(size=(50, n, 3))
    remembers, egg = answer_of(u + 0.01 * remembering(z, 0.9)), answer_of(u * [1.0, 0.9, 0.8] + 0.003 * z)
    for answer in (remembers, egg):
        assert answer.speaks()[[0, 3]].all()
    assert (remembers.first() == "memory").mean() >= 0.9
    assert (egg.first() == "shape").mean() >= 0.9


def test_very_large_sets_are_tested_in_part():
    """100,000 of 250,000 points are tested, in stretches of neighbours: memory is seen, a form of .001 σ is not."""
    rng, n = np.random.default_rng(14), 250_000
    u, z = directions(rng, (1, n)), rng.normal(size=(1, n, 3))
    assert evenly_thinned(Samples(u.swapaxes(1, 2))).shape == (1, 3, 100_000)
    assert answer_of(u * (1.0 + 1e-5 * u[..., :1] ** 2) + 0.01 * z).p[0] > 1e-4
    along = z[..., :1] + 0.3 * np.roll(z[..., :1], 1, axis=1)
    assert answer_of(u * (1.0 + 0.01 * along)).first()[0] == "memory"


def arcs(rng, sets, n, reach, width=0.0, sigma=0.01):
    """Points (sets, n, 3) of arcs of ± reach degrees on great circles about z, or of belts about them."""
    a, b = (np.radians(rng.uniform(-half, half, (sets, n))) for half in (reach, width))
    u = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
    return u + sigma * rng.normal(size=u.shape)


@pytest.mark.parametrize(("reach", "width"), [(45.0, 0.0), (180.0, 0.0), (90.0, 3.0)])
@pytest.mark.parametrize("n", [30, 300])
def test_circles_are_named(reach, width, n):
    """At least .98 of 400 sets are a hinge, and no more than that is bounded; false alarms 1e-4."""
    fit = study.fit(arcs(np.random.default_rng(n), 400, n, reach, width))
    assert (fit.status == Status.HINGE).sum() >= binom.ppf(1e-4, 400, 0.98)
    assert np.isfinite(fit.interval("radius")[:, 1]).mean() <= 0.05
    assert (fit.interval("radius")[:, 0] <= 1.0).mean() >= 0.95
    named = fit.status == Status.HINGE
    assert np.isinf(fit.interval("center")[named]).all()


@pytest.mark.parametrize("estimator", ["mle", "als", "gdke", "robust", "hinge"])
def test_every_estimator_says_so(estimator):
    fit = study.fit(arcs(np.random.default_rng(1), 20, 60, 120.0), estimator)
    assert (fit.status == Status.HINGE).mean() >= 0.95


@pytest.mark.parametrize("degrees", [20.0, 60.0, 180.0])
@pytest.mark.parametrize("sigma", [0.002, 0.03])
def test_caps_are_no_circles(on_cap, degrees, sigma):
    """Of 1000 caps at most as many are named as a share of .5 % gives in all but 1e-4 of runs."""
    fit = study.fit(on_cap(np.random.default_rng(2), 40, degrees, noise=sigma, sets=1000)[0])
    assert (fit.status == Status.HINGE).sum() <= binom.isf(1e-4, 1000, 0.005)


def test_errors_of_the_circle():
    """Centre, radius and axis scatter as their errors say: standardised errors of 500 arcs have a size of 1 to 12 %."""
    rng = np.random.default_rng(3)
    fit = study.fit(arcs(rng, 500, 80, 70.0))
    circle = fit.circle
    for error in ((circle.center / circle.center_errors).T, (circle.radius - 1.0) / circle.radius_error):
        assert np.sqrt(np.mean(error**2, axis=-1)) == pytest.approx(1.0, abs=0.12)
    tilt = np.arccos(np.minimum(np.abs(circle.axis[:, 2]), 1.0))
    assert np.sqrt(np.mean((tilt / circle.axis_error) ** 2)) == pytest.approx(1.0, abs=0.12)  # the other tilt is small


def test_a_circle_of_latitude_and_any_frame():
    """A small circle of a sphere is a circle as well; turned, moved and scaled it is the same one."""
    rng = np.random.default_rng(4)
    angle = rng.uniform(0.0, 2.0 * math.pi, 100)
    ring = np.column_stack([0.8 * np.cos(angle), 0.8 * np.sin(angle), np.full(100, 0.6)])
    points = ring + 0.005 * rng.normal(size=ring.shape)
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.array([3.0, -2.0, 5.0])
    fit, moved, huge = study.fit(points), study.fit(points @ turn.T + shift), study.fit(1e60 * points)
    for other in (fit, moved, huge):
        assert other.status == Status.HINGE
    np.testing.assert_allclose(moved.circle.center, fit.circle.center @ turn.T + shift, atol=1e-9)
    np.testing.assert_allclose(np.abs(moved.circle.axis @ turn @ fit.circle.axis), 1.0, atol=1e-9)
    np.testing.assert_allclose(huge.circle.radius, 1e60 * fit.circle.radius, rtol=1e-9)
    np.testing.assert_allclose(fit.circle.radius, 0.8, atol=5.0 * float(fit.circle.radius_error))


def test_other_dimensions_have_no_circle_in_space():
    u = np.random.default_rng(5).normal(size=(40, 2))
    assert np.isnan(study.fit(u).circle.radius)
    assert study.fit(u).circle.center.shape == (3,)

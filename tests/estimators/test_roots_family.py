"""The family that finds its own noise: the root η against other software and 40-digit sums, and theory's errors (§5.3).

`test_algebraic.py` compares centres with the publications' eigenproblems; here are the package circle-fit, the root η,
the radius, the quadratic pencil of `als`, and the variances of theory §5.3.
"""

import circle_fit
import mpmath
import numpy as np
import pytest
from scipy.linalg import eig

import study
from study import Status
from study.estimators import Samples
from study.estimators.algebraic import root
from study.sphere.cap import sample_cap

KAPPA = {"taubin": lambda d: 0.0, "pratt": lambda d: -4.0, "hyper": lambda d: -d * d, "als": lambda d: 2.0 * d}
RADIUS = {"taubin": lambda d: 0, "pratt": lambda d: 2, "hyper": lambda d: -d, "als": lambda d: -d}
NAMES = list(KAPPA)


def eta_of(points, name):
    """The root η in weights of 1/n, for one set or a batch (…, n, d)."""
    *lead, n, d = points.shape
    samples = Samples(points.reshape(-1, n, d).swapaxes(1, 2))
    return (root(samples, KAPPA[name](d)) * (n - 1) / n).reshape(lead)


def pencil(points, name):
    """Smallest root and sphere (η, centre, radius) of the matrix pencils of theory §5.1, by LAPACK, data centred.

    With z = (|x|², x, 1) and M their mean products, Taubin, Pratt and Hyper are M θ = η N θ. `als` is quadratic,
    (M - η N_H + d(d+2) η² e₁e₁ᵀ) θ = 0, and is made linear in (θ, ηθ).
    """
    n, d = points.shape
    origin = points.mean(axis=0)
    x = points - origin
    z = np.column_stack([np.sum(x**2, axis=1), x, np.ones(n)])
    moments, mean, unit = z.T @ z / n, z.mean(axis=0), np.eye(d + 2)[0]
    taubin = np.diag([4 * mean[0], *np.ones(d), 0.0])
    pratt = np.diag([0.0, *np.ones(d), 0.0])
    pratt[0, -1] = pratt[-1, 0] = -2.0
    hyper = taubin + d * (np.outer(mean, unit) + np.outer(unit, mean))
    if name == "als":
        zero, one = np.zeros((d + 2, d + 2)), np.eye(d + 2)
        left = np.block([[zero, one], [-moments, hyper]])
        right = np.block([[one, zero], [zero, d * (d + 2) * np.outer(unit, unit)]])
    else:
        left, right = moments, {"taubin": taubin, "pratt": pratt, "hyper": hyper}[name]
    values, vectors = eig(left, right)
    real = np.isfinite(values) & (np.abs(values.imag) < 1e-9 * np.abs(values)) & (values.real > 0.0)
    first = np.flatnonzero(real)[np.argmin(values[real].real)]
    _, b, c = np.split(vectors[: d + 2, first].real / vectors[0, first].real, [1, d + 1])
    return values[first].real, origin - b / 2, np.sqrt(b @ b / 4 - c[0])


@pytest.fixture(scope="module")
def circles(on_cap):
    """Points and radius of 60 circles: 6 to 200 points on arcs of 60° to 360° of any position, noise 0.001 to 0.1 r."""
    rng, sets = np.random.default_rng(7), []
    for _ in range(60):
        n, angle, radius = int(rng.integers(6, 200)), rng.uniform(30.0, 180.0), 10 ** rng.uniform(-1, 1.5)
        noise = radius * 10 ** rng.uniform(-3, -1)
        center = 2 * radius * rng.standard_normal(2)
        sets.append((on_cap(rng, n, angle, 2, noise, radius, center, axis=rng.standard_normal(2))[0], radius))
    return sets


@pytest.mark.parametrize("name", ["taubin", "pratt", "hyper"])
def test_circle_fit(circles, name):
    """In 2-D centre and radius are those of the package circle-fit (Chernov's programs), to 1e-9 r."""
    peer = {"taubin": circle_fit.taubinSVD, "pratt": circle_fit.prattSVD, "hyper": circle_fit.hyperSVD}[name]
    for points, radius in circles:
        fit, (x, y, r, _) = study.fit(points, name), peer(points)
        np.testing.assert_allclose([*fit.center, fit.radius], [x, y, r], rtol=0, atol=1e-9 * radius)


def test_als_is_kukush_markovsky_van_huffel(circles):
    """The centre of `als` is that of circle-fit's Kukush-Markovsky-van Huffel fit, to the 1e-6 r which that resolves.

    Its program bisects on the sign of an eigenvalue of a raw moment matrix; its radius is the mean distance.
    """
    for points, radius in circles:
        x, y, _, _ = circle_fit.kmh((points - points.mean(axis=0)) / radius, iter_max=200, epsilon=1e-15)
        center = points.mean(axis=0) + radius * np.array([x, y])
        np.testing.assert_allclose(study.fit(points, "als").center, center, rtol=0, atol=1e-6 * radius)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("noise", [0.01, 0.3])
def test_generalised_eigenproblem(rng, on_cap, noise, d, name):
    """Root, centre and radius are those of the published matrix pencil, to 1e-9 of their size."""
    for points in on_cap(rng, 40, 100.0, d, noise, radius=2.0, center=1.0, sets=20)[0]:
        fit, (eta, center, radius) = study.fit(points, name), pencil(points, name)
        size = np.linalg.norm(center - points.mean(axis=0)) + radius
        assert eta_of(points, name) == pytest.approx(eta, rel=1e-9, abs=1e-12)
        np.testing.assert_allclose([*fit.center, fit.radius], [*center, radius], rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("d", [2, 3, 5])
def test_root_of_the_equation(rng, on_cap, d, name):
    """Equation (5.1), from the raw data in 40 digits, changes sign within 1e-9 of η, below λ_min.

    Centre and radius follow from that root. For a small root g(0) is the difference of terms of size m₄, so η has
    an absolute error of some ε m₂ besides.
    """
    with mpmath.workdps(40):
        for noise, angle, n in [(1e-3, 60, 20), (0.05, 20, 100), (0.1, 180, d + 2), (0.5, 60, 30), (30.0, 180, 12)]:
            points = on_cap(rng, n, angle, d, noise, center=0.5)[0]
            x = mpmath.matrix(points.tolist())
            mean = [mpmath.fsum(x[:, i]) / n for i in range(d)]
            y = mpmath.matrix(n, d)
            for k in range(n):
                for i in range(d):
                    y[k, i] = x[k, i] - mean[i]
            square = mpmath.matrix([mpmath.fsum(y[k, i] ** 2 for i in range(d)) for k in range(n)])
            c, s = y.T * y / n, y.T * square / n
            m2, m4 = mpmath.fsum(square) / n, (square.T * square)[0] / n

            def g(eta, c=c, s=s, m2=m2, m4=m4):
                solved = mpmath.cholesky_solve(c - eta * mpmath.eye(d), s)  # raises unless positive definite
                return m4 - m2**2 - 4 * eta * m2 + KAPPA[name](d) * eta**2 - (s.T * solved)[0], solved

            eta = float(eta_of(points, name))
            slack = 1e-9 * eta + 100 * np.finfo(float).eps * float(m2)
            assert 0 <= eta < min(mpmath.eigsy(c, eigvals_only=True))
            assert g(mpmath.mpf(max(eta - slack, 0.0)))[0] > 0 > g(mpmath.mpf(eta + slack))[0]
            offset = np.array([float(v) / 2 for v in g(mpmath.mpf(eta))[1]])
            fit = study.fit(points, name)
            np.testing.assert_allclose(fit.center, [float(m) for m in mean] + offset, rtol=1e-9, atol=1e-9)
            expected = float(m2) + offset @ offset + RADIUS[name](d) * eta
            assert fit.radius**2 == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", [*NAMES, "fuller"])
@pytest.mark.parametrize("d", [2, 3, 4])
def test_interpolation_is_gdke(rng, on_cap, d, name):
    """Through d + 1 points there is one sphere without residuals: g(0) = 0, so every member is `gdke` (theory 5.1)."""
    points, directions = on_cap(rng, d + 1, d=d, noise=0.1, radius=3.0, center=1.0, sets=300)
    apart = np.linalg.svd(directions - directions.mean(axis=1, keepdims=True), compute_uv=False)[:, d - 1]
    points = points[apart > 0.3]  # the centre loses 1e-15 / 0.3², the root the square of that
    assert len(points) > 50
    fit, plain = study.fit(points, name), study.fit(points, "gdke")
    np.testing.assert_allclose(fit.center, plain.center, rtol=0, atol=1e-9)
    np.testing.assert_allclose(fit.radius, plain.radius, rtol=0, atol=1e-9)
    assert np.isnan(fit.noise_variance).all()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("d", [2, 3])
def test_root_grows_with_the_noise(rng, on_cap, d, name):
    """More of the same noise gives a larger η: every doubling from 1e-5 r to 1000 r, on each of 50 sets."""
    directions = on_cap(rng, 30, 80.0, d, sets=50)[1]
    z = rng.standard_normal(directions.shape)
    etas = np.array([eta_of(directions + sigma * z, name) for sigma in 1e-5 * 2.0 ** np.arange(27)])
    assert np.all(np.diff(etas, axis=0) > 0.0)


@pytest.mark.parametrize(("angle", "noise"), [(60.0, 0.3), (20.0, 0.03), (180.0, 0.5)])
def test_insignificant(rng, on_cap, angle, noise):
    """`als` and `fuller` are INSIGNIFICANT where λ_min - η ≤ 2η√(2/N), nowhere else (theory §2.2)."""
    points = on_cap(rng, 50, angle, noise=noise, sets=1000)[0]
    eta = eta_of(points, "als") * 50 / 49
    least = np.linalg.eigvalsh(np.array([np.cov(p.T) for p in points]))[:, 0]
    excess = (least - eta) / (2 * eta * np.sqrt(2 / 50))
    assert np.abs(excess - 1).min() > 1e-9  # no set lies on the edge
    weak = excess <= 1
    assert 10 < weak.sum() < 990
    for name in ("als", "fuller"):
        found = study.fit(points, name).own_status
        np.testing.assert_array_equal(found, np.where(weak, Status.INSIGNIFICANT, Status.OK))


def median_ratios(angle, noise, estimators, trials):
    """Median |ĉ - c| of each estimator over that of N(0, CRLB), N = 10 000, d = 3; and σ̂/σ of `als`.

    N(0, CRLB) is sampled by projecting the same normals z, K⁻¹Σ(u - ū)(uᵀz)σ with K = Σ(u - ū)(u - ū)ᵀ: its
    covariance is the bound of the realised directions, and chance is largely common to both medians.
    """
    rng, n = np.random.default_rng(20040101), 10_000
    errors, bound, sigma = {name: [] for name in estimators}, [], []
    for _ in range(trials // 50):
        u = sample_cap(rng, 50 * n, np.radians(angle), 3).reshape(50, n, 3).swapaxes(1, 2)
        z = rng.standard_normal((50, 3, n))
        y = u - u.mean(axis=2, keepdims=True)
        along = y @ np.einsum("bin,bin->bn", u, z)[:, :, None]
        bound.append(noise * np.linalg.norm(np.linalg.solve(y @ y.swapaxes(1, 2), along)[:, :, 0], axis=1))
        for name in estimators:
            fit = study.fit((u + noise * z).swapaxes(1, 2), name, noise)
            errors[name].append(np.linalg.norm(fit.center, axis=1))
            if name == "als":
                sigma.append(np.sqrt(fit.noise_variance) / noise)
    middle = np.median(np.concatenate(bound))
    return {name: np.median(np.concatenate(e)) / middle for name, e in errors.items()}, np.concatenate(sigma)


def test_als_attains_the_bound():
    """At 20°, N = 10⁴, σ = .01 r `als` errs as N(0, CRLB), `ugdk` 1.27 and `gdke` 61 times as much (theory §5.3).

    2000 trials. Scatter of the ratios, from 12 seeds of 1000 trials: .010, .030 and 1.0, of which the margins are 4.5.
    """
    ratio, sigma = median_ratios(20.0, 0.01, ["als", "ugdk", "gdke"], 2000)
    assert ratio["als"] < 1.05
    assert ratio["ugdk"] == pytest.approx(np.sqrt(1.64), abs=0.14)  # the axial variance of (5.3)
    assert ratio["gdke"] == pytest.approx(60.6, abs=5.0)
    # σ̂ scatters by 1/√(2N) = 0.7 %; the median of 2000 by 0.02 %, their scatter by 1.6 %
    assert np.median(sigma) == pytest.approx(1.0, abs=1e-3)
    assert sigma.std() == pytest.approx(1 / np.sqrt(2e4), rel=0.08)


def test_als_is_consistent_where_others_are_not():
    """At 45°, N = 10⁴, σ = .3 r `als` errs less than 3 times as N(0, CRLB), MLE and Taubin more than 20 (theory §5.3).

    2400 trials; the ratios are 2.6, 25.3 and 21.7, and scatter by .08, .4 and .36: margins of 4.7 and more.
    """
    ratio, sigma = median_ratios(45.0, 0.3, ["als", "mle", "taubin"], 2400)
    assert ratio["als"] < 3.0
    assert ratio["mle"] > 20.0
    assert ratio["taubin"] > 20.0
    assert np.median(sigma) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("d", [2, 3])
def test_als_variance_is_unbiased_at_any_size(rng, on_cap, assert_mean, d):
    """On a half sphere the mean of σ̂² is σ² at n = 8, 12, 20, 50 and 100: 20 000 trials each, to 4.5 standard errors.

    As σ → 0 it is the residual variance of a linear regression with d + 1 columns, exactly unbiased; what remains is
    some -50 σ²/(n r²) = -6e-5 at σ = .003 r and n = 8, a fortieth of a standard error.
    """
    for n in (8, 12, 20, 50, 100):
        fit = study.fit(on_cap(rng, n, 90.0, d, noise=0.003, sets=20_000)[0], "als")
        assert_mean(fit.noise_variance / 0.003**2, 1.0)

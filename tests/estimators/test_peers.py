"""Agreement with other people's software on 200 data sets: scikit-spatial, trimesh and SciPy."""

import numpy as np
import pytest
from scipy.optimize import least_squares, root
from skspatial.objects import Sphere
from trimesh.nsphere import fit_nsphere

import study
from study import Status


@pytest.fixture(scope="module")
def sets(on_cap):
    """Points, true centre, true radius and √tr CRLB/r of 200 sets: n 5..500, caps 40..180°, noise 0.001..0.05 r."""
    rng = np.random.default_rng(137)
    result = []
    for _ in range(200):
        n, angle = int(np.exp(rng.uniform(np.log(5), np.log(501)))), rng.uniform(40.0, 180.0)
        radius, noise = rng.uniform(0.5, 37.0), 10 ** rng.uniform(-3, np.log10(0.05))
        center = rng.standard_normal(3)
        center *= 2 * rng.random() / np.linalg.norm(center)
        axis = rng.standard_normal(3)
        points, directions = on_cap(rng, n, angle, 3, noise * radius, radius, center, axis=axis)
        bound = np.sqrt(np.trace(study.crlb(directions, noise)[:3, :3]))
        result.append((points, center, radius, bound))
    return result


def residuals(parameters, points):
    """Distances to the sphere (c, r)."""
    return np.linalg.norm(points - parameters[:3], axis=1) - parameters[3]


def jacobian(parameters, points):
    """Their derivatives."""
    v = points - parameters[:3]
    return np.column_stack([-v / np.linalg.norm(v, axis=1)[:, None], -np.ones(len(points))])


@pytest.mark.parametrize("estimator", ["gdke", "lls"])
def test_scikit_spatial(sets, estimator):
    """scikit-spatial's best fit is the algebraic one: centre and radius agree to 1e-9 r."""
    for points, _, radius, _ in sets:
        fit, peer = study.fit(points, estimator), Sphere.best_fit(points)
        np.testing.assert_allclose(fit.center, peer.point, rtol=0, atol=1e-9 * radius)
        assert fit.radius == pytest.approx(peer.radius, abs=1e-9 * radius)


@pytest.mark.parametrize("estimator", ["gdke", "lls"])
def test_trimesh(sets, estimator):
    """By iteration trimesh reaches the algebraic centre: it agrees to 1e-6 r.

    It compares sums of squares and takes finite differences, so it stops some 1e-7 r short; a second call begins where
    the first ended. Its radius is the mean distance, not the algebraic one, and so is not compared.
    """
    for points, _, radius, _ in sets:
        peer = fit_nsphere(points, prior=fit_nsphere(points)[0])[0]
        np.testing.assert_allclose(study.fit(points, estimator).center, peer, rtol=0, atol=1e-6 * radius)


def test_scipy(sets):
    """SciPy's least squares, begun at the truth, finds the MLE: centre and radius agree to 1e-9 r.

    least_squares compares sums of squares and so resolves 1e-7 r; `root` then finds where the gradient vanishes. Sets
    with a bound above 0.2 r are left out: they nearly fit a plane, where SciPy resolves nothing.
    """
    sound = [(points, center, radius) for points, center, radius, bound in sets if bound < 0.2]
    assert len(sound) > 190
    for points, center, radius in sound:
        fit = study.fit(points, "mle")
        assert fit.own_status == Status.OK
        start = np.append(center, radius)
        tight = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15}
        found = least_squares(residuals, start, jacobian, args=(points,), method="lm", **tight).x
        peer = root(lambda p, x: jacobian(p, x).T @ residuals(p, x), found, args=(points,), tol=1e-14).x
        np.testing.assert_allclose([*fit.center, fit.radius], peer, rtol=0, atol=1e-9 * radius)


def test_scipy_never_finds_better(sets):
    """Wherever SciPy ends, its sum of squares is not below the MLE's."""
    for points, center, radius, _ in sets:
        fit = study.fit(points, "mle")
        peer = least_squares(residuals, np.append(center, radius), jacobian, args=(points,), method="lm")
        ours = np.sum(residuals(np.append(fit.center, fit.radius), points) ** 2)
        assert ours <= 2 * peer.cost * (1 + 1e-12)

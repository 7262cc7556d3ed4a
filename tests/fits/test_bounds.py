"""The attainable bound against tables and the whole sphere's closed form.

The Cramér-Rao bound against the full Fisher information and the closed forms for caps.

Plans of measurements: their errors are those of fits to simulated points, and the messages.
"""

import itertools
import math

import mpmath
import numpy as np
import pytest
from scipy import integrate, special, stats

import study
from study.fits.errors.attainable import Cap, by_quadrature, cramer_rao
from study.fits.loops.jit import CHUNK
from study.fits.plan import plan_in_words
from study.fits.points.cap import sample_cap
from study.fits.points.information import weighted_scatter

TABLE = {
    3: {
        20: {0.01: 1.009, 0.03: 1.070, 0.1: 1.695, 0.2: 3.798, 0.3: 7.546, 0.6: 34.391},
        45: {0.01: 1.002, 0.03: 1.014, 0.1: 1.143, 0.2: 1.582, 0.3: 2.393, 0.6: 7.835},
        90: {0.01: 1.000, 0.03: 1.003, 0.1: 1.034, 0.2: 1.142, 0.3: 1.358, 0.6: 2.757},
        180: {0.01: 1.000, 0.03: 1.001, 0.1: 1.016, 0.2: 1.069, 0.3: 1.183, 0.6: 1.985},
    },
    2: {
        20: {0.03: 1.0465, 0.1: 1.4654, 0.2: 2.9071, 0.3: 5.4546, 0.6: 22.8643},
        45: {0.03: 1.0097, 0.1: 1.0986, 0.2: 1.4050, 0.3: 1.9905, 0.6: 5.9119},
        90: {0.03: 1.0022, 0.1: 1.0244, 0.2: 1.1040, 0.3: 1.2710, 0.6: 2.4721},
        180: {0.03: 1.0007, 0.1: 1.0078, 0.2: 1.0348, 0.3: 1.1000, 0.6: 1.6905},
    },
}
"""Root of the centre's trace over that of the Cramér-Rao bound (3.2), by an independent program with 32 and with 48
Legendre polynomials: dimension, half-angle, noise."""


def difference(one, other):
    """Largest difference of two covariances, in units of the standard deviations."""
    sd = np.sqrt(np.diag(other))
    return np.abs((one - other) / np.outer(sd, sd)).max()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("angle", [20, 45, 90, 180])
def test_tables(cap_moments, angle, d):
    """An independent program found the same to 1e-3."""
    _, k = cap_moments(angle, d)
    for noise, expected in TABLE[d][angle].items():
        trace = np.trace(study.attainable_bound(angle, noise, d)[:d, :d])
        ratio = math.sqrt(trace / (noise**2 * np.trace(np.linalg.inv(k))))
        assert ratio == pytest.approx(expected, abs=1e-3), noise


@pytest.mark.parametrize(("d", "angle"), [(2, 20), (3, 0.01), (3, 180), (6, 90), (20, 60)])
def test_resolution(d, angle):
    """More nodes with more functions change nothing by more than 1e-4, from the least noise to what hides the cap."""
    phi = math.radians(angle)
    for share in (1e-4, 0.3, 0.79, 0.81, 3.0) if d < 4 else (0.3, 0.81):
        coarse, fine = (by_quadrature(Cap(phi, share * phi, d), nodes) for nodes in (48, 56))
        assert difference(coarse, fine) < 1e-4, share


@pytest.mark.parametrize(("d", "angles"), [(2, (10, 45, 90, 170)), (3, (10, 45, 90, 180)), (5, (60,))])
def test_never_below_cramer_rao(d, angles):
    """The Cramér-Rao bound knows more: what it leaves between the two is positive semidefinite, up to the 1e-4."""
    for angle in angles:
        for noise in (1e-6, 0.01, 0.2, 2.0):
            bound, least = study.attainable_bound(angle, noise, d), cramer_rao(Cap(math.radians(angle), noise, d))
            root = np.linalg.inv(np.linalg.cholesky(least))
            assert np.linalg.eigvalsh(root @ bound @ root.T)[0] > 1 - 1e-4, (angle, noise)


@pytest.mark.parametrize("d", [2, 3, 7])
def test_little_noise(d):
    """Cramér-Rao's bound follows when the noise goes to nothing, and the excess falls as its square."""
    limit = cramer_rao(Cap(math.radians(60), 1.0, d))
    excess = [study.attainable_bound(60, noise, d) / noise**2 - limit for noise in (1e-3, 2e-3)]
    assert np.diag(excess[0] / np.maximum(np.abs(limit), 1e-9)).max() < 1e-4
    assert np.trace(excess[1]) / np.trace(excess[0]) == pytest.approx(4, rel=0.1)
    assert difference(study.attainable_bound(60, 1e-9, d) / 1e-18, limit) < 1e-9


@pytest.mark.parametrize("d", [2, 3])
def test_cramer_rao_of_a_cap(cap_moments, d):
    """Its closed form for one sample is the inverse of the mean of w wᵀ/σ², w = (u, 1) (theory (3.1))."""
    mean, k = cap_moments(70, d)
    information = np.block([[k + np.outer(mean, mean), mean[:, None]], [mean[None], np.ones((1, 1))]])
    assert difference(cramer_rao(Cap(math.radians(70), 0.2, d)), 0.04 * np.linalg.inv(information)) < 1e-12


@pytest.mark.parametrize("share", [1e-4, 0.8])
@pytest.mark.parametrize("d", [2, 3, 4])
def test_joins(d, share):
    """Where one way to compute it takes over from another, the two agree."""
    for angle in (3, 60, 180):
        noise = share * math.radians(angle)
        below, above = (study.attainable_bound(angle, noise * factor, d) for factor in (1 - 1e-7, 1 + 1e-7))
        assert difference(below, above) < 1e-5, angle


@pytest.mark.parametrize("d", [2, 3, 4, 8])
@pytest.mark.parametrize("noise", [0.01, 0.4, 6.0])
def test_whole_sphere(d, noise):
    """On the whole sphere one integral over R = |y| gives the bound (3.5), the same for all axes."""
    law = stats.ncx2(d, 1 / noise**2)  # of R²/σ²

    def mean(function):
        low, high = max(0.0, 1 - 12 * noise), 1 + 12 * noise
        nodes = np.unique([low, 1.0, high])
        density = lambda r: function(r) * law.pdf((r / noise) ** 2) * 2 * r / noise**2  # noqa: E731
        return sum(integrate.quad(density, *edges, epsabs=0, epsrel=1e-11)[0] for edges in itertools.pairwise(nodes))

    def projection(r):  # mean of u·y/R
        return special.ive(0.5 * d, r / noise**2) / special.ive(0.5 * d - 1, r / noise**2)

    lost = mean(lambda r: (r - projection(r) / square) ** 2) if (square := mean(lambda r: projection(r) ** 2)) else 0

    def scores(r):
        projected = r * projection(r)
        return [(projected - 1) / noise**2, (r * r + 1 - 2 * projected) / (2 * noise**4) - d / (2 * noise**2)]

    information = np.array([[mean(lambda r, i=i, j=j: scores(r)[i] * scores(r)[j]) for i in (0, 1)] for j in (0, 1)])
    bound = study.attainable_bound(180, noise, d)
    np.testing.assert_allclose(np.diag(bound)[:d], d * noise**4 / lost, rtol=1e-5)
    assert bound[d, d] == pytest.approx(np.linalg.inv(information)[0, 0], rel=1e-5)
    assert np.abs(bound - np.diag(np.diag(bound))).max() < 1e-6 * bound.max()


def test_results_are_the_callers():
    """Writing into a result leaves the next one alone."""
    study.attainable_bound(45, 0.3)[...] = 0
    assert np.all(np.linalg.eigvalsh(study.attainable_bound(45.0, 0.3)) > 0)


@pytest.mark.parametrize(
    ("arguments", "failure", "words"),
    [
        ({"angle": 0}, ValueError, r"angle = 0\.0: give the half-angle of the cap in degrees, above 0 and at most 180"),
        ({"angle": 180.5}, ValueError, r"angle = 180\.5: give"),
        ({"angle": math.nan}, ValueError, "angle = nan: give"),
        ({"noise": 0}, ValueError, r"noise = 0\.0: a standard deviation must be positive and finite"),
        ({"noise": -0.1}, ValueError, r"noise = -0\.1: a standard deviation"),
        ({"noise": math.inf}, ValueError, "noise = inf: a standard deviation"),
        ({"noise": 1e-200}, ValueError, "and so must its square"),
        ({"noise": np.eye(3)}, TypeError, r"noise has shape \(3, 3\): give one number"),
        ({"angle": [20, 45]}, TypeError, r"angle has shape \(2,\): give one number"),
        ({"dimension": 1}, ValueError, "dimension = 1: a sphere needs at least 2"),
        ({"dimension": 2.5}, TypeError, "integer"),
        ({"angle": 1.0, "noise": 100.0}, ValueError, r"noise = 100\.0 hides a cap of 1° so far"),
        ({"angle": 1e-100, "noise": 1e-160}, ValueError, "hides a cap of 1e-100° so far"),
        ({"angle": 1e-4, "noise": 10.0}, ValueError, r"hides a cap of 0\.0001° .*give less noise or a larger angle"),
    ],
)
def test_bad_input(arguments, failure, words):
    """A message names the value and the remedy."""
    with pytest.raises(failure, match=words):
        study.attainable_bound(**arguments)


def full_bound(directions, covariance, radius):
    """Bound on (c, r) from the whole (nd) × (d + 1 + n(d - 1)) Jacobian: the directions are parameters too."""
    n, d = directions.shape
    jacobian = np.zeros((n * d, d + 1 + n * (d - 1)))
    for i, u in enumerate(directions):
        rows = slice(i * d, (i + 1) * d)
        tangent = np.linalg.svd(u[None])[2][1:].T
        jacobian[rows, :d] = np.eye(d)
        jacobian[rows, d] = u
        jacobian[rows, d + 1 + i * (d - 1) : d + 1 + (i + 1) * (d - 1)] = radius * tangent
    information = jacobian.T @ np.kron(np.eye(n), np.linalg.inv(covariance)) @ jacobian
    return np.linalg.inv(information)[: d + 1, : d + 1]


@pytest.mark.parametrize("d", [2, 3, 4])
@pytest.mark.parametrize(("n", "radius"), [(7, 0.3), (CHUNK + 44, 20.0)])
def test_eliminated_directions(rng, d, n, radius):
    """J⁻¹ is the (c, r) block of the inverse of the full information, Σ anisotropic, whatever the radius (3.1)."""
    u = sample_cap(rng, n, 1.5, d)
    a = rng.standard_normal((d, d))
    covariance = a @ a.T + 0.1 * np.eye(d)
    expected = full_bound(u, covariance, radius)
    assert np.abs(study.crlb(u, covariance) - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("n", [4, CHUNK - 1, CHUNK, CHUNK + 1, 1000])
def test_equal_weights_need_no_row_of_their_own(rng, n):
    """Weights of one chunk stand for those of all, to the bit."""
    u, ones = sample_cap(rng, 2 * n, 1.0).T.reshape(3, 2, n).swapaxes(0, 1), np.ones((1, n))
    for few, many in zip(weighted_scatter(u, ones[:, :CHUNK]), weighted_scatter(u, ones), strict=True):
        np.testing.assert_array_equal(few, many)


@pytest.mark.parametrize("phi", [0.1, 1e-3, 1e-5])
def test_tiny_caps(rng, phi):
    """On a tiny cap the bound keeps the digits that inverting J would lose: 1e-13/φ² against 60 digits."""
    u = sample_cap(rng, 30, phi, 3)
    with mpmath.workdps(60):
        w = mpmath.matrix([[*map(float, row), 1.0] for row in u])
        for i in range(30):
            square = mpmath.fsum(w[i, j] ** 2 for j in range(3))  # rounded directions are not quite unit vectors
            for j in range(4):
                w[i, j] /= mpmath.sqrt(square)
        exact = np.array((mpmath.matrix(w.T * w) ** -1).tolist(), dtype=float)
    assert np.abs(study.crlb(u, 1.0) / exact - 1)[np.diag_indices(4)].max() < 1e-13 / phi**2


@pytest.mark.parametrize("n", [2, 3, 5, 100, 3000])
def test_circles_leave_the_centre_open(rng, random_rotation, n):
    """Directions on a circle, great or small, or too few of them give an infinite bound, in any orientation."""
    for height in (0.0, 0.8):
        for _ in range(20):
            a = rng.uniform(-np.pi, np.pi, n)
            across = np.sqrt(1 - height**2)
            u = np.stack([across * np.cos(a), across * np.sin(a), np.full(n, height)], axis=1) @ random_rotation(rng, 3)
            assert np.all(np.isposinf(study.crlb(u, 0.1)))


def test_batches(rng):
    """Leading axes are a batch, and an undetermined set leaves the others alone."""
    u = sample_cap(rng, 6 * 8, 2.0, 3).reshape(2, 3, 8, 3)
    u[1, 2, :, 2] = 0.0
    u[1, 2] /= np.linalg.norm(u[1, 2], axis=1, keepdims=True)
    bound = study.crlb(u, 0.2)
    assert bound.shape == (2, 3, 4, 4)
    assert np.all(np.isposinf(bound[1, 2]))
    for i, j in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]:
        np.testing.assert_allclose(bound[i, j], study.crlb(u[i, j], 0.2), rtol=1e-12)
    np.testing.assert_allclose(study.crlb(u[0], 0.2 * 0.2 * np.eye(3)), bound[0], rtol=1e-12)
    assert np.all(np.isposinf(study.crlb(np.empty((0, 3)), 0.2)))
    assert study.crlb(np.empty((0, 8, 3)), 0.2).shape == (0, 4, 4)
    assert np.all(np.isposinf(study.crlb(np.empty((2, 0, 3)), np.empty((2, 0)))))


def test_a_plan_says_that_the_noise_is_too_large():
    """Beyond .35 r a fit is weakly identified, whatever the number of points."""
    for noise, told in ((17.0, False), (18.0, True)):
        plan = study.plan_fit(noise, 50.0, 8.0, angle=90.0)
        lines = list(plan_in_words(plan, 8.0))
        assert any("above 0.35 radii: every fit will be weakly identified" in line for line in lines) == told


def test_a_plan_with_next_to_no_noise():
    """Errors over the noise do not depend on the radius, however large it is."""
    plans = [study.plan_fit(0.1, radius, 0.05, angle=60.0) for radius in (1e6, 1e160, 1e300)]
    assert len({plan.points for plan in plans}) == 1
    for plan in plans:
        np.testing.assert_allclose(plan[2:5], plans[0][2:5], rtol=1e-9)
        np.testing.assert_allclose(plan.simulated(), plans[0].simulated(), rtol=1e-4)


@pytest.mark.parametrize(("angle", "noise"), [(20.0, 0.06), (50.0, 0.4), (180.0, 0.05)])
def test_a_plan_says_how_often_its_fit_is_ok(rng, on_cap, angle, noise):
    """The share is that of other sets of the same plan, within 4 of both errors: by chance not in 1 of 16,000."""
    plan = study.plan_fit(noise, 1.0, angle=angle, points=40)
    share, error, *_ = plan.simulated()
    others = np.array([on_cap(rng, 40, angle=angle, noise=noise)[0] for _ in range(400)])
    ok = study.fit(others).ok.mean()
    assert abs(share - ok) <= 4.0 * np.hypot(error, max(np.sqrt(ok * (1.0 - ok) / 400), 1.0 / 400))
    assert (share > 0.95) == (angle == 180.0)
    lines = list(plan_in_words(plan, None))
    assert sum(line.startswith("status ok in ") for line in lines) == 1
    assert any("more than a third of the radius" in line for line in lines) == (plan.center_error > 1.0 / 3.0)
    assert (plan.center_error > 1.0 / 3.0) == (angle < 180.0)


@pytest.mark.parametrize(
    ("points", "angle", "noise", "apart"), [(15, 60.0, 0.05, True), (40, 20.0, 0.1, True), (400, 60.0, 0.02, False)]
)
def test_a_plan_says_how_far_its_fits_are_off(rng, on_cap, points, angle, noise, apart):
    """The errors are those of other sets of the same plan, within 4 of both errors of a quantile: not in 1 of 5,000.

    Few points err more than the bound says, and caps whose curvature the noise hides less: the plan prints both.
    """
    plan = study.plan_fit(noise, 1.0, angle=angle, points=points)
    others = study.fit(np.array([on_cap(rng, points, angle=angle, noise=noise)[0] for _ in range(400)]))
    sizes = np.sort(np.abs([others.center[:, 0], others.radius - 1.0]), axis=1)
    found = np.array([plan.simulated().center_error, plan.simulated().radius_error])
    low, high = (sizes[:, int(400 * 0.6827 + side * 4.0 * np.sqrt(2.0 * 400 * 0.6827 * 0.3173))] for side in (-1, 1))
    assert (low < found).all()
    assert (found < high).all()
    assert any(line.startswith("68 % of these fits are within") for line in plan_in_words(plan, None)) == apart


def test_a_plan_of_many_points_is_not_simulated():
    """Beyond 100,000 points no share is given, and no line of it is printed."""
    plan = study.plan_fit(0.1, 1.0, angle=90.0, points=100_001)
    assert np.isnan(plan.simulated()).all()
    assert not any("status ok" in line for line in plan_in_words(plan, None))


def test_the_three_plans_agree():
    """The cap for N points, the points for that cap, and the error of both are one plan, by the bound for the cap."""
    first = study.plan_fit(0.1, 50.0, 0.02, angle=70.0)
    second = study.plan_fit(0.1, 50.0, 0.02, points=first.points)
    third = study.plan_fit(0.1, 50.0, angle=70.0, points=first.points)
    assert second.angle == pytest.approx(70.0, rel=1e-3)
    assert third.center_error == pytest.approx(0.02, rel=1e-3)
    bound = study.attainable_bound(70.0, 0.1 / 50.0)
    assert first.points == np.ceil(bound[0, 0] * (50.0 / 0.02) ** 2)
    assert study.plan_fit(0.1, 50.0, 0.02, angle=70.0, of="radius").points == np.ceil(bound[3, 3] * (50.0 / 0.02) ** 2)
    errors = 50.0 * np.sqrt(np.diag(bound) / third.points)
    np.testing.assert_allclose([third.center_error, third.across_error, third.radius_error], errors[[0, 1, 3]])
    assert study.plan_fit(0.1, 50.0, 100.0, angle=70.0).points == 15  # as many as a test of the shape needs


@pytest.mark.parametrize(
    ("arguments", "failure", "words"),
    [
        ({}, ValueError, "a plan needs two of error, angle and points; it finds the third"),
        ({"error": 0.1, "angle": 30.0, "points": 50}, ValueError, "a plan needs two of"),
        ({"error": -0.1, "angle": 30.0}, ValueError, "error = -0.1: must be positive and finite"),
        ({"error": [0.1], "angle": 30.0}, TypeError, r"error has shape \(1,\): give one number"),
        ({"error": 0.1, "angle": 300.0}, ValueError, "angle = 300.0: give the half-angle of the cap"),
        ({"error": 0.1, "points": 5}, ValueError, "points = 5: plan with at least 15"),
        ({"error": 0.001, "points": 50}, ValueError, "even a whole sphere has an error 24.5 times that; give more poi"),
        ({"error": 1e-15, "angle": 1.0}, ValueError, r"error = 1e-15: needs .* points; give a larger error or angle"),
        ({"error": 0.1, "angle": 30.0, "of": "x"}, ValueError, "of = 'x': plan the error of the 'center'"),
    ],
)
def test_bad_plans(arguments, failure, words):
    """A message names the value and the remedy."""
    with pytest.raises(failure, match=words):
        study.plan_fit(0.1, 50.0, **arguments)


def test_the_plan_of_a_circle_in_space():
    """Its axis errs as much as the planned circles do, and a planned radius as in two dimensions.

    The root mean square of 400 tilts has a relative standard error of 3.5 %; the limit is 4 of these.
    """
    rng, plan = np.random.default_rng(61), study.plan_fit(0.02, 2.0, angle=50.0, points=60, dimension=2)
    t = np.radians(50.0) * rng.uniform(-1.0, 1.0, (400, 60))
    points = 2.0 * np.stack([np.cos(t), np.sin(t), 0.0 * t], axis=2)
    axis = study.fit_circle(points + 0.02 * rng.standard_normal(points.shape)).axis
    tilts = np.sqrt(np.mean(axis[:, :2] ** 2, axis=0)) / np.abs(axis[:, 2]).mean()
    assert tilts.max() == pytest.approx(plan.axis_error, rel=0.14)
    plan = plan._replace(in_space=True)
    assert plan.simulated().ok_share > 0.9
    assert next(iter(plan_in_words(plan, None))).startswith("60 points on an arc of ± 50°")

"""Several markers about one centre: the corrected equation 22, its weights, its noise, and bad input."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares, root
from scipy.special import stdtrit

import study
from study import Status
from study.fits import Incremental, mgdk
from study.fits.answers.markers import mgdk_so_far
from study.fits.points.cap import sample_cap

SIGMA = 1e-4 * np.array([[2.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 0.5]])


def drawn(rng, counts, radii, noise=0.01, angle=60.0, center=0.0, d=3):
    """Points of each marker on a cap about an axis of its own, and the directions."""
    root = noise * np.eye(d) if np.ndim(noise) == 0 else np.linalg.cholesky(noise)
    directions = [sample_cap(rng, n, np.radians(angle), d, rng.standard_normal(d)) for n in counts]
    pairs = zip(radii, directions, strict=True)
    return [center + r * u + rng.standard_normal(u.shape) @ root.T for r, u in pairs], directions


def weighed(markers, sigma, weights):
    """Corrected eq. 22: [Σw(C - Σ̂)]⁻¹ Σw[(C - Σ̂)x̄ + ½S], with C and S of eqs 5 and 6."""
    left, right = 0.0, 0.0
    for points, weight in zip(markers, weights, strict=True):
        mean, matrix = points.mean(axis=0), np.cov(points.T) - sigma
        y = points - mean
        s = np.sum(y * np.sum(y**2, axis=1)[:, None], axis=0) / (len(points) - 1)
        left, right = left + weight * matrix, right + weight * (matrix @ mean + s / 2)
    return np.linalg.solve(left, right)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_pooled_least_squares(rng, d):
    """Without noise to subtract it is one linear system, |x|² = 2c·x + k_p, with an intercept for each marker."""
    markers, _ = drawn(rng, [9, 40, 25], [0.5, 2.0, 1.0], 0.05, 90.0, 0.7, d)
    rows = [np.hstack([2 * x, np.tile(np.eye(3)[p], (len(x), 1))]) for p, x in enumerate(markers)]
    beta = np.linalg.lstsq(np.vstack(rows), np.concatenate([np.sum(x**2, axis=1) for x in markers]))[0]
    np.testing.assert_allclose(mgdk(markers, 1e-9, weighted=False).center, beta[:d], rtol=0, atol=1e-10)


@pytest.mark.parametrize("noise", [0.01, SIGMA])
def test_unequal_counts_and_weights(rng, noise):
    """Marker p has the weight n_p - 1, or (n_p - 1)/r̂_p² with r̂_p² the mean square distance; Σ̂ may be any."""
    markers, _ = drawn(rng, [7, 300, 40], [0.5, 2.0, 1.0], noise, center=0.2)
    sigma = noise**2 * np.eye(3) if np.ndim(noise) == 0 else noise
    counts = np.array([len(x) - 1.0 for x in markers])
    plain = mgdk(markers, noise, weighted=False)
    np.testing.assert_allclose(plain.center, weighed(markers, sigma, counts), rtol=0, atol=1e-11)
    fit = mgdk(markers, noise)
    square = np.array([np.mean(np.sum((x - fit.center) ** 2, axis=1)) for x in markers])
    np.testing.assert_allclose(fit.center, weighed(markers, sigma, counts / square), rtol=0, atol=1e-8)
    expected = np.sqrt(square - (counts / (counts + 1)) * np.trace(sigma))  # eq. 23
    np.testing.assert_allclose(fit.radii, expected, rtol=1e-12)
    assert fit.noise_variance == pytest.approx(np.trace(sigma) / 3, rel=1e-14)
    share = [w * np.cov(x.T) for w, x in zip(counts / square, markers, strict=True)]
    rho = np.linalg.eigvals(sigma @ np.linalg.inv(sum(share)) * np.sum(counts / square)).real.max()
    assert fit.condition == pytest.approx(rho, rel=1e-6)
    np.testing.assert_array_equal(fit.count, [7, 300, 40])


@pytest.mark.parametrize("count", [6, 100])
def test_noise_is_found(rng, assert_mean, count):
    """The mean of σ̂² is σ²: M + d numbers are fitted, which at n = 6 are a third of the samples (4.5 s.e.)."""
    fits = [mgdk(drawn(rng, [count] * 3, [0.5, 1.0, 2.0], angle=90.0)[0]) for _ in range(300)]
    assert_mean(np.array([fit.noise_variance for fit in fits]) / 0.01**2, 1.0)


@pytest.mark.parametrize(("noise", "trials", "expected"), [(0.01, 1000, 0.95), (None, 400, 0.95), (SIGMA, 1000, 0.925)])
def test_covariance_covers(rng, noise, trials, expected):
    """The 95 % ellipsoid of three markers of 8 samples covers the centre in 95 %, to 4.5 binomial standard errors.

    χ² where the noise was given, else F with N - M - d degrees of freedom. The anisotropic bound is not attained by a
    fit whose samples all weigh the same (its errors are 7 % larger): 92.5 % are covered, of 4000 trials.
    """
    limit = 3 * stats.f.ppf(0.95, 3, 3 * 8 - 3 - 3) if noise is None else stats.chi2.ppf(0.95, 3)
    hits = 0
    for _ in range(trials):
        fit = mgdk(drawn(rng, [8] * 3, [0.5, 1.0, 2.0], 0.01 if noise is None else noise, 90.0)[0], noise)
        hits += fit.center @ np.linalg.solve(fit.covariance, fit.center) < limit
    assert hits / trials == pytest.approx(expected, abs=4.5 * np.sqrt(expected * (1 - expected) / trials))


@pytest.mark.parametrize("n", [5, 30])
@pytest.mark.parametrize("weighted", [True, False])
def test_one_marker(rng, weighted, n):
    """One marker alone is a single set: `ugdk` where the noise is given, `als` where it is not."""
    (points,), _ = drawn(rng, [n], [2.0], 0.05, 120.0)
    for noise, name in [(0.05, "ugdk"), (SIGMA, "ugdk"), (None, "als")]:
        joint, single = mgdk([points], noise, weighted), study.fit(points, name, noise)
        np.testing.assert_allclose(joint.center, single.center, rtol=0, atol=1e-9)
        assert joint.radii[0] == pytest.approx(float(single.radius), rel=1e-9)
        assert joint.noise_variance == pytest.approx(float(single.estimates.noise_variance), rel=1e-9)
        assert joint.condition == pytest.approx(float(single.estimates.condition), rel=1e-9)
        np.testing.assert_allclose(joint.covariance, single.covariance[:3, :3], rtol=1e-8)


def test_markers_that_are_missing(rng):
    """A marker without samples has no effect; one of d + 1 is enough. Missing samples: `test_wrong_input`."""
    markers, _ = drawn(rng, [20, 30, 25], [0.5, 2.0, 1.0])
    for noise in (None, 0.01):
        one, two = mgdk([*markers, np.full((6, 3), np.nan), np.empty((0, 3))], noise), mgdk(markers, noise)
        np.testing.assert_array_equal(one.count, [20, 30, 25, 0, 0])
        np.testing.assert_array_equal([*one.center, *one.covariance.flat], [*two.center, *two.covariance.flat])
        np.testing.assert_array_equal(one.radii, [*two.radii, np.nan, np.nan])
    alone = mgdk([markers[0][:4], np.full((9, 3), np.nan)])
    assert alone.own_status == Status.OK
    assert alone.status == Status.WEAKLY_IDENTIFIED  # four points leave no freedom
    np.testing.assert_allclose(alone.center, study.fit(markers[0][:4], "gdke").center, rtol=0, atol=1e-9)


@pytest.mark.parametrize("noise", [None, 0.01])
def test_equivariance(rng, random_rotation, noise):
    """Markers that are shifted, rotated or in another unit have the shifted, rotated or rescaled centre."""
    markers, _ = drawn(rng, [20, 30, 25], [0.5, 2.0, 1.0], angle=90.0)
    fit, q, shift = mgdk(markers, noise), random_rotation(rng, 3), np.array([5.0, -3.0, 20.0])
    moved = mgdk([x @ q.T + shift for x in markers], noise)
    np.testing.assert_allclose(moved.center, q @ fit.center + shift, rtol=0, atol=1e-11)
    np.testing.assert_allclose(moved.covariance, q @ fit.covariance @ q.T, rtol=0, atol=1e-9 * np.trace(fit.covariance))
    for scale in (1e-120, 1e-30, 1e-6, 1e6, 1e30, 1e120):
        scaled = mgdk([scale * x for x in markers], None if noise is None else scale * noise)
        np.testing.assert_allclose(scaled.center / scale, fit.center, rtol=0, atol=1e-11)
        np.testing.assert_allclose(scaled.radii / scale, fit.radii, rtol=1e-11)
        np.testing.assert_allclose(scaled.standard_errors / scale, fit.standard_errors, rtol=1e-8)
        assert scaled.noise_variance / scale**2 == pytest.approx(fit.noise_variance, rel=1e-9)
        assert scaled.condition == pytest.approx(fit.condition, rel=1e-9)


@pytest.mark.parametrize("weighted", [True, False])
def test_exact_points(rng, weighted):
    """Without noise the centre and the radii are exact and the noise estimate zero, and nothing warns."""
    markers, _ = drawn(rng, [5, 30, 12], [0.5, 2.0, 1.0], 0.0, 90.0, center=1.0)
    fit = mgdk(markers, weighted=weighted)
    assert fit.status == Status.OK
    np.testing.assert_allclose(fit.center, 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fit.radii, [0.5, 2.0, 1.0], rtol=0, atol=1e-12)
    assert 0.0 <= fit.noise_variance < 1e-14


@pytest.mark.parametrize("noise", [0.0, 1e-13, 1e-10, 1e-6])
@pytest.mark.parametrize("count", [4, 5, 30])
def test_hardly_any_noise_on_a_small_cap(rng, count, noise):
    """Residuals of rounding alone may leave no root between zero and the least extent: nothing raises.

    Without noise the centre is GDKE's, to the rounding of a 5° cap; with a little noise it is that of `als`.
    """
    for _ in range(40):
        (points,), _ = drawn(rng, [count], [0.5], noise, 5.0, 1.0)
        fit = mgdk([points])
        assert fit.own_status is Status.OK
        wanted = study.fit(points, "als" if noise and count > 4 else "gdke").center
        np.testing.assert_allclose(fit.center, wanted, rtol=0, atol=1e-6 if noise < 1e-9 else 1e-3)


def test_a_matrix_that_is_singular_to_the_last_bit():
    """Noise as large as the extent itself has a status, and nothing raises."""
    square = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])
    for noise in (np.eye(2) * 4.0 / 3.0, np.diag([4.0 / 3.0, 1.0])):
        fit = mgdk([square], noise)
        assert fit.status in (Status.OK, Status.NOT_POSITIVE_DEFINITE)
        assert fit.condition == pytest.approx(1.0)


def test_noise_that_hides_everything():
    """Of two cubes about one middle as one marker no noise below the extent explains the residuals."""
    cube = np.array([[i, j, k] for i in (-1.0, 1.0) for j in (-1.0, 1.0) for k in (-1.0, 1.0)])
    fit = mgdk([np.concatenate([cube, 0.01 * cube])])
    assert fit.status is Status.NOT_POSITIVE_DEFINITE
    assert fit.condition > 1.0


def test_statuses(rng):
    """Markers that leave the centre undetermined have a status and NaN: nothing raises, nothing warns."""
    flat, line = rng.standard_normal((9, 3)) * [1, 1, 0], np.outer(np.arange(9.0), [1, 2, 3])
    good = drawn(rng, [9], [1.0])[0][0]
    infinite = np.where(np.arange(9)[:, None] == 4, np.inf, good)
    cases = [
        ([good[:3]], Status.TOO_FEW_POINTS),
        ([good[:2], good[3:5]], Status.TOO_FEW_POINTS),
        ([good[:1]] * 9, Status.TOO_FEW_POINTS),
        ([np.full((9, 3), np.nan)], Status.TOO_FEW_POINTS),
        ([flat, flat + np.array([0, 0, 3])], Status.SINGULAR),
        ([line, line + 1.0], Status.SINGULAR),
        ([np.ones((9, 3)), np.zeros((9, 3))], Status.SINGULAR),
        ([good, infinite], Status.NOT_FINITE),
        ([good, infinite[4:5]], Status.NOT_FINITE),
        ([1e150 * good], Status.NOT_FINITE),
        ([1e-150 * good], Status.NOT_FINITE),
    ]
    for markers, status in cases:
        for noise in (None, 0.1):
            fit = mgdk(markers, noise)
            assert fit.status is status
            assert np.isnan(fit.center).all()
            assert fit.radii.shape == (len(markers),)
            assert np.isnan(fit.covariance).all()


def test_a_point_at_the_center(rng):
    """It has no direction, and so tells nothing: the covariance is that without it."""
    poles = np.vstack([np.eye(3), -np.eye(3)])
    alone, beside = mgdk([poles], 0.1), mgdk([poles, np.zeros((1, 3))], 0.1)
    np.testing.assert_array_equal(beside.covariance, alone.covariance)
    assert beside.own_status is Status.OK
    with_it = study.fit(np.vstack([poles, np.zeros((1, 3))]), "gdke", 0.1)
    np.testing.assert_allclose(with_it.standard_errors, study.fit(poles, "gdke", 0.1).standard_errors, rtol=1e-12)


def test_a_fit_of_moments_holds_no_points(rng):
    """Its table has no residuals, and they are refused in words."""
    (points,), _ = drawn(rng, [30], [1.0])
    grown = Incremental(3)
    grown.update(points)
    fit = mgdk_so_far([grown])
    assert fit.to_frame()["residual_rms"].isna().all()
    with pytest.raises(ValueError, match="does not hold its points"):
        _ = fit.residuals


@pytest.mark.parametrize(("angle", "sigma"), [(0.3, 0.03), (0.5, 0.05), (0.8, 0.05)])
def test_standard_errors_of_one_marker_from_its_moments(rng, angle, sigma):
    """On a short arc they are those from the points within 15 %: noise widens the spread of directions."""
    turns = rng.uniform(-angle, angle, 400)
    points = np.stack([np.cos(turns), np.sin(turns)], axis=1) + sigma * rng.standard_normal((400, 2))
    grown = Incremental(2)
    grown.update(points)
    np.testing.assert_allclose(mgdk_so_far([grown]).standard_errors, mgdk([points]).standard_errors, rtol=0.15)


@pytest.mark.parametrize(
    ("markers", "says"),
    [
        ([], "at least one"),
        ([np.eye(4, 3), np.eye(4, 2)], r"same dimension"),
        ([np.ones(3)], r"marker 0 has shape \(3,\)"),
        ([np.eye(4, 3), np.ones((4, 1))], r"marker 1 has shape \(4, 1\)"),
    ],
)
def test_bad_input(markers, says):
    """No marker, unequal dimensions and wrong shapes raise an error that says what is wrong."""
    with pytest.raises(ValueError, match=says):
        mgdk(markers)


@pytest.mark.parametrize("angle", [40.0, 180.0])
def test_level_of_the_agreement(part_of, angle):
    """Of 400 sets of three markers about one centre, or a part, no more are refused than .01 gives but in 1e-4."""
    rng, sets = np.random.default_rng(21), part_of(400)
    p = [study.mgdk(drawn(rng, (20, 40, 80), (1.0, 2.0, 0.7), angle=angle)[0]).agreement for _ in range(sets)]
    assert stats.binom.ppf(1e-4, sets, 0.5) <= np.sum(np.array(p) < 0.5) <= stats.binom.isf(1e-4, sets, 0.5)
    assert np.sum(np.array(p) < 0.01) <= stats.binom.isf(1e-4, sets, 0.01)


@pytest.mark.parametrize("apart", [0.02, 1.0, 30.0])
def test_markers_that_share_no_centre_are_a_misfit(apart):
    """Two of three markers about one centre and one about another, from four times the error of a centre on."""
    rng = np.random.default_rng(22)
    for _ in range(10):
        points, _ = drawn(rng, (50, 50, 50), (1.0, 2.0, 0.7), angle=90.0)
        joint = study.mgdk([points[0], points[1], points[2] + [apart, 0.0, 0.0]])
        assert joint.status == Status.MISFIT
        assert joint.agreement < 0.01


def test_centres_that_differ_lengthen_the_common_interval(part_of, rng):
    """Two centres differ along the caps' axis by 2.3 errors of their difference, which is seldom a misfit.

    The interval held the centre of a marker in 0.44 of the ok fits. By Birge's factor it holds it in 0.74; of 75 fits
    0.58 or more, by chance not in 1 of 1000.
    """
    held = []
    for _ in range(part_of(400)):
        markers = [
            apart + sample_cap(rng, 150, np.radians(33.0), 3) + 0.01 * rng.standard_normal((150, 3))
            for apart in ([0.0, 0.0, 0.0], [0.058, 0.0, 0.0])
        ]
        joint = study.mgdk(markers)
        if joint.ok:
            low, high = joint.interval("x")
            held.append(low <= 0.0 <= high)
    assert len(held) >= 0.6 * part_of(400)
    assert np.mean(held) > 0.58


def test_agreement_needs_something_to_compare(rng):
    """One marker, exact points, or markers of few points leave no p value, and their status as it is."""
    points, u = drawn(rng, (30, 30), (1.0, 2.0))
    assert np.isnan(study.mgdk(points[:1]).agreement)
    exact = study.mgdk([u[0], 2.0 * u[1]])
    assert np.isnan(exact.agreement)
    assert exact.ok
    assert np.isnan(study.mgdk([points[0][:3], points[1][:3]]).agreement)
    gaps = points[0].copy()
    gaps[3] = np.nan
    moved = [gaps, points[1], points[1][:1]]  # one sample fixes its own radius
    assert study.mgdk(moved).agreement == pytest.approx(study.mgdk([np.delete(gaps, 3, 0), points[1]]).agreement)


@pytest.mark.parametrize("d", [2, 3])
def test_agreement_is_an_f_test(rng, d):
    """The squares of distances about a common centre and about each marker's own, by SciPy, with d for each further.

    A marker of d points fixes no centre of its own, and changes nothing.
    """
    markers, _ = drawn(rng, (20, 12, 15, d), (1.0, 2.0, 0.7, 1.5), noise=1e-3, angle=90.0, d=d)

    def left(*some):
        """Least squares of the distances of some markers from one centre."""
        start = [*np.zeros(d), *(np.linalg.norm(points, axis=1).mean() for points in some)]
        off = [lambda v, i=i, x=x: np.linalg.norm(x - v[:d], axis=1) - v[d + i] for i, x in enumerate(some)]
        return 2.0 * least_squares(lambda v: np.concatenate([f(v) for f in off]), start, xtol=1e-14, ftol=1e-14).cost

    apart, more, spare = sum(map(left, markers[:3])), 2 * d, 20 + 12 + 15 - 3 * (d + 1)
    p = stats.f.sf((left(*markers[:3]) - apart) / more / (apart / spare), more, spare)
    assert study.mgdk(markers[:3]).agreement == pytest.approx(p, rel=2e-3)
    assert study.mgdk(markers).agreement == pytest.approx(p, rel=2e-3)


def joint_score(markers, r, start, s):
    """T of the first marker's radius (theory 10.7), with centre, other radii and noise by SciPy's root finder.

    In space E R = r + s/r and E e·u = 1 - s/r², but for e^(-r²/2s), which is 1e-22 here or less.
    """
    sizes, m = np.array([len(points) for points in markers]), len(markers)
    x, which = np.concatenate(markers), np.repeat(np.arange(m), sizes)
    n = len(x)

    def deviations(unknown):
        radii, s = np.concatenate([[r], unknown[3:-1]]), unknown[-1]
        away = x - unknown[:3]
        distance = np.linalg.norm(away, axis=1)
        q = radii[which]
        mean, bend = q + s / q, q / (1.0 - s / q**2)
        return away / distance[:, None], distance, mean, bend, s - s**2 / q**2

    def equations(unknown):
        e, distance, mean, bend, variance = deviations(unknown)
        rest = distance - mean
        others = [rest[which == p].mean() for p in range(1, m)]
        noise = rest @ rest / (n - 3 - m + 1) - variance.mean()
        return [*((distance - bend) @ e / n), *others, noise]

    sizes_of = [np.linalg.norm(points - start, axis=1).mean() for points in markers[1:]]
    found = root(equations, [*start, *sizes_of, s], tol=1e-13)
    e, distance, mean, bend, variance = deviations(found.x)
    q, s = np.concatenate([[r], found.x[3:-1]])[which], found.x[-1]
    means = np.array([e[which == p].mean(axis=0) for p in range(m)])
    g = e - np.where(which > 0, 1.0, 0.0)[:, None] * means[which]
    matrix = np.sum(1.0 - bend / distance) * np.eye(3) + (e.T * (bend / distance)) @ e
    matrix -= sum(sizes[p] * np.outer(means[p], means[p]) for p in range(1, m))
    b = np.linalg.solve(matrix, e[which == 0].sum(axis=0))
    w = (which == 0) - g @ b
    inverse = np.linalg.inv(matrix)
    error = inverse @ (g.T * variance) @ g @ inverse.T
    across = (np.trace(error) - np.einsum("ni,ij,nj->n", e, error, e)) / distance
    rest = distance - mean
    weight = np.sum(w**2 * variance) / variance.mean()
    own = across[which == 0].mean()
    bias = 0.5 * (w @ across + own * (weight - w[which == 0].sum()))
    by_s = 1.0 / q, (1.0 / q) / (1.0 - s / q**2) ** 2  # of ρ and λ
    slope = by_s[0][which == 0].sum() - (e @ b) @ by_s[1] + ((means[which] @ b) * by_s[0])[which > 0].sum()
    bias += slope / np.sum(1.0 - 2.0 * s / q**2) * variance.sum() / (n - 3 - m + 1)
    total = rest[which == 0].sum()
    return (total - bias) / np.sqrt(weight * (rest @ rest - total**2 / weight) / (n - 3 - m))


def on_caps(rng, radii, degrees, noise, sizes):
    """Markers (n_p, 3) on caps about the first axis, with one centre at the origin."""
    caps = [r * sample_cap(rng, n, np.radians(degrees), 3) for r, n in zip(radii, sizes, strict=True)]
    return [cap + noise * rng.standard_normal(cap.shape) for cap in caps]


def test_ends_of_several_markers_are_quantiles_of_the_score():
    """At both ends of each radius T is Student's quantile with N - d - M degrees of freedom, times Birge's factor."""
    markers = on_caps(np.random.default_rng(22), (1.0, 2.0, 3.0), 45.0, 0.08, (40, 60, 50))
    fit = study.mgdk(markers)
    birge = np.sqrt(stats.f.isf(fit.agreement, 3, 110 - 2 * 4))  # of the markers of 60 and 50, whose noise is smaller
    assert birge > 1.0
    quantile = birge * stdtrit(150 - 3 - 3, 0.95)
    for p in range(3):
        ordered = [markers[p], *markers[:p], *markers[p + 1 :]]
        for r, sign in zip(fit.interval("radius", 0.9)[p], (1.0, -1.0), strict=True):
            start = fit.center + np.array([fit.radii[p] - r, 0.0, 0.0])
            assert joint_score(ordered, r, start, 0.0064) == pytest.approx(sign * quantile, rel=1e-3)


def test_the_interval_of_one_marker_is_that_of_fit():
    """One marker has the interval that `study.fit` gives its points."""
    (points,) = on_caps(np.random.default_rng(22), (2.0,), 50.0, 0.05, (60,))
    points[3] = np.nan
    fit, plain = study.mgdk([points]), study.fit(points)
    for of in ("center", "y"):
        np.testing.assert_array_equal(fit.interval(of), plain.interval(of))
    np.testing.assert_array_equal(fit.interval("radius"), [plain.interval("radius")])
    np.testing.assert_array_equal(fit.interval("diameter"), [plain.interval("diameter")])
    assert fit.intervals(0.95).identified.all()


@pytest.mark.parametrize(
    ("radii", "degrees", "noise"),
    [((1.0, 2.0, 3.0), 35.0, 0.15), ((1.0, 2.0, 3.0), 60.0, 0.02), ((0.1, 1.0, 3.0), 45.0, 0.05)],
)
def test_intervals_of_several_markers_cover(part_of, radii, degrees, noise):
    """Centre and radii are covered in 95 % of 200 sets, or a part, but for .015; false alarms: 1e-4 each.

    The .015 are what the method is off by in finite samples (theory 10.4).
    """
    rng, covered, sets = np.random.default_rng(23), list[np.ndarray](), part_of(200)
    for _ in range(sets):
        ends = study.mgdk(on_caps(rng, radii, degrees, noise, (60, 100, 150))).intervals(0.95)
        pairs = np.concatenate([ends.center[0], ends.radius[1:] - np.array(radii[1:])[:, None]])
        covered.append((pairs[:, 0] <= 0.0) & (pairs[:, 1] >= 0.0))
    assert (np.sum(covered, axis=0) >= stats.binom.ppf(1e-4, sets, 0.95 - 0.015)).all()


@pytest.mark.parametrize("heights", [(0.0, 0.0, 0.0), (-0.5, 0.0, 0.5)])
def test_markers_on_a_hinge_leave_the_centre_open(heights):
    """Circles about one axis: the centre may be anywhere on it, and no radius has an upper end."""
    rng = np.random.default_rng(24)
    for _ in range(20):
        markers = []
        for height, r in zip(heights, (1.0, 1.5, 2.0), strict=True):
            turn = rng.uniform(0.0, 1.5, 150)
            circle = np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(150, height)])
            markers.append(circle + 0.01 * rng.standard_normal(circle.shape))
        fit = study.mgdk(markers)
        assert np.isinf(fit.interval("center")).all()
        assert np.isinf(fit.interval("radius")[:, 1]).all()
        assert not fit.intervals(0.95).identified.any()


def test_intervals_of_markers_that_tell_nothing():
    """Ends are open where there are too few points, or points in a plane, and raise nothing; units change nothing."""
    rng = np.random.default_rng(25)
    flat = [rng.standard_normal((30, 3)) * [1, 1, 0] for _ in range(2)]
    for markers in (flat, [np.eye(3), 2 * np.eye(3)], [np.ones((1, 3)), np.full((4, 3), np.nan)]):
        fit = study.mgdk(markers)
        np.testing.assert_array_equal(fit.interval("radius"), [[0.0, np.inf]] * len(markers))
        np.testing.assert_array_equal(fit.interval("x"), [-np.inf, np.inf])
    markers = on_caps(rng, (1.0, 2.0), 60.0, 0.02, (40, 40))
    whole = study.mgdk(markers)
    for unit in (1e-60, 1e60):
        other = study.mgdk([unit * points for points in markers])
        np.testing.assert_allclose(other.interval("radius") / unit, whole.interval("radius"), rtol=1e-6)
        np.testing.assert_allclose(other.interval("center") / unit, whole.interval("center"), atol=1e-6)
    with pytest.raises(
        ValueError, match="of = 'w': an interval is that of 'radius', 'diameter', 'center', 'x', 'y', 'z'"
    ):
        whole.interval("w")
    with pytest.raises(ValueError, match="level = 1"):
        whole.interval("x", 1.0)


def on_circles(rng, n=150, tilt=0.0):
    """Three markers on circles about one axis, or of which the last is about a tilted one, with noise .01."""
    markers = []
    for radius, height, turned in ((1.0, 0.0, 0.0), (1.5, 0.3, 0.0), (2.0, -0.4, tilt)):
        a = rng.uniform(-1.5, 1.5, n)
        x = np.column_stack([radius * np.cos(a), radius * np.sin(a), np.full(n, height)])
        c, s = np.cos(turned), np.sin(turned)
        markers.append(x @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) + 0.01 * rng.normal(size=x.shape))
    return markers


def test_markers_on_a_hinge_are_a_hinge():
    """In 30 of 30 sets circles about one axis are a hinge, and the centre is open; about two axes it is found."""
    rng = np.random.default_rng(41)
    for _ in range(30):
        fit = study.mgdk(on_circles(rng))
        assert fit.status == Status.HINGE
        assert np.isinf(fit.interval("center")).all()
    fits = [study.mgdk(on_circles(rng, tilt=1.0)) for _ in range(10)]
    assert Status.HINGE not in [fit.status for fit in fits]


@pytest.mark.parametrize(("count", "size"), [(1, 3.0), (5, 0.5)])
def test_outliers_of_one_marker_are_named(count, size):
    """Some rows of one of three markers are displaced: of 30 fits none is ok, and nearly all use outliers."""
    rng, statuses = np.random.default_rng(42), []
    for _ in range(30):
        markers = on_caps(rng, (1.0, 1.5, 2.0), 60.0, 0.01, (100, 100, 100))
        step = rng.normal(size=(count, 3))
        markers[0][:count] += size * step / np.linalg.norm(step, axis=1, keepdims=True)
        statuses.append(study.mgdk(markers).status)
    assert Status.OK not in statuses
    assert statuses.count(Status.OUTLIERS) >= 25


def test_clean_markers_keep_their_level(part_of):
    """Of 200 clean sets at least 180 are ok: tests of fit, agreement and outliers of a marker have a level of 1 % each.

    Fewer, of these or of a part, have a probability below 1e-4 where the share is .96.
    """
    rng, sets = np.random.default_rng(43), part_of(200)
    fits = [study.mgdk(on_caps(rng, (1.0, 1.5, 2.0), 60.0, 0.01, (50, 40, 60))) for _ in range(sets)]
    assert sum(fit.ok for fit in fits) >= stats.binom.ppf(1e-4, sets, 0.96)


def test_memory_of_markers_is_named_and_allowed_for_in_order():
    """Noise with a memory of .5 from row to row is a misfit; in order, intervals are longer than of white noise."""
    rng = np.random.default_rng(44)
    t = np.linspace(0.0, 6.0 * np.pi, 150)
    a, b = 0.6 * np.sin(t), 0.6 * np.sin(1.31 * t + 0.4)
    path = np.column_stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
    markers = []
    for radius in (1.0, 1.5, 2.0):
        noise = 0.01 * rng.normal(size=path.shape)
        for i in range(1, len(noise)):
            noise[i] = 0.5 * noise[i - 1] + np.sqrt(0.75) * noise[i]
        markers.append(radius * path + noise)
    plain, ordered = study.mgdk(markers), study.mgdk(markers, ordered=True)
    assert plain.status == Status.MISFIT
    assert any(fit.first() == "memory" for fit in plain.goodness)
    assert ordered._stretch(0.95)[0] > 1.2

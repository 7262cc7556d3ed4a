"""Joint moments against the points themselves, and against arithmetic of 60 digits.

Centred moments against exact rational arithmetic.

Samples that arrive one by one or in parts: the paper's recurrences, and moments that merge, against the batch.
"""

import math
import pickle
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import study
from study import ESTIMATORS, Status
from study.fits import Incremental, Samples
from study.fits.loops.jit import BLOCK
from study.fits.loops.random import WORDS, seeded
from study.fits.points.cap import draw
from study.fits.points.moments import JointMoments, Moments

CLOSED = ["gdke", "ugdk", "als", "taubin", "pratt", "hyper"]

EPS = 2.0**-52


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
    directions, noise = drawn(np.random.default_rng(7), 50, 60, angle, d)
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
    directions, noise = drawn(np.random.default_rng(11), 4, 200, angle)
    for name, eta in (("gdke", 0.0), ("ugdk", 1e-26)):
        found = errors(name, directions, noise, 1e-13, 1.0)
        for t in range(len(found)):
            true = np.array(exact(directions[t], noise[t], mpmath.mpf(1e-13), 1, mpmath.mpf(eta)))
            assert np.linalg.norm(found[t, :3] - true) < 1e-10 * np.linalg.norm(true)


SIZES = [1, 2, 5, 511, 512, 513, 1024, 1025]


def in_fractions(points):
    """Mean, Σyyᵀ, Σy|y|² and Σ|y|⁴ of points (n, d), in fractions; the scales that rounding is measured against."""
    x = [[Fraction(float(v)) for v in point] for point in points]
    n, d = len(x), len(x[0])
    mean = [sum(p[i] for p in x) / n for i in range(d)]
    y = [[p[i] - mean[i] for i in range(d)] for p in x]
    square = [sum(v * v for v in p) for p in y]
    second = [[sum(p[i] * p[j] for p in y) for j in range(d)] for i in range(d)]
    third = [sum(p[i] * s for p, s in zip(y, square, strict=True)) for i in range(d)]
    as_float = [np.array(v, dtype=float) for v in (mean, second, third, sum(s * s for s in square))]
    size = np.sqrt(np.array(square, dtype=float))
    return as_float, [np.abs(points).max(), np.sum(size**2), np.sum(size**3), np.sum(size**4)]


def assert_exact(got, points, relative):
    """Each moment agrees with exact arithmetic, relative to the sum of its terms' magnitudes."""
    for value, (true, scale) in zip(got, zip(*in_fractions(points), strict=True), strict=True):
        np.testing.assert_allclose(value, true, rtol=0, atol=relative * scale)


def parts(moments, t=0):
    """The moments of one set, without its number of samples."""
    return moments.mean[t], moments.second[t], moments.third[t], moments.fourth[t]


def of(points):
    """Moments of one point set (n, d)."""
    return Moments.of(np.ascontiguousarray(points.T)[None])


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("d", [2, 3, 5])
def test_against_exact_arithmetic(rng, n, d):
    """Moments are right to 1e-14 of the sum of their terms, on both sides of every chunk boundary."""
    points = rng.standard_normal((n, d)) * np.arange(1, d + 1) + rng.standard_normal(d)
    assert_exact(parts(of(points)), points, 1e-14)


@pytest.mark.parametrize("offset", [1e6, 1e9])
@pytest.mark.parametrize("n", [7, 512, 600, 2000, BLOCK + 100])
def test_far_origin(rng, offset, n):
    """An origin 10⁶ or 10⁹ spreads away costs no digits, whatever the number of samples."""
    points = rng.standard_normal((n, 3)) + offset * np.array([1.0, -0.7, 0.3])
    assert_exact(parts(of(points)), points, 1e-14)


@pytest.mark.parametrize("order", ["as they come", "by height", "by a side", "around"])
def test_order_of_samples(rng, order):
    """Whatever the order, the variance along the axis of a flat cap, 2.5e-9 of that across it, keeps 13 digits.

    If blocks were merged by their means, which are rounded, it would be wrong by 1e-9 to 5e-7.
    """
    n, height = BLOCK + 5000, 1.0 - np.cos(np.radians(0.01))
    heights, turns = height * rng.random(n), 2.0 * np.pi * rng.random(n)
    across = np.sqrt(heights * (2.0 - heights))
    points = np.column_stack([1.0 - heights, across * np.cos(turns), across * np.sin(turns)]) + 100.0
    keys = {"by height": points[:, 0], "by a side": points[:, 1], "around": turns}
    points = points[np.argsort(keys.get(order, np.arange(n)))]
    axial = [Fraction(v) for v in points[:, 0].tolist()]
    mean = sum(axial) / n
    expected = float(sum((v - mean) ** 2 for v in axial))
    np.testing.assert_allclose(of(points).second[0, 0, 0], expected, rtol=1e-13)


@pytest.mark.parametrize("value", [0.3, 0.7, 1 / 3, 0.77])
def test_rounding_does_not_add_up(value):
    """8192 terms of one size, whose rounding errors may all have one sign, lose no more than 64 of them.

    Added to one sum they would lose 8192, in four lanes 2048; chunks are summed by themselves.
    """
    points = np.full((8192, 3), value)
    points[1::2] *= -1.0
    term = 3 * Fraction(value) ** 2
    _, second, _, fourth = parts(of(points))
    np.testing.assert_allclose(np.trace(second), float(8192 * term), rtol=64 * EPS)
    np.testing.assert_allclose(fourth, float(8192 * term**2), rtol=64 * EPS)


GROWING = ["gdke", "ugdk", "als", "fuller", "hinge", "taubin", "pratt", "hyper"]
FIELDS = ["center", "radius", "noise_variance", "condition"]


def fed(points, cuts=()):
    """An incremental fit that received the points in lumps between these cuts."""
    growing = Incremental(points.shape[1])
    for lump in np.split(points, cuts):
        growing.update(lump)
    return growing


def assert_moments(got, points, relative=1e-12):
    """Assert that moments agree with the batch's, relative to the sums of their terms' sizes."""
    y = points - points.mean(axis=0)
    size = np.linalg.norm(y, axis=1)
    batch = Moments.of(points.T[None])
    np.testing.assert_array_equal(got.n, len(points))
    np.testing.assert_allclose(got.mean, batch.mean, rtol=0, atol=relative * np.abs(points).max())
    for name, power in [("second", 2), ("third", 3), ("fourth", 4)]:
        scale = np.sum(size**power)
        np.testing.assert_allclose(getattr(got, name), getattr(batch, name), rtol=0, atol=relative * scale)


@pytest.mark.parametrize(("angle", "offset"), [(180.0, 0.0), (20.0, 10.0)])
def test_a_million_samples(rng, on_cap, angle, offset):
    """After 10⁶ updates the recurrences agree with batch GDKE, to 1e-9 r, also ten radii from the origin."""
    points = on_cap(rng, 1_000_000, angle, noise=0.05, center=offset)[0]
    stream, batch = study.fit(points, "igdk"), study.fit(points, "gdke")
    np.testing.assert_allclose(stream.center, batch.center, rtol=0, atol=1e-9)
    assert stream.radius == pytest.approx(float(batch.radius), abs=1e-9)
    assert stream.estimates.noise_variance == pytest.approx(float(batch.estimates.noise_variance), abs=1e-9)
    assert stream.status == Status.OK


@pytest.mark.parametrize("d", [2, 3, 5])
def test_recurrences_at_any_moment(rng, on_cap, d):
    """The recurrences are GDKE after every sample, from the first that determine a sphere on."""
    points = on_cap(rng, 60, 100.0, d, 0.05, radius=2.0, center=1.0)[0]
    points[: d + 1] = np.vstack([np.eye(d), -np.ones(d)])  # a start that is far from a plane
    for n in range(d + 1, 61):
        one, two = study.fit(points[:n], "igdk"), study.fit(points[:n], "gdke")
        np.testing.assert_allclose(one.center, two.center, rtol=0, atol=1e-10)
        assert one.radius == pytest.approx(float(two.radius), abs=1e-10)


@pytest.mark.parametrize("still", [8, 30, 200])
def test_recurrences_after_a_singular_start(rng, on_cap, still):
    """A marker that stands still at first, or moves in a plane, ends with the batch's answer too."""
    points = on_cap(rng, 400, 100.0, noise=0.02, center=1.0)[0]
    points[:still] = points[0]
    other = points.copy()
    other[:still, 2] = 0.25
    for sample in (points, other):
        one, two = study.fit(sample, "igdk"), study.fit(sample, "gdke")
        assert one.estimates.status == two.estimates.status == Status.OK
        np.testing.assert_allclose(one.center, two.center, rtol=0, atol=1e-9)


@pytest.mark.parametrize("d", [2, 3, 5])
def test_one_by_one_in_lumps_and_in_parts(rng, on_cap, d):
    """However the samples arrive - single, in lumps, in parts merged in any order - the moments are the batch's."""
    points = on_cap(rng, 1500, 70.0, d, 0.05, center=2.0)[0]
    assert_moments(fed(points, range(1, 1500)).moments, points)
    for _ in range(20):
        cuts = np.sort(rng.integers(0, 1500, rng.integers(1, 60)))
        assert_moments(fed(points, cuts).moments, points)
    single = Incremental(d)
    for point in points[:50]:
        single.update(point)
    assert_moments(single.moments, points[:50])
    cuts = np.sort(rng.choice(1499, 7, replace=False)) + 1
    parts = [Incremental(d), *map(fed, np.split(points, cuts)), Incremental(d)]
    while len(parts) > 1:
        i, j = rng.choice(len(parts), 2, replace=False)
        parts[i].merge(parts[j])
        del parts[j]
    assert_moments(parts[0].moments, points)


@pytest.mark.parametrize("name", GROWING)
def test_every_closed_form(rng, on_cap, name):
    """From lumps each closed form - those that remove the bias too - has the batch's answer, with a noise if it can."""
    points = on_cap(rng, 5000, 60.0, noise=0.05, radius=2.0, center=3.0)[0]
    growing = fed(points, np.sort(rng.integers(0, 5000, 30)))
    noises = [0.05] if name == "hinge" else [0.05, 0.05**2 * np.diag([1.0, 2.0, 1.5])]
    for noise in noises if name in ("ugdk", "hinge") else [None]:
        one = growing.fit(ESTIMATORS[name], noise).estimates
        two = study.fit(points, name, noise).estimates
        for field in FIELDS:
            np.testing.assert_allclose(getattr(one, field), getattr(two, field), rtol=1e-9, atol=1e-9)
        assert one.status == two.status
        assert one.center.shape == (3,)


def test_constant_memory(rng):
    """The state has the same size after five samples and after a hundred thousand: some 14 numbers."""
    growing, sizes = fed(rng.standard_normal((5, 3))), []
    for n in (1, 1000, 100_000):
        growing.update(rng.standard_normal((n, 3)))
        sizes.append(len(pickle.dumps(growing)))
    assert len(set(sizes)) == 1
    assert sizes[0] < 1000
    again = pickle.loads(pickle.dumps(growing))
    np.testing.assert_array_equal(again.fit(ESTIMATORS["als"]).center, growing.fit(ESTIMATORS["als"]).center)


def test_missing_samples(rng, on_cap):
    """Rows with a NaN are left out, alone, in a lump, or as a whole lump."""
    points = on_cap(rng, 60, 120.0, noise=0.02)[0]
    holes = points.copy()
    holes[[0, 7, 59], [1, 2, 0]] = np.nan
    holes[20:30] = np.nan
    rest = holes[~np.isnan(holes).any(axis=1)]
    for cuts in ([], [10, 20, 30, 45], range(1, 60)):
        assert_moments(fed(holes, cuts).moments, rest)
    empty = fed(np.full((5, 3), np.nan))
    assert empty.fit(ESTIMATORS["als"]).status == Status.TOO_FEW_POINTS
    empty.update(np.empty((0, 3)))
    empty.update(rest)
    np.testing.assert_allclose(empty.fit(ESTIMATORS["als"]).center, study.fit(holes, "als").center, rtol=0, atol=1e-12)


@pytest.mark.parametrize("chunk", [1, 7])
def test_far_points_keep_their_digits(rng, chunk):
    """A sphere a million radii away, fed in chunks, is where the same points at the origin have it: within 1e-9 radii.

    A step of float64 is 1.2e-10 there. Means formed about the origin were off by 1e-6 and more.
    """
    directions = rng.standard_normal((200, 3))
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) + 1e-3 * rng.standard_normal((200, 3))
    far = np.array([2.0**20, -(2.0**19), 2.0**18])
    points = (points + far) - far  # what float64 holds there
    growing, other = Incremental(3), Incremental(3)
    for part in np.split(points[:100] + far, range(chunk, 100, chunk)):
        growing.update(part)
    other.update(points[100:] + far)
    growing.merge(other)
    near, fit = study.fit(points, "als"), growing.fit(ESTIMATORS["als"])
    np.testing.assert_allclose(fit.center - far, near.center, rtol=0, atol=1e-9)
    assert float(fit.radius) == pytest.approx(float(near.radius), abs=1e-9)


def test_infinite_samples_are_not_missing(rng):
    """After an infinite coordinate every answer is NOT_FINITE, without a warning."""
    growing = fed(rng.standard_normal((9, 3)))
    growing.update([np.inf, 0.0, 0.0])
    growing.update(rng.standard_normal((9, 3)))
    assert growing.fit(ESTIMATORS["als"]).status == Status.NOT_FINITE


@pytest.mark.parametrize("points", [np.ones(2), np.ones((4, 2)), np.ones((1, 2, 3)), 1.0, [], np.ones((2, 4))])
def test_wrong_shapes(points):
    """Points of another shape than (d,) and (n, d) raise an error with the shape, and the state does not change."""
    growing = fed(np.eye(3))
    with pytest.raises(ValueError, match="points have shape") as caught:
        growing.update(points)
    assert str(np.shape(points)) in str(caught.value)
    np.testing.assert_array_equal(growing.moments.n, 3.0)
    assert growing.fit(ESTIMATORS["als"]).status == Status.TOO_FEW_POINTS
    with pytest.raises(ValueError, match="dimension 2 cannot be added to points of 3"):
        growing.merge(Incremental(2))
    for dimension in (-1, 0, 1):
        with pytest.raises(ValueError, match="dimension"):
            Incremental(dimension)


def test_standard_errors_need_the_points(rng, on_cap):
    """Estimators that read the points raise an error, for they are not stored; so do properties that need them."""
    growing = fed(on_cap(rng, 50, 120.0, noise=0.02)[0])
    for name in set(ESTIMATORS) - set(GROWING):
        with pytest.raises(ValueError, match="points"):
            growing.fit(ESTIMATORS[name])
    fit = growing.fit(ESTIMATORS["als"])
    for name in ("covariance", "standard_errors", "residual_rms", "count"):
        with pytest.raises(ValueError, match=r"study\.fit"):
            getattr(fit, name)

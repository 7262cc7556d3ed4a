"""Outliers, copies, and the fit that leaves outliers out.

Statistical tests compare a count of data sets with a binomial law: with the bounds given, each fails by chance once in
100,000 seeds.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy import special, stats

import study
from study import Samples, Status
from study.fits.estimators.robust import FALSE_ALARMS, log_choices, normal, outliers, smallest_chance
from study.fits.estimators.subsets import elemental, spread_out
from study.fits.points.samples import repeated

CHANCE = 1e-5


def named(points):
    """Outliers of points (sets, n, d)."""
    return outliers(Samples(points.swapaxes(1, 2)))


def spread(rng, points, share, reach=10.0):
    """Put the first points of each set anywhere in a cube; return their number."""
    count = int(share * points.shape[1])
    points[:, :count] = rng.uniform(-reach, reach, (len(points), count, points.shape[2]))
    return count


@pytest.mark.parametrize(("n", "size"), [(5, 3), (9, 4), (40, 4), (500, 3), (300, 9)])
def test_subsets(n, size):
    """Subsets hold different points, are no two the same, and use every point about equally often."""
    chosen = np.sort(elemental(n, size), axis=1)
    assert (np.diff(chosen, axis=1) > 0).all()
    assert chosen.min() >= 0
    assert chosen.max() < n
    assert len(np.unique(chosen, axis=0)) >= 0.99 * len(chosen)
    count = np.bincount(chosen.ravel(), minlength=n)
    if chosen.size >= 10 * n:  # each count is nearly normal
        assert stats.chisquare(count).pvalue > CHANCE
    np.testing.assert_array_equal(elemental(n, size), elemental.__wrapped__(n, size))


@pytest.mark.parametrize("n", [3, 500, 501, 12345])
def test_subsample(n):
    """The subsample holds different points from the whole length of a set."""
    places = spread_out(n)
    assert len(np.unique(places)) == len(places) == min(n, 500)
    assert np.diff(places).max() <= 2 * max(n / 500, 1)


def chance(n, d, k, x):
    """-log of the chance of a set without k points whose share of the sum of squares is x, by SciPy's Beta law."""
    sets = float(special.comb(n, k))
    sets = min(sets, np.exp(2.7) * sets**0.7)
    return np.log((0.5 if k == 1 else 0.25) / sets) - stats.beta.logcdf(x, (n - k - d - 1) / 2, k / 2)


@pytest.mark.parametrize(("n", "d"), [(6, 3), (9, 2), (30, 3), (100, 4), (400, 3)])
def test_chance_is_that_of_the_beta_law(rng, n, d):
    """The smallest chance of the nearest points is SciPy's, or above it by 0.4 in its logarithm at most."""
    told = 0
    for size in (1.0, 5.0, 20.0, 100.0, 1e4):
        for k in (1, max(n // 10, 1), n // 4):
            squares = np.sort(np.square(np.r_[rng.standard_normal(n - k), size * rng.uniform(0.5, 1.0, k)]))
            total = squares.sum() * rng.uniform(0.8, 1.0)
            least = (n + d + 2) // 2
            counts = np.arange(least, n)
            shares = np.cumsum(squares)[counts - 1] / total
            exact = [chance(n, d, n - m, min(x, 1.0)) for m, x in zip(counts, shares, strict=True)]
            found, m = smallest_chance(squares, log_choices(n, d), total, 0.0, d)
            assert found <= max(exact) + 1e-9
            if 3.0 < max(exact) < 600.0:  # beyond it SciPy's is 0
                assert found > max(exact) - 0.4
                assert exact[m - least] > max(exact) - 0.4
                told += 1
    assert told >= 3


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_search_finds_the_smallest_chance_of_all_sets(rng, share):
    """In the plane the outliers are those of a search through all 255 sets of five to eight of nine points.

    Sets are fitted by `mle`, where the search fits by Taubin's method; where the best two chances differ by less than
    a tenth of their logarithm, the other set is as good.
    """
    sets, n, d = 40, 9, 2
    turn = rng.uniform(0, 2 * np.pi, (sets, n))
    points = np.stack([np.cos(turn), np.sin(turn)], axis=2) + 0.02 * rng.standard_normal((sets, n, d))
    if share:
        spread(rng, points, share, 3.0)
    found = named(points)
    whole = study.fit(points, "mle").estimates.noise_variance * (n - d - 1)
    away = points - points.mean(axis=1, keepdims=True)
    whole = np.fmin(whole, np.linalg.eigvalsh(away.swapaxes(1, 2) @ away)[:, 0])
    best, second, which = np.full(sets, 0.0), np.full(sets, 0.0), np.zeros((sets, n), dtype=bool)
    for k in range(1, n - (n + d + 2) // 2 + 1):
        for out in combinations(range(n), k):
            inside = np.delete(np.arange(n), out)
            some = study.fit(points[:, inside], "mle").estimates.noise_variance * (n - k - d - 1)
            value = np.nan_to_num(chance(n, d, k, np.minimum(some / whole, 1.0)), nan=0.0)
            better = value > best
            second = np.where(better, best, np.maximum(second, value))
            best = np.where(better, value, best)
            which[better] = ~np.isin(np.arange(n), inside)
    alarm = best > -np.log(FALSE_ALARMS)
    clear = (np.abs(best + np.log(FALSE_ALARMS)) > 0.4) & (~alarm | (best - second > 0.4))
    assert clear.sum() > 25
    assert alarm.sum() >= (20 if share else 0)
    once = (alarm[:, None] & which)[clear]
    assert (found[clear] >= once).all()  # what is left without them is searched once more
    assert (found[clear] == once).all(axis=1).mean() > 0.8


@pytest.mark.parametrize(("n", "bad"), [(14, 3), (40, 2)])
def test_far_outliers_hide_no_others(rng, on_cap, n, bad):
    """Beside a point a million radii away, those at 25 standard deviations are named as well."""
    points, directions = on_cap(rng, n, 90, noise=0.01, sets=100)
    points[:, 1:bad] += 0.25 * directions[:, 1:bad]
    points[:, 0] *= 1e6
    assert named(points)[:, :bad].all(axis=1).sum() >= 95


@pytest.mark.parametrize(
    ("n", "angle", "noise", "bad", "most"),
    [(16, 180, 0.02, 6, 0.07), (60, 57, 0.02, 27, 0.15), (150, 35, 0.01, 45, 0.07)],
)
def test_nearly_half_of_the_points_are_clutter(rng, on_cap, n, angle, noise, bad, most):
    """The 95 % quantile of the centre's error is about twice that of the clean points' own fit.

    Clutter is uniform in a box half as large again as the clean points, and of ± 5 radii about the whole sphere.
    """
    points = on_cap(rng, n, angle, noise=noise, sets=200)[0]
    low, high = (edge(axis=1, keepdims=True) for edge in (points.min, points.max))
    size = 0.75 * (high - low) if angle < 180 else 5.0
    points[:, :bad] = (low + high) / 2 + size * rng.uniform(-1, 1, (200, bad, 3))
    assert np.quantile(np.linalg.norm(study.fit(points, "robust").center, axis=1), 0.95) < most


@pytest.mark.parametrize(
    ("n", "angle", "noise", "d", "sets"),
    [
        *[(10, 60, 0.1, 3, 2000), (10, 20, 0.2, 3, 3000), (30, 180, 0.01, 3, 1000)],
        *[(30, 60, 0.1, 2, 1000), (30, 20, 0.2, 3, 1500), (100, 60, 0.01, 3, 400)],
    ],
)
def test_false_alarms(rng, on_cap, part_of, n, angle, noise, d, sets):
    """Clean Gaussian data have an outlier in at most 1 % (+ .3 %) of the data sets."""
    sets = part_of(sets)
    count = int(named(on_cap(rng, n, angle, d, noise, sets=sets)[0]).any(axis=1).sum())
    assert count <= stats.binom.isf(CHANCE, sets, 0.013)


def test_false_alarms_of_many_points_without_a_sphere(rng):
    """Where noise hides the sphere, the distances of a cloud from its middle are skew, and are no outliers for that.

    Limits for normal distances would name a point in eight data sets of a hundred.
    """
    count = int(named(rng.standard_normal((200, 1000, 3)) * [1.0, 1.3, 1.3]).any(axis=1).sum())
    assert count <= stats.binom.isf(CHANCE, 200, 0.013)


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("radius", [0.0, 1.0, 2.0, 4.0, 30.0])
def test_law_of_distances(d, radius):
    """Distances made normal are as rare as normal numbers, by SciPy's law of χ with a centre elsewhere."""
    square = stats.ncx2(d, radius**2) if radius else stats.chi2(d)
    mean = square.expect(np.sqrt, lb=0.0, ub=square.isf(1e-15))
    share = square.mean() / mean**2 - 1.0
    moments = [
        square.expect(lambda q, p=p: normal(np.sqrt(q), mean, share, d) ** p, ub=square.isf(1e-15)) for p in (1, 2)
    ]
    spread = np.sqrt(moments[1] - moments[0] ** 2)
    for z in (3.0, 4.0, 5.0):
        made = normal(np.sqrt(square.isf(stats.norm.sf(z))), mean, share, d)
        assert (made - moments[0]) / spread == pytest.approx(z, rel=0.04)


@pytest.mark.parametrize(("n", "d"), [(40, 3), (40, 2), (1200, 3), pytest.param(60, 5, marks=pytest.mark.plain)])
def test_five_percent_at_ten_sigma(rng, on_cap, n, d):
    """Five percent of the points ten standard deviations off are all noticed in 99 % of the data sets."""
    sets = {60: 10, 1200: 30}.get(n, 150)
    points, directions = on_cap(rng, n, 90, d, 0.01, sets=sets)
    bad = n // 20
    points[:, :bad] += 0.1 * directions[:, :bad] * rng.choice([-1, 1], (sets, bad, 1))
    missed = int((~named(points)[:, :bad]).any(axis=1).sum())
    assert missed <= stats.binom.isf(CHANCE, sets, 0.01)


@pytest.mark.parametrize("kind", ["spread", "clustered"])
@pytest.mark.parametrize(("n", "angle", "noise", "d"), [(40, 60, 0.01, 3), (30, 180, 0.1, 3), (40, 90, 0.01, 2)])
def test_thirty_percent(rng, on_cap, kind, n, angle, noise, d):
    """With 30 % gross outliers the median error is at most 1.3 times that of the good points' own fit."""
    points = on_cap(rng, n, angle, d, noise, sets=300)[0]
    bad = spread(rng, points, 0.3)
    if kind == "clustered":
        middle = rng.standard_normal((300, 1, d))
        middle *= 3.0 / np.linalg.norm(middle, axis=2, keepdims=True)
        points[:, :bad] = middle + 0.3 * rng.standard_normal((300, bad, d))
    error = np.linalg.norm(study.fit(points, "robust").center, axis=1)
    best = np.linalg.norm(study.fit(points[:, bad:], "mle").center, axis=1)
    assert np.median(error) <= 1.3 * np.median(best)


@pytest.mark.parametrize("d", [2, 3, pytest.param(5, marks=pytest.mark.plain)])
def test_exact_points_and_many_outliers(rng, on_cap, d):
    """Points exactly on a sphere determine it, whatever 40 % of the points are."""
    points = on_cap(rng, 60, 90, d, center=rng.standard_normal(d), sets=3)[0]
    center = study.fit(points, "mle").center
    bad = spread(rng, points, 0.4)
    fit = study.fit(points, "robust")
    np.testing.assert_array_equal(fit.outliers, np.tile(np.arange(60) < bad, (3, 1)))
    np.testing.assert_allclose(np.c_[fit.center - center, fit.radius - 1.0], 0.0, atol=1e-11)


def test_without_outliers_it_is_mle(rng, on_cap):
    """Where no point is named, the answer is `mle`'s to the last bit; where one is, it is nearly that of the others.

    Least squares of the others weighs all of them by 1. Here points beyond 3 σ weigh less: of 24 points there is one in
    7 % of the sets, and the answer moves by less than half a standard error.
    """
    points = on_cap(rng, 25, 90, noise=0.02, sets=40)[0]
    points[7, 3] = [5.0, 5.0, 5.0]
    fit, mle = study.fit(points, "robust"), study.fit(points, "mle")
    clean = ~fit.outliers.any(axis=1)
    assert 30 < clean.sum() < 40
    for one, other in zip(fit.estimates, mle.estimates, strict=True):
        np.testing.assert_array_equal(one[clean], other[clean])
    rest = study.fit(points[7][~fit.outliers[7]], "mle")
    np.testing.assert_array_equal(fit.outliers[7].nonzero()[0], [3])
    moved = np.r_[fit.center[7] - rest.center, fit.radius[7] - rest.radius] / rest.standard_errors
    assert np.abs(moved).max() < 0.5
    assert (fit.standard_errors[7] > 0.8 * rest.standard_errors).all()
    assert (fit.standard_errors[7] < 1.5 * rest.standard_errors).all()


def test_symmetries(rng, on_cap, random_rotation):
    """Outliers are the same points after a motion, in another unit, in another order, and beside other sets."""
    points = on_cap(rng, 30, 80, noise=0.02, sets=20)[0]
    spread(rng, points, 0.2)
    found = named(points)
    assert found[:, :6].all(axis=1).sum() > 15
    np.testing.assert_array_equal(named(1e6 * points @ random_rotation(rng, 3) + 1e7), found)
    np.testing.assert_array_equal(named(1e-150 * points), found)
    order = rng.permutation(30)
    np.testing.assert_array_equal(named(points[:, order]), found[:, order])
    np.testing.assert_array_equal(named(points[4:5]), found[4:5])


def test_huge_outliers(rng, on_cap):
    """An outlier may be as far away as 1e30 radii; an infinite coordinate is a fault of the file."""
    points = on_cap(rng, 20, 90, noise=0.01)[0]
    points[4] = [1e30, -1e30, 0.0]
    fit = study.fit(points, "robust")
    assert fit.ok
    np.testing.assert_allclose(fit.center, 0.0, atol=0.05)
    points[4, 0] = np.inf
    assert study.fit(points, "robust").status == Status.NOT_FINITE
    assert not study.fit(points, "robust").outliers.any()


def test_missing_samples_are_no_outliers(rng, on_cap):
    """A set with missing samples has the outliers of the others."""
    points = on_cap(rng, 30, 90, noise=0.01, sets=2)[0]
    points[:, 5] += 1.0
    points[1, [2, 9], [0, 1]] = np.nan
    fit = study.fit(points, "robust")
    rest = np.delete(np.arange(30), [2, 9])
    np.testing.assert_array_equal(fit.outliers[1, rest], study.fit(points[1, rest], "als").outliers)
    assert fit.outliers[:, 5].all()
    assert not fit.outliers[1, [2, 9]].any()
    for n in (4, 5):  # of d + 2 points each is needed
        assert not study.fit(rng.standard_normal((6, n, 3)), "robust").outliers.any()


@pytest.mark.parametrize("missing", [False, True])
def test_errors_where_the_first_rows_do_not_count(rng, on_cap, missing):
    """Standard errors do not depend on whether the first few hundred rows are missing, and little on outliers there."""
    points = on_cap(rng, 1200, 60, noise=0.01)[0]
    points[:400] = np.nan if missing else points[:400] * rng.uniform(1.5, 3.0, (400, 1))
    fit = study.fit(points, "robust")
    rest = study.fit(points[400:][~fit.outliers[400:]], "mle")
    assert fit.ok
    np.testing.assert_allclose(fit.standard_errors, rest.standard_errors, rtol=1e-9 if missing else 0.1)
    if missing:
        one, two = study.fit(points, "als"), study.fit(points[400:], "als")
        np.testing.assert_allclose(one.standard_errors, two.standard_errors, rtol=1e-9)


def test_copies(rng, on_cap):
    """Rows that repeat an earlier one are counted; -0 equals 0, missing rows are none."""
    rows = on_cap(rng, 6, noise=0.01)[0]
    rows[0, 0] = 0.0
    points = np.stack([np.repeat(rows, 5, axis=0), on_cap(rng, 30, noise=0.01)[0]])
    points[0, 2, 0] = -0.0
    points[1, :7, 1] = np.nan
    points[1, 20] = points[1, 10]
    fit = study.fit(points, "als")
    assert [one.to_dict()["copies"] for one in fit] == [24, 1]
    shuffled = study.fit(points[:, rng.permutation(30)], "als")
    assert [one.to_dict()["copies"] for one in shuffled] == [24, 1]


@pytest.mark.parametrize("sets", [1, 3])
@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_copies_that_were_converted(rng, on_cap, random_rotation, sets, unit):
    """Copies moved by 1e-9 of the radius, as a conversion moves them, are copies; points 1e-5 apart are none.

    The interval of doubled points then is that of the points alone, where it would be narrower by √2.
    """
    once = unit * on_cap(rng, 60, 90, noise=0.02, sets=sets)[0]
    twice = np.concatenate([once, once + 1e-9 * unit * rng.uniform(-1, 1, once.shape)], axis=1)
    for points in (twice, twice @ random_rotation(rng, 3) + 5.0 * unit, twice[:, rng.permutation(120)]):
        fit = study.fit(points)
        assert {one.to_dict()["copies"] for one in fit} == {60}
        np.testing.assert_allclose(fit.interval("radius"), study.fit(once).interval("radius"), rtol=1e-6)
    apart = np.concatenate([once, once + 1e-5 * unit * rng.choice([-1, 1], once.shape)], axis=1)
    assert not any(one.to_dict()["copies"] for one in study.fit(apart))


def test_copies_among_many_points(rng):
    """Points on a grid, of which many share a coordinate, are no copies; of a million few are copies, and are found."""
    grid = np.stack(np.meshgrid(*[np.arange(20.0)] * 3), axis=-1).reshape(-1, 3)
    assert not repeated(grid.T[None]).any()
    many = rng.standard_normal((200_000, 3))
    many[rng.permutation(200_000)[:50]] = many[:1] + 1e-10 * rng.standard_normal((50, 3))
    assert 49 <= repeated(many.T[None]).sum() <= 50


def test_copies_in_a_large_batch(rng, on_cap):
    """Copies of every set are found, also in batches that are searched part by part."""
    points = on_cap(rng, 40, 90, noise=0.01, sets=3000)[0]
    row, copy = np.arange(3000) % 40, (np.arange(3000) + 7) % 40
    points[np.arange(0, 3000, 2), copy[::2]] = points[np.arange(0, 3000, 2), row[::2]]
    expected = np.zeros((3000, 40), dtype=bool)
    expected[np.arange(0, 3000, 2), np.maximum(row, copy)[::2]] = True
    np.testing.assert_array_equal(repeated(points.swapaxes(1, 2)), expected)


def test_more_copies_of_a_point_than_are_compared(rng, on_cap):
    """Of 300 copies of a point all but the first are copies, in any order and among others."""
    points = on_cap(rng, 500, 90, noise=0.01)[0]
    places = np.sort(rng.permutation(500)[:300])
    points[places] = points[places[0]]
    np.testing.assert_array_equal(np.flatnonzero(repeated(points.T[None])[0]), places[1:])


def test_copies_and_outliers(rng, on_cap):
    """Copies of an outlier, not exact ones too, are outliers; where half of the points are copies of few, none is."""
    points = on_cap(rng, 40, 90, noise=0.01)[0]
    points[[3, 7, 30]] = 4.0 + 1e-9 * rng.standard_normal((3, 3))
    np.testing.assert_array_equal(study.fit(points, "als").outliers.nonzero()[0], [3, 7, 30])
    rows = on_cap(rng, 12, 90, noise=0.01)[0]
    points = np.concatenate([rows, np.repeat(rows[:2], 20, axis=0)])
    assert not study.fit(points, "als").outliers.any()
    points[[3, 7]] = 4.0
    np.testing.assert_array_equal(study.fit(points, "als").outliers.nonzero()[0], [3, 7])


@pytest.mark.parametrize("share", [0.6, 0.8])
def test_points_close_together_are_no_majority(rng, on_cap, share):
    """Where most points were taken at one place of the sphere, the others are no outliers for that."""
    sets, n = 300, 40
    directions = on_cap(rng, n, 60, sets=sets)[1]
    directions[:, : int(share * n)] = directions[:, :1]
    found = named(directions + 0.01 * rng.standard_normal(directions.shape)).any(axis=1).sum()
    assert found <= stats.binom.isf(CHANCE, sets, 0.03)


def test_intervals_leave_out_what_the_fit_does(rng, on_cap):
    """An estimator of one's own that leaves outliers out says so, and has intervals without them, by any name."""
    points = on_cap(rng, 40, 90, noise=0.01)[0]
    points[3] = 4.0
    robust, plain = study.fit(points, "robust"), study.fit(points, "mle")
    other = study.Fit(plain.estimates, plain.samples, "mine", replace(study.ESTIMATORS["mle"], without_outliers=True))
    np.testing.assert_array_equal(other.interval("radius"), robust.interval("radius"))
    ends, rest = robust.interval("radius"), study.fit(np.delete(points, 3, axis=0)).interval("radius")
    assert ends[0] <= rest[0] < rest[1] <= ends[1]  # longer, for the choice of the points
    assert np.ptp(ends) < 1.5 * np.ptp(rest)
    assert plain.interval("radius")[1] != robust.interval("radius")[1]

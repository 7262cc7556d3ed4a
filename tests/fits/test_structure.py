"""What the test of fit sees in fits: the quick look, errors that allow for it, and the statuses that say so."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

import study
from study import Status
from study.fits import Samples
from study.fits.cap import sample_cap
from study.fits.corrected import corrected
from study.fits.goodness import SMALL, goodness
from study.fits.intervals import intervals
from study.fits.structure import quick_look, structure


def on_cap(rng, sets, n, degrees=180.0):
    """Directions (sets, n, 3), uniform on a cap."""
    return sample_cap(rng, sets * n, math.radians(degrees), 3).reshape(sets, n, 3)


def noisy(rng, u, sigma=0.01):
    """Points with white noise."""
    return u + sigma * rng.normal(size=u.shape)


def on_a_path(rng, sets, n, memory):
    """Points along a path within ± 40°, with AR(1) noise of .01."""
    t = np.linspace(0.0, 6.0 * math.pi, n)
    a, b = 0.7 * np.sin(t), 0.7 * np.sin(1.31 * t + 0.4)
    u = np.column_stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
    white = rng.normal(size=(sets, n, 3))
    return u + 0.01 * lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], white, axis=1)


def share_at_least(share, count, wanted):
    """True unless so small a share of successes has a probability below 1e-4 where ``wanted`` is true."""
    return round(share * count) >= binom.ppf(1e-4, count, wanted)


@pytest.mark.parametrize(
    ("angle", "sigma", "n"),
    [(180.0, 0.01, 100), (60.0, 0.02, 150), (90.0, 0.1, 100), (30.0, 0.01, 100), (45.0, 0.01, 100)],
)
def test_the_quick_look_misses_nothing(angle, sigma, n):
    """Of 1500 clean sets and 300 ellipsoids, every one in which a block speaks is tested in full.

    Where the noise is large, shape is judged by waves in full and by low moments in the quick look: half may differ.
    """
    rng = np.random.default_rng(1)
    clean, egg = on_cap(rng, 1500, n, angle), on_cap(rng, 300, n, angle) * [1.0, 0.97, 0.95]
    samples = Samples(np.ascontiguousarray(noisy(rng, np.concatenate([clean, egg]), sigma).swapaxes(1, 2)))
    seen = quick_look(samples, corrected(samples)).seen
    speaks = goodness(samples).speaks()
    assert speaks.any(axis=0).sum() >= 5
    assert seen[speaks[1:].any(axis=0)].all()
    assert seen[speaks[0]].mean() >= (0.5 if sigma > SMALL else 1.0)
    assert seen[:1500].mean() < 0.15


def test_a_filled_cube_is_not_ok():
    """Of 200 sets of 200 points at most as many are ok as a share of .03 gives in all but 1e-4 of runs."""
    rng = np.random.default_rng(14)
    ok = study.fit(rng.uniform(-1.0, 1.0, (200, 200, 3)) + 0.01 * rng.normal(size=(200, 200, 3))).ok
    assert ok.sum() <= binom.isf(1e-4, 200, 0.03)


def test_clean_points_keep_their_errors_to_the_digit():
    """Where nothing is seen, in at least .97 of 1000 clean sets, errors and intervals are those of white noise."""
    rng = np.random.default_rng(2)
    fit = study.fit(noisy(rng, on_cap(rng, 1000, 120, 70.0)))
    same = (fit.allowance == 1.0).all(axis=1)
    assert same.mean() >= 0.97
    np.testing.assert_array_equal(fit.covariance[same], fit.own_covariance[same])
    np.testing.assert_array_equal(fit.interval("radius")[same], intervals(fit.samples).radius[same])
    assert fit.ok.mean() >= 0.96


def test_errors_grow_with_the_form():
    """A form ten times as large makes the allowance grow, and the interval with it."""
    rng = np.random.default_rng(3)
    u = on_cap(rng, 50, 300, 60.0)
    fits = [study.fit(noisy(rng, u * (1.0 + size * u[..., 1:2] ** 2))) for size in (0.04, 0.4)]
    small, large = (np.median(fit.allowance[:, -1]) for fit in fits)
    assert 1.0 < 1.2 * small < large
    for fit in fits:
        white = np.ptp(intervals(fit.samples).radius, axis=1)
        wider = np.ptp(fit.interval("radius"), axis=1) / white
        finite = np.isfinite(wider)
        assert (wider[finite] >= 0.999 * fit.allowance[finite, -1]).mean() > 0.95  # by Student's quantile, too
        assert (fit.status != Status.OK).all()


@pytest.mark.parametrize("memory", [0.5, 0.9])
def test_memory_in_order(memory):
    """Along a path of 500 rows intervals of white noise cover too seldom; told the order, at least .9 of 300 cover."""
    rng = np.random.default_rng(4)
    points = on_a_path(rng, 300, 500, memory)
    fit = study.fit(points, ordered=True)
    white = intervals(fit.samples).radius
    covers = [((ends[:, 0] <= 1.0) & (ends[:, 1] >= 1.0)).mean() for ends in (white, fit.interval("radius"))]
    assert covers[0] < 0.85
    assert share_at_least(covers[1], 300, 0.9)
    unordered = study.fit(points)
    assert (unordered.status == Status.MISFIT).all()
    assert fit.ordered
    assert fit[:3].ordered
    assert fit.ok.mean() > 0.5 if memory == 0.5 else not fit.ok.any()


def test_outliers_are_a_status():
    """One far point of 60 is named; `robust`, which leaves it out, is ok, and so are the others' own statuses."""
    rng = np.random.default_rng(5)
    points = noisy(rng, on_cap(rng, 100, 60))
    points[:, 7] *= 1.2
    fit, others = study.fit(points), study.fit(points, "robust")
    assert (fit.status == Status.OUTLIERS).mean() >= 0.95
    assert (fit.own_status == Status.OK).all()
    assert others.ok.mean() >= 0.95
    assert not (fit.ok & fit.outliers.any(axis=1)).any()


@pytest.mark.parametrize(("n", "moved"), [(10, 1), (30, 1), (30, 6)])
def test_far_points_that_draw_the_fit_to_themselves_are_not_ok(n, moved):
    """Points at 2 r beyond a cap of 60° leave no residual; their sets are searched from trimmed squares, too."""
    rng = np.random.default_rng(11)
    points = noisy(rng, on_cap(rng, 200, n, 60.0), 0.02)
    points[:, :moved] *= 3.0
    fit = study.fit(points)
    assert not fit.ok.any()
    assert (fit.status == Status.OUTLIERS).mean() > 0.95
    assert np.abs(fit.radius - 1.0).max() > 0.5


@pytest.mark.parametrize(("n", "moved", "angle"), [(12, 2, 180.0), (15, 2, 60.0), (20, 3, 180.0)])
def test_of_few_points_no_fit_is_ok_whose_outliers_are_named(n, moved, angle):
    """Points moved by 30 σ hide in each other's residuals; of 200 sets at most 4 are ok where `outliers` names one."""
    rng = np.random.default_rng(12)
    points = noisy(rng, on_cap(rng, 200, n, angle))
    points[:, :moved] += 0.3 * on_cap(rng, 200, moved)
    fit = study.fit(points)
    named = fit.outliers.any(axis=1)
    assert named.mean() > 0.5
    assert (fit.ok & named).sum() <= 4


@pytest.mark.parametrize(("n", "angle"), [(20, 20.0), (80, 20.0), (80, 180.0)])
def test_a_placeholder_row_is_an_outlier(n, angle):
    """A row of -9999 beside points of radius 25 alone makes the radius; with few on a small cap it cannot be named."""
    rng = np.random.default_rng(3)
    points = 25.0 * on_cap(rng, 100, n, angle) + 0.3 * rng.normal(size=(100, n, 3))
    points[:, 10] = -9999.0
    fit = study.fit(points)
    assert not fit.ok.any()
    assert (fit.status == Status.OUTLIERS).mean() > (0.95 if n == 80 else 0.5)


def test_arcs_are_hinges_without_outliers():
    """A door's marker over 114°: every one of 200 sets is a hinge, though the arc's ends are far from its middle."""
    rng = np.random.default_rng(8)
    turn = rng.uniform(0.0, 2.0, (200, 100))
    fit = study.fit(noisy(rng, np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)))
    assert (fit.status == Status.HINGE).all()


@pytest.mark.parametrize("name", ["cylinder", "two spheres", "ellipsoid"])
def test_other_shapes_are_not_ok(name):
    """Of 100 sets of 200 points on other shapes none is ok."""
    rng = np.random.default_rng(6)
    u = on_cap(rng, 100, 200)
    shapes = {"ellipsoid": u * [1.0, 0.95, 0.9], "two spheres": u * rng.choice([1.0, 0.9], (100, 200, 1))}
    angle = rng.uniform(0.0, 2.0 * math.pi, (100, 200))
    shapes["cylinder"] = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-1.0, 1.0, (100, 200))], axis=-1)
    assert not study.fit(noisy(rng, shapes[name])).ok.any()


def test_heavy_tails_do_no_harm():
    """Student's t with 5 degrees of freedom speaks by its tails in 500 points, and at least .85 of the fits stay ok."""
    rng = np.random.default_rng(7)
    noise = rng.normal(size=(200, 500, 3)) / np.sqrt(rng.chisquare(5, (200, 500, 1)) / 3.0)
    fit = study.fit(on_cap(rng, 200, 500, 60.0) + 0.01 * noise)
    speaks = (fit.goodness.first() == "tails") & ~fit.outliers.any(axis=1)
    assert speaks.sum() >= 20
    assert share_at_least(fit.ok[speaks].mean(), speaks.sum(), 0.85)


def test_what_is_seen_does_not_depend_on_unit_gaps_or_copies():
    """The test of fit, what it allows for and the status are those of the points alone, in any unit."""
    rng = np.random.default_rng(8)
    points = noisy(rng, on_cap(rng, 3, 80) * [1.0, 0.9, 0.8])
    fit = study.fit(points)
    assert (fit.status == Status.MISFIT).all()
    gaps = np.full((3, 90, 3), np.nan)
    gaps[:, 4:84] = points
    copies = np.concatenate([points, points[:, :10]], axis=1)
    for other in (gaps, copies, 1e60 * points):
        again = study.fit(other)
        np.testing.assert_array_equal(again.status, fit.status)
        np.testing.assert_allclose(again.allowance, fit.allowance, rtol=1e-6)
        np.testing.assert_allclose(np.stack(again.goodness), np.stack(fit.goodness), rtol=1e-5)
    assert study.fit(points[0]).goodness.p.shape == ()


def test_lost_sets_show_nothing():
    """Sets that are too few, infinite or without noise have no structure, and cost the others nothing."""
    x = np.random.default_rng(9).normal(size=(4, 3, 40))
    x[0, 0, 0], x[1, :, 5:], x[2] = np.inf, np.nan, 1.0
    seen = structure(Samples(x))
    assert not seen.doubted[:3].any()
    assert (seen.ratio[:3] == 1.0).all()

"""Samples that arrive one by one or in parts: the paper's recurrences, and moments that merge, against the batch."""

import pickle

import numpy as np
import pytest

import study
from study import ESTIMATORS, Status
from study.fits import Incremental
from study.fits.moments import Moments

CLOSED = ["gdke", "ugdk", "als", "fuller", "hinge", "taubin", "pratt", "hyper"]
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


@pytest.mark.parametrize("offset", [0.0, 10.0])
@pytest.mark.parametrize("angle", [180.0, 60.0, 20.0])
def test_a_million_samples(rng, on_cap, angle, offset):
    """After 10⁶ updates the recurrences agree with batch GDKE, to 1e-9 r, also ten radii from the origin."""
    points = on_cap(rng, 1_000_000, angle, noise=0.05, center=offset)[0]
    stream, batch = study.fit(points, "igdk"), study.fit(points, "gdke")
    np.testing.assert_allclose(stream.center, batch.center, rtol=0, atol=1e-9)
    assert stream.radius == pytest.approx(float(batch.radius), abs=1e-9)
    assert stream.noise_variance == pytest.approx(float(batch.noise_variance), abs=1e-9)
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
        assert one.own_status == two.own_status == Status.OK
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


@pytest.mark.parametrize("name", CLOSED)
def test_every_closed_form(rng, on_cap, name):
    """From lumps each closed form - those that remove the bias too - has the batch's answer, with σ or Σ given."""
    points = on_cap(rng, 5000, 60.0, noise=0.05, radius=2.0, center=3.0)[0]
    growing = fed(points, np.sort(rng.integers(0, 5000, 30)))
    noises = [0.05] if name == "hinge" else [0.05, 0.05**2 * np.diag([1.0, 2.0, 1.5])]
    for noise in noises:
        one, two = growing.fit(ESTIMATORS[name], noise), study.fit(points, name, noise)
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
    for name in set(ESTIMATORS) - set(CLOSED):
        with pytest.raises(ValueError, match="points"):
            growing.fit(ESTIMATORS[name])
    fit = growing.fit(ESTIMATORS["als"])
    for name in ("covariance", "standard_errors", "residual_rms", "count"):
        with pytest.raises(ValueError, match=r"study\.fit"):
            getattr(fit, name)

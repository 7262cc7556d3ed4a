"""Rigid motion, the shapes of segments, and the noise of their poses."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from study.recordings import rigid
from study.recordings.joints import poses


def course(size, frames=400):
    """Rotation vectors (3, frames) of a smooth motion of mean zero."""
    t = np.arange(frames) / frames * 2 * np.pi
    return size * np.stack([np.sin(t), 0.5 * np.cos(2 * t), 0.2 * np.sin(3 * t)])


def test_rotation_vectors():
    """Vectors about the mean, in the parent's axes; NaN where unknown."""
    angles, rest = course(0.02), Rotation.from_rotvec([0.3, -0.8, 0.4])
    rotation = np.moveaxis((Rotation.from_rotvec(angles.T) * rest).as_matrix(), 0, 2)
    rotation[:, :, 7] = np.nan
    found = rigid.rotation_vectors(rotation)
    assert np.isnan(found[:, 7]).all()
    np.testing.assert_allclose(np.delete(found, 7, axis=1), np.delete(angles, 7, axis=1), atol=2e-4)


def test_angles_about_a_centre():
    """To first order, for two markers of which one is missing at times; one marker alone shows none along its arm."""
    angles, center = course(0.01), np.array([0.1, -0.2, 0.3])
    arms = np.array([[0.1, 0.02, 0.0], [0.0, 0.2, 0.1]])
    y = center[:, None] + np.einsum("tij,mj->mit", Rotation.from_rotvec(angles.T).as_matrix(), arms)
    used = np.ones((2, 400), dtype=bool)
    used[1, :5] = False
    found = rigid.angles_about_center(y, used, center)
    np.testing.assert_allclose(found[:, 5:], angles[:, 5:], atol=2e-4)
    alone = rigid.angles_about_center(y[:1], used[:1], center)
    along = arms[0] / np.linalg.norm(arms[0])
    np.testing.assert_allclose(alone, angles - np.outer(along, along @ angles), atol=2e-4)
    assert np.isnan(rigid.angles_about_center(y, np.zeros_like(used), center)).all()


@pytest.mark.parametrize("most", [1, 2])
def test_turning_ways(most):
    """About its greatest axis the joint turns one way in the rising half of a sine."""
    angles = course(0.3)
    ways = rigid.turning_ways(angles, 2, most)
    assert len(ways) == most
    rising = np.gradient(angles[0]) > 0
    one, two = ways[0]
    agree = (one == rising)[5:-5].mean()
    assert max(agree, 1 - agree) > 0.95
    assert not (one & two).any()
    assert (one | two)[2:-2].mean() > 0.98
    assert rigid.turning_ways(np.full((3, 9), np.nan), 1, 2) == []


@pytest.fixture
def moved(rng):
    """Make a template in random poses (m, 3, frames), with noise and gaps; rotations and translations come with it."""

    def make(template, frames=40, noise=0.0, gaps=0.0):
        turns = Rotation.random(frames, rng=rng).as_matrix().transpose(1, 2, 0)
        shifts = rng.normal(size=(3, frames))
        x = np.einsum("ijt,mj->mit", turns, template) + shifts
        x += noise * rng.standard_normal(x.shape)
        x[np.broadcast_to(rng.random((len(template), 1, frames)) < gaps, x.shape)] = np.nan
        return x, turns, shifts

    return make


@pytest.mark.parametrize(("m", "across", "side"), [(3, 1, 1), (4, 1, 1), (6, 1, 1), (5, 1, -1), (4, 0.1, 1)])
def test_agrees_with_scipy(rng, moved, m, across, side):
    """Rotations are those of scipy's Kabsch algorithm, for three markers (in a plane), four and six, with noise.

    For mirrored points, too, the best proper rotation is found, and for points near a line.
    """
    template = 0.1 * rng.standard_normal((m, 3)) * [1.0, across, across]
    x, _, _ = moved(template * [1.0, 1.0, side], noise=0.01 * across)
    rotation, origin, known = rigid.fit_rigid_motion(template, x)
    assert known.all()
    for t in range(x.shape[2]):
        wanted, _ = Rotation.align_vectors(x[:, :, t] - x[:, :, t].mean(axis=0), template - template.mean(axis=0))
        np.testing.assert_allclose(rotation[:, :, t], wanted.as_matrix(), atol=1e-9)
        shift = x[:, :, t].mean(axis=0) - wanted.apply(template.mean(axis=0))
        np.testing.assert_allclose(origin[:, t], shift, atol=1e-9)


def test_exact_motion_with_missing_and_unused_points(rng, moved):
    """The true motion comes back to rounding from points that are used; a frame with fewer than three is unknown."""
    template = rng.standard_normal((4, 3))
    x, turns, shifts = moved(template)
    x[3] += 1.0
    used = np.ones((4, x.shape[2]), dtype=bool)
    used[3] = False
    x[0, :, 5] = np.nan
    rotation, origin, known = rigid.fit_rigid_motion(template, x, used)
    assert list(np.flatnonzero(~known)) == [5]
    np.testing.assert_allclose(rotation[:, :, known], turns[:, :, known], atol=1e-12)
    np.testing.assert_allclose(origin[:, known], shifts[:, known], atol=1e-12)
    assert np.isnan(rotation[:, :, 5]).all()
    assert np.isnan(origin[:, 5]).all()


def test_a_mirrored_tetrahedron_has_no_rotation_or_a_proper_one(rng, moved):
    """With two labels of a regular tetrahedron exchanged many rotations are as good; none that is found has stretch."""
    template = 0.05 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    x, _, _ = moved(template[[1, 0, 2, 3]], frames=5000, noise=1e-9)
    rotation, _, known = rigid.fit_rigid_motion(template, x)
    r = rotation[:, :, known].transpose(2, 0, 1)
    np.testing.assert_allclose(r.swapaxes(1, 2) @ r, np.broadcast_to(np.eye(3), r.shape), atol=1e-6)


def test_mean_rotated_covariance(rng):
    """It is the mean over frames of R Σ Rᵀ, one by one."""
    axes, root = Rotation.random(30, rng=rng).as_matrix().transpose(1, 2, 0), rng.standard_normal((3, 3))
    covariance = root @ root.T
    wanted = np.mean([axes[:, :, t] @ covariance @ axes[:, :, t].T for t in range(30)], axis=0)
    np.testing.assert_allclose(rigid.mean_rotated_covariance(axes, covariance), wanted, atol=1e-12)


def test_nearest_rotation(rng):
    """For a sum of rotations it is the mean rotation that scipy has, and never a reflection."""
    axes = Rotation.from_rotvec(0.3 * rng.standard_normal((30, 3)))
    found = rigid.nearest_rotation(axes.as_matrix().sum(axis=0))
    np.testing.assert_allclose(found, axes.mean().as_matrix(), atol=1e-12)
    assert np.linalg.det(rigid.nearest_rotation(np.diag([1.0, 2.0, -3.0]))) > 0.0


@pytest.mark.parametrize("angle", [10.0, 60.0, 120.0])
def test_cap_angle_of_a_cap(rng, on_cap, angle):
    """On a uniformly filled cap it is the angle that holds 95 % of the area: cos = 1 - .95 (1 - cos φ)."""
    points, _ = on_cap(rng, 20_000, angle, radius=0.3, center=0.5)
    used = np.ones(len(points), dtype=bool)
    wanted = np.degrees(np.arccos(1 - 0.95 * (1 - np.cos(np.radians(angle)))))
    assert np.degrees(rigid.cap_angle(points.T, used, np.full(3, 0.5))) == pytest.approx(wanted, rel=0.02)


def test_unused_samples(rng, on_cap):
    """Unused samples do not widen the cap; without samples there is no angle."""
    points, _ = on_cap(rng, 500, 20.0)
    used = np.ones(600, dtype=bool)
    used[500:] = False
    y = np.concatenate([points, -points[:100]]).T
    assert rigid.cap_angle(y, used, np.zeros(3)) == rigid.cap_angle(points.T, used[:500], np.zeros(3))
    assert np.isnan(rigid.cap_angle(y, np.zeros(600, dtype=bool), np.zeros(3)))


def test_rotation_range_of_a_hinge(rng):
    """Of rotations about one axis, uniform within ±50°, 95 % are within 47.5° of their mean."""
    angles = np.radians(rng.uniform(-50, 50, 20_000))
    axis = np.array([0.6, 0.0, 0.8])
    rotation = (Rotation.from_euler("z", 30, degrees=True) * Rotation.from_rotvec(angles[:, None] * axis)).as_matrix()
    assert np.degrees(rigid.rotation_range(rotation.transpose(1, 2, 0))) == pytest.approx(47.5, abs=1.0)
    assert np.isnan(rigid.rotation_range(np.full((3, 3, 4), np.nan)))


SHAPE = np.array([[0.1, 0.12, 0.02], [0.1, -0.11, 0.0], [-0.12, 0.06, 0.01], [-0.1, -0.05, 0.06]])


@pytest.fixture
def seen(moved):
    """Make a shape in 300 random poses, or so many (m, 3, frames)."""
    return lambda shape=SHAPE, **options: moved(shape, **{"frames": 300} | options)[0]


def proper(found, shape):
    """Largest coordinate difference of two shapes after the best proper rotation."""
    a, b = found - found.mean(axis=0), shape - shape.mean(axis=0)
    turn, _ = Rotation.align_vectors(a, b)
    return np.abs(a - turn.apply(b)).max()


@pytest.mark.parametrize("gaps", [0.0, 0.3])
def test_the_shape_comes_back(seen, gaps):
    """Without noise the shape, and not its mirror image, comes back to rounding, with gaps or without."""
    points, _, outliers = poses.fit_template(seen(gaps=gaps))
    assert proper(points, SHAPE) < 1e-6
    assert not outliers.any()


def test_noise_averages_out(seen):
    """With noise of 2 mm and 2000 frames the shape's error is 2/√2000 mm per coordinate and a small bias.

    The largest of 12 deviates beyond 5 standard deviations: 7 in 10⁶; the bias is of second
    order, (σ/size)² of the size, 0.04 mm.
    """
    assert proper(poses.fit_template(seen(frames=2000, noise=0.002))[0], SHAPE) < 5 * 0.002 / np.sqrt(2000) + 5e-5


def test_swapped_markers_are_found(seen):
    """Two markers exchanged in some frames are outliers in these frames alone, and the shape is as before."""
    x = seen(frames=500, noise=0.001)
    x[[0, 2], :, 100:130] = x[[2, 0], :, 100:130]
    points, _, outliers = poses.fit_template(x)
    wrong = np.zeros((4, 500), dtype=bool)
    wrong[[0, 2], 100:130] = True
    assert (outliers[:, 100:130].sum(axis=0) >= 2).all()
    assert not outliers[:, ~wrong.any(axis=0)].any()
    assert proper(points, SHAPE) < 1e-3


def test_one_stray_marker(seen):
    """Of four markers, the displaced one is an outlier and no other."""
    x = seen(frames=400, noise=0.001)
    x[3, :, 50:60] += 0.2
    _points, good, outliers = poses.fit_template(x)
    assert outliers[3, 50:60].all()
    assert outliers.sum() == 10
    np.testing.assert_array_equal(good, ~outliers)


def test_two_markers(seen):
    """Of two markers both are outliers where their distance is wrong, for either may be."""
    x = seen(SHAPE[:2], frames=200, noise=0.001)
    x[1, :, 20:25] += 0.3
    points, _, outliers = poses.fit_template(x)
    assert outliers[:, 20:25].all()
    assert outliers.sum() == 10
    np.testing.assert_allclose(pdist(points), pdist(SHAPE[:2]), atol=1e-3)


def test_marker_apart_from_the_others(seen):
    """A marker that no frame shows with the others has no place; the others have. Without samples there is no shape."""
    x = seen()
    x[3] = np.nan
    points, *_ = poses.fit_template(x)
    assert np.isnan(points[3]).all()
    assert proper(points[:3], SHAPE[:3]) < 1e-6
    points, good, _ = poses.fit_template(np.full((3, 3, 10), np.nan))
    assert np.isnan(points).all()
    assert not good.any()


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_autocorrelation_time_of_an_autoregression(rng, phi):
    """For x' = φx + ε it is (1 + φ)/(1 - φ), to 10 % with 2·10⁵ frames (its error τ√(2·5τ/n) is 3 % at worst)."""
    series = lfilter([1.0], [1.0, -phi], rng.standard_normal((3, 200_000)), axis=1)
    np.testing.assert_allclose(poses.autocorrelation_time(series), (1 + phi) / (1 - phi), rtol=0.1)


def test_short_and_empty_series():
    """Series of one frame, or of zeros, have an autocorrelation time of 1."""
    np.testing.assert_array_equal(poses.autocorrelation_time(np.ones((2, 1))), 1.0)
    np.testing.assert_array_equal(poses.autocorrelation_time(np.zeros((2, 50))), 1.0)


def test_covariance_of_a_sum_over_correlated_frames(rng):
    """It is the covariance over many independent pairs of correlated series, of unequal size and memory.

    300 sums fix a variance to 8 %, the estimate has about 10 %; 50 % is four of both together: 1 in 10⁴.
    """
    mix = np.array([[1.0, 0.0], [30.0, 40.0]])

    def draw(count):
        noise = rng.standard_normal((count, 2, 4000))
        series = np.stack([lfilter([1.0], [1.0, -0.9], noise[:, 0], axis=1), noise[:, 1]], axis=1)
        return np.einsum("ij,njt->nit", mix, series)

    sums = draw(300).sum(axis=2)
    wanted = np.cov(sums.T)
    one = draw(1)[0]
    found, independent = poses.long_run_covariance(one - one.mean(axis=1)[:, None])
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    assert np.abs((found - wanted) / scale).max() < 0.5
    np.testing.assert_allclose(independent, (one - one.mean(axis=1)[:, None]) @ one.T, rtol=1e-10)
    assert found[0, 0] > 10 * independent[0, 0]


TRIANGLE = np.array([[0.12, 0.0, 0.02], [-0.1, 0.03, 0.0], [-0.02, -0.03, -0.02]])

POINTS = np.array([[0.3, 0.1, -0.2], [0.0, 0.05, 0.4]])


@pytest.fixture
def pose_noise():
    """Make the pose noise of a template whose points are all used in all frames."""

    def make(template, noise, frames=1):
        return poses.PoseNoise.of(template, noise, np.ones((len(template), frames), bool), np.ones(frames, bool))

    return make


@pytest.mark.parametrize(("template", "shows"), [(SHAPE - SHAPE.mean(axis=0), 0), (TRIANGLE, 10)])
def test_noise_of_a_point_in_noisy_axes(rng, pose_noise, template, shows):
    """Fixed points scatter by (*) and move in by B, in the axes of Kabsch's fits to 40,000 noisy copies of a template.

    One point of the template has another noise than the rest, not isotropic. Variances of 40,000 have an error of 0.7 %
    and second order adds (σ/extent)² = 1 % here: 5 % of the trace is beyond 5 errors of both. The means are compared to
    within 4.5 standard errors of each component: 12 of them fail by chance in 1 of 12,000. In the axes of the
    thin triangle points are displaced by more than 10 standard errors.
    """
    sigma, frames = 0.003, 40_000
    noise = np.repeat(sigma**2 * np.eye(3)[None], len(template), axis=0)
    noise[0] = np.diag([4.0, 1.0, 0.25]) * sigma**2
    epsilon = np.einsum("mij,mjt->mit", np.linalg.cholesky(noise), rng.standard_normal((len(template), 3, frames)))
    rotation, origin, known = rigid.fit_rigid_motion(template, template[:, :, None] + epsilon)
    assert known.all()
    found = pose_noise(template, noise)
    for point in POINTS:
        y = rigid.to_local(rotation, origin, np.repeat(point[:, None], frames, axis=1))
        wanted = found.covariance_at(point)
        assert np.abs(np.cov(y) - wanted).max() < 0.05 * np.trace(wanted)
        away = point - found.centroid[0]
        drawn = found.centroid[0] + (2 * np.eye(3) - found.expansion()[0]) @ away + found.mean_shift()[0]
        assert np.abs((y.mean(axis=1) - drawn) / (y.std(axis=1) / np.sqrt(frames))).max() < 4.5
        assert np.abs((y.mean(axis=1) - point) / (y.std(axis=1) / np.sqrt(frames))).max() > shows


def test_patterns(pose_noise):
    """Frames with the same points share a pattern, whose noise is that of its points alone."""
    used = np.ones((4, 6), dtype=bool)
    used[0, 2:4] = False
    known = np.array([True, True, True, True, True, False])
    noise = np.repeat(1e-6 * np.eye(3)[None], 4, axis=0)
    found = poses.PoseNoise.of(SHAPE, noise, used, known)
    assert found.pattern[5] == -1
    assert len(set(found.pattern[[0, 1, 4]])) == len(set(found.pattern[[2, 3]])) == 1
    part = pose_noise(SHAPE[1:], noise[1:])
    np.testing.assert_allclose(found.tilt[found.pattern[2]], part.tilt[0], rtol=1e-12)
    np.testing.assert_allclose(found.centroid[found.pattern[2]], SHAPE[1:].mean(axis=0), rtol=1e-12)
    mean = (3 * pose_noise(SHAPE, noise).covariance_at(POINTS[0]) + 2 * part.covariance_at(POINTS[0])) / 5
    np.testing.assert_allclose(found.covariance_at(POINTS[0]), mean, rtol=1e-10)
    assert found.worst_angles.max() == pytest.approx(np.sqrt(np.linalg.eigvalsh(part.tilt[0])[-1]))
    assert (found.removed.covariance_at(POINTS[0]) == 0.0).all()


def test_rigid_residual_operator(rng):
    """It is a projection of rank 3m - 6 that removes rigid motion."""
    left = poses.rigid_residual_operator(SHAPE)
    np.testing.assert_allclose(left @ left, left, atol=1e-12)
    assert np.trace(left) == pytest.approx(6.0)
    turn, shift = rng.standard_normal((2, 3))
    np.testing.assert_allclose(left @ (np.cross(turn, SHAPE) + shift).ravel(), 0.0, atol=1e-12)


def test_a_marker_at_the_centre_has_no_cap():
    """It lies in no direction from the centre in any frame."""
    assert np.isnan(rigid.cap_angle(np.full((3, 5), 0.2), np.ones(5, dtype=bool), np.full(3, 0.2)))


def test_angles_that_a_mean_rotation_implies(rng):
    """About one axis by θ they are √(2 - 2 |mean e^iθ|), 0, 0; unknown frames do not count."""
    angles = rng.normal(0.0, 0.3, 500)
    rotation = Rotation.from_rotvec(angles[:, None] * [0.6, 0.0, 0.8]).as_matrix().transpose(1, 2, 0)
    rotation[:, :, 7] = np.nan
    wanted = np.sqrt(2.0 - 2.0 * np.abs(np.exp(1j * np.delete(angles, 7)).mean()))
    np.testing.assert_allclose(rigid.rms_rotation(rotation), [wanted, 0.0, 0.0], atol=1e-7)
    assert np.isnan(rigid.rms_rotation(np.full((3, 3, 4), np.nan))).all()

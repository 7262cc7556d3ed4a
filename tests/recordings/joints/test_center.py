"""Noise of another shape than expected, and noise that is slow."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import study
from study.recordings.joints.center import SHAPE_ERROR, LocalMarker, PooledMoments, fit_center
from study.recordings.joints.estimate import symmetric_fit
from study.recordings.joints.find import find_joints
from study.recordings.joints.poses import PoseNoise, fit_poses
from study.recordings.markersets import load_markerset
from study.recordings.rigid import fit_rigid_motion, to_local
from study.recordings.synthetic.make import Recipe, synthesize

CENTER = np.array([0.02, 0.09, -0.1])

PELVIS = np.array([[0.09, 0.12, 0.05], [0.09, -0.12, 0.05], [-0.1, 0.06, 0.06], [-0.1, -0.06, 0.06]])

LEG = np.array([[0.02, 0.06, -0.25], [0.0, 0.05, -0.42]])


def still(frames):
    """Noise of an exact pose."""
    none = np.zeros((1, 3, 3))
    return PoseNoise(np.zeros(frames, dtype=np.int64), np.zeros((1, 3)), none, none, none)


@pytest.fixture
def leg(rng):
    """Make two markers about a joint that rotates within ± degrees, in the axes of four noisy ones, and their noise."""

    def make(frames, sigma, about):
        turns = Rotation.from_euler("yxz", rng.uniform(-1, 1, (frames, 3)) * about, degrees=True).as_matrix()
        child = np.einsum("tij,mj->mit", turns, LEG) + CENTER[:, None]
        seen = np.repeat(PELVIS[:, :, None], frames, axis=2)
        seen = seen + sigma * rng.standard_normal(seen.shape)
        rotation, origin, known = fit_rigid_motion(PELVIS, seen)
        y = to_local(rotation, origin, child + sigma * rng.standard_normal(child.shape))
        noise = np.repeat(max(sigma, 1e-9) ** 2 * np.eye(3)[None], 4, axis=0)
        pose = PoseNoise.of(PELVIS, noise, np.ones((4, frames), bool), known)
        return [LocalMarker(each, known, max(sigma, 1e-9) ** 2) for each in y], pose

    return make


def test_with_isotropic_noise_it_is_mgdk(rng, on_cap):
    """Centre, radii and condition are those of `study.mgdk`; η times the assumed variance is its noise variance.

    (`mgdk` counts degrees of freedom in the noise it reports; η as such is the same.)
    """
    sets = [on_cap(rng, n, 40.0, noise=0.02, radius=r, center=CENTER)[0] for n, r in ((400, 1.0), (300, 0.5))]
    joint = study.mgdk(sets)
    markers = []
    for points in sets:
        y = np.full((3, 400), np.nan)
        y[:, : len(points)] = points.T
        markers.append(LocalMarker(y, ~np.isnan(y[0]), 1e-4))
    found = fit_center(markers, still(400))
    np.testing.assert_allclose(found.center, joint.center, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.radii, joint.radii, rtol=1e-6)
    assert found.condition == pytest.approx(joint.condition, rel=1e-4)
    spare = (700 - 3 - 2) / 700
    assert found.size * 1e-4 == pytest.approx(joint.noise_variance * spare, rel=1e-4)
    assert found.axis is None


def test_size_zero_is_gdke(rng, on_cap):
    """With size 0 nothing is taken off, which is the algebraic fit of one marker."""
    points, _ = on_cap(rng, 200, 50.0, noise=0.05)
    found = fit_center([LocalMarker(points.T.copy(), np.ones(200, bool), 1.0)], still(200), size=0.0)
    np.testing.assert_allclose(found.center, study.fit(points, "gdke").center, atol=1e-10)


def pull(errors):
    """Largest mean error of a coordinate, in its standard errors."""
    return np.abs(np.mean(errors, axis=0) / (np.std(errors, axis=0, ddof=1) / np.sqrt(len(errors)))).max()


def test_unbiased_in_noisy_axes_where_mgdk_is_not(leg):
    """Over 80 recordings the mean error is within 4.5 standard errors of 0, covariances are right, 95 % sets cover.

    False alarms: 3 means 2·10⁻⁵; χ²(3) of 80 means, within 4 standard errors, 6·10⁻⁵; binomial(80, .95) below 69 or
    above 80, 2·10⁻³ one-sided below. `mgdk`, which takes the noise for isotropic, is biased by 10 standard errors.
    """
    errors, plain, squares = [], [], []
    for _ in range(80):
        markers, pose = leg(800, 0.005, (35, 15, 15))
        found = fit_center(markers, pose)
        error = found.center - CENTER
        errors.append(error)
        plain.append(study.mgdk([m.y.T for m in markers]).center - CENTER)
        squares.append(error @ np.linalg.solve(found.covariance, error))
        assert found.size == pytest.approx(1.0, abs=0.25)
        assert found.effective_frames > 400
    assert pull(errors) < 4.5
    assert pull(plain) > 10
    assert abs(np.mean(squares) - 3.0) < 4 * np.sqrt(6.0 / 80) + 0.3  # 0.3: the covariances are estimates, too
    assert (np.array(squares) < stats.chi2.ppf(0.95, 3)).sum() >= 69


def test_hinge(leg):
    """About one axis the centre is right to 3 mm across it, the axis to 2°, and the error along it is 0."""
    markers, pose = leg(1000, 0.002, (60, 0, 0))
    found = fit_center(markers, pose)
    assert found.axis is not None
    assert np.degrees(np.arccos(abs(found.axis[1]))) < 2.0
    across = found.center - CENTER
    assert np.hypot(across[0], across[2]) < 0.003
    assert found.covariance @ found.axis == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(found.radii, np.hypot(LEG[:, 0], LEG[:, 2]), atol=0.003)
    assert not found.clear


@pytest.mark.parametrize("hinge", [None, False])
def test_a_small_cap_is_no_hinge(leg, hinge):
    """A small cap has a short extent, too, but it curves: with little noise no direction is dropped."""
    markers, pose = leg(2000, 0.0005, (8, 8, 8))
    found = fit_center(markers, pose, hinge)
    assert found.axis is None
    assert np.linalg.norm(found.center - CENTER) < 0.02


def test_repeated_frames(leg):
    """Frames that are repeated forty times change neither the covariance nor the effective number of frames.

    It is found from a spectrum's lowest frequencies, some twenty, and to a third; a factor of 2.5 is three of these.
    """
    markers, pose = leg(200, 0.004, (35, 20, 20))
    once = fit_center(markers, pose)
    stretched = PoseNoise(np.repeat(pose.pattern, 40), pose.centroid, pose.shift, pose.tilt, pose.cross)
    again = [LocalMarker(np.repeat(m.y, 40, axis=1), np.repeat(m.used, 40), m.own) for m in markers]
    found = fit_center(again, stretched)
    np.testing.assert_allclose(found.center, once.center, atol=2e-4)
    assert once.effective_frames > 100
    assert 200 / 2.5 < found.effective_frames < 2.5 * 200
    assert found.frames == 8000
    assert 1 / 2.5 < np.trace(found.covariance) / np.trace(once.covariance) < 2.5


def test_too_few_or_in_a_line():
    """Too few samples, or samples on a line, give no centre and no warning."""
    for y in (np.outer([1.0, 0.0, 0.0], np.arange(10)), np.eye(3), np.full((3, 5), np.nan)):
        assert fit_center([LocalMarker(y, ~np.isnan(y[0]), 1e-6)], still(y.shape[1])) is None


RADIUS, SIGMA = 0.1, 0.002

ARMS = np.array([[0.0, 0.0, -0.1], [0.06, 0.0, -0.08], [0.02, 0.05, -0.12]])


def swinging(rng, frames, slow, arms=ARMS[:1]):
    """Markers about a joint at the origin, with noise of which ``slow`` is the correlation of successive frames."""
    angles = np.radians(12.0) * np.sin(
        rng.uniform(0, 2 * np.pi, (3, 1)) + np.outer([0.11, 0.071, 0.053], np.arange(frames))
    )
    noise = lfilter([np.sqrt(1 - slow**2)], [1, -slow], rng.standard_normal((len(arms), 3, frames)), axis=2)
    y = arms[:, :, None] + np.cross(angles[None], arms[:, :, None], axis=1)
    y *= np.linalg.norm(arms, axis=1)[:, None, None] / np.linalg.norm(y, axis=1)[:, None]
    return [LocalMarker(each, np.ones(frames, dtype=bool), SIGMA**2) for each in y + SIGMA * noise]


def pooled(markers):
    """Moments of markers in the axes of an exact pose."""
    pose = still(markers[0].y.shape[1])
    return PooledMoments(markers, list(range(len(markers))), pose, 1.0)


@pytest.mark.parametrize("slow", [0.0, 0.5, 0.9])
def test_slow_share(rng, slow):
    """The correlation of successive residuals is that of the noise, to 4 standard errors of 8000 frames.

    Its standard error is at most √((1 + φ²)/(1 - φ²)/n); the residual is linear in the noise along the radius.
    """
    found = pooled(swinging(rng, 8000, slow)).slow_share(np.zeros(3))
    assert found == pytest.approx(slow, abs=4 * np.sqrt((1 + slow**2) / (1 - slow**2) / 8000) + 0.002)


def test_a_frame_without_a_neighbour_shows_no_slow_share(rng):
    """Where each second sample is missing, no pair is left, and the share is 0."""
    (marker,) = swinging(rng, 200, 0.9)
    assert pooled([LocalMarker(marker.y, np.arange(200) % 2 == 0, marker.own)]).slow_share(np.zeros(3)) == 0.0


def test_slow_noise_hides_a_small_cap(rng):
    """The same extent that exceeds white noise may be tissue that slides along one line, if the noise is slow."""
    white, slow = (fit_center(swinging(rng, 4000, each), still(4000)) for each in (0.0, 0.95))
    assert white.significance > 4 * slow.significance > 0.0
    assert np.trace(slow.shape) > 10 * np.trace(white.shape)


def test_shape_covariance_is_what_noise_of_another_shape_does(rng):
    """It is the shift of the centre where the noise along a principal direction is larger, summed over directions.

    The refit with moments of such noise is independent of the Jacobian; weights that follow the centre, which the
    Jacobian leaves out, make up to a tenth.
    """
    moments = pooled(swinging(rng, 4000, 0.0, ARMS))
    size, center = moments.solve(np.eye(3))
    found = moments.shape_covariance(size, center, np.eye(3), SHAPE_ERROR)
    share, expected = 1e-3, np.zeros((3, 3))
    f, noise_shift, zfz = moments.f, moments.shift, moments.zfz
    for e in np.linalg.eigh(moments.matrix(size, np.eye(3)))[1].T:
        along = np.einsum("i,pij,j->p", e, f, e)
        more = share * along[:, None, None] * np.outer(e, e)
        extent = np.einsum("i,pij,j->p", e, moments.c, e)
        moments.f, moments.shift, moments.zfz = f + more, noise_shift + more, zfz + share * along * extent
        shift = (moments.solve(np.eye(3))[1] - center) * SHAPE_ERROR / share
        expected += np.outer(shift, shift)
    assert np.linalg.norm(found - expected) < 0.1 * np.linalg.norm(expected)


def test_noise_along_the_radius_of_one_marker_is_measured(rng):
    """One marker's residual is the noise along its radius, so that an error of that moves no centre."""
    moments = pooled(swinging(rng, 4000, 0.0))
    size, center = moments.solve(np.eye(3))
    error = np.sqrt(np.diag(moments.shape_covariance(size, center, np.eye(3), SHAPE_ERROR)))
    extent = np.linalg.eigvalsh(moments.matrix(0.0, np.eye(3)))[0] / moments.w.sum()
    correction = RADIUS * size * SIGMA**2 / (extent - size * SIGMA**2)  # that part of the radius is due to it
    assert error[2] < 0.2 * SHAPE_ERROR * correction


def test_a_joint_adds_no_noise_to_the_poses_that_rest_on_it():
    """A joint's error is the same in every frame, so thighs and shanks show the markers' noise, 1 mm, to 6 %.

    Three residuals of a frame and 600 frames know it to 1.7 %: a false alarm in 2000 for one segment.
    """
    recording, _ = synthesize(Recipe(frames=600, rate=50.0, seed=3, noise=0.001, gait=True))
    found = find_joints(load_markerset("cmu41"), recording)
    for side in ("left", "right"):
        for segment in ("thigh", "shank", "upper_arm"):
            assert found.poses[f"{side}_{segment}"].sigma == pytest.approx(0.001, rel=0.06)


PARENT = np.array([[0.1, 0.0, 0.0], [-0.1, 0.05, 0.0], [0.0, -0.1, 0.05], [0.0, 0.05, 0.1]])

CHILD = np.array([[0.0, 0.06, -0.1], [0.04, -0.02, -0.2], [-0.04, 0.0, -0.25]])

JOINT = np.array([0.03, 0.05, -0.2])

AXIS = np.array([0.2, 0.9, 0.3]) / np.linalg.norm([0.2, 0.9, 0.3])


@pytest.fixture
def limbs(rng):
    """Make two segments about a joint, with three or four noisy markers each, rotating about three axes, or one."""

    def make(frames, sigma, degrees):
        world = Rotation.random(frames, rng=rng)
        angles = np.radians(rng.uniform(-1, 1, (frames, 3)) * degrees)
        if degrees[1] or degrees[2]:
            bend = Rotation.from_euler("yxz", angles)
        else:
            bend = Rotation.from_rotvec(angles[:, :1] * AXIS)
        joint = world.apply(JOINT)
        sets = []
        for turn, shape, shift in ((world, PARENT, np.zeros(3)), (world * bend, CHILD, joint)):
            x = np.einsum("tij,mj->mit", turn.as_matrix(), shape) + np.broadcast_to(shift, (frames, 3)).T
            sets.append([row + sigma * rng.standard_normal(row.shape) for row in x])
        parent, child = (fit_poses(s, "abcd"[: len(x)], x) for s, x in zip(("parent", "child"), sets, strict=True))
        return parent, child, joint.T, world.apply(AXIS).T

    return make


def test_unbiased_and_its_covariance_right(limbs):
    """Over 60 recordings of 500 frames the mean error is within 4.5 errors of 0 (3 in 10⁵), and 95 % sets cover.

    Binomial(60, .95) is below 50 in 3 of 10⁴. The noise is large here: it rotates the child's pose by 4°.
    """
    errors, level = [], 0
    for _ in range(60):
        parent, child, joint, _ = limbs(500, 0.004, (40, 20, 20))
        found = symmetric_fit(parent, child)
        error = found.in_parent - parent.mean_place(joint)
        errors.append(error)
        level += error @ np.linalg.solve(found.covariance, error) < stats.chi2.ppf(0.95, 3)
    assert pull(errors) < 4.5
    assert level >= 50


def test_a_hinge_shows_its_axis(limbs):
    """A hinge's axis is right to 1° in both segments, and the centre is on it to 2 mm."""
    parent, child, joint, axis = limbs(1000, 0.002, (60, 0, 0))
    found = symmetric_fit(parent, child)
    assert found.hinge
    for poses, direction in zip((parent, child), found.axes, strict=True):
        true = poses.to_local(axis + poses.origin).mean(axis=1)
        assert np.degrees(np.arccos(abs(direction @ true) / np.linalg.norm(true))) < 1.0
    off = found.in_parent - parent.mean_place(joint)
    true = parent.to_local(axis + parent.origin).mean(axis=1)
    assert np.linalg.norm(np.cross(off, true / np.linalg.norm(true))) < 0.002
    assert np.degrees(found.rms_angles[0]) == pytest.approx(60 / np.sqrt(3), abs=3)
    assert np.degrees(found.rms_angles[1:]).max() < 3


def test_no_joint_without_rotation(limbs):
    """Segments that do not rotate have no joint, and neither have segments that share too few frames."""
    parent, child, _, _ = limbs(50, 0.0, (0.5, 0.3, 0.3))
    assert symmetric_fit(parent, child) is None
    assert symmetric_fit(parent.in_frames(np.arange(3)), child.in_frames(np.arange(3))) is None

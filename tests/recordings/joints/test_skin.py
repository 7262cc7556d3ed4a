"""Tests of skin."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from study import mgdk
from study.recordings.joints import skin
from study.recordings.joints.estimate import USABLE
from study.recordings.joints.find import find_joints
from study.recordings.joints.poses import rigid_residual_operator
from study.recordings.markersets import load_markerset
from study.recordings.recording import Recording
from study.recordings.synthetic.make import Recipe, synthesize

ARMS = np.array([[0.0, 0.05, -0.2], [0.06, 0.0, -0.3], [-0.05, -0.04, -0.25]])

FRAME = np.array([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.05, 0.02], [-0.1, -0.05, 0.02]])
ALL = np.ones(4, dtype=bool)


def motion(frames=500):
    """Rotation vectors of mean zero, of some 10°."""
    t = np.arange(frames) / frames * 2 * np.pi
    return 0.2 * np.stack([np.sin(2 * t), 0.6 * np.sin(3 * t + 1), 0.5 * np.sin(5 * t + 2)])


def response(angles, z):
    """Inverse, slopes and arms of a fit to three markers with weights 1/r², and the shifts of their places."""
    r = np.linalg.norm(ARMS, axis=1)
    normal = sum(each @ each.T / each.shape[1] / r[j] ** 2 for j, each in enumerate(z))
    slopes = np.array([each @ angles.T / each.shape[1] / r[j] for j, each in enumerate(z)])
    return np.linalg.inv(normal), slopes, ARMS / r[:, None], [skin.pose_shifts(FRAME, ALL, place) for place in ARMS]


def test_spheres_against_refits():
    """The covariance is that of MGDK's centre over 400 bodies with skin of 5 mm/rad, half of it common to the markers.

    Each of three variances is from 400 draws: relative standard error .07; four of these, and 8 % of nonlinearity.
    """
    rng, angles = np.random.default_rng(4), motion()
    rotation = Rotation.from_rotvec(angles.T).as_matrix()
    clean = np.einsum("tij,mj->mit", rotation, ARMS)
    z = clean - clean.mean(axis=2, keepdims=True)
    stated = skin.sphere_skin(*response(angles, z), 0.005**2, 0.0)
    centers = []
    for _ in range(400):
        common, own = np.sqrt(0.5) * 0.005 * rng.standard_normal((2, 3, 3, 3))
        moved = np.einsum("mij,jt->mit", own + common[:1], angles)
        y = np.einsum("tij,mjt->mit", rotation, ARMS[:, :, None] + moved)
        centers.append(mgdk([each.T for each in y]).center)
    found = np.cov(np.array(centers).T)
    np.testing.assert_allclose(np.diag(stated), np.diag(found), rtol=4 * 0.07 + 0.08)
    assert 1.0 < np.sqrt(np.linalg.eigvalsh(stated)[-1]) / 0.005 < 4.0  # about β metres, whatever the range


def test_common_skin_shifts_an_image_as_a_whole():
    """The pose's skin moves a point by its mean and by its rotation; a joint among the points is not on skin."""
    place = np.array([0.0, 0.1, -0.2])
    shifts = skin.pose_shifts(FRAME, ALL, place)
    np.testing.assert_allclose(skin.image_skin(shifts, 0.0), np.eye(3))
    middle = skin.image_skin(skin.pose_shifts(FRAME, ALL, FRAME.mean(axis=0)), 1.0)
    np.testing.assert_allclose(middle, np.eye(3) / 4, atol=1e-12)
    three = skin.pose_shifts(FRAME, np.array([False, True, True, True]), place)
    assert np.trace(skin.image_skin(three, 1.0)) < np.trace(skin.image_skin(shifts, 1.0))


def test_pairs_against_least_squares():
    """The covariance is that of the point that minimises |Eθ + θ × dc|², for drawn E."""
    rng, angles = np.random.default_rng(5), motion()
    second = angles @ angles.T / angles.shape[1]
    cross = np.array([[[0, -c, b], [c, 0, -a], [-b, a, 0]] for a, b, c in angles.T]).reshape(-1, 3)
    shifts = [
        np.linalg.lstsq(cross, -(0.01 * rng.standard_normal((3, 3)) @ angles).T.ravel(), rcond=None)[0]
        for _ in range(1000)
    ]
    stated = skin.pair_skin(second, np.eye(3), 0.01**2 * np.eye(3))
    np.testing.assert_allclose(np.diag(stated), np.var(shifts, axis=0), rtol=4 * np.sqrt(2 / 1000))


POINTS = np.array([[0.1, 0, 0], [-0.1, 0.02, 0], [0, 0.12, 0.03], [0.02, -0.03, 0.1]])


def drawn(beta, noise, rng, frames=600):
    """Departures that a rigid fit leaves of skin of slope β and of noise, and the joint's angles."""
    t = np.arange(frames) / frames * 2 * np.pi
    angles = 0.3 * np.stack([np.sin(3 * t), np.sin(5 * t + 1), np.sin(7 * t + 2)])
    moved = beta * np.einsum("mij,jt->mit", rng.standard_normal((4, 3, 3)), angles)
    moved += noise * rng.standard_normal(moved.shape)
    left = rigid_residual_operator(POINTS) @ moved.reshape(12, -1)
    return left.reshape(moved.shape), angles


def test_slope_is_right_on_average():
    """Over 60 bodies the mean square slope is that which was drawn; each is from 6 x 3 normal numbers.

    Its relative standard error is √(2/18/60) = .043; the quadratics take up none of it. Four of these are allowed.
    """
    rng = np.random.default_rng(1)
    found = [skin.skin_slope(*drawn(0.01, 0.001, rng)) for _ in range(60)]
    assert np.mean(found) == pytest.approx(1e-4, rel=4 * 0.043)


def test_a_slope_that_few_coordinates_show():
    """Errors are those of Student's law: four markers show six coordinates, with three of the body's 2/3 · 9 degrees.

    A segment without a pose of its own gets 1.5 times the mean of the body.
    """
    departures, angles = drawn(0.01, 0.0001, np.random.default_rng(8))
    errors = skin.SkinErrors(Recording("a", ("A",), np.zeros((1, 3, 600)), 100.0), {})
    errors.departures = {"thigh": departures}
    one, other = (errors._slope(segment, angles) / skin.skin_slope(departures, angles) for segment in ("thigh", "arm"))
    assert one == pytest.approx(stats.t(6).var())
    assert other == pytest.approx(1.5)


def test_noise_alone_has_no_slope():
    """What noise of 2 mm explains by chance, a slope of .7 mm/rad, is taken off: less than half is left."""
    rng = np.random.default_rng(2)
    found = [skin.skin_slope(*drawn(0.0, 0.002, rng)) for _ in range(40)]
    by_chance = 9 * 0.002**2 / 600 / (3 * 0.3**2 / 2)
    assert np.mean(found) < 0.5 * by_chance


def test_too_little_to_measure():
    """Two markers, or frames that are too few, show no slope."""
    departures, angles = drawn(0.01, 0.001, np.random.default_rng(3))
    assert np.isnan(skin.skin_slope(departures[:2], angles))
    assert np.isnan(skin.skin_slope(departures[:, :, :50], angles[:, :50]))
    departures[0, :, 60:] = np.nan
    assert skin.skin_slope(departures, angles) > 0.0
    departures[0, :, 30:] = np.nan
    assert np.isnan(skin.skin_slope(departures, angles))


def test_angles_about_two_axes_show_a_slope_that_rounding_does_not_change(rng):
    """A joint that never rotates about one axis leaves regressors without extent, which explain nothing."""
    angles = rng.standard_normal((3, 400)) * np.array([[0.3], [0.2], [0.0]])
    departures = np.einsum("mij,jt->mit", 0.005 * rng.standard_normal((4, 3, 3)), angles)
    departures += 0.001 * rng.standard_normal((4, 3, 400))
    slopes = [skin.skin_slope(departures, angles + 1e-16 * rng.standard_normal((3, 400))) for _ in range(5)]
    np.testing.assert_allclose(slopes, slopes[0], rtol=1e-9)


def slid(beta, noise, rng, frames=600):
    """Changes of the radii of three markers about the centre that fits them best, and the joint's angles."""
    t = np.arange(frames) / frames * 2 * np.pi
    angles = 0.3 * np.stack([np.sin(3 * t), np.sin(5 * t + 1), np.sin(7 * t + 2)])
    slopes = beta * rng.standard_normal((3, 3))
    radii = slopes @ angles + noise * rng.standard_normal((3, frames))
    # a shift dc of the centre changes the radius along û by û × dc per radian
    arms = np.cross(np.eye(3)[None], (ARMS / np.linalg.norm(ARMS, axis=1)[:, None])[:, None]).reshape(9, 3)
    design = np.einsum("mij,it->mtj", arms.reshape(3, 3, 3), angles).reshape(-1, 3)
    return (radii.ravel() - design @ np.linalg.lstsq(design, radii.ravel(), rcond=None)[0]).reshape(3, -1), angles


def test_slope_of_radii_is_right_on_average():
    """Over 100 bodies the mean square slope is that which was drawn; the centre takes one marker's share of it.

    Each is from six normal numbers: relative standard error √(2/6/100) = .058, of which four are allowed.
    """
    rng = np.random.default_rng(6)
    slopes = [skin.radius_slope(*slid(0.05, 0.0005, rng)) for _ in range(100)]
    assert np.mean(slopes) == pytest.approx(0.05**2, rel=4 * 0.058)


def test_radii_without_skin_have_no_slope():
    """What noise explains by chance does not count; one marker shows nothing, for the centre takes its slope."""
    rng = np.random.default_rng(7)
    assert [skin.radius_slope(*slid(0.0, 0.002, rng)) for _ in range(20)] == [0.0] * 20
    radii, angles = slid(0.05, 0.001, rng)
    assert np.isnan(skin.radius_slope(radii[:1], angles))


def test_markers_that_slide_with_the_hip(part_of):
    """Markers on trochanters and epicondyles slide by 20-30 mm: of 16 hips, or a part, none is undoubted and 2 cm off.

    Of 24 hips of other bodies, 8 % were, when errors came from the template alone; none is since radii count.
    """
    markerset, far, hips = load_markerset("rizzoli"), 0, 0
    for seed in range(40, 40 + part_of(8)):
        recipe = Recipe(800, 50.0, seed=seed, soft_tissue=0.02 + 0.00125 * (seed - 40), skin="slide", markers="rizzoli")
        recording, truth = synthesize(recipe)
        joints = find_joints(markerset, recording)
        for name in ("left_hip", "right_hip"):
            estimate = joints[name].estimate
            off = estimate.center - estimate.poses.mean_place(truth.centers[truth.joints.index(name)])
            far += bool(np.linalg.norm(off) > 0.02 and joints[name].status in USABLE)
            hips += 1
    assert (far, hips) == (0, 2 * part_of(8))

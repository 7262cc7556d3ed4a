"""Points of the body: anatomical axes, and hips by regression."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from study.recordings import api
from study.recordings.export import write_mot
from study.recordings.export.tree import ExportedMotion, angle_lines, joint_angles
from study.recordings.joints.estimate import JointStatus
from study.recordings.joints.find import load_calibration, save_calibration
from study.recordings.markersets import landmarks, load_markerset, shipped, side_of
from study.recordings.recording import Recording
from study.recordings.skeleton import anatomy
from study.recordings.skeleton.anatomy import (
    SIGMA,
    anatomical_axes,
    hip_by_regression,
    legs,
    points_of_the_body,
    regression_hint,
    weighted,
)
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_scene
from study.recordings.synthetic.make import Recipe, body, synthesize
from tests.recordings.bodies import axes_of_the_body


def other_program(left, right, behind):
    """Hips, mm, as the R package `biomechanics` has them in ``compute_hjc_regression``: its axes, its numbers."""
    middle, along = (left + right) / 2, (right - left) / np.linalg.norm(right - left)
    down = np.cross(along, (right - behind) / np.linalg.norm(right - behind))
    down /= np.linalg.norm(down)
    ahead = np.cross(down, along)
    width, depth = np.linalg.norm(right - left), np.linalg.norm(behind - middle)
    steps = (0.33 * width + 7.3, -0.24 * depth - 9.9, -0.30 * width - 10.9)
    axes = np.stack([along, ahead, down])
    return [middle + np.array([sign * steps[0], *steps[1:]]) @ axes for sign in (-1.0, 1.0)]


@pytest.mark.parametrize("seed", range(5))
def test_the_regression_is_that_of_another_program(seed):
    """Pelves of several shapes and poses; posterior spines in two points or as a sacrum."""
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=seed).as_matrix(), rng.normal(0, 1000, 3)
    left, right, behind = np.array([[90, 120, 0], [90, -120, 0], [-75, 0, 15]]) + rng.normal(0, 10, (3, 3))
    half = np.array([rng.normal(0, 5), 45, 0])
    given = {"left asis": left, "right asis": right, "left psis": behind + half, "right psis": behind - half}
    placed = {name: (turn @ x + shift) / 1000.0 for name, x in given.items()}
    wanted = other_program(*(turn @ x + shift for x in (left, right, behind)))
    sacrum = {name: x for name, x in placed.items() if "asis" in name} | {"sacrum": (turn @ behind + shift) / 1000.0}
    for points in (placed, sacrum):
        for one, hip in zip(("left", "right"), wanted, strict=True):
            np.testing.assert_allclose(1000.0 * hip_by_regression(points, one), hip, atol=1e-9)
    assert hip_by_regression({name: x for name, x in placed.items() if name != "left psis"}, "left") is None


@pytest.mark.parametrize("error", [0.002, 0.01, 0.06])
def test_the_error_of_a_weighted_hip_covers(error):
    """95 % regions hold the truth as often as they say, within 4.5 standard errors (false alarms 1e-5), 1000 hips."""
    rng = np.random.default_rng(1)
    shape = error**2 * np.diag([1.0, 0.5, 0.1])
    inside, count = 0, 0
    for _ in range(1000):
        truth = rng.normal(size=3)
        regression, motion = truth + rng.normal(0, SIGMA, 3), rng.multivariate_normal(truth, shape)
        center, covariance, both = weighted(regression, motion, shape)
        off = center - truth
        inside += off @ np.linalg.solve(covariance, off) < stats.chi2.ppf(0.95, 3)
        count += both
        assert np.trace(covariance) <= 3 * SIGMA**2 + 1e-15
    assert abs(count / 1000 - 0.99) < 4.5 * np.sqrt(0.99 * 0.01 / 1000)
    assert inside / 1000 > 0.95 - 4.5 * np.sqrt(0.95 * 0.05 / 1000)


def test_motion_that_is_wrong_by_more_than_it_says_does_not_count():
    regression = np.array([0.0, 0.1, 0.0])
    center, covariance, both = weighted(regression, regression + 0.11 * np.eye(3)[0], 0.009**2 * np.eye(3))
    np.testing.assert_array_equal(center, regression)
    np.testing.assert_array_equal(covariance, SIGMA**2 * np.eye(3))
    assert not both
    assert not weighted(regression, np.full(3, np.nan), np.full((3, 3), np.nan))[2]


@pytest.fixture(scope="module")
def walker():
    """A body that walks, with landmarks that slide: its hips are doubted."""
    return synthesize(Recipe(700, 60.0, markers="rizzoli", skin="slide", soft_tissue=0.02, gait=True))


def test_hips_by_regression_only_where_motion_leaves_doubts(walker, tmp_path):
    """Doubted hips are placed, labelled and stored; every other joint, and hips that move on purpose, stay."""
    recording, _ = walker
    before, after = api.find_joints(recording), api.find_joints(recording, hips="regression")
    hips = {"left_hip", "right_hip"}
    assert not any(before[name].usable for name in hips)
    assert regression_hint(before, recording)[0].startswith("every hip is doubted: --hips regression takes them from")
    assert regression_hint(after, recording) == []
    drawn = draw_skeleton(before, recording)
    points = points_of_the_body(drawn, recording)
    for place in after.joints:
        if place.joint.name not in hips:
            np.testing.assert_array_equal(place.in_parent, before[place.joint.name].in_parent)
            continue
        assert place.status == JointStatus.REGRESSION
        assert not place.usable
        assert place.reason.startswith("by regression on the pelvis' width and depth (Harrington 2007)")
        assert place.standard_error <= SIGMA + 1e-12
        plain = hip_by_regression(points, place.joint.name.partition("_")[0])
        assert np.linalg.norm(place.in_parent - plain) < 3 * SIGMA
        if "weighted" not in place.reason:
            np.testing.assert_allclose(place.in_parent, plain, atol=1e-12)
    again = load_calibration(save_calibration(after, tmp_path / "c.json"))
    assert again["left_hip"].status == JointStatus.REGRESSION
    for one, other in zip(again.shapes, after.shapes, strict=True):
        np.testing.assert_array_equal(one.anatomy, other.anatomy)
    moved, _ = synthesize(Recipe(700, 60.0, markers="rizzoli"))
    one, other = api.find_joints(moved), api.find_joints(moved, hips="regression")
    assert [place.status for place in other.joints] == [place.status for place in one.joints]


@pytest.mark.parametrize("label", ["{}HJC", "{}HJC_harrington", "{}_HJC", "{}hjc"])
def test_the_laboratorys_own_centre_goes_first(walker, label):
    """A centre in the file is taken, under the labels that programs give it."""
    recording, truth = walker
    hips = np.stack([truth.centers[truth.joints.index(name)] for name in ("left_hip", "right_hip")])
    labels = [label.format("L"), label.format("R")]
    positions = np.concatenate([recording.positions, hips])
    lab = Recording("lab", (*recording.markers, *labels), positions, recording.rate)
    joints = api.find_joints(lab, hips="regression")
    for name in ("left_hip", "right_hip"):
        assert joints[name].reason.startswith("the laboratory's own centre, left in the file")
    drawn = draw_skeleton(joints, recording)
    off = np.linalg.norm(drawn.center("left_hip") - hips[0], axis=0)
    assert np.median(off) < 0.02  # skin on the pelvis and motion's share; by motion alone it is farther


def test_a_body_without_points_has_no_regression():
    """Nor have its joints clinical angles; they are named as what they are."""
    recording, _ = synthesize(Recipe(300, 60.0))
    joints = api.find_joints(recording, hips="regression")
    assert legs(joints.markerset) == {}
    assert regression_hint(joints, recording) == []
    assert all(np.isnan(shape.anatomy).all() for shape in joints.shapes)
    (line,) = angle_lines(joints)
    assert line.startswith("angles of waist, neck, ")
    assert line.endswith("for want of points of the body that show anatomical axes")


def with_axes(calibration):
    """Segments that have anatomical axes."""
    return {shape.segment for shape in calibration.shapes if not np.isnan(shape.anatomy).any()}


def test_sessions_take_points_from_the_static_trial():
    """Medial markers are in the static trial alone; axes and hips come from it, and serve the walk."""
    walk, _ = synthesize(Recipe(500, 60.0, seed=2, markers="rizzoli", gait=True))
    still, _ = synthesize(Recipe(60, 60.0, seed=3, markers="rizzoli", reach=0.0))
    medial = [marker for marker in walk.markers if marker.endswith(("FME", "TAM"))]
    bare = walk.select([marker for marker in walk.markers if marker not in medial])
    assert with_axes(api.find_joints(bare)) == {"pelvis", "left_foot", "right_foot"}
    both = api.find_joints([replace(bare, name="walk")], static=replace(still, name="static"))
    legs_of = (f"{one}_{part}" for one in ("left", "right") for part in ("thigh", "shank", "foot"))
    assert with_axes(both) == {"pelvis", *legs_of}


@pytest.fixture(scope="module", params=[False, True], ids=["smooth", "gait"])
def known(request):
    """A recording without noise, the truth about it, its joints and its skeleton."""
    recording, truth = synthesize(Recipe(600, 60.0, markers="rizzoli", noise=1e-6, gait=request.param))
    joints = api.find_joints(recording)
    return recording, truth, joints, draw_skeleton(joints, recording)


def test_axes_are_those_of_the_body(known):
    """The axes are the body's own, computed from its table, within half a degree; points in one place give none."""
    _, truth, joints, drawn = known
    wanted = axes_of_the_body()
    assert set(wanted) == with_axes(joints)
    for name, axes in wanted.items():
        true = truth.rotations[truth.segments.index(name)] @ axes
        ours = np.einsum("ijt,jk->tik", drawn.rotation(name), joints.shape(name).anatomy)
        away = Rotation.from_matrix(np.swapaxes(true, 1, 2) @ ours).magnitude()
        assert np.degrees(away).max() < 0.5, name
    with np.errstate(all="raise"):
        points = {"left asis": np.zeros(3), "right asis": np.zeros(3), "sacrum": np.ones(3)}
        assert anatomical_axes(joints, points) == {}
        assert hip_by_regression(points, "left") is None


def test_angles_are_those_of_grood_and_suntay(known, tmp_path):
    """Hips, knees, ankles and pelvis within half a degree of SciPy's Cardan angles of the true rotations."""
    recording, truth, joints, drawn = known
    motion = ExportedMotion(drawn, recording, skeleton_scene(drawn, recording))
    table, axes = joint_angles(motion), axes_of_the_body()
    world = {name: truth.rotations[truth.segments.index(name)] @ axes[name] for name in axes}
    checked = 0
    for number, name in enumerate(truth.joints):
        parent, child = truth.parents[number], truth.children[number]
        if parent not in axes or child not in axes:
            continue
        turn = Rotation.from_matrix(np.swapaxes(world[parent], 1, 2) @ world[child])
        wanted = np.unwrap(turn.as_euler("ZXY"), axis=0).T
        mirror = -1.0 if name.startswith("left") else 1.0
        signs = [-1.0 if name.endswith("knee") else 1.0, mirror, mirror]
        for word, sign, angle in zip(("flexion", "adduction", "rotation"), signs, wanted, strict=True):
            off = table[f"{name}_{word}"] - np.degrees(sign * angle)
            off -= 360.0 * np.round(np.median(off) / 360.0)
            assert np.abs(off).max() < 0.5, (name, word)
            checked += 1
    assert checked == 18
    assert table["left_knee_flexion"].median() > 0.0
    tilt = Rotation.from_matrix(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ world["pelvis"]).as_euler("ZXY")[:, 0]
    np.testing.assert_allclose(table["pelvis_tilt"], np.degrees(np.unwrap(tilt)), atol=0.5)
    lines = angle_lines(joints)
    assert lines[0].startswith("angles of left_hip, left_knee, left_ankle, right_hip, right_knee, right_ankle: Grood")
    assert lines[1].startswith("angles of waist: zero where bones hang straight down")
    write_mot(motion, tmp_path / "a.mot")
    assert (tmp_path / "a.mot").read_text().splitlines()[0] == "; ".join([recording.name, *lines])


@pytest.mark.parametrize("name", shipped())
def test_points_of_shipped_sets(name):
    """Labels of each set stand for points on the segment that carries them, on their own side."""
    markerset = load_markerset(name)
    owners = {marker: segment.name for segment in markerset.segments for marker in segment.markers}
    for point, label in landmarks(tuple(owners)).items():
        one, _, kind = point.rpartition(" ") if point == "sacrum" else point.partition(" ")
        part = anatomy._OWNERS[kind if kind in anatomy._OWNERS else point]
        assert owners[label].endswith(part), (point, label)
        assert not one or side_of([label]) == one


@pytest.fixture(scope="module")
def stiff():
    """A walk whose left ankle and knee hardly move, for skin of a millimetre; the truth; and its joints."""
    recording, truth = synthesize(Recipe(600, 60.0, seed=4, markers="rizzoli", noise=0.001, reach=0.05))
    return recording, truth, api.find_joints(recording)


def test_joints_between_points_of_the_body(stiff):
    """Knees and ankles that hardly move are midway between epicondyles and malleoli, and say so.

    The middles are those of the body's table of markers, in the world, to the noise of poses.
    """
    recording, truth, joints = stiff
    place = {label: np.array(at) for part in body("rizzoli") for label, at in part.markers.items()}
    drawn = draw_skeleton(joints, recording)
    for side, letter in (("left", "L"), ("right", "R")):
        for name, segment, pair in (("knee", "thigh", ("FLE", "FME")), ("ankle", "shank", ("FAL", "TAM"))):
            joint = joints[f"{side}_{name}"]
            assert joint.status == JointStatus.LANDMARK
            assert joint.reason.startswith("midway between the")
            assert "; by motion: " in joint.reason
            assert joint.standard_error == pytest.approx(0.01)
            number = truth.segments.index(f"{side}_{segment}")
            middle = 1.75 * (place[letter + pair[0]] + place[letter + pair[1]]) / 2
            wanted = np.einsum("tij,j->it", truth.rotations[number], middle) + truth.origins[number]
            off = np.linalg.norm(drawn.center(f"{side}_{name}") - wanted, axis=0)
            assert np.median(off) < 0.002
    motion = ExportedMotion(drawn, recording, skeleton_scene(drawn, recording))
    assert "left_ankle_landmark" in motion.with_joints().markers
    assert any("left_ankle" in line for line in joints.reasons())


def test_a_hinge_beside_its_epicondyles_is_doubted():
    """The distance of a knee from its epicondyles is across its axis; beyond 2.5 √(error² + 1 cm²) it is doubted.

    The epicondyles are moved by 40 mm across the axis in the recording.
    """
    recording, _ = synthesize(Recipe(900, 60.0, seed=5, markers="rizzoli", noise=0.001))
    near = api.find_joints(recording)["left_knee"]
    assert near.status == JointStatus.HINGE
    assert near.beside < 0.025
    shape = api.find_joints(recording).shape("left_thigh")
    drawn = draw_skeleton(api.find_joints(recording), recording)
    step = 0.04 * np.cross(near.axis, near.in_parent - shape.places.mean(axis=0))
    step *= 0.04 / np.linalg.norm(step)
    positions = recording.positions.copy()
    for label in ("LFLE", "LFME"):
        positions[recording.row(label)] += np.einsum("ijt,j->it", drawn.rotation("left_thigh"), step)
    far = api.find_joints(Recording("far", recording.markers, positions, recording.rate))["left_knee"]
    assert far.status == JointStatus.LANDMARK
    assert far.beside == pytest.approx(0.04, abs=0.012)
    assert "by motion: implausible" in far.reason

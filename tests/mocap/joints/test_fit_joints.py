import numpy as np
import pytest
from scipy import stats

from study.mocap.geometry.range_of_motion import rotation_range
from study.mocap.io.recording import Recording
from study.mocap.joints.estimates import CENTIMETRE, USABLE, JointStatus
from study.mocap.joints.fit_joints import find_joints
from study.mocap.joints.joint_report import joint_lines
from study.mocap.markersets.set_file import load_markerset
from study.mocap.skeleton.calibrate import calibration_from
from study.mocap.skeleton.draw_skeleton import draw_skeleton
from study.mocap.skeleton.skeleton_scene import skeleton_scene
from study.mocap.skeleton.skeleton_table import skeleton_lines
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

CMU41 = load_markerset("cmu41")


def compared(found, truth):
    """For each joint: distance to the truth, largest standardised error along a principal axis, and level of the set.

    A hinge is compared with the line that its true axis is; distances are then across that.
    """
    result = {}
    for each in found.joints:
        k = truth.joints.index(each.joint.name)
        estimate = each.estimate
        error = estimate.center - estimate.poses.mean_place(truth.centers[k])
        basis = np.eye(3)
        if estimate.axis is not None:
            parent = truth.rotations[truth.segments.index(truth.parents[k])]
            axis = np.nanmean(estimate.poses.to_local((parent @ truth.axes[k]).T + estimate.poses.origin), axis=1)
            basis = np.linalg.svd(axis[None])[2][1:].T
        error, covariance = basis.T @ error, basis.T @ estimate.covariance @ basis
        values, vectors = np.linalg.eigh(covariance)
        pulls = np.abs(vectors.T @ error) / np.sqrt(values)
        result[each.joint.name] = (np.linalg.norm(error), pulls.max(), stats.chi2.cdf((pulls**2).sum(), len(error)))
    return result


def moved(truth, name):
    """Angle about the mean within which 95 % of a joint's true rotations are, degrees."""
    k = truth.joints.index(name)
    parent, child = (truth.rotations[truth.segments.index(each[k])] for each in (truth.parents, truth.children))
    return np.degrees(rotation_range(np.einsum("tji,tjk->ikt", parent, child)))


def axis_off(found, truth, name):
    """Angle between a hinge's axis and the true one, degrees."""
    k = truth.joints.index(name)
    poses = found.poses[found[name].joint.parent]
    parent = truth.rotations[truth.segments.index(truth.parents[k])]
    axis = np.nanmean(poses.to_local((parent @ truth.axes[k]).T + poses.origin), axis=1)
    return np.degrees(np.arccos(min(abs(axis @ found[name].axis_in_parent) / np.linalg.norm(axis), 1.0)))


HINGES = ("left_elbow", "right_elbow", "left_knee", "right_knee")


def test_without_noise_every_joint_is_exact(exact):
    """Without noise joints are exact to a micrometre, hinges across their axes, and axes to 0.01°."""
    _, truth, found = exact
    for name, (error, _, _) in compared(found, truth).items():
        assert error < 1e-6, name
        wanted = JointStatus.HINGE if name in HINGES else JointStatus.OK
        assert found[name].status == wanted, name
    assert all(axis_off(found, truth, name) < 0.01 for name in HINGES)


def test_noise_is_covered():
    """With 1 and 3 mm of noise errors are within three standard errors, and 95 % sets cover as often as they should.

    12 recordings of 14 joints: 3 standard errors along any of three axes are exceeded by chance by 0.8 % of joints, so
    by 1.4 of 168; 6 and more in 4 of 1000. (Fixed seeds; a single recording passes in 9 of 10.) Sets of 95 %:
    binomial(168, .95) is below 150 in 3 of 1000.
    """
    far, covered, count = 0, 0, 0
    for seed in range(12):
        recording, truth = synthesize(Recipe(frames=1500, noise=0.001 if seed < 6 else 0.003, seed=200 + seed))
        found = find_joints(CMU41, recording)
        for _, pull, level in compared(found, truth).values():
            far, covered, count = far + (pull > 3.0), covered + (level < 0.95), count + 1
        assert all(axis_off(found, truth, name) < 2.0 for name in HINGES)
    assert count == 12 * 14
    assert far < 6
    assert covered >= 150


@pytest.mark.parametrize("noise", [0.001, 0.003, 0.005])
def test_gaps_of_a_fifth(noise):
    """Joints that moved by more than 30° are right to 3 mm, with 1-5 mm of noise and a fifth of the samples missing.

    43 seconds of motion. (With 5 mm standard errors are 1-3 mm: over seeds 6 to 13, 98 of 99 joints keep to it.)
    """
    recording, truth = synthesize(Recipe(frames=5200, noise=noise, gaps=0.2, seed=5))
    found = find_joints(CMU41, recording)
    for name, (error, pull, _) in compared(found, truth).items():
        assert pull < 4.5, name
        if moved(truth, name) > 30:
            assert error < 0.003, name
            assert found[name].status in (JointStatus.OK, JointStatus.HINGE)
    assert all(axis_off(found, truth, name) < 2.0 for name in HINGES)


def test_swaps_do_no_harm():
    """Errors stay small where one frame in twenty has two neighbouring markers exchanged."""
    recording, truth = synthesize(Recipe(frames=2000, noise=0.001, swaps=0.05))
    assert truth.swaps
    for name, (error, _, _) in compared(find_joints(CMU41, recording), truth).items():
        assert error < 0.001, name


def test_places_and_axes_in_both_segments(figure):
    """Both segments' places are the same point of the world, within the poses' noise; so are a hinge's axes."""
    found = figure[2]
    for name in ("neck", "left_elbow", "left_knee", "right_hip"):
        joint = found[name]
        parent, child = found.poses[joint.joint.parent], found.poses[joint.joint.child]
        apart = parent.to_world(joint.in_parent) - child.to_world(joint.in_child)
        assert np.sqrt((apart**2).sum(axis=0)).max() < 0.03
        assert (
            np.linalg.norm(np.nanmean(parent.to_local(child.to_world(joint.in_child)), axis=1) - joint.in_parent)
            < 0.001
        )
    knee = found["left_knee"]
    turned = np.einsum("ijt,j->it", found.poses["left_thigh"].rotation, knee.axis_in_parent)
    other = np.einsum("ijt,j->it", found.poses["left_shank"].rotation, knee.axis_in_child)
    assert np.median((turned * other).sum(axis=0)) > np.cos(np.radians(3))
    assert np.isnan(found["left_hip"].axis_in_parent).all()
    assert np.isnan(found["left_wrist"].in_child).all()  # a hand with one marker has no pose of its own


def test_missing_marker(figure):
    """Without one thigh marker the knee has no pose, and says why; joints that do not need it are found."""
    recording = figure[0]
    names = [name for name in recording.markers if name not in ("LTHI", "LHEE")]
    found = find_joints(CMU41, recording.select(names))
    assert found["left_knee"].status == JointStatus.NO_FRAME
    assert "left_thigh has" in found["left_knee"].reason
    assert found["left_knee"].estimate is None
    assert found["left_hip"].status == JointStatus.OK
    assert found["right_ankle"].status == JointStatus.OK


def test_a_joint_between_a_segment_without_poses_and_one_with_poses_by_the_joint_below():
    """The reason says in one short line why neither segment shows the knee."""
    recording, _ = synthesize(Recipe(frames=40, seed=8))
    knee = find_joints(CMU41, recording)["left_knee"]
    assert knee.status == JointStatus.NO_FRAME
    assert knee.reason.endswith("; left_shank has one only by the joint left_ankle)")
    assert "left_thigh has 2 points (LTHI, LKNE); its pose needs 3" in knee.reason
    assert "\n" not in knee.reason


def test_a_ball_that_moved_about_one_axis_is_doubted():
    """Joints that are balls in the marker set are no hinges: they are centimetres off along the axis, and say so."""
    recording, _ = synthesize(Recipe(frames=40, seed=11))
    found = find_joints(CMU41, recording)
    assert found["neck"].estimate.axis is not None
    assert not [each.joint.name for each in found.joints if each.status in USABLE and each.joint.kind == "ball"]
    assert found["right_elbow"].status == JointStatus.HINGE
    scene = skeleton_scene(draw_skeleton(calibration_from(found, recording), recording), recording)
    words = "a ball joint that moved about one axis: its place along it is not known"
    lines = [*joint_lines(found), *skeleton_lines(scene)]
    assert any(line.startswith(f"neck: {words}") for line in lines)
    assert any(line.startswith(f"neck: not reliable: {words}") for line in lines)
    assert not any(line.startswith("right_elbow:") for line in lines)


def test_a_figure_that_does_not_move():
    """Where no marker moves, with noise or without, no joint is called found."""
    for noise in (0.0, 0.001):
        recording, _ = synthesize(Recipe(frames=300, noise=noise, reach=0.0))
        found = find_joints(CMU41, recording)
        assert not any(each.status in (JointStatus.OK, JointStatus.HINGE) for each in found.joints), noise


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_hardly_any_frames(small, frames):
    """In one, two or five frames no joint is found, and each has its reason; nothing fails or warns."""
    recording = small(CMU41.markers(), frames=frames)
    found = find_joints(CMU41, recording)
    assert not any(each.status in (JointStatus.OK, JointStatus.HINGE) for each in found.joints)
    assert all(each.reason for each in found.joints)


def test_nothing_but_missing_samples():
    """In a recording without samples every joint says so."""
    recording = Recording("empty", CMU41.markers(), np.full((41, 3, 20), np.nan), 100.0)
    found = find_joints(CMU41, recording)
    assert {each.status for each in found.joints} <= {JointStatus.NO_FRAME, JointStatus.UNSEEN}


def test_a_real_recording(kata_joints):
    """Every joint of a karate kata is found, with an error that says whether it is known to a centimetre.

    Skin leaves none of them to a centimetre without doubt. Femora and tibiae of the sides agree to 8 %.
    """
    found = kata_joints
    assert len(found.joints) == 14
    assert all(each.estimate is not None and each.reason for each in found.joints)
    sure = {each.joint.name for each in found.joints if each.status in (JointStatus.OK, JointStatus.HINGE)}
    assert all((each.estimate.standard_error < CENTIMETRE) == (each.joint.name in sure) for each in found.joints)
    assert all(0.002 < each.estimate.floor < 0.02 for each in found.joints)
    places = {each.joint.name: each.estimate.poses.to_world(each.estimate.center) for each in found.joints}
    for above, below in (("hip", "knee"), ("knee", "ankle")):
        lengths = []
        for side in ("left", "right"):
            bone = np.linalg.norm(places[f"{side}_{above}"] - places[f"{side}_{below}"], axis=0)
            assert np.nanstd(bone) < 0.02
            lengths.append(np.nanmedian(bone))
        assert abs(lengths[0] - lengths[1]) < 0.08 * np.mean(lengths)
        assert 0.35 < np.mean(lengths) < 0.55

"""Sides that contradict each other: the rule, its words, and the rates of false and missed alarms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from study.recordings.joints.estimate import (
    CENTIMETRE,
    USABLE,
    Estimate,
    JointStatus,
    PlaceDifference,
    check_against_sides,
    check_both_ways,
    side_differences,
)
from study.recordings.joints.find import JointPlace, find_joints, in_both_segments
from study.recordings.joints.report import METHODS, agreement_table, joint_lines, joint_table
from study.recordings.markersets import load_markerset
from study.recordings.recording import Recording
from study.recordings.rigid import rotation_range
from study.recordings.skeleton.calibrate import with_checks
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_lines, skeleton_scene
from study.recordings.synthetic.make import Recipe, synthesize

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


def test_noise_is_covered(part_of):
    """With 1 and 3 mm of noise errors are within three standard errors, and 95 % sets cover as often as they should.

    8 recordings of 14 joints, or two: 3 standard errors along any of three axes are exceeded by chance by 0.8 % of
    joints, so by .9 of 112; 5 and more in 2.5 of 1000. Sets of 95 %: binomial(112, .95) is below 98 in 1 of 1000.
    """
    far, covered, count, recordings = 0, 0, 0, part_of(8)
    for seed in range(0, 8, 8 // recordings):
        recording, truth = synthesize(Recipe(frames=1500, noise=0.001 if seed < 4 else 0.003, seed=200 + seed))
        found = find_joints(CMU41, recording)
        for _, pull, level in compared(found, truth).values():
            far, covered, count = far + (pull > 3.0), covered + (level < 0.95), count + 1
        assert all(axis_off(found, truth, name) < 2.0 for name in HINGES)
    assert count == recordings * 14
    assert far <= stats.binom.isf(2.5e-3, count, 0.008)
    assert covered >= stats.binom.ppf(1e-3, count, 0.95)


@pytest.mark.parametrize("noise", [0.001, 0.005])
def test_gaps_of_a_fifth(noise):
    """Joints that moved by more than 30° are right to 3 mm, with 1-5 mm of noise and a fifth of the samples missing.

    43 seconds of motion. (With 5 mm standard errors are 1-3 mm: over seeds 6 to 13, 98 of 99 joints keep to it.)
    """
    recording, truth = synthesize(Recipe(frames=5200, noise=noise, gaps=0.2, seed=5))
    found = find_joints(CMU41, recording)
    for name, (error, pull, _) in compared(found, truth).items():
        assert pull < 4.5, name
        ends = (names[truth.joints.index(name)] for names in (truth.parents, truth.children))
        parent, child = (truth.rotations[truth.segments.index(end)] for end in ends)
        if np.degrees(rotation_range(np.einsum("tji,tjk->ikt", parent, child))) > 30:
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
        mean = np.nanmean(parent.to_local(child.to_world(joint.in_child)), axis=1)
        assert np.linalg.norm(mean - joint.in_parent) < 0.001
    knee = found["left_knee"]
    turned = np.einsum("ijt,j->it", found.poses["left_thigh"].rotation, knee.axis_in_parent)
    other = np.einsum("ijt,j->it", found.poses["left_shank"].rotation, knee.axis_in_child)
    assert np.median((turned * other).sum(axis=0)) > np.cos(np.radians(3))
    assert np.isnan(found["left_hip"].axis_in_parent).all()
    # a hand with one marker has no pose of its own: its axes are the forearm's, and the table has no place in it
    np.testing.assert_array_equal(found["left_wrist"].in_child, found["left_wrist"].in_parent)
    assert np.isnan(joint_table(found).set_index("joint").loc["left_wrist", "center_child_x"])


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
    scene = skeleton_scene(draw_skeleton(with_checks(found, recording), recording), recording)
    words = "a ball joint that moved about one axis: its place along it is not known"
    lines = [*joint_lines(found), *skeleton_lines(scene, found)]
    doubted = [line.partition(": ")[0].split(", ") for line in lines if f": {words}" in line]
    assert any("neck" in names and "right_elbow" not in names for names in doubted)
    # in the print of phase 2, with the joints of the same reason, or not shown
    told = [line for line in skeleton_lines(scene, found) if f": {words}" in line]
    assert any("neck" in line.partition(": ")[0] or line.startswith("note: neck is not shown") for line in told)
    assert not any(line.startswith("right_elbow:") for line in lines)


def test_a_figure_that_does_not_move_or_hardly_appears(small):
    """Where no marker moves, or in one, two or five frames, no joint is called found; nothing fails or warns."""
    still = [synthesize(Recipe(frames=300, noise=noise, reach=0.0))[0] for noise in (0.0, 0.001)]
    for recording in (*still, *(small(CMU41.markers(), frames=frames) for frames in (1, 2, 5))):
        found = find_joints(CMU41, recording)
        assert not any(each.status in (JointStatus.OK, JointStatus.HINGE) for each in found.joints)
        assert all(each.reason for each in found.joints)


def test_nothing_but_missing_samples():
    """In a recording without samples every joint says so, every distance of the table is NaN, and nothing warns."""
    recording = Recording("empty", CMU41.markers(), np.full((41, 3, 20), np.nan), 100.0)
    found = find_joints(CMU41, recording)
    assert {each.status for each in found.joints} <= {JointStatus.NO_FRAME, JointStatus.UNSEEN}
    table = agreement_table(found, recording)
    assert len(table) == 14
    assert table[[f"from_{name}" for name in METHODS]].isna().all(axis=None)


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


def test_without_noise_all_methods_agree():
    """With 0.1 mm of noise methods agree to 2 mm, images of a joint coincide, and ranges of motion are the body's."""
    recording, _ = synthesize(Recipe(frames=600, noise=1e-4))
    table = agreement_table(find_joints(CMU41, recording), recording).set_index("joint")
    balls = table.drop([name for name in table.index if "elbow" in name or "knee" in name])
    for name in ("mgdk", "gdke", "ugdk", "mle"):
        assert balls[f"from_{name}"].max() < 2e-3, name
    assert table["from_two_sided"].max() < 1e-3
    assert table["gap"].max() < 2e-3
    assert 20 < table.loc["left_knee", "turn"] < 60
    assert 30 < table.loc["left_hip", "cap"] < 90
    assert np.isnan(table.loc["left_wrist", "turn"])  # a hand of one marker has no frame
    assert table.loc["left_wrist", "radii"][0] > 0.05
    exact, _ = synthesize(Recipe(frames=200, noise=0.0))  # all that is left is rounding: numbers or NaN
    assert len(agreement_table(find_joints(CMU41, exact), exact)) == 14


X, Y = np.eye(3)[:2]

MILLIMETRE = 1e-6 * np.eye(3)


@pytest.fixture(scope="module")
def estimate(figure):
    """An estimate in the chest's axes: at the origin, known to a millimetre, without an axis."""
    found = figure[2]["neck"].estimate
    return replace(found, side="both", center=np.zeros(3), covariance=MILLIMETRE, axis=None, status=JointStatus.OK)


def other(estimate, center, frames=None, **changes):
    """Another estimate in the same axes, from so many frames."""
    if frames is not None:
        kind = "pair" if estimate.sphere is None else "sphere"
        changes[kind] = replace(getattr(estimate, kind), frames=frames)
    return replace(estimate, side="parent", center=np.array(center, dtype=float), **changes)


@pytest.mark.parametrize(
    ("center", "changes", "status"),
    [
        ((0.012, 0, 0), {}, "DISAGREE"),
        ((0.009, 0, 0), {}, "OK"),  # within the centimetre, however small the errors
        ((0.012, 0, 0), {"covariance": 1e-4 * np.eye(3)}, "OK"),  # 1.2 of the other's standard errors
        ((0.03, 0, 0), {"covariance": 1e-4 * np.eye(3), "status": JointStatus.UNSURE}, "DISAGREE"),  # 3 of them
        ((0.1, 0, 0), {"status": JointStatus.NOT_POSITIVE_DEFINITE}, "OK"),
        ((0.1, 0, 0), {"status": JointStatus.INSIGNIFICANT}, "OK"),
        ((0.1, 0, 0), {"frames": 9}, "OK"),  # seen too briefly to have an error
        ((0.03, 0, 0), {"axis": X}, "OK"),  # along the other's axis
        ((0.03, 0.02, 0), {"axis": X}, "DISAGREE"),  # 20 mm across; 30 mm along an axis tilted by 10° are 5 mm
        ((0.06, 0.02, 0), {"axis": X}, "OK"),  # too far along to be compared
    ],
)
def test_what_contradicts(estimate, center, changes, status):
    """A difference must exceed a centimetre and the errors, across a hinge's axis; only valid errors count."""
    assert check_against_sides(estimate, [other(estimate, center, **changes)])[0].status.name == status


@pytest.mark.parametrize(("angle", "status"), [(15, "HINGE"), (25, "DISAGREE"), (155, "DISAGREE"), (170, "HINGE")])
def test_axes_that_differ(estimate, angle, status):
    """Axes contradict each other beyond 20°, whatever their signs."""
    chosen = replace(estimate, axis=X, status=JointStatus.HINGE)
    axis = np.cos(np.radians(angle)) * X + np.sin(np.radians(angle)) * Y
    judged, words = check_against_sides(chosen, [other(chosen, (0, 0.002, 0), axis=axis)])
    assert judged.status.name == status
    assert words == "" or f"turns its axis by {min(angle, 180 - angle)}° and puts it 2 mm away" in words


def test_errors_cover_both_estimates(estimate):
    """The place stays; its error along the line to the other estimate is the distance, and across it unchanged."""
    judged, words = check_against_sides(estimate, [other(estimate, (0.03, 0, 0)), other(estimate, (0, 0.05, 0))])
    assert np.array_equal(judged.center, estimate.center)
    np.testing.assert_allclose(judged.covariance, np.diag([1e-6, 1e-6 + 0.05**2, 1e-6]))
    assert judged.standard_error == pytest.approx(0.05, rel=1e-3)
    assert words == "its estimate in its parent's axes puts it 50 mm away, beyond what the errors explain"
    unsure = replace(estimate, status=JointStatus.UNSURE)  # an estimate with another flag is returned unchanged
    assert check_against_sides(unsure, [other(unsure, (0.5, 0, 0))]) == (unsure, "")


def way(vector, error, axis=None):
    """The difference of two centres with equal, isotropic errors."""
    covariance = error**2 * np.eye(3)
    return PlaceDifference.of(np.array(vector, dtype=float), 2 * covariance, axis, "ways")


@pytest.mark.parametrize(
    ("vector", "error", "status"),
    [
        ((0.012, 0, 0), 0.001, "REVERSES"),
        ((0.009, 0, 0), 0.001, "OK"),  # within the centimetre
        ((0.012, 0, 0), 0.003, "OK"),  # z² = 8.0, and the 98.75 % quantile of χ² with 3 degrees is 10.8
        ((0.014, 0, 0), 0.003, "REVERSES"),  # z² = 10.9: beyond it
    ],
)
def test_bending_against_straightening(estimate, vector, error, status):
    """The two ways contradict each other beyond a centimetre and chance; the error then covers their difference."""
    judged, words = check_both_ways(estimate, [way(vector, error), way((0.001, 0, 0), 0.01)])
    assert judged.status.name == status
    grown = np.outer(vector, vector) if status == "REVERSES" else np.zeros((3, 3))
    np.testing.assert_allclose(judged.covariance, estimate.covariance + grown)
    np.testing.assert_allclose(judged.skin, estimate.skin + grown)
    assert ("bending and straightening put it" in words) == (status == "REVERSES")


def test_ways_about_two_axes(estimate):
    """Contradictions about two axes add up, and the larger is named; an unsure estimate stays unsure, but wider."""
    unsure = replace(estimate, status=JointStatus.UNSURE)
    judged, words = check_both_ways(unsure, [way((0.03, 0, 0), 0.001), way((0, 0.05, 0), 0.001)])
    assert judged.status == JointStatus.UNSURE
    np.testing.assert_allclose(judged.covariance, np.diag([1e-6 + 0.03**2, 1e-6 + 0.05**2, 1e-6]))
    assert "put it 50 mm apart" in words
    across = way((0.03, 0.004, 0), 0.001, X)
    assert across.distance == pytest.approx(0.004)
    assert across.directions == 2


def test_false_alarms(part_of):
    """With noise of 1-5 mm, and a fifth of the samples missing or none, at most three of 60 joints are flagged.

    Of 697 such joints of 120 other recordings 7 were flagged, 1 %: binomial(60, .01) is above 3 in 3.5 of 1000. A part
    of the joints is of one noise.
    """
    flagged, noises = [], part_of(5)
    for millimetres in [3, 1, 2, 4, 5][:noises]:
        for gaps in (0.0, 0.2):
            recipe = Recipe(2500, noise=0.001 * millimetres, gaps=gaps, seed=899 + millimetres)
            found = find_joints(CMU41, synthesize(recipe)[0])
            usable = (joint for joint in found.joints if joint.status in (*USABLE, JointStatus.DISAGREE))
            comparable = (joint for joint in usable if side_differences(joint.estimate, joint.estimates[1:]))
            flagged += [joint.status == JointStatus.DISAGREE for joint in comparable]
    assert 8 * noises < len(flagged) <= 12 * noises
    assert sum(flagged) <= stats.binom.isf(3.5e-3, len(flagged), 0.01)


def test_soft_tissue_artefact(part_of):
    """With skin sliding by 2-3 cm, most joints that are more than 2 cm off are in doubt, and fewer of the good ones.

    Of 197 such joints of 44 other recordings 13 were not, 7 %: of the 49 here a fifth or more are in 2 of 1000 sets
    of seeds, if joints are independent. Of 196 joints within 1 cm there, 31 % were not in doubt; a part has too few.
    """
    rows, recordings = [], part_of(10)
    for seed in range(800, 800 + recordings):
        recording, truth = synthesize(Recipe(2500, noise=0.001, soft_tissue=0.03, seed=seed))
        for found in (joint for joint in find_joints(CMU41, recording).joints if joint.estimate is not None):
            true = truth.centers[truth.joints.index(found.joint.name)]
            off = found.estimate.center - found.estimate.poses.mean_place(true)
            axis = np.zeros(3) if found.estimate.axis is None else found.estimate.axis
            rows.append((found.status in USABLE, np.linalg.norm(off - (off @ axis) * axis)))
    undoubted, error = (np.array(column) for column in zip(*rows, strict=True))
    far = error > 0.02
    assert far.sum() >= 4 * recordings
    assert undoubted[far].sum() <= stats.binom.isf(2e-3, far.sum(), 0.07)
    assert recordings < 10 or undoubted[error < 0.01].mean() > 2.0 * undoubted[far].mean()


def test_axis_of_contradictory_sides(kata_joints):
    """A hinge whose sides contradict each other has its own estimate's axis, so that its whole error is reported."""
    elbow = kata_joints["right_elbow"]
    forearm = next(each for each in elbow.estimates if each.side == "child")
    kinds = (JointStatus.DISAGREE, JointStatus.HINGE)
    places = (JointPlace(elbow.joint, kind, "", estimates=(forearm,)) for kind in kinds)
    doubted, agreed = (in_both_segments(place, kata_joints.poses) for place in places)
    np.testing.assert_array_equal(doubted.axis_in_child, forearm.axis)
    assert np.abs(agreed.axis_in_child @ forearm.axis) < 0.98  # the rotations of both segments show another axis
    assert np.linalg.norm(doubted.axis_in_parent) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("axis", "place", "wanted"),
    [
        ([0.0, 0.0, 1.0], [1.0, 2.0, 3.0], [0.5, 0.5, 3.0]),
        ([0.0, 0.6, 0.8], [0.5, 1.5, 0.5], [0.5, 0.86, 0.98]),
        (None, [1.0, 2.0, 3.0], None),
        ([0.0, 0.0, 1.0], [np.nan] * 3, None),
        (None, [np.nan] * 3, None),
    ],
)
def test_a_place_along_the_axis(axis, place, wanted):
    """It is c + ((p - c)·a) a; where the axis or the point is not known the estimate is the same."""
    poses, center = SimpleNamespace(mean_place=lambda _: np.array(place)), np.full(3, 0.5)
    axis = None if axis is None else np.array(axis)
    estimate = Estimate("parent", poses, (), center, np.eye(3), axis, "none", np.ones((1, 1), dtype=bool))
    moved = estimate.placed_along_axis(np.zeros((3, 1)))
    if wanted is None:
        assert moved is estimate
    else:
        np.testing.assert_allclose(moved.center, wanted, atol=1e-15)


def test_the_range_of_a_hinge_is_that_of_its_segments(exact):
    """The range of knees and elbows is the true relative rotation, also where markers about the joint show less."""
    _, truth, joints = exact
    table = joint_table(joints).set_index("joint")
    for name in ("left_knee", "right_knee", "left_elbow", "right_elbow"):
        number = truth.joints.index(name)
        parent, child = (truth.segments.index(names[number]) for names in (truth.parents, truth.children))
        turn = np.einsum("tji,tjk->tik", truth.rotations[parent], truth.rotations[child])
        angles = Rotation.from_matrix(turn).as_rotvec() @ truth.axes[number]
        wanted = np.degrees(np.sqrt(2.0 - 2.0 * np.abs(np.exp(1j * angles).mean())))
        assert table.loc[name, "moved_most"] == pytest.approx(wanted, abs=0.2)
    marker = np.degrees(joints["left_knee"].estimate.fit.rms_angles).max()
    assert marker < table.loc["left_knee", "moved_most"] - 0.5

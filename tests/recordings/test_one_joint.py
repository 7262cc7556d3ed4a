"""`study joint` against bodies with known joints, the real functional trial, and wrong labels."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.formats.read import read_recording
from study.recordings.joints.estimate import JointStatus
from study.recordings.joints.find import find_joints
from study.recordings.one_joint import find_clusters, fit_one_joint, is_centre, joint_json, joint_line, other_centres
from study.recordings.recording import Recording, RecordingError
from study.recordings.synthetic.make import Recipe, synthesize
from tests.recordings.hips import CENTRE, PELVIS, hip_motion, in_axes_of

LABELS = ("LASI", "RASI", "LPSI", "RPSI", "RTH1", "RTH2", "RTH3")
FRAMES = 400
PARENT, CHILD = "LASI,RASI,LPSI,RPSI", "RTH1,RTH2,RTH3"


def body(left=(), **motion):
    """A recording of a pelvis and a thigh, and the positions of their joint.

    ``left``: labels and offsets (metres) of points that another program left near the joint.
    """
    x, pelvis, joint = hip_motion(FRAMES, seed=5, **motion)
    x = np.stack([*x, *((joint + pelvis.apply(offset)).T for _, offset in left)])
    return Recording("walk", (*LABELS, *(label for label, _ in left)), x, 100.0), joint


def in_axes(found, place):
    """A place given in the body's own coordinates, in the parent's axes of the fit, by the parent's markers."""
    return in_axes_of(found.places - found.places.mean(axis=0), PELVIS, place)


def fitted(recording, across="", hinge=False, child=CHILD):
    """The joint of the pelvis and a thigh's markers."""
    return fit_one_joint(recording, find_clusters(recording, PARENT, child, across, hinge=hinge))


@pytest.fixture(scope="module")
def hip():
    """A ball joint with centres of other programs: one 12 mm away, one of the other side."""
    recording, joint = body(left=(("R_HipCentre", (0.0, 0.012, 0.0)), ("lhjc", (0.18, 0.0, 0.0))))
    return recording, joint, fitted(recording)


def test_a_ball_is_found_with_its_error(hip):
    """The centre is the truth within its covariance (false alarms: 1 in 10 000), in both axes."""
    recording, joint, found = hip
    assert found.found.status == JointStatus.OK
    apart = found.found.in_parent - in_axes(found, CENTRE)
    assert apart @ np.linalg.solve(found.found.covariance, apart) < 21.1  # χ² of three
    assert found.error < 0.002
    np.testing.assert_allclose(found.in_recording, joint.mean(axis=0), atol=0.002)
    assert found.frame == 1
    start = recording.positions[:4, :, 0]
    np.testing.assert_allclose(found.places, start - start.mean(axis=0), atol=0.005)
    assert (found.frames, found.found.joint.kind) == (FRAMES, "ball")


def test_range_of_motion(hip):
    """95 % of the rotations are within the quantile of the drawn angles."""
    angles = np.linalg.norm(np.random.default_rng(1).uniform(-0.5, 0.5, (100_000, 3)), axis=1)
    assert hip[2].turn == pytest.approx(np.degrees(np.quantile(angles, 0.95)), abs=2.0)


def test_other_programs_centres(hip):
    """Points called hip centres are compared, the nearest first; markers are not."""
    _, _, found = hip
    (near, distance, _), (other, far, _) = found.compared
    assert (near, other) == ("R_HipCentre", "lhjc")
    assert (distance, far) == pytest.approx((0.012, 0.18), abs=0.003)
    line = joint_line(found)
    (doubt,) = found.doubts  # 12 mm are beyond three errors of less than 2 mm
    assert not found.ok  # every doubt counts
    assert doubt.startswith("R_HipCentre of another program is 12 mm away")
    assert "R_HipCentre of another program is 12" in line or "R_HipCentre of another program is 11" in line
    assert "lhjc" not in line
    values = json.loads(joint_json(found))
    assert values["doubts"] == [doubt]
    assert values["compared"] == [
        {"label": "R_HipCentre", "distance": distance, "frames": FRAMES},
        {"label": "lhjc", "distance": far, "frames": FRAMES},
    ]


CENTRES = ("LHJC", "rkjc", "L_HipCentre", "RightHipCenter", "hip_joint_center_r")


@pytest.mark.parametrize("label", [*CENTRES, "LASI", "HJC_offset_cluster", "RTH1", "centre_of_mass"])
def test_labels_of_centres(label):
    assert is_centre(label) == (label in CENTRES)


def test_distance_is_the_median_over_frames_with_both():
    """Frames without the point or the joint do not count; a point never seen with the joint is left out."""
    x = np.zeros((2, 3, 5))
    x[0, 0] = [1, 2, np.nan, 4, 50]
    x[0, 1:, 2] = np.nan
    x[1] = np.nan
    joint = np.zeros((3, 5))
    joint[:, 4] = np.nan
    (only,) = other_centres(Recording("walk", ("LHJC", "RHJC"), x, 100.0), joint)
    assert only == ("LHJC", 2.0, 3)


def test_a_parent_that_is_posed_with_the_joint():
    """Markers of a parent that lie nearly on a line have their places, and the joint that completes them has none."""
    recording, _ = synthesize(Recipe(600))
    arm = find_clusters(recording, "LSHO,LUPA,LELB", "LWRA,LWRB,LFRM", hinge=True)
    found = fit_one_joint(recording, arm)
    assert found.places.shape == (3, 3)
    length = np.linalg.norm(found.places[1] - found.places[2])
    apart = np.linalg.norm(recording.of("LUPA") - recording.of("LELB"), axis=0)
    assert length == pytest.approx(np.median(apart), abs=0.002)
    assert list(json.loads(joint_json(found))["parent_markers"]) == ["LSHO", "LUPA", "LELB"]


def test_a_ball_that_moved_as_a_hinge_is_not_ok():
    """Its place along the axis shows in nothing; as a hinge it is ok, with the true axis, and no other place counts."""
    axis = np.array([0.0, 0.6, 0.8])
    recording, _ = body(axis=axis)
    ball = fitted(recording)
    assert not ball.ok
    assert ball.doubts
    hinge = fitted(recording, hinge=True)
    assert hinge.ok, hinge.doubts
    found, true = hinge.found.axis_in_parent, in_axes(hinge, axis + PELVIS.mean(axis=0))
    assert abs(found @ true) > np.cos(np.radians(2.0))
    across = np.eye(3) - np.outer(true, true)
    assert np.linalg.norm(across @ (hinge.found.in_parent - in_axes(hinge, CENTRE))) < 0.004
    assert "the place along it is not known" in joint_line(hinge)


def test_a_hinge_is_midway_between_two_points():
    """Two points across the axis give the place along it; across the axis nothing changes."""
    axis = np.array([0.0, 0.6, 0.8])
    ends = [("LFC", 0.05 * axis + [0.02, 0, 0]), ("MFC", -0.03 * axis - [0.02, 0, 0])]
    recording, _ = body(axis=axis, left=ends)
    plain, placed = (fitted(recording, across, hinge=True) for across in ("", "LFC,MFC"))
    step, found = placed.found.in_parent - plain.found.in_parent, placed.found.axis_in_parent
    np.testing.assert_allclose(step, (step @ found) * found, atol=1e-9)
    true = in_axes(placed, CENTRE + 0.01 * axis)
    assert abs((placed.found.in_parent - true) @ in_axes(placed, axis + PELVIS.mean(axis=0))) < 0.002
    assert "the place along it is midway between LFC and MFC" in joint_line(placed)
    with pytest.raises(RecordingError, match="--across names 1 points; it takes two"):
        find_clusters(recording, PARENT, CHILD, "LFC")


def test_a_place_along_an_axis_is_no_reason_to_doubt():
    """Nothing shows where a hinge without points across it lies along its axis, and so whether that is in the body.

    An axis that is 40 cm beside the body is a reason, wherever the joint is along it.
    """
    inside, beside = (
        fitted(body(axis=np.array(axis), beside=away)[0], hinge=True)
        for axis, away in (([0.0, 0.74, 0.67], 0.0), ([0.0, 0.0, 1.0], 0.4))
    )
    assert inside.ok, inside.doubts
    (doubt,) = beside.doubts
    assert doubt.startswith("seen along its axis, outside the markers' hull in 100% of the frames, by up to ")


def test_points_that_are_not_at_the_joint():
    """A hip is no hinge: two points do not place it by being named, be they on other segments or far along an axis."""
    child, (first, _) = "RTH1,RTH2", body()
    free = fitted(first, hinge=True, child=child)
    turn, _ = Rotation.align_vectors(free.places, PELVIS - PELVIS.mean(axis=0))
    axis = turn.inv().apply(free.found.estimate.axis)  # along which the place is not asked for
    ends = [("A", 0.04 * axis), ("B", -0.04 * axis), ("C", 0.25 * axis), ("D", 0.35 * axis)]
    recording, _ = body(left=ends)
    moving = np.concatenate([recording.positions, 0.1 * np.random.default_rng(1).standard_normal((1, 3, FRAMES))])
    recording = Recording("walk", (*recording.markers, "FOOT"), moving, 100.0)
    placed, far, strange = (fitted(recording, across, True, child) for across in ("A,B", "C,D", "A,FOOT"))
    assert (placed.ok, placed.misplaced) == (True, ())
    assert (far.ok, len(far.misplaced)) == (False, 1)
    assert "it is no hinge: it rotated about every direction, and its centre is 30" in joint_line(far)
    assert not strange.ok
    assert "doubts: FOOT is on neither segment: it moves by " in joint_line(strange)
    assert json.loads(joint_json(far))["ok"] is False


def test_a_knee_is_where_another_program_has_it_along_its_axis(shared_file):
    """The toolbox puts the knee midway between the epicondyles; without these it is centimetres away along its axis."""
    recording = read_recording(shared_file("gait_same_session.c3d"))
    along = []
    for across in ("", "LLFC,LMFC"):
        clusters = find_clusters(recording, "LTH1,LTH2,LTH3", "LTB1,LTB2,LTB3", across, hinge=True)
        joints = find_joints(clusters, recording)
        local = joints.poses["parent"].to_local(recording.of("LKJC"))
        found = joints["joint"]
        assert fit_one_joint(recording, clusters).misplaced == ()
        along.append(abs(np.nanmean((local - found.in_parent[:, None]).T @ found.axis_in_parent)))
    assert along[0] > 0.05
    assert along[1] < 0.001


def test_a_joint_that_did_not_move():
    """It has a status and a doubt, null for its place in JSON, and is not ok."""
    recording, _ = body(noise=1e-5, sweep=0.0)
    still = fitted(recording)
    values = json.loads(joint_json(still))
    assert (still.ok, values["ok"], values["status"]) == (False, False, "still")
    assert values["center"] == [None] * 3
    assert "did not move" in joint_line(still)


def test_no_doubts():
    """A centre of another program that agrees is no reason to doubt, nor is one of the other side."""
    other = ("LHJC", (0.18, 0.0, 0.0))
    for left in ((("RHJC", (0.0, 0.0, 0.004)), other), (other,)):
        found = fitted(body(left=left)[0])
        assert (found.ok, found.doubts) == (True, ())
        assert joint_line(found).endswith("; no doubts")


def test_a_walk_is_compared_with_the_functional_centres(shared_file):
    """Skin moves with the hip in gait: the walk's left hip is centimetres from the functional one, and doubted."""
    found = fitted(read_recording(shared_file("gait_same_session.c3d")), child="LTH1,LTH2,LTH3")
    label, distance, _ = found.compared[0]
    assert label == "LHJC"
    assert distance > 0.03
    assert found.doubts


def test_labels_with_a_prefix_and_other_letters():
    recording, _ = body()
    found = find_clusters(recording, "Bob:LASI, rasi ,lpsi,,Rpsi", "rth1,RTH2,x:rth3")
    assert found.markers() == LABELS
    twins = replace(recording, markers=(*recording.markers[:-1], "lasi"))
    for name, label in (("Lasi", "LASI"), ("lasi", "lasi"), ("LASI", "LASI")):  # as it is, else the first in the file
        assert find_clusters(twins, f"{name},RASI,LPSI", "RTH1").markers()[0] == label


@pytest.mark.parametrize(
    ("parent", "child", "words"),
    [
        ("LASIS,RASI,LPSI", CHILD, "no marker of this name: --parent 'LASIS'; did you mean 'LASI'"),
        (PARENT, "RTHI1,RTH2", "--child 'RTHI1'; did you mean 'RTH1'"),
        ("LASIS,RASI,LPSI", "THR3", "--parent 'LASIS'; --child 'THR3'; did you mean 'LASI' and 'RTH3'"),
        (PARENT, "RTH1,LASI", "LASI is named twice"),
        ("LASI,RASI", CHILD, "--parent names 2 markers; its axes need 3; --child has enough: exchange the two"),
        ("LASI,RASI", "RTH1", "--parent names 2 markers; its axes need 3$"),
        (PARENT, ",", "--child names no marker"),
        (PARENT, "GONE", "GONE has no sample in any frame"),
    ],
)
def test_wrong_labels_are_answered_with_the_nearest(one_line, parent, child, words):
    """One line with the recording's name."""
    recording, _ = body()
    x = np.concatenate([recording.positions, np.full((1, 3, FRAMES), np.nan)])
    recording = Recording("walk", (*LABELS, "GONE"), x, 100.0)
    with one_line(RecordingError, words, start="walk: "):
        find_clusters(recording, parent, child)


@pytest.mark.parametrize("side", ["L", "R"])
def test_functional_trial(shared_file, side):
    """Hips moved on purpose are ok, to 9 mm."""
    child = ",".join(f"{side}TH{i}" for i in (1, 2, 3))
    found = fitted(read_recording(shared_file("functional_hips.c3d")), child=child)
    assert found.ok, found.doubts
    assert found.error < 0.009  # its markers' radii change with the angle by 4 mm/rad, which three of them show
    assert found.compared == ()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_knee_that_is_not_called_a_hinge(seed):
    """Its markers slide by 2 cm, so that they show a centre; the clusters of a knee are doubted without --hinge."""
    recording, _ = synthesize(Recipe(800, 50.0, seed=seed, soft_tissue=0.02, skin="slide", markers="rizzoli"))
    clusters = find_clusters(recording, "LFTC,LFLE,LFME", "LFAX,LTTC,LFAL,LTAM")
    joint = fit_one_joint(recording, clusters)
    assert not joint.ok
    assert any(doubt.startswith("it moved by") and "one axis, as a knee, is a hinge" in doubt for doubt in joint.doubts)

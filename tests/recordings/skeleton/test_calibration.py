"""Distances of joints from the markers' hull: of a cube, of a body's true joints, and where there is no hull."""

import json
from dataclasses import replace

import numpy as np
import pytest

from study.recordings.formats.read import read_recording
from study.recordings.joints.estimate import JointStatus
from study.recordings.joints.find import load_calibration, save_calibration
from study.recordings.joints.report import joint_table
from study.recordings.markersets import choose, load_markerset
from study.recordings.recording import RecordingError
from study.recordings.skeleton.calibrate import (
    calibrate,
    hip_doubts,
    hull_distances,
    hull_doubt,
    other_subject,
    require_same_subject,
    with_checks,
    with_doubts,
)
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_lines, skeleton_scene
from study.recordings.synthetic.make import Recipe, synthesize


def test_saved_and_read_it_is_the_same(figure, figure_calibration, tmp_path):
    """A calibration that is read back draws the same skeleton to the last bit."""
    recording, made = figure[0], figure_calibration
    read = load_calibration(save_calibration(made, tmp_path / "of" / "calibration.json"))
    assert read.markerset == made.markerset
    assert (read.source, read.frames) == (made.source, made.frames)
    for one, other in zip(made.joints, read.joints, strict=True):
        assert (one.joint, one.status, one.reason) == (other.joint, other.status, other.reason)
    np.testing.assert_array_equal(draw_skeleton(read, recording).centers, draw_skeleton(made, recording).centers)
    np.testing.assert_array_equal([s.misfit for s in read.shapes], [s.misfit for s in made.shapes])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("not json", "not a calibration: not JSON"),
        ("[]", "not a calibration"),
        ('{"format": "else"}', "not a calibration"),
        ('{"format": "sphere-fit-study calibration", "version": 9}', "version 9"),
        ('{"format": "sphere-fit-study calibration", "version": 1}', "a damaged calibration"),
    ],
)
def test_other_files_are_refused(text, words, one_line, tmp_path):
    """A file that is no calibration is refused in one line."""
    path = tmp_path / "c.json"
    path.write_text(text)
    with one_line(RecordingError, words):
        load_calibration(path)


@pytest.mark.parametrize(
    ("section", "key", "change", "words"),
    [
        ("joints", "covariance", lambda _: [[1.0]], "damaged"),
        ("joints", "status", lambda _: "FINE", "damaged"),
        ("joints", "joint", lambda _: "tail", "damaged"),
        ("joints", "in_child", lambda _: [1.0, 2.0], "damaged"),
        ("joints", "in_parent", lambda _: [], "damaged"),
        # as many numbers in another shape are no places: read, they would be scrambled
        ("segments", "places", lambda rows: np.transpose(rows).tolist(), r"shape \(3, \d\) where \(m, 3\) is needed"),
        ("segments", "places", lambda rows: np.ravel(rows).tolist(), r"shape \(\d+,\) where \(m, 3\) is needed"),
        ("segments", "scatter", lambda row: [row], r"shape \(1, \d\) where \(m,\) is needed"),
    ],
)
def test_damage_is_noticed(figure_calibration, tmp_path, section, key, change, words):
    """A matrix of the wrong size or shape, and an unknown joint or status, are refused."""
    path = save_calibration(figure_calibration, tmp_path / "c.json")
    document = json.loads(path.read_text())
    part = next(one for one in document[section] if section == "joints" or len(one["markers"]) > 3)
    part[key] = change(part[key])
    path.write_text(json.dumps(document))
    with pytest.raises(RecordingError, match=words):
        load_calibration(path)


def moved(calibration, name, in_parent):
    """The calibration with a joint at another place in its parent's axes."""
    joints = (replace(p, in_parent=np.array(in_parent)) if p.joint.name == name else p for p in calibration.joints)
    return replace(calibration, joints=tuple(joints))


def judged(calibration, recording):
    """The calibration with doubts and warnings, from the distances in the recording."""
    centers = draw_skeleton(calibration, recording).centers
    gaps = np.full(len(calibration.joints), np.nan)
    return with_doubts(calibration, hull_distances(recording.positions, centers)[0], gaps)


def warned(calibration, recording):
    """Warnings and doubts by joint."""
    words = {p.joint.name: (*p.warnings, p.reason) for p in judged(calibration, recording).joints}
    return {name: told for name, told in words.items() if told not in (("ok",), (JointStatus.HINGE.text,))}


def widened(calibration, factor):
    """The calibration with its hips so many times as far apart; where they were, and their middle."""
    hips = [calibration[f"{side}_hip"].in_parent for side in ("left", "right")]
    middle = (hips[0] + hips[1]) / 2
    for side, at in zip(("left", "right"), hips, strict=True):
        calibration = moved(calibration, f"{side}_hip", middle + factor * (at - middle))
    return calibration, hips, middle


def test_a_body_raises_no_warning(figure_calibration, figure):
    """The synthetic body's hips are .71 of its front waist markers apart, and its sides are equal."""
    assert warned(figure_calibration, figure[0]) == {}


@pytest.mark.parametrize(("factor", "warns"), [(0.85, True), (0.95, False), (1.65, False), (1.8, True)])
def test_hips(figure_calibration, figure, factor, warns):
    """Hip to hip over the spines' markers is plausible from .65 to 1.2; the body's is .05/.07 = .714."""
    wide = judged(widened(figure_calibration, factor)[0], figure[0])
    for place in (wide["left_hip"], wide["right_hip"]):
        assert ("hip to hip is" in place.reason) == warns
        assert (place.status == JointStatus.IMPLAUSIBLE) == warns
        assert not warns or "of LFWT to RFWT: 0.65 to 1.2 is plausible" in place.reason


def test_the_width_is_known_by_geometry(figure_calibration, figure):
    """Labels do not matter, nor markers on the crests above; a plate of three markers on the sacrum shows no width."""
    wide, hips, middle = widened(figure_calibration, 1.8)
    shape = wide.shape("pelvis")
    up = np.cross(hips[0] - hips[1], shape.places[0] - shape.places[2])
    crests = shape.places[:2] + 0.06 * up / np.linalg.norm(up) * np.sign(up @ (shape.places[0] - middle))

    def with_pelvis(markers, places):
        pelvis = replace(shape, markers=markers, places=places, scatter=np.zeros(len(markers)))
        return replace(wide, shapes=tuple(pelvis if s is shape else s for s in wide.shapes))

    named = with_pelvis(tuple("abcdef"), np.concatenate([shape.places, 1.3 * (crests - middle) + middle]))
    assert "of a to b" in hip_doubts(named)["left_hip"][0]
    plate = with_pelvis(("a", "b", "c"), shape.places[2] + np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0.05]]))
    assert not hip_doubts(plate)


def test_bones_of_unequal_length(figure_calibration, figure):
    """A thigh that is a fifth longer than the other is named on both of its joints, on either side."""
    knee = figure_calibration["left_knee"].in_parent
    hip = figure_calibration["left_hip"].in_child
    found = warned(moved(figure_calibration, "left_knee", hip + 1.2 * (knee - hip)), figure[0])
    assert {"left_hip", "left_knee", "right_hip", "right_knee"} <= set(found)
    assert "the bone left_hip - left_knee is 51" in found["left_knee"][0]
    assert "left_elbow" not in found


def test_a_joint_outside_the_hull(figure_calibration, figure):
    """A hip three metres in front of the body, outside in nearly all frames, is doubted; a neck gets a warning."""
    hip = judged(moved(figure_calibration, "left_hip", [3.0, 0.0, 0.0]), figure[0])["left_hip"]
    assert hip.status == JointStatus.IMPLAUSIBLE
    assert "outside the markers' hull in" in hip.reason
    outside, gaps = np.full((2, len(figure_calibration.joints)), np.nan)
    outside[[place.joint.name for place in figure_calibration.joints].index("neck")] = 0.95
    neck = with_doubts(figure_calibration, outside, gaps)["neck"]
    assert neck.status == figure_calibration["neck"].status
    assert neck.warnings == ("outside the markers' hull in 95% of the frames",)


def test_a_joint_that_its_segments_put_apart(figure_calibration, figure):
    """A neck three metres in front of the trunk is three metres from where the head has it: not drawn, and told."""
    recording, apart = figure[0], moved(figure_calibration, "neck", [3.0, 0.0, 0.0])
    skeleton = draw_skeleton(apart, recording)
    assert np.isnan(skeleton.center("neck")).all()
    (words,) = with_checks(apart, recording)["neck"].warnings
    away = np.linalg.norm(np.array([3.0, 0.0, 0.0]) - figure_calibration["neck"].in_parent)
    assert words == f"its two segments put it {1000 * away:.0f} mm apart"
    note = next(note for note in skeleton_scene(skeleton, recording).notes if note.startswith("neck is not shown"))
    assert words in note


def test_both_phases_say_the_same(figure, tmp_path):
    """Error, floor and warnings are the same in the table of phase 1 and in a calibration that is read again."""
    recording, _, found = figure
    calibration = load_calibration(save_calibration(with_checks(found, recording), tmp_path / "calibration.json"))
    table = joint_table(found).set_index("joint")
    for place in calibration.joints:
        assert place.standard_error == table.loc[place.joint.name, "error"]
        assert place.floor == table.loc[place.joint.name, "floor"]
        assert 0.001 < place.floor < 0.05
        assert place.warnings == ()
    scene = skeleton_scene(draw_skeleton(calibration, recording), recording)
    neck = table.loc["neck"]
    row = next(line for line in skeleton_lines(scene, calibration) if line.startswith("neck")).split()
    assert row[:6] == ["neck", "ok", f"{1000 * neck['error']:.1f}", "mm", f"{1000 * neck['floor']:.1f}", "mm"]


def test_older_calibrations_are_read(figure_calibration, tmp_path):
    """A file without floor, warnings and distances from epicondyles is read; these are then not known."""
    path = save_calibration(figure_calibration, tmp_path / "calibration.json")
    text = path.read_text()
    assert '"warnings": []' in text
    lines = [line for line in text.splitlines() if line.split('"')[1:2] not in (["floor"], ["warnings"], ["beside"])]
    path.write_text("\n".join(lines).replace("],\n  }", "]\n  }").replace("],\n  },", "]\n  },"))
    neck = load_calibration(path)["neck"]
    assert np.isnan([neck.floor, neck.beside]).all()


def test_another_subject_is_refused(kata, kata_calibration, kata_halves, shared_file, one_line):
    """Two real people are refused with each other's calibration; halves of one recording fit each other's."""
    someone = choose(read_recording(shared_file("cmu_85_02.c3d")))
    theirs = calibrate(someone.recording, someone.markerset)
    for calibration, other in ((kata_calibration, someone.recording), (theirs, kata.recording)):
        with one_line(RecordingError, "does not show the subject calibrated in.*--force"):
            require_same_subject(calibration, other)
    (first, of_first), (second, of_second) = kata_halves
    for calibration, other in ((of_first, second), (of_second, first)):
        assert require_same_subject(calibration, other) == []


def test_the_same_session_is_accepted(functional):
    """A functional trial's calibration draws the walk of its session, and the hips are those of the trial.

    The pelvis moves little in itself, so the hips' places in it are the calibration's whatever the walk shows.
    """
    trial, walk = functional
    calibration = calibrate(trial.recording, trial.markerset)
    assert require_same_subject(calibration, walk.recording) == []
    assert require_same_subject(calibration, walk.recording, force=True) == []
    drawn = draw_skeleton(calibration, walk.recording)
    apart = np.linalg.norm(drawn.center("left_hip") - drawn.center("right_hip"), axis=0)
    left, right = (place.in_parent for place in calibration.joints)
    assert np.nanmedian(apart) == pytest.approx(np.linalg.norm(left - right), abs=1e-6)
    for name, other in (("left_hip", "LHJC"), ("right_hip", "RHJC")):
        off = np.linalg.norm(drawn.center(name) - walk.source.of(other), axis=0)
        assert np.nanmedian(off) < 0.01  # another method's centres of the same trials


def body(seed, height=1.75, replaced=0.0):
    """A body of this height, each marker put on elsewhere by so many metres, root mean square."""
    recording, truth = synthesize(Recipe(400, 60.0, seed=seed, height=height, soft_tissue=0.004, skin="random"))
    owner = {marker: s.name for s in load_markerset("cmu41").segments for marker in s.markers}
    positions, rng = recording.positions.copy(), np.random.default_rng(seed)
    for row, marker in enumerate(recording.markers):
        turns = truth.rotations[truth.segments.index(owner[marker])]
        positions[row] += np.einsum("tij,j->it", turns, replaced / np.sqrt(3) * rng.standard_normal(3))
    return replace(recording, positions=positions)


def test_sessions_and_other_bodies():
    """Markers that are put on again by 1-10 mm are accepted; other sizes from 5 % on, and 20 mm, are refused.

    Of 12 bodies each, all were judged so; with legs and pelvis alone one of 12 that was 5 % smaller passed at 10 mm.
    """
    for seed in range(2):
        calibration = calibrate(body(seed), load_markerset("cmu41"))
        for replaced in (0.001, 0.005, 0.01):
            assert not other_subject(calibration, body(seed + 50, replaced=replaced))
        others = [(1.05 * 1.75, 0.0), (0.95 * 1.75, 0.0), (1.05 * 1.75, 0.01), (1.75, 0.02)]
        assert all(other_subject(calibration, body(seed + 50, *other)) for other in others)
        assert not other_subject(calibration, body(seed + 50, replaced=0.015), refit=True)
        assert other_subject(calibration, body(seed + 50, 1.05 * 1.75), refit=True)


def test_one_segment_with_exchanged_labels_does_not_refuse_a_subject(figure, figure_calibration):
    """Two markers of the head bear each other's label throughout: the subject is accepted, but not by the head alone.

    Only segments that carry joints count: where the hips alone have places, the head says nothing.
    """
    recording = figure[0]
    labels = [{"LFHD": "RBHD", "RBHD": "LFHD"}.get(label, label) for label in recording.markers]
    exchanged = replace(recording, markers=tuple(labels))
    assert other_subject(figure_calibration, exchanged) == ""
    for names, words in ((["neck"], "1 of 2 segments do not fit (head: "), (["left_hip", "right_hip"], "")):
        part = figure_calibration
        for place in part.joints:
            part = part if place.joint.name in names else moved(part, place.joint.name, [np.nan] * 3)
        assert words in other_subject(part, exchanged)
        assert bool(words) == bool(other_subject(part, exchanged))


def test_scene_of_another_subject(figure_calibration):
    """A scene that is drawn by force says once, in its notes, what was overruled; its joints are usable."""
    calibration = figure_calibration
    other, _ = synthesize(Recipe(frames=300, height=1.5, seed=2))
    scene = skeleton_scene(
        draw_skeleton(calibration, other), other, require_same_subject(calibration, other, force=True)
    )
    assert scene.source == "joints found in synthetic-1"
    assert not any("subject" in doubt for doubt in scene.doubts)
    assert sum("does not show the subject" in note for note in scene.notes) == 1


CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def still(points, frames=100):
    """Points (n, 3) that do not move."""
    return np.repeat(np.asarray(points, dtype=float)[:, :, None], frames, axis=2)


def test_distances_from_a_cube():
    """Shares and 95 % quantiles are right inside, outside a face, and outside in 10 frames of 100."""
    centers = still([[0.5, 0.5, 0.9], [0.5, 0.5, 1.03], [0.5, 0.5, 0.5]])
    centers[2, 0, :10] = 1.06
    shares, distances = hull_distances(still(CORNERS), centers)
    np.testing.assert_allclose(shares, [0.0, 1.0, 0.1])
    np.testing.assert_allclose(distances, [-0.1, 0.03, 0.06])
    inside, above, sometimes = map(hull_doubt, shares, distances)
    assert inside == above == ""
    assert sometimes == "outside the markers' hull in 10% of the frames, by up to 60 mm"


def test_missing_markers():
    """Frames without a corner are left out, and so is a marker that is always missing; too few frames give NaN."""
    places, centers = still([*CORNERS, [0.5, 0.5, 9.0]]), still([[0.9, 0.9, 0.9]])
    places[8] = np.nan
    places[7, :, 50:] = np.nan  # the corner next to the joint
    assert hull_distances(places, centers)[1] == pytest.approx(-0.1)
    places[7, :, 10:] = np.nan
    (share,), (distance,) = hull_distances(places, centers)
    assert np.isnan(share)
    assert hull_doubt(share, distance) == ""


@pytest.mark.parametrize("places", [still(CORNERS[:3]), still(CORNERS[:4]), still(np.empty((0, 3)))])
def test_no_hull(places):
    """Three markers, four in a plane, and none have no hull, so the distance is NaN; so is an unknown joint's."""
    assert np.isnan(hull_distances(places, still([[0.0, 0.0, 0.0]]))).all()
    assert np.isnan(hull_distances(still(CORNERS), np.full((1, 3, 100), np.nan))).all()

"""Poses of phase 2: each segment follows its own markers, and says how well."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.export.tree import ExportedMotion, joint_angles
from study.recordings.formats.read import read_recording
from study.recordings.joints.estimate import JointStatus
from study.recordings.markersets import Joint, MarkerSet, Segment, load_markerset, match
from study.recordings.recording import Recording
from study.recordings.rigid import fit_poses_to
from study.recordings.skeleton.calibrate import calibrate, with_joints
from study.recordings.skeleton.draw import Flag, draw_skeleton
from study.recordings.skeleton.scene import skeleton_scene
from study.recordings.synthetic.make import SKIN, Recipe, synthesize
from tests.recordings.bodies import axes_of_the_body

RIZZOLI = load_markerset("rizzoli")


def kabsch(template, x):
    """Rotations (frames, 3, 3) of a template (m, 3) to markers (m, 3, frames), by Kabsch's singular values."""
    a, b = template - template.mean(axis=0), x - x.mean(axis=0)
    u, _, vt = np.linalg.svd(np.einsum("mit,mj->tij", b, a))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return u @ vt


def apart(one, other):
    """Angles between rotations (frames, 3, 3), degrees."""
    return np.degrees(Rotation.from_matrix(np.swapaxes(one, 1, 2) @ other).magnitude())


def seen_by_markers(skeleton, recording, segment):
    """Frames that show all of a segment's markers, and the poses that Kabsch's algorithm gives them there."""
    shape = skeleton.calibration.shape(segment)
    x = np.stack([recording.of(marker) for marker in shape.markers])
    whole = ~np.isnan(x).any(axis=(0, 1))
    return whole, kabsch(shape.places, x[:, :, whole])


def test_weights_are_those_of_scipy(rng):
    """Of weighted points the rotation is that of SciPy's Kabsch algorithm with these weights."""
    places, weights = rng.normal(size=(4, 3)), np.array([1.0, 1.0, 0.3, 0.02])
    turns = Rotation.random(20, rng=rng)
    x = np.einsum("tij,mj->mit", turns.as_matrix(), places) + 0.1 * rng.standard_normal((4, 3, 20))
    rotation, origin, fitted, _, _ = fit_poses_to(places, x, np.full(4, np.inf), weights)
    assert fitted.all()
    share = weights / weights.sum()
    for t in range(20):
        middles = share @ places, share @ x[:, :, t]
        wanted, _ = Rotation.align_vectors(x[:, :, t] - middles[1], places - middles[0], weights)
        np.testing.assert_allclose(rotation[:, :, t], wanted.as_matrix(), atol=1e-9)
        np.testing.assert_allclose(origin[:, t], middles[1] - wanted.apply(middles[0]), atol=1e-9)


@pytest.mark.parametrize("stray", [0, 1, 2])
def test_the_stray_one_of_three_is_rejected(rng, stray):
    """Of three markers the one that is 5 cm off is rejected, whatever its direction, and the others are kept."""
    places = np.array([[0.0, 0.0, 0.0], [0.11, 0.0, 0.0], [0.03, 0.12, 0.0]])
    joint = np.array([[0.05, 0.03, 0.3]])
    x = np.einsum("tij,mj->mit", Rotation.random(50, rng=rng).as_matrix(), np.concatenate([places, joint]))
    directions = rng.standard_normal((3, 50))
    # along the normal of their plane no distance changes to first order, so that nothing tells which one is off
    normal = np.cross(x[1] - x[0], x[2] - x[0], axis=0)
    normal /= np.linalg.norm(normal, axis=0)
    directions -= (directions * normal).sum(axis=0) * normal
    x[stray] += 0.05 * directions / np.linalg.norm(directions, axis=0)
    used = fit_poses_to(places, x[:3], np.full(3, 0.01))[3]
    kept = [k for k in range(3) if k != stray]
    assert used[kept].all(axis=0).mean() > 0.9
    assert not used[stray].any()


def test_a_joint_that_is_off_rejects_no_marker(figure, figure_calibration):
    """A foot follows its three markers, whatever its ankle: with one that is 4 cm off, and one known to 2 m only.

    Before, such a joint was the foot's pivot: markers were rejected, and the rotation was off by tens of degrees.
    """
    recording, ankle = figure[0], figure_calibration["left_ankle"]
    moved = replace(ankle, in_parent=ankle.in_parent + np.array([0.0, 0.0, 0.04]))
    far = replace(ankle, covariance=4.0 * np.eye(3), in_parent=ankle.in_parent + 0.5, status=JointStatus.UNSURE)
    for place in (moved, far):
        joints = tuple(place if p.joint.name == "left_ankle" else p for p in figure_calibration.joints)
        skeleton = draw_skeleton(replace(figure_calibration, joints=joints), recording)
        number = skeleton.segments.index("left_foot")
        assert skeleton.left_out[number] == 0.0
        assert (skeleton.segment_flags[number] == Flag.SEEN).all()
        whole, wanted = seen_by_markers(skeleton, recording, "left_foot")
        assert whole.all()
        assert apart(np.moveaxis(skeleton.rotation("left_foot"), 2, 0), wanted).max() < 1e-6
    assert np.isnan(skeleton.center("left_ankle")).all()  # of ± 2 m
    note = next(note for note in skeleton_scene(skeleton, recording).notes if note.startswith("left_ankle"))
    assert "not shown" in note


def test_a_hand_near_an_uncertain_wrist_is_held(figure, figure_calibration):
    """A marker nearer to a wrist than three of its errors shows no direction; the hand is held to the forearm."""
    recording, hand = figure[0], figure_calibration.shape("left_hand")
    wrist = figure_calibration["left_wrist"]
    away = np.linalg.norm(hand.places[0] - wrist.in_child)
    turns = []
    for share, flag in ((3.0, Flag.BRIDGED), (0.1, Flag.SEEN)):
        place = replace(wrist, covariance=(share * away) ** 2 * np.eye(3))
        joints = tuple(place if p.joint.name == "left_wrist" else p for p in figure_calibration.joints)
        skeleton = draw_skeleton(replace(figure_calibration, joints=joints), recording)
        forearm, turned = (np.moveaxis(skeleton.rotation(f"left_{name}"), 2, 0) for name in ("forearm", "hand"))
        assert (skeleton.segment_flags[skeleton.segments.index("left_hand")] == flag).all()
        relative = np.swapaxes(forearm, 1, 2) @ turned
        turns.append(apart(relative, np.broadcast_to(wrist.mean_rotation, relative.shape)).max())
    assert turns[0] < 0.1 * turns[1]


def test_samples_that_are_left_out_are_told(figure, figure_calibration):
    """Of a tenth of a foot's samples, displaced by 10 cm, the note and the doubts of its joint tell."""
    recording = figure[0]
    positions = recording.positions.copy()
    positions[recording.row("LTOE"), 2, : 3 * recording.frames // 10] += 0.1
    skeleton = draw_skeleton(figure_calibration, Recording("off", recording.markers, positions, recording.rate))
    assert skeleton.left_out[skeleton.segments.index("left_foot")] == pytest.approx(0.1, abs=0.005)
    scene = skeleton_scene(skeleton, recording)
    assert any("far from their places: 10.0% of left_foot" in note for note in scene.notes)
    doubt = scene.doubts[scene.joints.index("left_ankle")]
    assert "10% of the samples of left_foot are far from their places" in doubt


def truth_of_angles(truth, axes):
    """True angles about z, x and y of each joint between anatomical axes (3, frames), degrees (Grood and Suntay)."""
    world = {name: truth.rotations[truth.segments.index(name)] @ axes[name] for name in axes}
    for name, parent, child in zip(truth.joints, truth.parents, truth.children, strict=True):
        if parent in axes and child in axes:
            turn = np.swapaxes(world[parent], 1, 2) @ world[child]
            # e1 = z of the parent, e3 = y of the child, e2 across both
            x = np.arcsin(turn[:, 2, 1])
            z, y = np.arctan2(-turn[:, 0, 1], turn[:, 1, 1]), np.arctan2(-turn[:, 2, 0], turn[:, 2, 2])
            mirror = -1.0 if name.startswith("left") else 1.0
            signs = np.array([-1.0 if name.endswith("knee") else 1.0, mirror, mirror])
            yield name, signs[:, None] * np.degrees(np.unwrap(np.stack([z, x, y])))


@pytest.mark.parametrize("law", [None, SKIN[0], *(pytest.param(law, marks=pytest.mark.slow) for law in SKIN[1:])])
def test_angles_are_inside_their_errors(part_of, law):
    """Hips, knees and ankles: with 1 mm of noise within 1° rms; with skin of 1 cm as often inside as they state.

    The angles are compared up to a constant, because the error of the axes themselves is not stated. Of 288 angles of
    sixteen other bodies .926 (angle) to .951 (no skin) of the samples were within 1.96 errors, .930 with skin that
    slides; between bodies the share varies by .024: a mean is three of its errors below .926 in 1 of 1000 seeds.
    """
    inside, squares, bodies = [], [], part_of(4)
    for seed in range(11, 11 + bodies):
        skin = {} if law is None else {"soft_tissue": 0.01, "skin": law}
        recording, truth = synthesize(Recipe(400, 50.0, seed=seed, gait=seed % 2 == 0, markers="rizzoli", **skin))
        joints = calibrate(recording, RIZZOLI, recording)
        skeleton = draw_skeleton(joints, recording)
        table = joint_angles(ExportedMotion(skeleton, recording, skeleton_scene(skeleton, recording)))
        for name, angles in truth_of_angles(truth, axes_of_the_body()):
            if f"{name}_adduction" not in table:  # of a thigh whose hip is not known
                continue
            for word, true in zip(("flexion", "adduction", "rotation"), angles, strict=True):
                off = table[f"{name}_{word}"].to_numpy() - true
                off = (off - np.nanmedian(off))[~np.isnan(off)]
                error = table[f"{name}_{word}_error"].dropna().to_numpy()
                inside += list(np.abs(off) < 1.96 * error)
                squares += list(off**2)
    assert len(squares) > 0.8 * bodies * 18 * 400
    assert np.mean(inside) > 0.926 - 3.0 * 0.024 / np.sqrt(bodies)
    assert law is not None or np.sqrt(np.mean(squares)) < 1.0


def test_a_real_walk_follows_its_markers(functional):
    """Pelvis and thighs of a session's walk, where all markers are seen, against Kabsch's algorithm: ≤ 2° rms, ≤ 7°.

    One sample of the left thigh is stray: without it the largest difference is rounding.
    """
    trials = [match.recording for match in functional]
    joints = calibrate(trials[0], functional[0].markerset)
    skeleton = draw_skeleton(joints, trials[1])
    for segment in skeleton.segments:
        whole, wanted = seen_by_markers(skeleton, trials[1], segment)
        off = apart(np.moveaxis(skeleton.rotation(segment)[:, :, whole], 2, 0), wanted)
        assert np.sqrt((off**2).mean()) < 2.0
        assert (off > 1e-6).sum() <= 1
        assert off.max() < 7.0
        number = skeleton.segments.index(segment)
        assert (skeleton.segment_flags[number][whole] == Flag.SEEN).mean() > 0.98


@pytest.mark.parametrize("name", ["cmu_85_02.c3d", "cmu_135_02.c3d"])
def test_real_segments_with_three_markers_are_seen(shared_file, name):
    """Of the frames that show three markers, hardly any are bridged; a hand does not spin beside its forearm."""
    placed, calibration = with_joints(read_recording(shared_file(name)), None, None)
    skeleton = draw_skeleton(calibration, placed.recording)
    for segment, flags in zip(skeleton.segments, skeleton.segment_flags, strict=True):
        if calibration.shape(segment).has_own_pose:
            markers = np.stack([placed.recording.of(marker) for marker in calibration.shape(segment).markers])
            enough = (~np.isnan(markers[:, 0])).sum(axis=0) >= 3
            # in the kata the marker of a toe is 8 cm from its place in 112 of 5202 frames
            assert (flags[enough] != Flag.SEEN).mean() <= (0.022 if segment == "left_foot" else 0.0), segment
    for side in ("left", "right"):
        forearm, hand = (np.moveaxis(skeleton.rotation(f"{side}_{name}"), 2, 0) for name in ("forearm", "hand"))
        beside = np.swapaxes(forearm, 1, 2) @ hand
        assert apart(beside[:-1], beside[1:]).max() < 15.0


def legs_of_the_session():
    """The marker set of the session's legs: clusters with epicondyles, malleoli, and three markers on each foot."""
    segments, joints = [Segment(name="pelvis", markers=("LASI", "RASI", "LPSI", "RPSI"))], []
    clusters = {"thigh": "TH1 TH2 TH3 LFC MFC", "shank": "TB1 TB2 TB3 LMAL MMAL", "foot": "CAL MT1 MT2"}
    for letter, side in (("L", "left"), ("R", "right")):
        above = "pelvis"
        for (part, labels), joint in zip(clusters.items(), ("hip", "knee", "ankle"), strict=True):
            name, kind = f"{side}_{part}", "hinge" if joint == "knee" else "ball"
            markers = tuple(letter + label for label in labels.split())
            segments.append(Segment(name=name, parent=above, markers=markers))
            joints.append(Joint(name=f"{side}_{joint}", parent=above, child=name, kind=kind))
            above = name
    return MarkerSet(name="legs", segments=tuple(segments), joints=tuple(joints))


def test_angles_of_a_real_walk(shared_file):
    """Hips and knees in frames with all markers: ≤ 2° rms and ≤ 5° from Kabsch's poses and Grood and Suntay's angles.

    Angles are computed from the poses in the test; only the anatomical axes are the calibration's.
    """
    recording, markerset = read_recording(shared_file("gait_same_session.c3d")), legs_of_the_session()
    placed = match(markerset, recording)
    joints = calibrate(placed.recording, markerset, recording, "regression")
    skeleton = draw_skeleton(joints, placed.recording)
    table = joint_angles(ExportedMotion(skeleton, recording, skeleton_scene(skeleton, placed.recording)))
    axes, compared = {s.segment: s.anatomy for s in joints.shapes if not np.isnan(s.anatomy).any()}, 0
    for place in joints.joints:
        ends = place.joint.parent, place.joint.child
        if not set(ends) <= set(axes):
            continue
        whole, world = np.ones(recording.frames, dtype=bool), []
        for name in ends:
            seen, turns = seen_by_markers(skeleton, placed.recording, name)
            every = np.full((recording.frames, 3, 3), np.nan)
            every[seen] = turns @ axes[name]
            world.append(every)
            whole &= seen
        turn = np.swapaxes(world[0][whole], 1, 2) @ world[1][whole]
        floating = np.cross(turn[:, :, 1], [0.0, 0.0, 1.0])  # across the child's y and the parent's z
        floating /= np.linalg.norm(floating, axis=1)[:, None]
        flexion = np.degrees(np.arctan2(floating[:, 1], floating[:, 0]))
        adduction = 90.0 - np.degrees(np.arccos(turn[:, 2, 1]))
        rotation = np.degrees(
            np.arctan2((turn[:, :, 2] * floating).sum(axis=1), (turn[:, :, 0] * floating).sum(axis=1))
        )
        mirror = -1.0 if place.joint.name.startswith("left") else 1.0
        bends = -1.0 if place.joint.name.endswith("knee") else 1.0
        for word, wanted in (
            ("flexion", bends * flexion),
            ("adduction", mirror * adduction),
            ("rotation", mirror * rotation),
        ):
            off = table[f"{place.joint.name}_{word}"].to_numpy()[whole] - wanted
            off -= 360.0 * np.round(off / 360.0)
            assert np.sqrt((off**2).mean()) < 2.0, (place.joint.name, word)
            assert np.abs(off).max() < 5.0, (place.joint.name, word)
            compared += 1
        assert whole.mean() > 0.4
    assert compared >= 12

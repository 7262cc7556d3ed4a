"""Tests of draw."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize
from scipy.spatial.transform import Rotation

from study.recordings.markersets import load_markerset
from study.recordings.recording import Recording, RecordingError
from study.recordings.skeleton.between import InterpolatedRotation
from study.recordings.skeleton.calibrate import calibrate, hull_distances, hull_doubt, with_checks
from study.recordings.skeleton.draw import (
    LARGEST_ERROR,
    Flag,
    complete_poses,
    draw_skeleton,
)
from study.recordings.skeleton.scene import frame_errors, skeleton_scene, skeleton_table
from study.recordings.synthetic.make import Recipe, synthesize

CMU41 = load_markerset("cmu41")


@pytest.fixture(scope="module")
def still(exact):
    """A figure without noise, its truth, and its calibration."""
    recording, truth, found = exact
    return recording, truth, with_checks(found, recording)


def off(skeleton, truth, joint):
    """A joint less the truth in each frame (3, frames); for a hinge, across its true axis."""
    k = truth.joints.index(joint)
    away = skeleton.center(joint) - truth.centers[k]
    if np.isfinite(truth.axes[k, 0]):
        axis = (truth.rotations[truth.segments.index(truth.parents[k])] @ truth.axes[k]).T
        away = away - axis * (axis * away).sum(axis=0)
    return away


def errors(skeleton, truth, joint):
    """Distance of a joint from the truth in each frame (frames,); for a hinge, from the line of its true axis."""
    return np.linalg.norm(off(skeleton, truth, joint), axis=0)


def without(recording, hidden):
    """The recording with samples missing: {marker: slice of frames}."""
    positions = recording.positions.copy()
    for marker, frames in hidden.items():
        positions[recording.row(marker), :, frames] = np.nan
    return Recording(recording.name, recording.markers, positions, recording.rate)


def test_without_noise_joints_are_exact(still):
    """Without noise every joint is seen, and right to a hundredth of a millimetre, in every frame."""
    recording, truth, calibration = still
    skeleton = draw_skeleton(calibration, recording)
    for joint in skeleton.joints:
        assert errors(skeleton, truth, joint).max() < 1e-5, joint
    assert (skeleton.flags == Flag.SEEN).all()
    assert np.nanmax(skeleton.misfits) < 1e-6


@pytest.mark.parametrize("noise", [0.001, 0.005])
def test_noise_of_millimetres(noise):
    """The root mean square error of every joint is within 3.5 times the noise."""
    recording, truth = synthesize(Recipe(frames=2500, noise=noise, seed=3))
    skeleton = draw_skeleton(calibrate(recording, CMU41), recording)
    for joint in skeleton.joints:
        rms = np.sqrt((errors(skeleton, truth, joint) ** 2).mean())
        assert rms < 3.5 * noise, joint


def test_one_marker_gives_a_direction(still):
    """A forearm with one marker left points from the elbow along that marker, and is flagged."""
    recording, _, calibration = still
    part = slice(100, 180)
    skeleton = draw_skeleton(calibration, without(recording, {"LFRM": part, "LWRA": part}))
    whole = draw_skeleton(calibration, recording)
    at = skeleton.segments.index("left_forearm")
    assert (skeleton.segment_flags[at, part] == Flag.BRIDGED).all()
    assert (skeleton.segment_flags[at, :100] == Flag.SEEN).all()
    shape = calibration.shape("left_forearm")
    place = shape.places[shape.markers.index("LWRB")]
    there = np.einsum("ijt,j->it", skeleton.rotations[at], place) + skeleton.origins[at]
    # the marker and the elbow, each with its error, say the length between them
    np.testing.assert_allclose(there[:, part], recording.of("LWRB")[:, part], atol=1e-3)
    apart = np.linalg.norm(skeleton.center("left_wrist") - whole.center("left_wrist"), axis=0)
    assert apart[part].max() < 0.03
    assert np.delete(apart, np.r_[part]).max() < 1e-5
    wrist = skeleton.joints.index("left_wrist")
    assert (skeleton.flags[wrist, part] == Flag.BRIDGED).all()


def test_gaps_are_bridged_for_a_while_and_then_unknown(still):
    """A hidden shank, and what depends on it, is bridged and flagged in near frames and unknown in far ones.

    It is unknown, too, where its error would exceed 5 cm.
    """
    recording, _, calibration = still
    part = slice(200, 600)
    hidden = without(recording, dict.fromkeys(("LSHN", "LANK", "LHEE", "LTOE", "LMT5"), part))
    skeleton = draw_skeleton(calibration, hidden, bridge=0.5)
    number = skeleton.joints.index("left_ankle")
    ankle, error = skeleton.flags[number], np.sqrt(skeleton.posed[number].max(axis=0))
    assert (ankle[[200, 201, 598, 599]] == Flag.BRIDGED).all()
    assert (ankle[261:539] == Flag.UNKNOWN).all()
    assert (np.isnan(skeleton.center("left_ankle")[0]) == (ankle == Flag.UNKNOWN)).all()
    shank = skeleton.segment_flags[skeleton.segments.index("left_shank")]
    assert (shank[200:260] == Flag.BRIDGED).all()
    assert (shank[540:600] == Flag.BRIDGED).all()
    assert error[ankle == Flag.BRIDGED].max() <= LARGEST_ERROR
    assert error[200] < error[201]
    assert error[599] < error[598]
    assert (skeleton.flags[skeleton.joints.index("left_knee")] == Flag.SEEN).all()
    strict = draw_skeleton(calibration, hidden, bridge=0.5, largest_error=0.01)
    lost = (strict.flags[number] == Flag.UNKNOWN) & (ankle == Flag.BRIDGED)
    assert lost.any()
    assert (error[lost] > 0.9 * np.sqrt(0.01**2 - strict.calibration["left_ankle"].standard_error ** 2)).all()
    with pytest.raises(RecordingError, match="largest_error = 0 metres; it must be above 0"):
        draw_skeleton(calibration, hidden, largest_error=0.0)


def test_root_with_two_markers(still):
    """With two of the pelvis's markers hips are still near, and flagged; what the chest's markers show is not."""
    recording, truth, calibration = still
    part = slice(300, 330)
    skeleton = draw_skeleton(calibration, without(recording, {"LFWT": part, "LBWT": part}))
    flags = dict(zip(skeleton.joints, skeleton.flags[:, part], strict=True))
    for joint in ("left_hip", "right_hip"):
        assert (flags[joint] == Flag.BRIDGED).all()
        assert errors(skeleton, truth, joint)[part].max() < 0.02
    for joint in ("waist", "left_wrist"):
        assert (flags[joint] == Flag.SEEN).all()


def test_swapped_markers(still):
    """Segments do not follow knee and toe markers that are exchanged in some frames."""
    recording, truth, calibration = still
    positions = recording.positions.copy()
    pair = [recording.row(marker) for marker in ("LKNE", "LTOE")]
    positions[pair, :, 400:420] = positions[pair[::-1], :, 400:420]
    skeleton = draw_skeleton(calibration, Recording("swapped", recording.markers, positions, recording.rate))
    assert errors(skeleton, truth, "left_knee")[400:420].max() < 0.15
    knee = skeleton.flags[skeleton.joints.index("left_knee")]
    assert (knee[400:420] == Flag.BRIDGED).all()
    assert errors(skeleton, truth, "left_ankle")[:400].max() < 1e-5


def test_gaps_of_a_fifth():
    """Errors in frames called seen are of the order of the noise; bridged frames are mostly near, too."""
    recording, truth = synthesize(Recipe(frames=2500, noise=0.001, gaps=0.2))
    skeleton = draw_skeleton(calibrate(recording, CMU41), recording)
    for i, joint in enumerate(skeleton.joints):
        away, flags = errors(skeleton, truth, joint), skeleton.flags[i]
        assert np.quantile(away[flags == Flag.SEEN], 0.95) < 0.01, joint
        bridged = away[flags == Flag.BRIDGED]
        assert not len(bridged) or np.median(bridged) < 0.01, joint
        assert np.isnan(away[flags == Flag.UNKNOWN]).all()


def test_bones_keep_their_lengths(kata_halves):
    """In a real recording a bone is off its length by its joint's gap, and halves agree within their errors.

    From the joint in the child to the next joint a bone has the calibration's length. From the joint in the parent,
    where it is drawn, it differs by the gap, which the test computes anew from both poses. Only frames count that show
    both segments. Lengths of one half against the other: 8 bones, none beyond 4 combined standard errors, most within
    2.
    """
    lengths, stated = [], []
    for piece, calibration in kata_halves:
        skeleton = draw_skeleton(calibration, piece)
        rows, errors_of = [], []
        for side in ("left", "right"):
            for above, below in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
                place, end = calibration[f"{side}_{above}"], calibration[f"{side}_{below}"]
                parent, child = (skeleton.segments.index(name) for name in (place.joint.parent, place.joint.child))
                seen = (skeleton.segment_flags[[parent, child]] == Flag.SEEN).all(axis=0)
                assert seen.mean() > 0.9
                ends = [
                    np.einsum("ijt,j->it", skeleton.rotations[k][:, :, seen], at) + skeleton.origins[k][:, seen]
                    for k, at in ((parent, place.in_parent), (child, place.in_child))
                ]
                drawn = skeleton.center(place.joint.name)[:, seen]
                np.testing.assert_allclose(drawn, ends[0], atol=1e-9)
                gap = np.linalg.norm(ends[1] - ends[0], axis=0)
                assert np.sqrt((gap**2).mean()) == pytest.approx(skeleton.gaps[skeleton.joints.index(place.joint.name)])
                length = np.linalg.norm(end.in_parent - place.in_child)
                if not np.isnan(skeleton.center(end.joint.name)).any():
                    bone = np.linalg.norm(drawn - skeleton.center(end.joint.name)[:, seen], axis=0)
                    assert (np.abs(bone - length) <= gap + 1e-9).all()
                rows.append(length)
                u = end.in_parent - place.in_child
                u = u / np.linalg.norm(u)
                first = place.mean_rotation.T @ place.covariance @ place.mean_rotation
                errors_of.append(u @ (first + end.covariance) @ u)
        lengths.append(rows)
        stated.append(errors_of)
    off = np.abs(np.subtract(*lengths)) / np.sqrt(np.sum(stated, axis=0))
    assert off.max() < 4.0
    assert np.median(off) < 2.0
    femora, tibiae = np.mean(lengths, axis=0)[[0, 4]], np.mean(lengths, axis=0)[[1, 5]]
    for left, right in (femora, tibiae):
        assert abs(left - right) < 0.08 * (left + right) / 2


def test_joints_stay_inside_the_markers(kata, kata_calibration):
    """In a real recording every joint is in the box of all markers, but for the thickness of an elbow.

    Noise hides the wrists, whose hands have one marker: they are uncertain by 8 and 12 cm, and not drawn.
    An elbow has one marker, on its outer side: at arm's length its middle is up to 4 cm outside the box.
    """
    skeleton = draw_skeleton(kata_calibration, kata.recording)
    low, high = np.nanmin(kata.recording.positions, axis=0), np.nanmax(kata.recording.positions, axis=0)
    drawn = [row for row in zip(skeleton.joints, skeleton.centers, strict=True) if not np.isnan(row[1]).all()]
    assert {"left_wrist", "right_wrist"} == set(skeleton.joints) - {joint for joint, _ in drawn}
    for joint, center in drawn:
        beyond = np.maximum(low - center, center - high).max(axis=0)
        assert np.nanmax(beyond) < 0.05, joint
        most = 0.25 if "elbow" in joint else 0.03
        assert (beyond > 0.01).mean() < most, joint
    shares, distances = hull_distances(kata.recording.positions, skeleton.centers)
    for joint, share, distance in zip(skeleton.joints, shares, distances, strict=True):
        assert "wrist" in joint or distance < (0.035 if "elbow" in joint else 0.025), joint
        assert hull_doubt(share, distance) == "", joint
    assert distances[skeleton.joints.index("left_elbow")] > 0.01


def test_a_joint_that_leaves_the_body_is_doubted(still):
    """A waist that is 30 cm in front of the body is doubted in the scene, and no other joint is."""
    recording, _, calibration = still
    skeleton = draw_skeleton(calibration, recording)
    centers = skeleton.centers.copy()
    k = skeleton.joints.index("waist")
    centers[k] += 0.3 * skeleton.rotation("pelvis")[:, 0]
    scene = skeleton_scene(replace(skeleton, centers=centers), recording)
    doubted = {joint for joint, doubt in zip(scene.joints, scene.doubts, strict=True) if "markers' hull in" in doubt}
    assert doubted == {"waist"}


@pytest.mark.parametrize("frames", [1, 3])
def test_hardly_any_frames(still, frames):
    """One frame can be drawn with a calibration."""
    recording, truth, calibration = still
    few = recording.select(frames=slice(0, frames))
    part = replace(truth, centers=truth.centers[:, :, :frames], rotations=truth.rotations[:, :frames])
    assert errors(draw_skeleton(calibration, few), part, "left_hip").max() < 1e-5


def test_nothing_seen(still):
    """Without samples nothing is known, and there is no calibration; a negative time to bridge is refused."""
    recording, _, calibration = still
    empty = Recording("empty", recording.markers, np.full((41, 3, 20), np.nan), 100.0)
    skeleton = draw_skeleton(calibration, empty)
    assert np.isnan(skeleton.centers).all()
    assert (skeleton.flags == Flag.UNKNOWN).all()
    with pytest.raises(RecordingError, match="no segment of this calibration has a pose"):
        draw_skeleton(calibrate(empty, CMU41), recording)
    with pytest.raises(RecordingError, match="0 or more"):
        draw_skeleton(calibration, recording, bridge=-1.0)


PLACES = np.array([[0.0, 0.1, -0.3]])


@pytest.mark.parametrize("pinned", [True, False])
def test_shortest_arc(rng, pinned):
    """With one sure marker the segment points at it from its joint, by the least rotation from the expected pose.

    The least rotation that takes u to v is about u × v, by the angle between them.
    """
    joint, expected = np.array([0.02, -0.05, 0.1]), Rotation.random(rng=rng)
    u = expected.apply(PLACES[0] - joint)
    v = Rotation.from_rotvec([0.3, -0.5, 0.2]).apply(u)
    at = np.array([1.0, 2.0, 3.0])
    places, x = np.stack([PLACES[0], joint]), np.stack([at + v, at])[:, :, None]
    if not pinned:
        x[1] = np.nan
    weights, sure = np.array([1e6, 1e6]), np.array([1e-3])
    turns, origins, _ = complete_poses(places, x, weights, expected.as_matrix()[:, :, None], sure)
    rotation, origin = turns[:, :, 0], origins[:, 0]
    np.testing.assert_allclose(rotation @ PLACES[0] + origin, x[0, :, 0], atol=1e-3)
    if pinned:
        axis = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        angle = np.arccos(u @ v / (np.linalg.norm(u) * np.linalg.norm(v)))
        wanted = Rotation.from_rotvec(angle * axis) * expected
        off = Rotation.from_matrix(rotation @ wanted.as_matrix().T).magnitude()
        assert off < 2 * 0.002 * angle  # the expected rotation has .002 of the weight at least
        np.testing.assert_allclose(rotation @ joint + origin, at, atol=1e-3)
    else:  # a marker without a joint shows no direction
        np.testing.assert_allclose(rotation, expected.as_matrix(), atol=1e-12)


def test_an_expected_rotation_is_weighed_against_points(rng):
    """The completed pose minimises Σ w |x - R p - o|² + s |R - R₀|², as a general minimiser finds it."""
    places, weights, sure = 0.1 * rng.normal(size=(3, 3)), np.array([1e4, 2e4, 3e3]), 150.0
    expected = Rotation.random(rng=rng)
    x = (Rotation.from_rotvec([0.4, -0.3, 0.5]) * expected).apply(places) + 0.02 * rng.normal(size=(3, 3)) + 1.0

    def residuals(parameters):
        turn = Rotation.from_rotvec(parameters[:3]) * expected
        points = np.sqrt(weights)[:, None] * (x - turn.apply(places) - parameters[3:])
        return np.concatenate([points.ravel(), np.sqrt(sure) * (turn.as_matrix() - expected.as_matrix()).ravel()])

    best = optimize.least_squares(residuals, np.r_[0.0, 0.0, 0.0, x.mean(axis=0)], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    wanted = Rotation.from_rotvec(best.x[:3]) * expected
    args = places, x[:, :, None], weights, expected.as_matrix()[:, :, None], np.array([sure])
    rotation, origin, middle = (part[..., 0] for part in complete_poses(*args))
    np.testing.assert_allclose(rotation, wanted.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(origin, best.x[3:], atol=1e-6)
    np.testing.assert_allclose(middle, weights @ places / weights.sum())


def hide_segments(recording, rng, markerset=CMU41):
    """Hide all markers of every segment once to three times, for .1 to 2 seconds."""
    positions = recording.positions.copy()
    for segment in markerset.segments:
        for _ in range(rng.integers(1, 4)):
            length = int(recording.rate * rng.uniform(0.1, 2.0))
            first = rng.integers(0, recording.frames - length)
            positions[[recording.row(marker) for marker in segment.markers], :, first : first + length] = np.nan
    return Recording(recording.name, recording.markers, positions, recording.rate)


@pytest.mark.slow
def test_hidden_segments():
    """Joints do not leap while a neighbour shows them, and bridged ones are where their errors say.

    Of 168 joints of 12 other recordings none leapt by more than 12 mm from frame to frame where it was seen; 93.6 ±
    1.8 % of the bridged coordinates were within 1.96 stated standard errors.
    """
    inside = []
    for seed, tissue in ((1, 0.0), (2, 0.01), (3, 0.0), (4, 0.01)):
        skin = {"soft_tissue": tissue, "skin": "random" if tissue else "mixed"}
        whole, truth = synthesize(Recipe(1500, 100.0, seed=seed, gait=seed % 2 == 1, **skin))
        calibration = calibrate(synthesize(Recipe(1500, 100.0, seed=seed + 1000, **skin))[0], CMU41)
        recording = hide_segments(whole, np.random.default_rng(seed))
        skeleton = draw_skeleton(calibration, recording)
        scene = skeleton_scene(skeleton, recording)
        stated = frame_errors(scene)
        for i, joint in enumerate(skeleton.joints):
            away, seen = off(skeleton, truth, joint), skeleton.flags[i] == Flag.SEEN
            steps = np.linalg.norm(np.diff(away, axis=1), axis=0)[seen[1:] & seen[:-1]]
            assert steps.max() < 0.03, joint
            bridged = skeleton.flags[i] == Flag.BRIDGED
            error = stated[scene.joints.index(joint)][:, bridged]
            inside += list((np.abs(away[:, bridged]) <= 1.96 * error)[~np.isnan(error)])
    assert np.mean(inside) > 0.93


def test_a_hip_that_the_thigh_shows():
    """Three markers of a thigh show the hip while the pelvis is hidden; with both hidden it is missing."""
    rizzoli = load_markerset("rizzoli")
    recording, truth = synthesize(Recipe(600, noise=0.0005, markers="rizzoli"))
    calibration, part, both = calibrate(recording, rizzoli), slice(200, 320), slice(400, 420)
    hidden = dict.fromkeys(rizzoli.segment("pelvis").markers, part)
    skeleton = draw_skeleton(calibration, without(recording, hidden), bridge=0.0)
    hip = skeleton.joints.index("left_hip")
    assert (skeleton.flags[hip] == Flag.SEEN).all()
    assert errors(skeleton, truth, "left_hip").max() < 0.005
    hidden = dict.fromkeys((*rizzoli.segment("pelvis").markers, *rizzoli.segment("left_thigh").markers), both)
    positions = without(without(recording, hidden), dict.fromkeys(recording.markers, slice(410, 420)))
    skeleton = draw_skeleton(calibration, positions, bridge=2.0)
    assert np.isnan(skeleton.center("left_hip")[:, 410:420]).all()
    assert (skeleton.flags[:, 410:420] == Flag.UNKNOWN).all()
    assert np.isnan(skeleton_table(skeleton_scene(skeleton, positions)).query("411 <= frame <= 420")["x"]).all()


def test_the_error_of_an_interpolated_rotation():
    """A random walk of rotations: the covariance in the middle of a gap of 2h frames is h/2 of a step's.

    Beyond an end it is that of as many steps. From some 280 gaps of 8 frames that overlap by half at most: ± 10 %.
    """
    rng, step, n = np.random.default_rng(3), np.array([0.01, 0.02, 0.03]), 2400
    turns = Rotation.from_rotvec(step * rng.standard_normal((n, 3)))
    course = [Rotation.identity()]
    for turn in turns:
        course.append(turn * course[-1])
    rotation = np.moveaxis(Rotation.concatenate(course).as_matrix(), 0, 2)
    known = np.ones(n + 1, dtype=bool)
    known[1001:1008] = known[-4:] = False
    path = InterpolatedRotation(rotation, None, known)
    middle, beyond = path.covariance(np.array([1004, n]))
    np.testing.assert_allclose(np.diag(middle), 2.0 * step**2, rtol=0.35)
    np.testing.assert_allclose(np.diag(beyond), 4.0 * step**2, rtol=0.35)
    edge = path.covariance(np.array([1001]))[0]
    np.testing.assert_allclose(np.trace(edge), np.trace(middle) * 7 / 16, rtol=1e-9)  # 1 · (8 - 1)/4²
    halfway = Rotation.from_matrix(rotation[:, :, [1000, 1008]].transpose(2, 0, 1)).mean().as_matrix()
    np.testing.assert_allclose(path.at(np.array([1004]))[:, :, 0], halfway, atol=1e-12)

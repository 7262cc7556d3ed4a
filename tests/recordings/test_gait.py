"""Gait: events, cycles and curves of a synthetic body that walks."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.export.tree import ExportedMotion, joint_angles
from study.recordings.gait import ANGLES, PERCENT, gait_events, gait_lines, gait_of
from study.recordings.joints.estimate import JointStatus
from study.recordings.markersets import landmarks, load_markerset
from study.recordings.recording import Recording, RecordingError
from study.recordings.skeleton.calibrate import calibrate
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_scene
from study.recordings.synthetic.make import Recipe, synthesize
from study.recordings.view.gait import draw, page
from tests.recordings.bodies import axes_of_the_body


def motion_of(recording, calibration):
    drawn = draw_skeleton(calibration, recording)
    return ExportedMotion(drawn, recording, skeleton_scene(drawn, recording))


@pytest.fixture(scope="module")
def walk():
    """A walk of a synthetic body, the truth about it, and its motion."""
    recording, truth = synthesize(Recipe(900, 100.0, gait=True, markers="rizzoli", noise=0.0005))
    calibration = calibrate(recording, load_markerset("rizzoli"), recording)
    return recording, truth, motion_of(recording, calibration)


@pytest.fixture(scope="module")
def gait(walk):
    """Its gait."""
    return gait_of([walk[2]])


def test_events_of_feet_that_swing_as_a_cosine(walk):
    """Heels that are .3 cos(2π t / 1.1 s) in front of the pelvis strike at whole periods; toes leave half-way.

    To one frame of 10 ms. The pelvis faces along x of its anatomical axes, and turns by 40° on the way.
    """
    recording, _, motion = walk
    number = motion.skeleton.segments.index("pelvis")
    facing = Rotation.from_rotvec(np.radians(np.linspace(0, 40, 900))[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    axes = motion.skeleton.calibration.shape("pelvis").anatomy
    # forward along the world's x, up along z: columns x, y, z of the anatomical axes
    rotations = motion.skeleton.rotations.copy()
    standing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    rotations[number] = np.einsum("tij,jk,lk->ilt", facing, standing, axes)
    skeleton = replace(motion.skeleton, rotations=rotations)
    positions, points = recording.positions.copy(), landmarks(recording.markers)
    time, place = np.arange(900) / 100.0, skeleton.origins[number]
    for side, start in (("left", 0.0), ("right", 0.55)):
        for kind, shift in (("heel", 0.0), ("fifth metatarsal", 0.0)):
            ahead = 0.3 * np.cos(2 * np.pi * (time - start - shift) / 1.1)
            positions[recording.row(points[f"{side} {kind}"])] = place + ahead * facing[:, :, 0].T
    moved = replace(motion, skeleton=skeleton, recording=Recording("w", recording.markers, positions, 100.0))
    for side, start in (("left", 0.0), ("right", 0.55)):
        strikes, offs = gait_events(moved)[side]
        assert len(strikes) >= 6
        assert len(offs) >= 6
        for frames, phase in ((strikes, start), (offs, start + 0.55)):
            cycles = (frames / 100.0 - phase) / 1.1
            assert np.abs(cycles - np.round(cycles)).max() * 1.1 <= 0.01


@pytest.mark.parametrize("axes", [True, False])
def test_a_walk_of_known_speed(walk, axes):
    """A pelvis that goes at 1.2 m/s, up a ramp and swaying: speed, stride and cadence are those along the floor.

    It begins 9 m off the origin and ends 2 m beyond it. Heels and toes swing as a cosine of 1.1 s along the walk. The
    direction is that in which the pelvis faces, or moves, if it has no anatomical axes. Strikes to a frame of 10 ms.
    """
    recording, _, motion = walk
    number, time, points = (
        motion.skeleton.segments.index("pelvis"),
        np.arange(900) / 100.0,
        landmarks(recording.markers),
    )
    along = -np.array([np.cos(0.5), np.sin(0.5), 0.0])
    origins, rotations = motion.skeleton.origins.copy(), motion.skeleton.rotations.copy()
    origins[number] = np.array([[8.0], [4.0], [1.0]]) + 1.2 * along[:, None] * time + [[0.0], [0.0], [0.3]] * time
    shape = motion.skeleton.calibration.shape("pelvis")
    facing = np.column_stack([along, [0.0, 0.0, 1.0], np.cross(along, [0.0, 0.0, 1.0])])
    rotations[number] = (facing @ shape.anatomy.T)[:, :, None]
    shapes = tuple(
        replace(one, anatomy=np.full((3, 3), np.nan)) if one is shape and not axes else one
        for one in motion.skeleton.calibration.shapes
    )
    calibration = replace(motion.skeleton.calibration, shapes=shapes)
    skeleton = replace(motion.skeleton, origins=origins, rotations=rotations, calibration=calibration)
    positions = recording.positions.copy()
    for side, start in (("left", 0.0), ("right", 0.55)):
        swing = 0.3 * np.cos(2 * np.pi * (time - start) / 1.1)
        for kind in ("heel", "fifth metatarsal"):
            positions[recording.row(points[f"{side} {kind}"])] = origins[number] + swing * along[:, None]
    moved = replace(motion, skeleton=skeleton, recording=Recording("w", recording.markers, positions, 100.0))
    cycles = gait_of([moved]).cycles
    np.testing.assert_allclose(cycles["speed"], 1.2, rtol=1e-9)
    np.testing.assert_allclose(cycles["stride"], 1.2 * cycles["duration"], rtol=1e-9)
    np.testing.assert_allclose(cycles["cadence"], 120.0 / cycles["duration"], rtol=1e-12)
    for side, start in (("left", 0.0), ("right", 0.55)):
        rows = cycles[cycles["side"] == side]
        assert rows["cycle"].tolist() == list(range(1, len(rows) + 1))
        assert len(rows) >= 5
        strikes = np.append(rows["start"], rows["end"].iloc[-1])
        away = (strikes - start) / 1.1
        assert np.abs(away - np.round(away)).max() * 1.1 < 0.0101
        assert np.abs(rows["duration"] - 1.1).max() < 0.0201
        assert np.abs(rows["stance"] - 50.0).max() < 2.0
    if not axes:  # the last frames of the walk, in which it goes less than half a metre
        still = replace(
            skeleton, origins=origins - 1.2 * along[:, None] * time * (np.arange(len(origins)) == number)[:, None, None]
        )
        with pytest.raises(RecordingError, match=r"moves less than 0\.5 m, so that forward is not known"):
            gait_events(replace(moved, skeleton=still))


def test_what_is_printed(gait):
    """Cycles are counted by side; each parameter is mean ± standard deviation, each range that of the mean curve."""
    lines = [re.split(r"\s{2,}", line.strip()) for line in gait_lines(gait)]
    said = {line[0]: line[1:] for line in lines}
    sides = [gait.cycles[gait.cycles["side"] == side] for side in ("left", "right")]
    assert said["cycles"] == [str(len(rows)) for rows in sides]
    for words, key, form in (
        ("duration of a cycle / s", "duration", ".2f"),
        ("stance / %", "stance", ".1f"),
        ("stride / m", "stride", ".2f"),
        ("speed / (m/s)", "speed", ".2f"),
        ("cadence / (steps/min)", "cadence", ".0f"),
    ):
        pairs = [(np.mean(rows[key]), np.std(rows[key], ddof=1)) for rows in sides]
        assert said[words] == [f"{mean:{form}} ± {sd:{form}}" for mean, sd in pairs]
    for joint, angle in itertools.product(("hip", "knee", "ankle"), ANGLES):
        for place, side in enumerate(("left", "right")):
            own = gait.curves.query(f"side == '{side}' and joint == '{joint}' and angle == '{angle}'")
            curves = np.array([part[["value", "error"]].to_numpy() for _, part in own.groupby("cycle")])
            mean, error = curves[:, :, 0].mean(axis=0), np.sqrt((curves[:, :, 1] ** 2).mean(axis=0))
            words = f"{mean.min():.0f}° to {mean.max():.0f}°, ± {np.median(error):.1f}°"
            assert said[f"{joint} {angle}"][place] == words
    order = [line[0] for line in lines]
    wanted = [f"{joint} {angle}" for joint in ("hip", "knee", "ankle") for angle in ANGLES]
    assert [words for words in order if words in wanted] == wanted


def test_cycles_are_those_of_the_body(walk, gait):
    """Cycles follow one another, of one duration, left and right half a cycle apart as the body's phases are."""
    assert set(gait.cycles["side"]) == {"left", "right"}
    for _, rows in gait.cycles.groupby("side"):
        assert len(rows) >= 5
        np.testing.assert_allclose(rows["duration"], rows["end"] - rows["start"])
        np.testing.assert_allclose(rows["cadence"], 120.0 / rows["duration"])
        np.testing.assert_allclose(rows["speed"], rows["stride"] / rows["duration"])
        assert rows["duration"].std() < 0.05
        assert rows["stance"].between(40, 80).all()
        for (_, one), (_, other) in itertools.pairwise(rows.iterrows()):
            assert other["start"] >= one["end"]


def test_curves_are_the_angles_of_the_table(walk, gait):
    """At 0 and 100 % a curve has the angle and the error of its strikes; its means are those of NumPy."""
    angles = joint_angles(walk[2])
    for (side, cycle), rows in gait.curves.groupby(["side", "cycle"]):
        one = gait.cycles[(gait.cycles["side"] == side) & (gait.cycles["cycle"] == cycle)].iloc[0]
        first, last = round(one["start"] * 100), round(one["end"] * 100)
        for joint, angle in itertools.product(("hip", "knee", "ankle"), ANGLES):
            part = rows[(rows["joint"] == joint) & (rows["angle"] == angle)]
            assert list(part["percent"]) == list(PERCENT)
            for key, suffix in (("value", ""), ("error", "_error")):
                wanted = angles[f"{side}_{joint}_{angle}{suffix}"].to_numpy()[[first, last]]
                np.testing.assert_allclose(part[key].to_numpy()[[0, 100]], wanted, atol=1e-9)
    means = gait.means().query("side == 'left' and joint == 'knee' and angle == 'flexion'")
    table = gait.curves.query("side == 'left' and joint == 'knee' and angle == 'flexion'")
    stacked = np.array([part["value"].to_numpy() for _, part in table.groupby("cycle")])
    np.testing.assert_allclose(means["mean"], stacked.mean(axis=0))
    np.testing.assert_allclose(means["sd"], stacked.std(axis=0, ddof=1))
    assert (means["cycles"] == len(stacked)).all()


def test_the_mean_curve_is_the_true_one(walk, gait):
    """The mean flexion of hips and knees over the cycles is that of the true rotations at the same times to 1°."""
    _, truth, _ = walk
    axes = axes_of_the_body()
    world = {name: truth.rotations[truth.segments.index(name)] @ axes[name] for name in axes}
    for joint, parent, child, sign in (("hip", "pelvis", "thigh", 1.0), ("knee", "thigh", "shank", -1.0)):
        for side in ("left", "right"):
            above = parent if parent == "pelvis" else f"{side}_{parent}"
            turn = np.swapaxes(world[above], 1, 2) @ world[f"{side}_{child}"]
            true = sign * np.degrees(np.unwrap(np.arctan2(-turn[:, 0, 1], turn[:, 1, 1])))
            rows = gait.cycles[gait.cycles["side"] == side]
            times = [np.linspace(a, b, 101) for a, b in zip(rows["start"], rows["end"], strict=True)]
            wanted = np.mean([np.interp(t, np.arange(900) / 100.0, true) for t in times], axis=0)
            means = gait.means().query("angle == 'flexion'")
            found = means[(means["side"] == side) & (means["joint"] == joint)]["mean"]
            assert np.abs(found.to_numpy() - wanted).max() < 1.0


def test_gaps_of_a_curve_stay_missing(walk):
    """Where a knee's angle is missing the curve is, and its error; a hip that is seen is whole."""
    recording, _, motion = walk
    first = int(gait_events(motion)["left"][0][1]) + 30
    hidden = recording.positions.copy()
    segments = (load_markerset("rizzoli").segment(f"left_{name}") for name in ("shank", "foot"))
    rows = [recording.row(marker) for segment in segments for marker in segment.markers]
    hidden[rows, :, first : first + 60] = np.nan
    gappy = motion_of(Recording("gappy", recording.markers, hidden, 100.0), motion.skeleton.calibration)
    table, curves = joint_angles(gappy), gait_of([gappy]).curves
    missing = table["left_knee_flexion"].isna()
    assert 0 < missing.sum() <= 60
    knee = curves.query("side == 'left' and joint == 'knee' and angle == 'flexion'")
    assert knee["value"].isna().any()
    assert knee["value"].isna().equals(knee["error"].isna())
    assert not curves.query("joint == 'hip'")["value"].isna().any()


def test_doubted_joints_are_told(walk):
    """A joint of a leg that is doubted is named in the notes, with its reason; a reliable one is not."""
    recording, _, motion = walk
    calibration = motion.skeleton.calibration
    usable = [p.joint.name for p in calibration.joints if p.usable and p.joint.name.endswith(("hip", "knee", "ankle"))]
    assert usable
    joints = tuple(
        replace(p, status=JointStatus.UNSURE, reason="for this test") if p.joint.name == usable[0] else p
        for p in calibration.joints
    )
    notes = gait_of([motion_of(recording, replace(calibration, joints=joints))]).notes
    assert f"{usable[0]}: doubted: for this test" in notes
    own = gait_of([motion]).notes
    assert not [note for note in own if {*note.partition(": ")[0].split(", ")} & {*usable}]
    placed = replace(calibration["left_ankle"], status=JointStatus.LANDMARK, reason="midway between the malleoli")
    joints = tuple(placed if p.joint.name == "left_ankle" else p for p in calibration.joints)
    notes = gait_of([motion_of(recording, replace(calibration, joints=joints))]).notes
    assert "left_ankle: midway between the malleoli" in notes


def test_a_recording_without_a_cycle(walk, one_line):
    """Half a second has no cycle: an error names the walk; beside another walk it is a note."""
    recording, _, motion = walk
    short = motion_of(replace(recording.select(frames=slice(0, 50)), name="short"), motion.skeleton.calibration)
    with one_line(RecordingError, r"short: no whole cycle: two strikes of one heel are never seen in a row"):
        gait_of([short])
    both = gait_of([motion, short])
    assert any(note.startswith("short: no whole cycle") for note in both.notes)


def test_pictures_and_page(gait):
    """The page has nine panels with unique ids, the parameters, and escapes names; equal gaits give equal bytes."""
    text = page(gait, "a <walk>")
    assert text == page(gait, "a <walk>")
    assert text.count("<svg") == 9
    assert "a &lt;walk&gt;" in text
    assert "<walk>" not in text
    ids = [part.split('"')[0] for part in text.split(' id="')[1:]]
    assert len(ids) == len(set(ids))
    assert 'src="http' not in text
    assert 'href="http' not in text
    figure = draw(gait)
    assert len(figure.axes) == 9
    lines = [line for line in figure.axes[3].lines if line.get_label() in ("left", "right")]
    wanted = gait.means().query("side == 'left' and joint == 'knee' and angle == 'flexion'")["mean"]
    np.testing.assert_allclose(lines[0].get_ydata(), wanted)

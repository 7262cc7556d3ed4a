"""Gait: events, cycles and curves of a synthetic body that walks."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import study
from study.recordings.events import Course, gait_events
from study.recordings.export.tree import ExportedMotion, joint_angles
from study.recordings.gait import ANGLES, PANELS, PERCENT, Gait, _parameters, _spikes, gait_lines, gait_of
from study.recordings.joints.estimate import JointStatus
from study.recordings.markersets import choose, load_markerset
from study.recordings.recording import Contact, GaitEvent, Laboratory, Recording, RecordingError
from study.recordings.skeleton.calibrate import calibrate
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_scene
from study.recordings.synthetic.make import Recipe, synthesize
from study.recordings.view.gait import draw, page
from tests.recordings.bodies import axes_of_the_body
from tests.recordings.walks import walk as made_walk


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


def off(events, truth):
    """Errors of events, seconds, by kind: the distance to the nearest true one of the side and kind."""
    errors = {"strike": [], "off": []}
    for event in events:
        errors[event.kind].append(min(event.time - truth[event.side, event.kind], key=abs))
    return {kind: np.array(values) for kind, values in errors.items()}


@pytest.mark.parametrize(
    ("height", "speed", "belt"),
    [
        *[(1.75, 0.7, True), (1.75, 1.8, False), (1.1, 0.6, False)],
        *(
            pytest.param(*walk, marks=pytest.mark.slow)
            for walk in ((1.75, 1.3, False), (1.1, 1.0, True), (1.2, 1.4, False))
        ),
    ],
)
def test_events_by_markers_are_the_true_ones(height, speed, belt):
    """Strikes and offs of adults and children, on a floor and on a belt, are within 15 ms in the median.

    None is lost but at the ends, none is made up. Speed, stride, step, width and stance are those of the walk.
    """
    recording, truth = made_walk(1, height, speed, belt=belt, yaw=2.0)
    gait = gait_of([motion_of(recording, calibrate_by_name(recording))])
    errors = off(gait.events[0], truth)
    assert {event.source for event in gait.events[0]} == {"markers"}
    for kind, values in errors.items():
        assert abs(np.median(values)) <= 0.015
        assert np.abs(values).max() <= 0.03
        assert sum(len(truth[side, kind]) for side in ("left", "right")) - len(values) <= 4
    stride = speed * np.diff(truth["left", "strike"])[0]
    size = height / 1.75
    wanted = {
        "stride": stride,
        "speed": speed,
        "step": 0.5 * stride,
        "width": 0.18 * size,
        "cadence": 120 * speed / stride,
    }
    for name, value in wanted.items():
        np.testing.assert_allclose(gait.cycles[name].mean(), value, rtol=0.02)
    assert abs(gait.cycles["stance"].mean() - 62.0) < 3.0
    assert abs(gait.cycles["double_support"].mean() - 24.0) < 6.0
    assert any("on a treadmill" in note for note in gait.notes) == belt


def calibrate_by_name(recording):
    placed = choose(recording)
    assert placed.whole.name == "by-name"
    return calibrate(placed.recording, placed.markerset, recording)


WANDS = {"~ASIS": "~_ASIS", "V.Sacral": "L_PSIS R_PSIS", "~Heel": "~_HEEL", "~Toe": "~_TOE", "~Knee": "~_LAT_KNEE"}
WANDS |= {"~Ankle": "~_LAT_ANKLE", "~Thigh": "~_THIGH_1 ~_THIGH_2", "~Shank": "~_SHANK_1 ~_SHANK_2"}
HAYES = ["~ASI", "VSAC", "~HEE", "~TOE", "~KNE", "~ANK", "~THI", "~SHA"]
CODA = {"~PSIS": "~_PSIS", "~Ant.Fem": "~_THIGH_1", "~Post.Fem": "~_THIGH_4", "~Ant.Tib": "~_SHANK_1"}
CODA |= {"~Post.Tib": "~_SHANK_4"} | {label: WANDS[label] for label in ("~ASIS", "~Knee", "~Ankle", "~Heel", "~Toe")}
SHORT = {"~ASI": "~_ASIS", "~PSI": "~_PSIS", "~HEE": "~_HEEL", "~MT1": "~_MT1", "~MT5": "~_MT5"}
SHORT |= {f"~TH{k}": f"~_THIGH_{k}" for k in range(1, 5)} | {f"~SK{k}": f"~_SHANK_{k}" for k in range(1, 5)}
FEET = {label: marker for label, marker in SHORT.items() if label not in ("~HEE", "~MT1", "~MT5")}
FEET |= {"~FT1": "~_HEEL", "~FT2": "~_MT5", "~FT3": "~_MT1"}
WORN = {
    "Helen Hayes, Cortex": {label.replace("~", "~."): marker for label, marker in WANDS.items()},
    "Helen Hayes, short": dict(zip(HAYES, WANDS.values(), strict=True)),
    "Codamotion": {label.replace("~", "~."): marker for label, marker in CODA.items()},
    "Visual3D, short": SHORT,
}
"""The labels of a set, and the markers of a made walk in whose middle each is; ~ stands for a side."""


def worn(recording, labels):
    """The recording of a body that wears a set; its wands stand out by 6 cm."""
    markers, positions = [], []
    for label, marker in labels.items():
        for letter in "LR" if "~" in label else " ":
            places = [recording.of(one.replace("~", letter)) for one in marker.split()]
            out = 0.06 * {"L": 1, "R": -1, " ": 0}[letter] * label.lower().endswith(("thigh", "shank", "thi", "sha"))
            markers.append(label.replace("~", letter))
            positions.append(np.mean(places, axis=0) + np.array([[0.0], [out], [0.0]]))
    return replace(recording, markers=tuple(markers), positions=np.array(positions))


@pytest.mark.parametrize("name", WORN)
def test_sets_of_laboratories_have_a_gait_table(name):
    """Knees and hips bend as the limbs do; with widths the wands of Helen Hayes show the angles of Grood and Suntay.

    Without widths a note names the points that no label is.
    """
    recording, _ = made_walk(3, seconds=4.0)
    markers = worn(recording, WORN[name])
    gait = study.find_gait(markers, hips="regression")
    assert {"hip", "knee", "ankle", "pelvis"} <= {*gait.means()["joint"]}
    assert any("no label is that of a medial epicondyle or a medial malleolus" in note for note in gait.notes)
    measured = gait
    if name.startswith("Helen Hayes"):  # the middle of a knee and an ankle is 5 cm from their markers
        widths = {f"{side} {joint}": 0.086 for side in ("left", "right") for joint in ("knee", "ankle")}
        measured = study.find_gait(replace(markers, widths=widths), hips="regression")
        assert not any("no anatomical axes" in note for note in measured.notes)
    for side, letter, out in (("left", "L", 0.085), ("right", "R", -0.085)):
        pelvis = 0.5 * (recording.of("L_ASIS") + recording.of("R_ASIS"))
        knee, ankle = (
            0.5 * (recording.of(f"{letter}_LAT_{end}") + recording.of(f"{letter}_MED_{end}"))
            for end in ("KNEE", "ANKLE")
        )
        thigh, shank = knee - pelvis - np.array([[-0.07], [out], [-0.08]]), ankle - knee
        lean = [np.degrees(np.arctan2(line[0], -line[2])) for line in (thigh, shank)]
        for joint, wanted in (("hip", lean[0]), ("knee", lean[0] - lean[1])):
            means = measured.means().query(f"side == '{side}' and joint == '{joint}' and angle == 'flexion'")["mean"]
            assert abs(means.min() - wanted.min()) < 3.0
            assert abs(means.max() - wanted.max()) < 3.0


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_angles_of_a_pelvis_that_is_turned(yaw):
    """The front 12° down, the left side 5° up, then it 8° to the front: those of the walk, whatever its direction.

    For the right side obliquity and rotation are the opposite; feet point ahead. Sequence: Wu et al. 2002.
    """
    recording, _ = made_walk(3, seconds=4.0)
    rows = [recording.row(f"{side}_{spine}") for side in "LR" for spine in ("ASIS", "PSIS")]
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # rows: ahead, up, to the right
    turn = axes.T @ Rotation.from_euler("ZXY", [-12.0, 5.0, -8.0], degrees=True).as_matrix() @ axes
    positions, middle = recording.positions.copy(), recording.positions[rows].mean(axis=0)
    positions[rows] = middle + np.einsum("ij,mjt->mit", turn, positions[rows] - middle)
    way = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix()
    gait = study.find_gait(replace(recording, positions=np.einsum("ij,mjt->mit", way, positions)), hips="regression")
    means = gait.means().groupby(["joint", "angle", "side"])["mean"].mean()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for angle, wanted in (("tilt", 12.0), ("obliquity", 5.0 * sign), ("rotation", 8.0 * sign)):
            assert means["pelvis", angle, side] == pytest.approx(wanted, abs=0.3)
        assert means["foot", "progression", side] == pytest.approx(0.0, abs=0.5)


def test_a_walk_without_heels_names_the_labels_that_lack():
    recording, _ = made_walk(3, seconds=4.0)
    with pytest.raises(RecordingError, match="no label of the file is that of a left heel, left toe, right heel"):
        study.find_gait(worn(recording, FEET), hips="regression")


def test_events_of_the_file_go_first_then_plates():
    """A side with two strikes in the file has its strikes alone; a plate's counts if the heel is on it."""
    recording, truth = made_walk(2)
    left, right = (truth[side, "strike"] for side in ("left", "right"))
    told = tuple(GaitEvent("left", "strike", time + 0.004) for time in left[1:3])
    heel = recording.of("R_HEEL")[:, round(right[2] * 100)]
    plate = heel + np.array([[-0.1, -0.2, 0], [0.5, -0.2, 0], [0.5, 0.2, 0], [-0.1, 0.2, 0]])
    beside = plate + np.array([0.3, 0.0, 0.0])
    loads = Contact(right[2] + 0.006, np.nan, plate), Contact(right[1] + 0.02, np.nan, beside)
    marked = replace(recording, laboratory=Laboratory(told, loads))
    gait = gait_of([motion_of(marked, calibrate_by_name(recording))])
    strikes = [event for event in gait.events[0] if event.kind == "strike"]
    assert [event for event in strikes if event.side == "left"] == list(told)
    by_plate = [event.time for event in strikes if event.source == "plate"]
    np.testing.assert_allclose(by_plate, [right[2] + 0.006])
    assert {event.source for event in strikes if event.side == "right"} == {"plate", "markers"}
    rows = gait.cycles
    assert list(rows.loc[rows["side"] == "left", "events"]) == ["file"]
    assert {"plate and markers", "markers and plate"} <= set(rows.loc[rows["side"] == "right", "events"])
    assert any("2 strikes by the file, 1 strike by force plates" in note for note in gait.notes)


def test_events_without_a_heel():
    """A walk without markers of heels has the cycles that the file marks; step and width are not known.

    A strike after the last frame, as in a file that was cut, ends no cycle.
    """
    recording, truth = made_walk(3)
    told = tuple(GaitEvent(side, kind, time) for (side, kind), times in truth.items() for time in times)
    side = min(("left", "right"), key=lambda side: truth[side, "strike"][-1])
    told += (GaitEvent(side, "strike", truth[side, "strike"][-1] + np.diff(truth[side, "strike"])[0]),)
    assert told[-1].time > recording.frames / recording.rate
    bare = recording.select([m for m in recording.markers if not m.endswith(("HEEL", "TOE", "MT1", "MT5"))])
    bare = replace(bare, laboratory=Laboratory(told))
    gait = gait_of([motion_of(bare, calibrate_by_name(bare))])
    assert len(gait.cycles) == sum(len(truth[side, "strike"]) - 1 for side in ("left", "right"))
    np.testing.assert_allclose(gait.cycles["stance"], 62.0, atol=1e-6)
    assert gait.cycles["step"].isna().all()


def test_parameters_of_a_cycle_by_hand():
    """A second uphill: stride and speed are horizontal, step and width between the heels at their own strikes.

    Both feet stand in the first and the sixth tenth of it. Without an off of the other foot that is not known.
    """
    time = np.arange(121) / 100.0 - 0.2  # it begins 0.2 s after the first frame
    still = np.zeros_like(time)
    ahead = np.stack([1.0 + still, still, still])
    heels = {
        "left heel": np.stack([1.25 * (time > 0.9), 0.12 + still, still]),
        "right heel": np.stack([0.6 * (time > 0.4), -0.08 + still, still]),
    }
    course = Course(np.stack([1.2 * time, still, 0.5 * time]), ahead, ahead, 0.0, np.zeros((3, 121)), heels)
    events = [GaitEvent("right", "off", 0.3), GaitEvent("right", "strike", 0.7), GaitEvent("left", "off", 0.8)]
    strikes = GaitEvent("left", "strike", 0.2), GaitEvent("left", "strike", 1.2)
    found = _parameters(course, 100.0, strikes, 0.8, [*events, *strikes])
    wanted = {"stance": 60.0, "stride": 1.2, "speed": 1.2, "cadence": 120.0, "step": 0.65, "width": 0.2}
    assert found == pytest.approx(wanted | {"double_support": 20.0})
    fewer = _parameters(course, 100.0, strikes, 0.8, [*events[1:], *strikes])
    assert fewer == pytest.approx(wanted | {"double_support": np.nan}, nan_ok=True)


def test_without_a_pelvis(one_line):
    """A marker set without the spines of the pelvis is refused with a sentence."""
    body, _ = synthesize(Recipe(200, 100.0))
    motion = motion_of(body, calibrate(body, load_markerset("cmu41")))
    with one_line(RecordingError, "no pelvis with both spines"):
        gait_of([motion])


def vicon(shared_file, name, still):
    """The gait of a subject whose file has Vicon's own results, and the file's points by label (3, frames)."""
    import ezc3d

    files = [shared_file(f"plug_in_gait/{one}.c3d") for one in (name, still)]
    gait = study.find_gait(files[0], static=files[1], hips="regression")
    file = ezc3d.c3d(str(files[0]))
    point = file["parameters"]["POINT"]
    labels = [*point["LABELS"]["value"], *point["LABELS2"]["value"]]
    return gait, {label: file["data"]["points"][:3, row] for row, label in enumerate(labels)}


@pytest.mark.parametrize(("name", "still"), [("HC030A05", "HC030A01"), ("HC039A17", "HC039A01")])
def test_vicons_events_and_angles(shared_file, name, still):
    """Events are the file's; by plates they agree to 10 ms, by markers within 15 ms in the median and 30 at most.

    The pelvis' angles are Vicon's to 2.5°, for Vicon takes the laboratory's axis for the way; ankle flexion to 5°.
    """
    gait, points = vicon(shared_file, name, still)
    assert {event.source for event in gait.events[0]} == {"file"}
    assert list(gait.cycles["side"]) == ["left", "right"]
    motion, told = gait.motions[0], gait.events[0]
    loads = motion.recording.laboratory.contacts
    for laboratory, source, most in ((Laboratory(contacts=loads), "plate", 0.010), (Laboratory(), "markers", 0.030)):
        others = gait_events(replace(motion, recording=replace(motion.recording, laboratory=laboratory)))
        apart = [
            min(
                (o.time - e.time for o in others if (o.side, o.kind, o.source) == (e.side, e.kind, source)),
                key=abs,
                default=9,
            )
            for e in told
        ]
        near = np.array([x for x in apart if abs(x) < 0.1])
        assert len(near) >= (4 if source == "plate" else 7)
        assert np.abs(near).max() <= most
        assert abs(np.median(near)) <= 0.015
    for side, column in (("left", "L"), ("right", "R")):
        row = gait.cycles[gait.cycles["side"] == side].iloc[0]
        frames = np.linspace(row["start"], row["end"], 101) * 100.0
        rows = gait.curves[gait.curves["side"] == side].set_index(["joint", "angle"]).sort_index()
        for joint, angle, label, axis, most in (
            *(("pelvis", kind, "PelvisAngles", k, 2.5) for k, kind in enumerate(("tilt", "obliquity", "rotation"))),
            ("ankle", "flexion", "AnkleAngles", 0, 5.0),
        ):
            own = rows.loc[(joint, angle), "value"].to_numpy()
            theirs = points[f"{column}{label}"][axis]
            theirs = np.interp(frames, np.arange(len(theirs)), theirs)
            if not np.isnan(own).all():
                assert abs(np.nanmedian(own - theirs)) < most


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
            mean, spread = curves[:, :, 0].mean(axis=0), curves[:, :, 0].var(axis=0, ddof=1) / len(curves)
            error = np.sqrt((curves[:, :, 1] ** 2).mean(axis=0) + spread)  # of three cycles or more
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
        times = one["start"], one["end"]
        for joint, angle in itertools.product(("hip", "knee", "ankle"), ANGLES):
            part = rows[(rows["joint"] == joint) & (rows["angle"] == angle)]
            assert list(part["percent"]) == list(PERCENT)
            for key, suffix in (("value", ""), ("error", "_error")):
                wanted = np.interp(times, angles["time"], angles[f"{side}_{joint}_{angle}{suffix}"])
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
    strikes = [event.time for event in gait_events(motion) if (event.side, event.kind) == ("left", "strike")]
    first = int(strikes[1] * 100) + 30
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
    """The page has a panel for each angle and the body, with unique ids, the parameters, and escapes names."""
    text = page(gait, "a <walk>")
    assert text == page(gait, "a <walk>")
    assert text.count("<svg") == len(PANELS) + 1
    assert "a &lt;walk&gt;" in text
    assert "<walk>" not in text
    ids = [part.split('"')[0] for part in text.split(' id="')[1:]]
    assert len(ids) == len(set(ids))
    assert 'src="http' not in text
    assert 'href="http' not in text
    figure = draw(gait)
    assert len(figure.axes) == len(PANELS) + 1
    lines = [line for line in figure.axes[6].lines if line.get_label() in ("left", "right")]
    wanted = gait.means().query("side == 'left' and joint == 'knee' and angle == 'flexion'")["mean"]
    np.testing.assert_allclose(lines[0].get_ydata(), wanted)


def some(gait, cycles, **changes):
    """The gait with the first cycles of each side."""
    rows, curves = (table[table["cycle"] <= cycles] for table in (gait.cycles, gait.curves))
    return Gait(**{**vars(gait), "cycles": rows, "curves": curves, **changes})


def test_single_cycles_and_no_spread_below_three(gait):
    """Two cycles have thin lines and no standard deviation; three have a band; the table says ± from three on."""
    two, three = some(gait, 2), some(gait, 3)
    assert two.means()["sd"].isna().all()
    assert three.means()["sd"].notna().all()
    assert not any("±" in line for line in list(gait_lines(two))[:9])
    assert any("±" in line for line in list(gait_lines(three))[:9])
    for shown, count in ((two, 2), (three, 3)):
        ax = draw(shown).axes[6]
        assert sum(line.get_linewidth() == 0.4 for line in ax.lines) == 2 * count
        assert (
            len([band for band in ax.collections if len(band.get_paths()) and band.get_alpha() == 0.15])
            == (count > 2) * 2
        )
    means = three.means()
    np.testing.assert_allclose(means["total"], np.sqrt(means["error"] ** 2 + means["sd"] ** 2 / 3))


def test_a_spike_is_marked_and_a_reason_stands_in_place_of_a_curve(gait):
    """A point 12° off its neighbours is suspect and gets a ring; a panel without a curve has the reason."""
    assert not gait.curves["suspect"].any()
    curves = gait.curves.copy()
    gone = curves["joint"] == "ankle"
    curves.loc[gone, ["value", "error"]] = np.nan
    reasons = dict.fromkeys(itertools.product(("left", "right"), ["ankle"], ANGLES), "its knee bends backwards")
    ax = draw(Gait(**{**vars(gait), "curves": curves, "reasons": reasons})).axes[9]
    assert [" ".join(t.get_text().split()) for t in ax.texts] == ["missing: its knee bends backwards"]
    values = np.sin(np.linspace(0, 6, 101)) * 30
    assert not _spikes(values).any()
    values[26] += 12.0
    assert list(np.flatnonzero(_spikes(values))) == [26]

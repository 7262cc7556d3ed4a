"""Lines of frames: what is read, and what is not.

Joints of a stream against the fit of all points at once, the truth, and their own errors.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import study
from study.fits.answers.markers import mgdk_so_far
from study.recordings.live import FrameError, LiveJoints, read_frame
from study.recordings.one_joint import find_clusters, fit_one_joint
from study.recordings.recording import Recording
from tests.recordings.hips import CENTRE, PELVIS, THIGH, hip_motion, in_axes_of


def test_a_frame():
    """Positions in metres; markers that are not seen are not there."""
    frame = read_frame('{"LASI": [1, 2.5, -3], "RASI": null}\n', 0.001)
    assert list(frame) == ["LASI"]
    np.testing.assert_allclose(frame["LASI"], [0.001, 0.0025, -0.003])
    assert read_frame("{}", 1.0) == {}


NUMBERS = "the position of 'LASI' is not three finite numbers"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("LASI 1 2 3", "no JSON"),
        ('{"LASI": [1, 2, 3]', "no JSON"),
        ("[" * 100_000, "no JSON"),
        (f'{{"LASI": [1, 2, 1{"0" * 5000}]}}', "no JSON"),
        ("[1, 2, 3]", "not an object of labels and positions"),
        ("7", "not an object of labels and positions"),
        ('{"LASI": "here"}', NUMBERS),
        *((f'{{"LASI": [1, 2, {x}]}}', NUMBERS) for x in ("NaN", "1e400", "1" + "0" * 320, "true", "null")),
        ('{"LASI": [1, 2]}', NUMBERS),
    ],
)
def test_what_is_no_frame(line, words):
    with pytest.raises(FrameError, match=words):
        read_frame(line, 1.0)


PARENT, CHILD = tuple("ABCD"), tuple("EFG")


def frames(count, repeat=1, **motion):
    """Frames of a pelvis with a thigh, in random poses, each of them repeated with the same noise."""
    x, _, _ = hip_motion(count, **motion)
    for t in np.repeat(np.arange(count), repeat):
        yield dict(zip(PARENT + CHILD, x[:, :, t], strict=True))


def hip(stream=(), parent=PARENT):
    """The joint of a stream."""
    joints = LiveJoints([("hip", parent, CHILD)])
    for frame in stream:
        joints.add(frame)
    return joints


def grown(joints):
    """The answer for the joint, and its distance from its true place in the axes of the fit."""
    answer = joints.answers()["hip"]
    return answer, answer.fit.center - in_axes_of(joints.joints["hip"].parent.template, PELVIS, CENTRE)


def test_moments_give_what_points_give(rng, on_cap):
    """The centre, radii and noise of `mgdk` for the same points; the covariance is the same bound, to 5 %."""
    sets = [on_cap(rng, 400, 40.0, noise=0.002, radius=r)[0] for r in (0.1, 0.3)]
    growing = [study.Incremental(3) for _ in sets]
    for part, points in zip(growing, sets, strict=True):
        for few in np.array_split(points, 7):
            part.update(few)
    one, all_at_once = mgdk_so_far(growing), study.mgdk(sets)
    np.testing.assert_allclose(one.center, all_at_once.center, atol=1e-9)
    np.testing.assert_allclose(one.radii, all_at_once.radii, rtol=1e-7)
    assert one.sigma == pytest.approx(all_at_once.sigma, rel=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(one.covariance)), all_at_once.standard_errors, rtol=0.05)


@pytest.mark.parametrize("repeat", [1, 6])
def test_errors_are_those_of_the_jackknife(repeat):
    """Squared errors of 24 streams are as stated, be each frame new or there six times (false alarms: 1 in 1000).

    They are those of the place in the named frame, to which its own noise adds, and without that those of the blocks.
    """
    ratios = []
    for seed in range(24):
        joints = hip(frames(240 // repeat, seed=seed, repeat=repeat))
        answer, off = grown(joints)
        axes = joints.joints["hip"].parent.axes_covariance(answer.fit.center)
        x, _, place = hip_motion(240 // repeat, seed=seed)
        there = (answer.frame - 1) // repeat
        named = x[:4, :, there].mean(axis=0) + answer.fit.center - place[there]
        within = answer.fit.covariance - axes
        ratios.append([off @ off / np.trace(within), named @ named / np.trace(answer.fit.covariance)])
    assert (np.mean(ratios, axis=0) > 0.4).all()
    assert (np.mean(ratios, axis=0) < 2.0).all()


@pytest.mark.parametrize(("share", "doubted"), [(0.0, False), (0.01, True), (0.05, True), (0.2, True)])
def test_exchanged_labels_are_doubted(share, doubted):
    """Of 4 streams of 1500 frames all are ok, or none if labels are exchanged; they were, off by 10.8 mm at ± 3.5."""
    rng = np.random.default_rng(7)
    for seed in range(4):
        stream = list(frames(1500, seed=seed))
        for k in np.flatnonzero(rng.uniform(size=1500) < share):
            stream[k] |= {"E": stream[k]["F"], "F": stream[k]["E"]}
        answer = hip(stream).answers()["hip"]
        assert answer.ok != doubted
        assert ("out of place" in answer.words) == doubted


def test_a_marker_that_is_knocked_halfway_is_doubted():
    """A thigh marker 2 cm further from the hip in the second half of the stream."""
    x, _, place = hip_motion(1500, seed=3)
    away = x[4] - place.T
    x[4, :, 750:] += 0.02 * (away / np.linalg.norm(away, axis=0))[:, 750:]
    answer = hip(dict(zip(PARENT + CHILD, x[:, :, t], strict=True)) for t in range(1500)).answers()["hip"]
    assert 0.4 < answer.far < 0.6
    assert "of the frames a marker is out of place: labels exchanged, or a marker knocked" in answer.doubt


def test_a_joint_improves_in_constant_memory():
    """The error falls, the answer is ok at last, and there are never more than sixteen blocks."""
    joints = hip()
    errors = []
    for number, frame in enumerate(frames(3000), start=1):
        joints.add(frame)
        if number in (100, 3000):
            errors.append(joints.answers()["hip"].error)
        assert len(joints.joints["hip"].blocks) <= 16
    assert errors[1] < errors[0]
    answer = joints.answers()["hip"]
    assert answer.ok
    assert " mm in the parent's axes of frame 1; noise" in answer.words
    assert answer.words.endswith("9000 samples; ok")
    turn = Rotation.from_rotvec(np.random.default_rng(9).uniform(-0.5, 0.5, (20_000, 3)))
    spread = [np.cov(turn.apply(x / np.linalg.norm(x)).T) for x in THIGH]
    expected = np.sqrt(np.linalg.eigvalsh(np.mean(spread, axis=0)))
    np.testing.assert_allclose(answer.angles, expected, rtol=0.05)


def test_case_of_labels():
    """Small and capital letters are alike; where labels differ in nothing else, the one so spelt is the marker."""
    stream = list(frames(30))
    joints = hip(stream, [label.lower() for label in PARENT])
    assert not joints.lacking
    assert np.array_equal(joints.answers()["hip"].fit.center, grown(hip(stream))[0].fit.center)
    doubled = hip()
    for number, frame in enumerate(stream):
        seen = {label: place for label, place in frame.items() if label != "E" or number % 2 == 0}
        doubled.add({"e": np.zeros(3), **seen})
    assert int(doubled.answers()["hip"].fit.count.sum()) == 30 * 3 - 15


def test_too_little_is_not_ok():
    """Neither a joint that hardly turned, nor one of few frames, nor one without frames."""
    still = grown(hip(frames(600, sweep=0.02, noise=1e-4)))[0]
    assert not still.ok
    assert still.words.endswith("unsure: it moved by less than 2° about some direction")
    noisy = grown(hip(frames(600, sweep=0.1, noise=0.01)))[0]
    assert noisy.error > 0.01
    assert "; unsure: its error is above 1 cm" in noisy.words
    few = grown(hip(frames(30)))[0]
    assert (few.ok, few.error) == (False, np.inf)
    assert few.words.endswith("unsure: too few frames to know its error")
    nothing = hip().answers()["hip"]
    assert (nothing.ok, nothing.words) == (False, "no frame has all markers of its parent")


def test_segments_that_never_come():
    """The answer says whose markers lack, and the stream knows their labels."""
    for labels, words in (
        (PARENT, "no frame has a marker of its child and enough of its parent's"),
        (CHILD, "no frame has all markers of its parent"),
    ):
        joints = hip({label: frame[label] for label in labels} for frame in frames(60))
        answer = joints.answers()["hip"]
        assert (answer.ok, answer.words) == (False, words)
        assert tuple(joints.labels) == labels
        assert {*joints.lacking, *labels} == {*PARENT, *CHILD}


def test_gaps():
    """Markers that are missing in some frames, the parent's among them, leave the centre where it is."""
    rng = np.random.default_rng(5)
    stream = [next(whole := frames(800))]
    stream += [{label: x for label, x in frame.items() if rng.random() > 0.2} for frame in whole]
    answer, off = grown(hip(stream))
    assert answer.ok
    assert np.linalg.norm(off) < 4 * answer.error


SPIKE = np.array([3.0, -8.0, 5.0])


@pytest.mark.parametrize("every", [1, 100], ids=["an answer a frame", "an answer a hundred frames"])
@pytest.mark.parametrize(
    ("number", "marker", "place"),
    [
        (0, None, np.zeros(3)),
        (0, "A", SPIKE),
        (0, "E", SPIKE),
        (40, "A", SPIKE),
        (40, "E", SPIKE),
        (40, "F", 1e6 * SPIKE),
    ],
)
def test_a_frame_of_zeros_or_a_spike_costs_that_frame(every, number, marker, place):
    """The first frame, or a later one, is wrong in one marker or in all: the joint is as near as without it."""
    joints = hip()
    for k, frame in enumerate(frames(400)):
        wrong = dict.fromkeys([marker] if marker else frame, place) if k == number else {}
        joints.add(frame | wrong)
        if (every == 1 and abs(k - number) < 8) or k % 100 == 99:
            joints.answers()
    answer, off = grown(joints)
    assert answer.ok
    assert np.linalg.norm(off) < 0.005  # five times the noise of a coordinate
    assert tuple(joints.zeros) == (() if marker else PARENT + CHILD)


def test_markers_that_jump_to_and_fro_are_counted():
    """Every tenth frame has a spike: those samples are left out, and no others."""
    joints = hip(x | ({"E": x["E"] + SPIKE} if k % 10 == 9 else {}) for k, x in enumerate(frames(400)))
    assert int(joints.answers()["hip"].fit.count.sum()) == 400 * 3 - 40
    assert joints.jumps == 40


def test_no_sound_sample_is_left_out():
    """A leg that rests and then swings by 60° within ten frames jumps nowhere."""
    turn = Rotation.from_rotvec([[np.radians(60) * np.clip((t - 40) / 10, 0, 1), 0, 0] for t in range(100)])
    places = {label: CENTRE + turn.apply(x) for label, x in zip(CHILD, THIGH, strict=True)}
    still = dict(zip(PARENT, PELVIS, strict=True))
    joints = hip(still | {label: x[t] for label, x in places.items()} for t in range(100))
    joints.answers()
    assert joints.jumps == 0


def test_the_centre_is_in_the_axes_of_the_whole_recording():
    """In axes and shape a stream and `study joint` agree to the noise; the axes are the world's in the named frame.

    Before, the axes were those of whichever early frame was most typical, which nothing named.
    """
    x, _, hip = hip_motion(1200, noise=0.0005, seed=5)
    x[0, :, :3] = np.nan  # the first frame with all markers is the fourth
    labels = ["P1", "P2", "P3", "P4", "T1", "T2", "T3"]
    joints = LiveJoints([("joint", labels[:4], labels[4:])])
    for t in range(1200):
        joints.add({label: x[k, :, t] for k, label in enumerate(labels) if not np.isnan(x[k, 0, t])})
    (row,) = joints.data()
    assert row["axes_frame"] == 4
    assert "mm in the parent's axes of frame 4; noise" in joints.answers()["joint"].words
    shape = np.array([row["parent_markers"][label] for label in labels[:4]])
    there = x[:4, :, 3]
    np.testing.assert_allclose(shape, there - there.mean(axis=0), atol=0.004)
    center = np.array(row["center"])
    np.testing.assert_allclose(there.mean(axis=0) + center, hip[3], atol=0.004)
    recording = Recording("hip", tuple(labels), x, 100.0)
    whole = fit_one_joint(recording, find_clusters(recording, "P1,P2,P3,P4", "T1,T2,T3"))
    np.testing.assert_allclose(center, whole.found.in_parent, atol=0.002)
    assert whole.frame == 4
    assert row["ok"]

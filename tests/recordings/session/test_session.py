"""Several trials of one session in one calibration: joints from the trials that moved them; other persons refused.

Pooled places against the weighted mean written out by hand; bodies of known joints; a functional trial cut into the
halves that move one hip each.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.joints.center import CenterFit
from study.recordings.joints.estimate import USABLE, Estimate, JointStatus, SymmetricFit
from study.recordings.joints.find import JointPlace, allowance, exchange, find_joints
from study.recordings.markersets import Joint, MarkerSet, Segment, load_markerset, match
from study.recordings.recording import Recording, RecordingError
from study.recordings.session import (
    calibrate_session,
    pool_places,
    refit_shapes,
    session_lines,
    session_table,
)
from study.recordings.skeleton.calibrate import calibrate, other_subject
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.synthetic.make import PARTS, Recipe, body, draw_motion, marker_noise, skin_motion
from tests.recordings.hips import in_axes_of

MARKERSET = load_markerset("rizzoli")
HIPS = ["left_hip", "right_hip"]
SEGMENTS = tuple(segment for segment in MARKERSET.segments if segment.name in ("pelvis", "left_thigh", "right_thigh"))
JOINTS = tuple(joint for joint in MARKERSET.joints if joint.name in HIPS)
HIPS_ALONE = MarkerSet(name="hips", segments=SEGMENTS, joints=JOINTS)


def body_trial(name, moving, seed, who=0, still=0.1, skin="mixed", tissue=0.004, frames=1000, reach=0.8):
    """A trial of a synthetic body with the markers of `rizzoli`, in which only the named joints move.

    The others sway by the share ``still`` of their ranges. ``who`` is the subject, whose skin moves alike in all of
    its trials.
    """
    recipe = Recipe(frames=frames, rate=100.0, seed=who, soft_tissue=tissue, skin=skin, markers="rizzoli")
    reaches = dict.fromkeys(moving, reach)
    motions = {r: draw_motion(frames, 100.0, seed, height=1.75, reach=r, style="smooth") for r in (still, reach)}
    rows = {part.name: row for row, part in enumerate(PARTS)}
    rotations, origins, quiet = (array.copy() for array in motions[still])
    phases = still * quiet
    for row, part in enumerate(PARTS[1:], start=1):
        parent, one = rows[part.parent], motions[reaches.get(part.joint, still)][0]
        rotations[row] = rotations[parent] @ np.swapaxes(one[parent], 1, 2) @ one[row]
        origins[row] = origins[parent] + rotations[parent].dot(1.75 * np.array(part.at)).T
        phases[row] = reaches.get(part.joint, still) * quiet[row]
    parts = body("rizzoli")
    segments = np.array([row for row, part in enumerate(parts) for _ in part.markers])
    offsets = 1.75 * np.array([place for part in parts for place in part.markers.values()])
    local = offsets[:, :, None] + skin_motion(recipe, rotations, phases, segments)
    x = np.einsum("mtij,mjt->mit", rotations[segments], local) + origins[segments]
    x = x + marker_noise(x.shape, 0.001, seed)
    return Recording(name, tuple(label for part in parts for label in part.markers), x, 100.0)


def body_session(who, **options):
    """The trials of one subject: left hip, right hip, knees; and a static one."""
    moving = {"left": ["left_hip"], "right": ["right_hip"], "knees": ["left_knee", "right_knee"]}
    numbered = enumerate(moving.items(), 1000 * who + 1)
    trials = [body_trial(name, joints, number, who, **options) for number, (name, joints) in numbered]
    return trials, body_trial("static", [], 1000 * who + 4, who, **options | {"still": 0.02, "frames": 200})


def true_place(calibration, joint):
    """A joint's true place in a calibration's axes of its parent, by the parent's markers (3,)."""
    part = next(part for part in PARTS if part.joint == joint)
    own, shape = next(one for one in body("rizzoli") if one.name == part.parent), calibration.shape(part.parent)
    true = 1.75 * np.array([own.markers[marker] for marker in shape.markers])
    return in_axes_of(shape.places, true, 1.75 * np.array(part.at))


@pytest.fixture(scope="module")
def trials():
    """A trial for each hip, one for both, and a static one, without skin."""
    moving = {"left": HIPS[:1], "right": HIPS[1:], "both": HIPS}
    moved = [body_trial(name, hips, seed, tissue=0.0) for seed, (name, hips) in enumerate(moving.items(), 1)]
    return moved, body_trial("static", [], 4, still=0.02, tissue=0.0, frames=60)


@pytest.fixture(scope="module")
def session(trials):
    """Their calibration."""
    return calibrate_session(MARKERSET, *trials)


def test_a_single_trial_has_the_allowance_of_a_session():
    """Hips that sway by 2-3° are ok by the error of their fit, and unsure by skin of 1 mm, as a session has them."""
    trial = match(HIPS_ALONE, body_trial("still", [], 2, still=0.12, tissue=0.002, frames=600)).recording
    found, alone = find_joints(HIPS_ALONE, trial), calibrate(trial, HIPS_ALONE)
    for name in HIPS:
        hidden = np.sqrt(np.linalg.eigvalsh(allowance(found[name]))[-1])
        assert found[name].status == JointStatus.OK
        assert hidden > 0.02
        assert alone[name].status == JointStatus.UNSURE
        assert alone[name].standard_error > hidden
        assert "it moved too little to show it: ± " in alone[name].reason


def test_each_joint_comes_from_the_trials_that_moved_it(session):
    assert session.calibration["left_hip"].trials in [("left", "both"), ("both", "left")]
    assert session.calibration["right_hip"].trials in [("right", "both"), ("both", "right")]
    table = session_table(session).set_index(["recording", "joint"])["merged"]
    assert not table["static", "left_hip"]
    assert table["both", "left_hip"]
    lines = list(session_lines(session))
    assert any(line.startswith("left_hip: not from") and "right" in line and "static" in line for line in lines)
    nowhere = [line.split() for line in lines if line.startswith("left_ankle ")]  # though some trial calls it ok
    assert nowhere == [["left_ankle", "still", *"------"]]
    assert any(part.usable for part in session.parts["left_ankle"])


@pytest.mark.parametrize("hip", HIPS)
def test_the_merged_centre_is_the_true_one(session, hip):
    """Within its covariance, by the 99.99 % quantile of χ² of three, to 2 mm, and better than each trial's."""
    calibration = session.calibration
    place = calibration[hip]
    apart = place.in_parent - true_place(calibration, hip)
    assert place.status in USABLE
    assert apart @ np.linalg.solve(place.covariance + (0.0002**2) * np.eye(3), apart) < 21.1
    assert np.linalg.norm(apart) < 0.002
    assert place.standard_error < min(part.standard_error for part in session.parts[hip] if part.usable)


def test_shapes_are_the_static_trials(session, trials):
    """The distances between markers are those of the static trial to .1 mm, less than its noise over 60 frames."""
    shape, static = session.calibration.shape("pelvis"), match(MARKERSET, trials[1]).recording
    for i, one in enumerate(shape.markers):
        for j, two in enumerate(shape.markers[:i]):
            true = np.linalg.norm(static.of(one) - static.of(two), axis=0).mean()
            assert np.linalg.norm(shape.places[i] - shape.places[j]) == pytest.approx(true, abs=1e-4)


def test_a_trial_without_a_segment(trials):
    """A trial without the other thigh's markers is merged; neither hip suffers."""
    thighs = {side: MARKERSET.segment(f"{side}_thigh").markers for side in ("right", "left")}
    some = [
        trial.select([marker for marker in trial.markers if marker not in lacking])
        for trial, lacking in zip(trials[0], thighs.values(), strict=False)
    ]
    found = calibrate_session(HIPS_ALONE, some).calibration
    for hip, trial in zip(HIPS, some, strict=True):
        assert found[hip].trials == (trial.name,)
        assert np.linalg.norm(found[hip].in_parent - true_place(found, hip)) < 0.003


@pytest.mark.parametrize("count", [3, 1])
def test_a_hinge_is_placed_by_the_static_trial(count):
    """The medial marker is on in the static trial alone; the knee is midway between it and the lateral one there.

    A shank of one marker has no pose, and the knee's place in it is that in the thigh.
    """
    rng, frames = np.random.default_rng(8), 300
    axis, knee = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, -0.4])
    thigh = np.array([[0.07, 0.05, -0.1], [-0.06, 0.04, -0.2], [0.05, -0.06, -0.3]])
    shank = np.array([[0.05, 0.04, -0.1], [-0.04, 0.05, -0.2], [0.03, -0.05, -0.3]])
    ends = knee + np.array([[0.01, 0.06, 0.0], [0.01, -0.04, 0.0]])

    def trial(name, sweep, labels):
        body = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (frames, 3)))
        bend = Rotation.from_rotvec(sweep * rng.uniform(0.0, 1.0, (frames, 1)) * axis)
        local = [np.tile(p, (frames, 1)) for p in (*thigh, *ends)] + [knee + bend.apply(p) for p in shank]
        x = np.stack([body.apply(each) for each in local]).transpose(0, 2, 1)
        every = ("T1", "T2", "T3", "LAT", "MED", "S1", "S2", "S3")
        whole = Recording(name, every, x + 0.0005 * rng.standard_normal(x.shape), 100.0)
        return whole.select([label for label in every if label not in labels])

    upper = Segment(name="thigh", markers=("T1", "T2", "T3"))
    lower = Segment(name="shank", markers=("S1", "S2", "S3")[:count], parent="thigh")
    hinge = Joint(name="knee", parent="thigh", child="shank", kind="hinge", across=("LAT", "MED"))
    markers = MarkerSet(name="leg", segments=(upper, lower), joints=(hinge,))
    found = calibrate_session(markers, [trial("bend", 1.2, ("MED",))], trial("static", 0.0, ())).calibration
    place, middle = found["knee"], np.array([0.0, 0.01, 0.0])
    assert place.trials == ("bend",)
    assert np.linalg.norm(place.in_parent - in_axes_of(found.shape("thigh").places, thigh, knee + middle)) < 0.002
    if count == 1:
        np.testing.assert_allclose(place.in_child, place.in_parent, atol=1e-9)
    else:
        assert np.linalg.norm(place.in_child - in_axes_of(found.shape("shank").places, shank, middle)) < 0.003


def larger(recording, size):
    """The recording of a body that is so many times as large."""
    return replace(recording, positions=size * recording.positions)


def test_another_person_is_refused(trials):
    """A body of 15 % more size; by force it is merged, and what is overruled is a line. So is a name given twice."""
    one, two, _ = trials[0]
    other = larger(two, 1.15)
    with pytest.raises(RecordingError, match=r"right does not show the subject calibrated in left.*--force"):
        calibrate_session(HIPS_ALONE, [one, other])
    forced = calibrate_session(HIPS_ALONE, [one, other], force=True)
    assert [line.startswith("--force overrules: right does not show") for line in forced.overruled] == [True]
    assert next(session_lines(forced)) == forced.overruled[0]
    with pytest.raises(RecordingError, match="left: given twice"):
        calibrate_session(HIPS_ALONE, [one, replace(two, name="left")])


def test_segments_that_a_recording_lacks_do_not_count(session, trials):
    """A recording of one thigh and no more shows another body by that alone."""
    thigh = trials[0][0].select(MARKERSET.segment("left_thigh").markers)
    assert other_subject(session.calibration, larger(thigh, 1.5))
    assert not other_subject(session.calibration, thigh)


def test_shapes_refitted_to_a_recording(session):
    """The shapes are the recording's, to its noise, in the calibration's axes; joints stay where they are."""
    later = body_trial("later", HIPS[:1], 7, tissue=0.0)
    moved = np.array(later.positions)
    moved[later.row("LFTC")] += 0.02 * np.array([0.0, 0.6, 0.8])[:, None]
    moved = replace(later, positions=moved)
    calibration = session.calibration
    found = refit_shapes(calibration, later)
    np.testing.assert_allclose(found.shape("pelvis").places, calibration.shape("pelvis").places, atol=3e-4)
    np.testing.assert_array_equal(found["left_hip"].in_parent, calibration["left_hip"].in_parent)
    before, after = (draw_skeleton(each, moved) for each in (calibration, refit_shapes(calibration, moved)))
    thigh = before.segments.index("left_thigh")
    assert after.misfits[thigh] < before.misfits[thigh]


def test_two_recordings_of_one_session(functional):
    """The walk is merged with the functional trial; its hips stay where that puts them, or are doubted."""
    whole, trials = functional[0].whole, [one.recording for one in functional]
    alone, merged = (calibrate_session(whole, part).calibration for part in (trials[:1], trials))
    for hip in ("left_hip", "right_hip"):
        apart = np.linalg.norm(merged[hip].in_parent - alone[hip].in_parent)
        assert apart < 0.005 or merged[hip].status == JointStatus.DISAGREE


NONE = np.full(3, np.nan)

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def part(trial, place, errors, status=JointStatus.OK, axis=NONE):
    """A trial's place; the child's axes are turned by 90° and 1 m away."""
    at = np.asarray(place, dtype=float)
    return JointPlace(
        joint=Joint(name="hip", parent="pelvis", child="thigh"),
        status=status,
        reason=status.text,
        in_parent=at,
        in_child=TURN.T @ at + 1.0,
        covariance=np.diag(np.square(errors)),
        axis_in_parent=np.asarray(axis, dtype=float),
        axis_in_child=NONE,
        mean_rotation=TURN,
        trials=(trial,),
    )


def test_weighted_mean():
    """Each coordinate is weighted by its own error: 1 : 4 and 4 : 1; the child's place is the same point."""
    one, two = part("a", (0, 0, 0), (0.001, 0.002, 0.001)), part("b", (0.005, 0.005, 0), (0.002, 0.001, 0.001))
    found = pool_places([one, two])
    np.testing.assert_allclose(found.in_parent, [0.001, 0.004, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.in_child, TURN.T @ found.in_parent + 1.0, atol=1e-12)
    np.testing.assert_allclose(found.covariance, np.diag([0.8e-6, 0.8e-6, 0.5e-6]), atol=1e-15)
    assert set(found.trials) == {"a", "b"}


def hinge(trial, place, error):
    """A trial's place across the axis z."""
    return part(trial, place, (error, error, 0.0), JointStatus.HINGE, (0, 0, 1))


UNSURE = JointStatus.UNSURE
STOOD = part("c", NONE, (0.001,) * 3, JointStatus.STILL)
BALL, SIDE = part("ball", (0, 0, 0), (0.002,) * 3), hinge("hinge", (0.004, 0.004, 0.5), 0.002)
BAD, GOOD = part("bad", (0.05, 0, 0), (0.001,) * 3, UNSURE), part("good", (0, 0, 0), (0.002,) * 3)
WORSE, BEST = part("a", (0.05, 0, 0), (0.03,) * 3, UNSURE), part("b", (0.01, 0, 0), (0.02,) * 3, UNSURE)
ONE, TWO = hinge("one", (0, 0, 0.1), 0.001), hinge("two", (0.004, 0, 0.3), 0.002)


@pytest.mark.parametrize(
    ("parts", "place", "trials", "status"),
    [
        ([SIDE, BALL], (0.002, 0.002, 0), ("ball", "hinge"), "OK"),  # about one axis alone it says nothing along that
        ([TWO, ONE], (0.0008, 0, 0.1), ("one", "two"), "HINGE"),
        ([BAD, GOOD], (0, 0, 0), ("good",), "OK"),  # trials that are not reliable do not count
        ([WORSE, BEST, STOOD], (0.01, 0, 0), ("b",), "UNSURE"),  # of these alone the best, with its own status
    ],
)
def test_pooled_places(parts, place, trials, status):
    found = pool_places(parts)
    np.testing.assert_allclose(found.in_parent, place, atol=1e-12)
    assert (found.trials, found.status.name) == (trials, status)


def test_reliable_trials_that_contradict_each_other():
    """The best one's place stays, and its covariance covers the other; a word says so."""
    found = pool_places([part("a", (0, 0, 0), (0.002,) * 3), part("b", (0.03, 0, 0), (0.003,) * 3)])
    assert found.status == JointStatus.DISAGREE
    assert found.reason == "b puts it 30 mm from where a does: beyond what the errors explain"
    np.testing.assert_array_equal(found.in_parent, np.zeros(3))
    assert found.standard_error == pytest.approx(np.hypot(0.03, 0.002))
    near = pool_places([part("a", (0, 0, 0), (0.002,) * 3), part("b", (0.009, 0, 0), (0.003,) * 3)])
    assert near.status == JointStatus.OK  # below a centimetre


def test_axes_that_contradict_each_other():
    one = hinge("one", (0, 0, 0), 0.001)
    tilted = replace(one, axis_in_parent=np.array([0.0, np.sin(0.5), np.cos(0.5)]), trials=("two",))
    found = pool_places([one, tilted])
    assert found.status == JointStatus.DISAGREE
    assert "its axis turned by 29°" in found.reason


OWN = {"left_hip": "left", "right_hip": "right", "left_knee": "knees", "right_knee": "knees"}


@pytest.mark.parametrize(
    ("who", "still", "tissue", "skin"),
    [
        (7, 0.1, 0.02, "mixed"),
        pytest.param(0, 0.05, 0.004, "mixed", marks=pytest.mark.slow),
        pytest.param(38, 0.2, 0.004, "mixed", marks=pytest.mark.slow),
        pytest.param(65, 0.2, 0.004, "angle", marks=pytest.mark.slow),
    ],
)
def test_a_trial_that_does_not_move_a_joint_has_no_vote(who, still, tissue, skin):
    """Hips come from their own trials, knees nearly always; without the rule hips and knees are up to 42 cm off here.

    What is usable is within three of its standard errors of the truth, across a hinge's axis.
    """
    trials, static = body_session(who, still=still, tissue=tissue, skin=skin)
    merged = calibrate_session(MARKERSET, trials, static).calibration
    for joint, trial_name in OWN.items():
        place = merged[joint]
        assert place.trials[0] == trial_name
        assert len(place.trials) == 1 or "knee" in joint
        off = place.in_parent - true_place(merged, joint)
        off = off if place.axis is None else off - (off @ place.axis) * place.axis
        assert np.linalg.norm(off) < (3.0 * place.standard_error if place.usable else 0.02)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_leg_that_stands_has_no_vote_in_a_real_trial(side, functional):
    """A functional trial moves the left hip in its first half, the right one in its second."""
    whole, recording = functional[0].whole, functional[0].recording
    parts = {"left": slice(0, 3120), "right": slice(3120, None)}
    halves = [replace(recording.select(frames=frames), name=name) for name, frames in parts.items()]
    joint = f"{side}_hip"
    session, alone = calibrate_session(whole, halves), find_joints(whole, recording)
    place = session.calibration[joint]
    assert (place.trials, place.status) == ((side,), JointStatus.OK)
    hips = [one["right_hip"].in_parent - one["left_hip"].in_parent for one in (session.calibration, alone)]
    assert np.linalg.norm(hips[0]) == pytest.approx(np.linalg.norm(hips[1]), abs=0.006)
    other = next(part for part in session.parts[joint] if part.trials != (side,))
    assert other.rank > place.rank


def test_hips_of_a_session_are_judged_by_their_distance(trials):
    """Each trial moves one hip; what is merged is doubted where the pelvis is too wide for the hips' distance."""
    wide = []
    for recording in trials[0][:2]:
        positions, rows = np.array(recording.positions), [recording.row("LIAS"), recording.row("RIAS")]
        positions[rows] += 0.3 * (positions[rows] - positions[rows].mean(axis=0))
        wide.append(replace(recording, positions=positions))
    merged = calibrate_session(HIPS_ALONE, wide).calibration
    for hip in HIPS:
        assert merged[hip].status == JointStatus.IMPLAUSIBLE
        assert "of LIAS to RIAS: 0.65 to 1.2 is plausible" in merged[hip].reason


def allowed(part, errors):
    """A trial's place with the allowance of these standard deviations."""
    return replace(part, allowance=np.diag(np.square(errors)))


def test_an_allowance_beyond_a_centimetre_takes_the_vote():
    """The trial with the smaller stated error does not count; below a centimetre the allowance is a weight."""
    moved_it, stood = part("moved", (0, 0, 0), (0.005,) * 3), part("stood", (0.035, 0, 0), (0.002,) * 3)
    found = pool_places([allowed(stood, (0.012,) * 3), moved_it])
    assert (found.trials, found.status) == (("moved",), JointStatus.OK)
    np.testing.assert_array_equal(found.in_parent, np.zeros(3))
    near = allowed(replace(stood, in_parent=np.array([0.008, 0, 0])), (0.009, 0.001, 0.001))
    both = pool_places([near, moved_it])
    share = 25.0 / (25.0 + 4.0 + 81.0)  # of the trial that stood, by x
    np.testing.assert_allclose(both.in_parent, [0.008 * share, 0.0, 0.0], atol=1e-12)
    assert both.covariance[0, 0] == pytest.approx(share**2 * 4e-6 + (1 - share) ** 2 * 25e-6)


def test_what_skin_hides_along_an_arm():
    """Skin of 1 mm over a rotation of θ² about each axis hides (1 mm)²/θ²: of poses' rotation for all three axes.

    Markers that move on a sphere show no rotation about their arm, the axis of the least one: there it is as much as
    for the weaker of the two others.
    """
    turn, squares = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix(), np.array([1e-4, 0.01, 0.04])
    normal, none, used = turn @ np.diag(squares) @ turn.T, np.zeros(3), np.ones((1, 50), dtype=bool)
    sphere = CenterFit(none, none, 0, 1, 0, none, none, 50, 50, None, none, 9, True, none, 50 * normal, np.ones(1))
    pair = SymmetricFit(None, none, none, none, 0.0, none, none, False, normal, 50, 50)
    for kind, shown in (({"sphere": sphere}, [0.01, 0.01, 0.04]), ({"pair": pair}, squares)):
        estimate = Estimate("parent", None, (), none, np.eye(3), None, "none", used, **kind)
        place = replace(part("one", none, (0.001,) * 3), estimates=(estimate,))
        np.testing.assert_allclose(allowance(place), turn @ np.diag(1e-6 / np.array(shown)) @ turn.T, rtol=1e-9)


def test_a_joint_that_no_trial_moved():
    """By the best trial it is unsure by its allowance, too; beyond 5 cm it is nowhere, and the reason says so."""
    near = pool_places([allowed(part("a", (0.1, 0, 0), (0.005,) * 3), (0.02, 0.012, 0.012))])
    assert near.status == JointStatus.UNSURE
    assert near.reason == "no trial moved it enough to show it: ± 21 mm, if skin slides by 1 mm"
    assert near.standard_error == pytest.approx(np.hypot(0.005, 0.02))
    far = pool_places([allowed(part("static", (0.1, 0, 0), (0.464,) * 3, JointStatus.UNSURE), (0.3,) * 3)])
    assert (far.status, far.reason) == (JointStatus.STILL, "no trial moved it")
    assert np.isnan([*far.in_parent, *far.in_child, *far.covariance.ravel()]).all()
    moved_it = pool_places([part("moved", (0.1, 0, 0), (0.464,) * 3, JointStatus.UNSURE)])
    assert not np.isnan(moved_it.in_parent).any()  # it moved: what is large is its own error


def test_a_session_has_no_waist_from_its_static_trial():
    """Stiff trunks: the waist is nowhere in the calibration and in every frame, and the legs are drawn as before."""
    trials, static = body_session(12, still=0.02)
    session = calibrate_session(MARKERSET, trials, static)
    waist = session.calibration["waist"]
    assert (waist.status, waist.reason) == (JointStatus.STILL, "no trial moved it")
    drawn = draw_skeleton(session.calibration, trials[0])
    assert np.isnan(drawn.center("waist")).all()
    assert not np.isnan(drawn.center("left_hip")).any()
    lines = list(session_lines(session))
    assert [line.split()[1:] for line in lines if line.startswith("waist ")] == [["still", *"------"]]
    assert any("left_hip: not from" in line and "static (hardly moved it)" in line for line in lines)


def exchanged(recording, one, two, share, seed=1):
    """The recording with two labels exchanged in about this share of the frames, half a second at a time."""
    run = max(round(0.5 * recording.rate), 1)
    count = recording.frames // run + 1
    chosen = np.random.default_rng(seed).permutation(count) < round(share * count)
    frames = np.repeat(chosen, run)[: recording.frames]
    positions, rows = np.array(recording.positions), [recording.row(one), recording.row(two)]
    positions[np.ix_(rows, range(3), frames)] = positions[np.ix_(rows[::-1], range(3), frames)]
    return replace(recording, positions=positions), frames


@pytest.mark.parametrize("share", [0.1, 0.43])
def test_markers_that_exchange_their_labels_are_named(share):
    """Epicondyles: the two, the share to 2 % and the first frame are in the reasons of both joints of the thigh."""
    recording = body_trial("moves", list(OWN), seed=5)
    wrong, frames = exchanged(recording, "RFLE", "RFME", share)
    found = find_joints(MARKERSET, wrong)
    for joint in ("right_hip", "right_knee"):
        assert found[joint].status not in USABLE
        words, share_named = found[joint].reason.split(" in ")[:2]
        assert words == "RFLE and RFME exchange their labels"
        assert float(share_named.split("%")[0]) == pytest.approx(100 * frames.mean(), abs=2.0)
    assert f"first in frame {frames.argmax() + 1}: exchange them back" in found["right_hip"].reason
    assert "exchange" not in found["left_hip"].reason


@pytest.mark.parametrize("skin", ["mixed", "random", "slide", "angle"])
def test_no_exchange_where_there_is_none(skin):
    """Skin of 1 and 2 cm, and markers in symmetric places on a trunk."""
    for tissue in (0.01, 0.02):
        recording = body_trial("moves", list(OWN), seed=3, skin=skin, tissue=tissue)
        assert [words for segment in MARKERSET.segments if (words := exchange(segment.markers, recording))] == []


def test_an_exchange_in_a_real_recording(functional):
    """Two markers of a thigh's cluster; the recording as it is has none."""
    whole, recording = functional[0].whole, functional[0].recording
    assert [exchange(segment.markers, recording) for segment in whole.segments] == [""] * 3
    wrong, frames = exchanged(recording, "LTH1", "LTH2", 0.43)
    seen = ~np.isnan(recording.positions).any(axis=1)
    words = f"LTH1 and LTH2 exchange their labels in {(frames & seen[:3].all(axis=0)).mean():.0%}"[:40]
    assert words in exchange(whole.segment("left_thigh").markers, wrong)

"""Tests of synthetic."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from study.recordings.markersets import choose, load_markerset
from study.recordings.recording import RecordingError
from study.recordings.rigid import nearest_rotation
from study.recordings.synthetic import make
from study.recordings.synthetic.make import MARKERS, PARTS, SKIN, Recipe, body, synthesize, unit


def test_soft_tissue():
    """The displacement is at most its amplitude, and half of it follows the joint."""
    phases = np.sin(np.linspace(0, 40, 3000))[None] * np.ones((6, 1))
    slid = make.soft_tissue(phases, 120.0, 0.01, 1)
    size = np.linalg.norm(slid, axis=1)
    assert size.max() <= 0.01 + 1e-15
    assert (size.max(axis=1) > 0.005).all()
    # the rest is an oscillation of half the amplitude on one line
    for marker in slid:
        direction = marker @ phases[0] / (phases[0] @ phases[0])
        assert np.linalg.norm(direction) == pytest.approx(0.005, rel=0.1)
        rest = marker - direction[:, None] * phases[0]
        values = np.linalg.svd(rest, compute_uv=False)
        assert values[1] < 0.1 * values[0]
    assert not make.soft_tissue(phases, 120.0, 0.0, 1).any()


@pytest.mark.parametrize("share", [0.0, 0.001, 0.2, 0.5, 0.99, 1.0])
@pytest.mark.parametrize("frames", [7, 1000])
def test_gaps_have_their_share(share, frames):
    """Each marker lacks its share of frames, rounded."""
    mask = make.gaps(4, frames, 120.0, share, 1)
    assert (mask.sum(axis=1) == round(share * frames)).all()


def test_gaps_come_in_runs():
    """Gaps take 0.2 s on average and are anywhere, also at the ends."""
    mask = make.gaps(3000, 1200, 120.0, 0.2, 1)
    starts = (np.diff(mask.astype(int), axis=1, prepend=0) == 1).sum(axis=1)
    assert (starts == 10).all()
    assert mask[:, 0].any()
    assert mask[:, -1].any()
    # except near the ends, all frames have the same probability. With runs of 24 frames on average, the autocorrelation
    # time is about 40 frames: over 100 frames of 3000 markers the standard error is √(.16 · 40 / 300,000) = .0046
    middle = mask[:, 100:-100].mean(axis=0).reshape(-1, 100).mean(axis=1)
    assert np.abs(middle - 0.2).max() < 4.5 * 0.0046


def test_every_cut_is_equally_likely():
    """Seven frames of nine are missing in two runs: each of 6 x 3 ways, in 18000 draws within 4.5 standard errors."""
    drawn = (row for seed in range(3600) for row in make.gaps(5, 9, 17.5, 7 / 9, seed))
    counts = Counter(tuple(np.flatnonzero(row)) for row in drawn)
    assert len(counts) == 18
    expected = 18000 / 18
    assert max(abs(count - expected) for count in counts.values()) < 4.5 * np.sqrt(expected)


def test_the_right_side_mirrors_the_left():
    """The right side mirrors the left one, except for four markers, which differ in height."""
    parts = {part.name: part for part in PARTS}
    uneven = set()
    for name, left in parts.items():
        if not name.startswith("left_"):
            continue
        right = parts[name.replace("left_", "right_")]
        np.testing.assert_allclose(np.array(right.at) * [1, -1, 1], left.at)
        for label, place in left.markers.items():
            mirrored = np.array(right.markers["R" + label[1:]]) * [1, -1, 1]
            np.testing.assert_allclose(mirrored[:2], place[:2])
            uneven |= {label} if mirrored[2] != place[2] else set()
    assert uneven == {"LUPA", "LFRM", "LTHI", "LSHN"}


def test_limbs_have_winters_proportions():
    """Standing, the soles are near the floor and the top of the head is at the body's height."""
    at = {part.joint: np.array(part.at) for part in PARTS if part.joint}
    assert np.linalg.norm(at["left_knee"]) == 0.245
    assert np.linalg.norm(at["right_elbow"]) == 0.186
    hip, head = 0.53, 0.53 + sum(at[joint][2] for joint in ("waist", "neck")) + 0.105
    assert abs(hip - 0.245 - 0.246 - 0.039) < 1e-12
    assert 0.9 < head < 1.0


def test_pairs_are_the_nearest():
    pairs = make.nearest_pairs()
    assert {("LBWT", "RBWT"), ("LWRA", "LWRB"), ("LTOE", "LMT5")} <= set(pairs)
    assert {marker for pair in pairs for marker in pair} == set(MARKERS)


def test_truth_beside_it(tmp_path):
    """There is a row per joint, and one per frame and joint; the segment poses give each joint its true place."""
    _, truth = synthesize(Recipe(frames=20))
    paths = make.write_truth(truth, tmp_path / "walk.c3d")
    assert [path.name for path in paths] == ["walk.joints.parquet", "walk.truth.parquet"]
    joints, poses = map(pd.read_parquet, paths)
    assert list(joints.joint) == list(truth.joints)
    assert (joints.kind == "hinge").sum() == 4
    knee = joints.set_index("joint").loc["left_knee"]
    assert (knee.parent, knee.child, knee.bone_from) == ("left_thigh", "left_shank", "left_hip")
    assert knee.bone_length == pytest.approx(0.245 * 1.75)
    assert joints.bone_length.isna().sum() == 3, "from the pelvis to what hangs on it there is no bone"
    assert len(poses) == 14 * 20
    hip, knee_path = (poses[poses.joint == name].sort_values("frame") for name in ("left_hip", "left_knee"))
    turn = Rotation.from_rotvec(hip[["turn_x", "turn_y", "turn_z"]].to_numpy().copy())
    center = ["center_x", "center_y", "center_z"]
    there = hip[center].to_numpy() + turn.apply(knee[center].to_numpy(dtype=float))
    np.testing.assert_allclose(knee_path[center].to_numpy(), there, atol=1e-12)


def test_where_nothing_can_be_written(tmp_path):
    _, truth = synthesize(Recipe(frames=30))
    with pytest.raises(RecordingError, match="cannot be written"):
        make.write_truth(truth, tmp_path / "none" / "walk.c3d")


PLACE = {part.name: i for i, part in enumerate(PARTS)}
SEGMENT = np.array([i for i, part in enumerate(PARTS) for _ in part.markers])
STYLES = {"smooth": 0.5, "independent": 0.5, "gait": 0.15}
"""Styles of motion, and the share of each range that they use at least."""


def moving(frames=3000, reach=1.0, style="smooth"):
    """Rotations, origins and phases of the segments."""
    return make.draw_motion(frames, 120.0, 5, height=1.75, reach=reach, style=style)


def relative(rotations, part):
    """Rotations of a segment in its parent's axes (frames, 3, 3), from the matrices of both."""
    return np.swapaxes(rotations[PLACE[part.parent]], 1, 2) @ rotations[PLACE[part.name]]


def vectors(truth, name):
    """Rotation vectors of a segment in its parent's axes, about their mean (3, frames)."""
    turns = relative(truth.rotations, PARTS[PLACE[name]])
    return Rotation.from_matrix(turns @ nearest_rotation(turns.sum(axis=0)).T).as_rotvec().T


def angles(rotations, part):
    """Angles of a joint and their ranges, degrees: three of a ball, one of a hinge, whose axis stays."""
    turns = relative(rotations, part)
    if part.axis is None:
        return Rotation.from_matrix(turns).as_euler("YXZ", degrees=True).T, np.array(part.ranges).T
    axis = unit(part.axis)
    np.testing.assert_allclose(turns @ axis, np.broadcast_to(axis, (len(turns), 3)), atol=1e-12)
    return np.degrees(Rotation.from_matrix(turns).as_rotvec() @ axis)[None], np.array(part.ranges[:1]).T


@pytest.mark.parametrize("style", STYLES)
def test_joints_stay_in_their_natural_range(style):
    """Rotations are proper; angles read back from them stay in the range of motion, and use their share of it."""
    rotations, *_ = moving(style=style)
    both = rotations @ np.swapaxes(rotations, 2, 3)
    np.testing.assert_allclose(both, np.broadcast_to(np.eye(3), both.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    for part in PARTS[1:]:
        found, (low, high) = angles(rotations, part)
        assert (found.min(axis=1) >= low - 1e-9).all(), part.joint
        assert (found.max(axis=1) <= high + 1e-9).all(), part.joint
        assert (np.ptp(found, axis=1) >= STYLES[style] * (high - low) - 1e-9).all(), part.joint


def test_motion_is_smooth_or_independent():
    """No angle changes faster than its range times the highest frequency; angles drawn anew do, and are uniform.

    The lag-one correlation of 15 phases over 3000 frames: each within 4.5 of its standard errors of zero.
    """
    (*_, smooth), (*_, anew) = moving(), moving(style="independent")
    assert np.abs(np.diff(smooth, axis=1)).max() < 2 * np.pi * 0.7 / 120
    assert np.abs(smooth).max() <= 1.0
    assert np.abs(np.diff(anew, axis=1)).max() > 1.5
    assert max(abs(np.corrcoef(row[1:], row[:-1])[0, 1]) for row in anew) < 4.5 / np.sqrt(3000)
    np.testing.assert_allclose(anew.var(axis=1), 1 / 3, atol=4.5 * np.sqrt(4 / 45 / 3000))


def test_more_frames_leave_the_first_as_they_were():
    np.testing.assert_array_equal(moving(frames=50)[1], moving(frames=80)[1][:, :, :50])


def slid(**changes):
    """Displacements in the segments' axes (markers, 3, frames), and the truth."""
    recipe = {"frames": 400, "noise": 0.0, "rate": 50.0} | changes
    firm, truth = synthesize(Recipe(**recipe))
    soft, _ = synthesize(Recipe(**recipe, soft_tissue=0.02))
    rotation = truth.rotations[SEGMENT]
    return np.einsum("mtji,mjt->mit", rotation, soft.positions - firm.positions), truth


@pytest.mark.parametrize("gait", [False, True])
@pytest.mark.parametrize("skin", [law for law in SKIN if law != "slide"])
def test_skin_is_at_most_its_amplitude(skin, gait):
    moved, truth = slid(skin=skin, gait=gait)
    _, soft = synthesize(Recipe(400, 50.0, soft_tissue=0.02, skin=skin, gait=gait))
    np.testing.assert_array_equal(truth.centers, soft.centers)  # joints stay
    size = np.linalg.norm(moved, axis=1).max(axis=1)
    assert size.max() <= 0.02 + 1e-12
    assert np.median(size) > 0.004


@pytest.mark.parametrize("skin", ["angle", "velocity", "cluster", "random"])
def test_what_the_skin_moves_with(skin):
    """Linear in the rotation vector of the segment's joint, or in its rate; equal in a cluster; or in neither."""
    moved, truth = slid(skin=skin)
    drive = vectors(truth, "left_thigh")
    one, two = moved[PLACE["left_thigh"] == SEGMENT]
    explained = linear_in(one, np.gradient(drive, axis=1) if skin == "velocity" else drive)
    assert explained < 0.9 if skin == "random" else explained > 1 - 1e-9
    assert np.allclose(one, two) == (skin == "cluster")


def linear_in(moved, drive):
    """Share of a displacement (3, frames) that is linear in what drives it (k, frames)."""
    fitted = moved @ np.linalg.pinv(drive, rcond=1e-9) @ drive
    return 1.0 - ((moved - fitted) ** 2).sum() / (moved**2).sum()


@pytest.mark.parametrize(("marker", "joints"), [("LFTC", "h"), ("LFLE", "hk"), ("RFME", "hk"), ("LFAX", "k")])
def test_markers_slide_over_joints(marker, joints):
    """Trochanter, epicondyles and fibula slide with the angles of hip and knee, as far as asked for; others stay."""
    recipe = Recipe(frames=400, noise=0.0, rate=50.0, markers="rizzoli")
    firm, truth = synthesize(recipe)
    soft, _ = synthesize(replace(recipe, skin="slide", soft_tissue=0.02))
    row = firm.markers.index(marker)
    parts = body("rizzoli")
    segment = next(i for i, part in enumerate(parts) if marker in part.markers)
    moved = np.einsum("tji,jt->it", truth.rotations[segment], (soft.positions - firm.positions)[row])
    assert np.linalg.norm(moved, axis=0).max() == pytest.approx(0.02)
    side = "left" if marker[0] == "L" else "right"
    drives = {"h": vectors(truth, f"{side}_thigh"), "k": vectors(truth, f"{side}_shank")}
    assert linear_in(moved, np.concatenate([drives[key] for key in joints])) > 1 - 1e-9
    assert all(linear_in(moved, drives[key]) < 0.999 for key in joints if len(joints) == 2)
    still = ["LIAS", "RIPS", "SXS", "LTTC", "LFCC", "RFM5"]
    assert all(np.array_equal(firm.of(label), soft.of(label)) for label in still)


@pytest.mark.parametrize("name", ["cmu41", "rizzoli"])
def test_the_body_wears_the_labels_of_a_shipped_set(name):
    """Its labels are on the segments of the set, which is chosen; motion and joints are those of cmu41."""
    owners = {marker: segment.name for segment in load_markerset(name).segments for marker in segment.markers}
    assert all(owners[label] == part.name for part in body(name) for label in part.markers)
    recording, truth = synthesize(Recipe(frames=10, markers=name, noise=0.0))
    chosen = choose(recording)
    assert (chosen.whole.name, chosen.lost, chosen.extra) == (name, {}, ())
    np.testing.assert_array_equal(truth.centers, synthesize(Recipe(frames=10))[1].centers)
    if name == "cmu41":
        assert recording.markers == MARKERS
        return
    for side, hip in (("L", "left_hip"), ("R", "right_hip")):  # a hip is where the trochanter keeps its distance
        away = recording.of(f"{side}FTC") - truth.centers[truth.joints.index(hip)]
        assert np.ptp(np.linalg.norm(away, axis=0)) < 1e-12


def test_gait_is_in_strides():
    """Rotations of the hip repeat with the stride, .8 to 1.1 per second, and are mostly flexion."""
    _, truth = slid(gait=True, frames=1000)
    vector = vectors(truth, "right_thigh")
    power = np.abs(np.fft.rfft(vector[1])) ** 2
    stride = np.argmax(power[1:]) + 1
    assert 0.75 < stride / (1000 / 50.0) < 1.15
    assert vector[1].std() > 2.0 * max(vector[0].std(), vector[2].std())
    assert np.degrees(np.abs(vector).max()) < 45.0


@pytest.mark.parametrize("height", [1.75, 1.5])
def test_markers_and_joints_are_fixed_in_their_segments(height):
    """Segments carry their markers at the model's places, in heights, and joints at their ends; bones are between."""
    recording, truth = synthesize(Recipe(frames=800, noise=0.0, height=height))
    offsets = height * np.array([place for part in PARTS for place in part.markers.values()])
    np.testing.assert_array_equal(truth.offsets, offsets)
    np.testing.assert_array_equal(truth.in_parent, height * np.array([part.at for part in PARTS if part.joint]))
    x = np.einsum("mtij,mj->mit", truth.rotations[SEGMENT], offsets) + truth.origins[SEGMENT]
    np.testing.assert_allclose(recording.positions, x, atol=1e-12)
    for center, at, parent, child in zip(truth.centers, truth.in_parent, truth.parents, truth.children, strict=True):
        above, below = truth.segments.index(parent), truth.segments.index(child)
        np.testing.assert_array_equal(center, truth.origins[below])
        np.testing.assert_allclose((truth.rotations[above] @ at).T + truth.origins[above], center, atol=1e-12)
    center = dict(zip(truth.joints, truth.centers, strict=True))
    assert len(truth.bones) == 11
    for (start, end), length in truth.bones.items():
        np.testing.assert_allclose(np.linalg.norm(center[start] - center[end], axis=0), length, rtol=1e-12)


def test_the_same_recipe_gives_the_same_bytes():
    """Each artefact is drawn from a stream of its own."""
    recipe = {"frames": 300, "noise": 0.002, "soft_tissue": 0.01, "gaps": 0.1, "swaps": 0.1}
    first, truth = synthesize(Recipe(**recipe))
    again, _ = synthesize(Recipe(**recipe))
    assert first.positions.tobytes() == again.positions.tobytes()
    other, other_truth = synthesize(Recipe(**recipe, seed=2))
    assert other.positions.tobytes() != first.positions.tobytes()
    assert other_truth.swaps != truth.swaps
    plain, plain_truth = synthesize(Recipe(frames=300, noise=0.002))
    np.testing.assert_array_equal(plain_truth.origins, truth.origins)
    double, _ = synthesize(Recipe(frames=300, noise=0.004))
    perfect, _ = synthesize(Recipe(frames=300, noise=0.0))
    np.testing.assert_allclose(
        double.positions - perfect.positions, 2 * (plain.positions - perfect.positions), atol=1e-14
    )


def test_noise_gaps_and_swaps_are_as_asked_for():
    quiet, _ = synthesize(Recipe(frames=2000, noise=0.0))
    noisy, _ = synthesize(Recipe(frames=2000, noise=0.003))
    off = noisy.positions - quiet.positions
    assert off.std() == pytest.approx(0.003, rel=4.5 / np.sqrt(2 * off.size))
    holed, truth = synthesize(Recipe(frames=2000, noise=0.003, gaps=0.2))
    np.testing.assert_array_equal(~holed.seen(), truth.missing)
    np.testing.assert_allclose(holed.missing(), 0.2)
    np.testing.assert_array_equal(holed.positions[:, 0][holed.seen()], noisy.positions[:, 0][holed.seen()])
    mixed, truth = synthesize(Recipe(frames=2000, noise=0.003, swaps=0.05))
    moved = np.zeros(2000, dtype=bool)
    for first, end, (a, b) in truth.swaps:
        frames = slice(first, end)
        np.testing.assert_array_equal(mixed.of(a)[:, frames], noisy.of(b)[:, frames])
        np.testing.assert_array_equal(mixed.of(b)[:, frames], noisy.of(a)[:, frames])
        moved[frames] = True
    assert moved.sum() == 100
    assert len({pair for *_, pair in truth.swaps}) > 1
    np.testing.assert_array_equal(mixed.positions[:, :, ~moved], noisy.positions[:, :, ~moved])

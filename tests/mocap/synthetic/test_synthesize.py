import itertools

import numpy as np
import pytest

import study
from study.mocap.io.recording import RecordingError
from study.mocap.markersets.match import choose
from study.mocap.synthetic.body_model import MARKERS, PARTS
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

SEGMENT = {label: i for i, part in enumerate(PARTS) for label in part.markers}


@pytest.fixture(scope="module")
def perfect():
    """A body without any artefact."""
    return synthesize(Recipe(frames=800, noise=0.0))


def test_segments_are_rigid(perfect):
    """Two markers of one segment keep the distance of the body model."""
    recording, _ = perfect
    for part in PARTS:
        for a, b in itertools.pairwise(part.markers):
            apart = np.linalg.norm(recording.of(a) - recording.of(b), axis=0)
            wanted = 1.75 * np.linalg.norm(np.subtract(part.markers[a], part.markers[b]))
            np.testing.assert_allclose(apart, wanted, rtol=1e-12)


def test_joints_are_centres_of_spheres(perfect):
    """Markers on both sides of a joint keep their distance to it, which the truth gives."""
    recording, truth = perfect
    for j, (parent, child) in enumerate(zip(truth.parents, truth.children, strict=True)):
        for segment, shift in ((parent, truth.in_parent[j]), (child, np.zeros(3))):
            for label in PARTS[truth.segments.index(segment)].markers:
                apart = np.linalg.norm(recording.of(label) - truth.centers[j], axis=0)
                offset = truth.offsets[truth.markers.index(label)] - shift
                np.testing.assert_allclose(apart, np.linalg.norm(offset), rtol=1e-10)


def test_an_estimator_finds_the_joints(perfect):
    """A fit to the child's markers in the true parent's axes gives the true centre, up to rounding."""
    recording, truth = perfect
    for joint in ("left_hip", "right_shoulder", "neck", "left_ankle"):
        j = truth.joints.index(joint)
        parent = truth.segments.index(truth.parents[j])
        label = next(iter(PARTS[truth.segments.index(truth.children[j])].markers))
        away = recording.of(label) - truth.origins[parent]
        seen = np.einsum("tji,jt->ti", truth.rotations[parent], away)
        fit = study.fit(seen, "gdke")
        np.testing.assert_allclose(fit.center, truth.in_parent[j], atol=1e-9)


def test_hinges_turn_about_their_axes(perfect):
    """The axis has the same direction in the world from either segment; ball joints have none."""
    _, truth = perfect
    for j, joint in enumerate(truth.joints):
        if not joint.endswith(("knee", "elbow")):
            assert np.isnan(truth.axes[j]).all()
            continue
        assert np.linalg.norm(truth.axes[j]) == pytest.approx(1.0)
        by_parent = truth.rotations[truth.segments.index(truth.parents[j])] @ truth.axes[j]
        by_child = truth.rotations[truth.segments.index(truth.children[j])] @ truth.axes[j]
        np.testing.assert_allclose(by_parent, by_child, atol=1e-12)


def test_bones(perfect):
    """The length of a bone is the distance of its joints in every frame."""
    _, truth = perfect
    center = dict(zip(truth.joints, truth.centers, strict=True))
    assert set(truth.bones) >= {("left_hip", "left_knee"), ("right_elbow", "right_wrist"), ("waist", "neck")}
    assert len(truth.bones) == 11
    for (start, end), length in truth.bones.items():
        np.testing.assert_allclose(np.linalg.norm(center[start] - center[end], axis=0), length, rtol=1e-12)
    assert truth.bones["left_hip", "left_knee"] == pytest.approx(0.245 * 1.75)


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
    for swap in truth.swaps:
        a, b = swap.markers
        frames = slice(swap.first, swap.end)
        np.testing.assert_array_equal(mixed.of(a)[:, frames], noisy.of(b)[:, frames])
        np.testing.assert_array_equal(mixed.of(b)[:, frames], noisy.of(a)[:, frames])
        moved[frames] = True
    assert moved.sum() == 100
    np.testing.assert_array_equal(mixed.positions[:, :, ~moved], noisy.positions[:, :, ~moved])


def test_soft_tissue_moves_markers_on_their_segments():
    """Markers move by the given amount at most; the joints stay."""
    firm, truth = synthesize(Recipe(frames=500, noise=0.0))
    soft, soft_truth = synthesize(Recipe(frames=500, noise=0.0, soft_tissue=0.02))
    np.testing.assert_array_equal(truth.centers, soft_truth.centers)
    slid = np.linalg.norm(soft.positions - firm.positions, axis=1)
    assert slid.max() <= 0.02 + 1e-12
    assert (slid.max(axis=1) > 0.008).all()


def test_another_height_is_another_body():
    _, truth = synthesize(Recipe(frames=50, noise=0.0, height=1.5))
    _, tall_truth = synthesize(Recipe(frames=50, noise=0.0, height=1.8))
    np.testing.assert_allclose(tall_truth.in_parent, 1.2 * truth.in_parent)
    np.testing.assert_allclose(tall_truth.rotations, truth.rotations)


def test_the_marker_set_fits():
    recording, _ = synthesize(Recipe(frames=10))
    found = choose(recording)
    assert (found.whole.name, found.lost, found.extra) == ("cmu41", {}, ())
    assert recording.markers == MARKERS
    assert set(SEGMENT) == set(MARKERS)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("frames", 1, "frames = 1 of a synthetic body must be from 2 to"),
        ("noise", -0.001, "noise = -0.001 of a synthetic body must be from 0"),
        ("noise", float("nan"), "noise = nan"),
        ("gaps", 1.5, "gaps = 1.5 of a synthetic body must be from 0 to 1"),
        ("rate", 0.0, "rate = 0"),
        ("seed", -1, "seed = -1"),
        ("height", 0.0, "height = 0"),
    ],
)
def test_a_recipe_that_cannot_be_made(field, value, words):
    with pytest.raises(RecordingError, match=words):
        Recipe(**{field: value})

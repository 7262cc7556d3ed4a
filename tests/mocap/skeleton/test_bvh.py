import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.io.recording import RecordingError
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.markersets.set_file import load_markerset
from study.mocap.skeleton.bvh import write_bvh
from study.mocap.skeleton.calibrate import calibrate
from study.mocap.skeleton.draw_skeleton import draw_skeleton
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize

CMU41 = load_markerset("cmu41")


def read_bvh(path):
    """Parse a BVH file by its grammar alone, and return nodes' places {name: (3, frames)}, parents and frame time.

    As Blender does it: a node's position channels, where it has them, stand in place of its offset; rotations apply in
    the order in which the channels are listed.
    """
    words = iter(path.read_text().split())
    assert next(words) == "HIERARCHY"
    nodes, stack, width = [], [], 0
    for word in words:
        if word in ("ROOT", "JOINT", "End"):
            name = next(words)
            node = {
                "name": f"{stack[-1]['name']} end" if word == "End" else name,
                "parent": stack[-1] if stack else None,
            }
            node["channels"], node["first"] = [], width
            assert (word == "ROOT") == (not stack)
            assert next(words) == "{"
            stack.append(node)
            nodes.append(node)
        elif word == "OFFSET":
            stack[-1]["offset"] = np.array([float(next(words)) for _ in range(3)])
        elif word == "CHANNELS":
            stack[-1]["first"] = width
            stack[-1]["channels"] = [next(words) for _ in range(int(next(words)))]
            width += len(stack[-1]["channels"])
        elif word == "}":
            stack.pop()
        else:
            assert word == "MOTION"
            assert not stack
            break
    assert next(words) == "Frames:"
    frames = int(next(words))
    assert (next(words), next(words)) == ("Frame", "Time:")
    time = float(next(words))
    numbers = np.array([float(word) for word in words]).reshape(frames, width)
    for node in nodes:
        turn, place = np.tile(np.eye(3), (frames, 1, 1)), np.tile(node["offset"], (frames, 1))
        for k, channel in enumerate(node["channels"]):
            column = numbers[:, node["first"] + k]
            if channel.endswith("position"):
                place[:, "XYZ".index(channel[0])] = column
            else:
                turn = turn @ Rotation.from_euler(channel[0], column[:, None], degrees=True).as_matrix()
        above = node["parent"]
        node["turn"] = turn if above is None else above["turn"] @ turn
        node["place"] = place if above is None else above["place"] + np.einsum("tij,tj->ti", above["turn"], place)
    return {node["name"]: node["place"].T for node in nodes}, time


def test_another_reader_finds_the_joints_where_they_are(figure, figure_calibration, tmp_path):
    """An independent reader finds every joint to a hundredth of a millimetre, y up, and the frame time."""
    skeleton = draw_skeleton(figure_calibration, figure[0].select(frames=slice(0, 300)))
    places, time = read_bvh(write_bvh(skeleton, tmp_path / "walk.bvh"))
    assert time == pytest.approx(1 / 120, abs=1e-8)
    for joint in skeleton.joints:
        x, y, z = skeleton.center(joint)
        np.testing.assert_allclose(places[joint], np.stack([x, z, -y]), atol=1e-5)
    assert {name for name in places if name.endswith(" end")} == {
        f"{name} end" for name in ("neck", "left_wrist", "right_wrist", "left_ankle", "right_ankle")
    }


def test_segment_without_a_known_joint_moves_freely(tmp_path):
    """A head that does not move on the chest has no neck; its node has its own positions, and they are right."""
    recording, _ = synthesize(Recipe(frames=300, noise=0.001))
    calibration = calibrate(
        recording.select([m for m in recording.markers if m not in ("C7", "T10", "CLAV", "STRN")]), CMU41
    )
    skeleton = draw_skeleton(calibration, recording)
    places, _ = read_bvh(write_bvh(skeleton, tmp_path / "part.bvh"))
    for joint in skeleton.joints:
        center = skeleton.center(joint)
        if joint in places and not np.isnan(center).any():
            x, y, z = center
            np.testing.assert_allclose(places[joint], np.stack([x, z, -y]), atol=1e-5, err_msg=joint)


def test_several_roots(tmp_path):
    """A set of two roots, legs and trunk, in one file: the second moves freely below the first, and is where it is."""
    recording, _ = synthesize(Recipe(frames=300, noise=0.001))
    parts = [s.model_copy(update={"parent": None}) if s.name == "thorax" else s for s in CMU41.segments]
    two = MarkerSet(name="two", segments=tuple(parts), joints=tuple(j for j in CMU41.joints if j.name != "waist"))
    skeleton = draw_skeleton(calibrate(recording, two), recording)
    places, _ = read_bvh(write_bvh(skeleton, tmp_path / "two.bvh"))
    for joint in ("neck", "left_elbow", "right_knee"):
        x, y, z = skeleton.center(joint)
        np.testing.assert_allclose(places[joint], np.stack([x, z, -y]), atol=1e-5, err_msg=joint)


def test_unknown_frames_hold_the_pose(figure, figure_calibration, tmp_path):
    """A frame that is unknown repeats the last known pose, so that there are numbers everywhere."""
    recording = figure[0].select(frames=slice(0, 400))
    positions = recording.positions.copy()
    positions[:, :, 100:] = np.nan
    hidden = type(recording)("hidden", recording.markers, positions, recording.rate)
    places, _ = read_bvh(write_bvh(draw_skeleton(figure_calibration, hidden, bridge=0.1), tmp_path / "hidden.bvh"))
    for place in places.values():
        assert np.isfinite(place).all()
        np.testing.assert_allclose(place[:, 150:], place[:, [-1]] * np.ones(250), atol=1e-9)


def test_no_root(figure, figure_calibration, tmp_path):
    """A recording without a pelvis is refused in one line."""
    recording = figure[0]
    rest = recording.select([m for m in recording.markers if m[1:] not in ("FWT", "BWT")])
    with pytest.raises(RecordingError, match="its pelvis is known in no frame"):
        write_bvh(draw_skeleton(figure_calibration, rest), tmp_path / "none.bvh")


def test_a_folder_that_cannot_be_written(figure, figure_calibration, tmp_path):
    (tmp_path / "file").touch()
    skeleton = draw_skeleton(figure_calibration, figure[0].select(frames=slice(0, 50)))
    with pytest.raises(RecordingError, match="cannot be written"):
        write_bvh(skeleton, tmp_path / "file" / "walk.bvh")

"""The hierarchy of joints that files are written from."""

import numpy as np

from study.mocap.export.joint_tree import joint_tree
from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.markersets.set_file import load_markerset
from study.mocap.skeleton.calibrate import calibrate


def test_several_roots(figure, exported):
    """A set of two roots, legs and trunk, is one tree: the second moves freely below the first, and is where it is."""
    cmu41, recording = load_markerset("cmu41"), figure[0].select(frames=slice(0, 300))
    parts = [s.model_copy(update={"parent": None}) if s.name == "thorax" else s for s in cmu41.segments]
    two = MarkerSet(name="two", segments=tuple(parts), joints=tuple(j for j in cmu41.joints if j.name != "waist"))
    motion = exported(recording, calibrate(recording, two))
    places = {}

    def place(node, turn, start):
        step = node.offset[:, None] if node.course is None else node.course
        places[node.name] = here = start + np.einsum("ijt,jt->it", turn, np.broadcast_to(step, start.shape))
        for child in node.children:
            place(child, np.einsum("ijt,jkt->ikt", turn, node.rotation), here)

    frames = recording.positions.shape[-1]
    place(joint_tree(motion), np.repeat(np.eye(3)[:, :, None], frames, axis=2), np.zeros((3, frames)))
    for joint in ("neck", "left_elbow", "right_knee"):
        expected = motion.upright @ motion.skeleton.center(joint)
        np.testing.assert_allclose(places[joint], expected, atol=1e-6, err_msg=joint)

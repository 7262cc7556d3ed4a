import numpy as np

from study.mocap.markersets.set_file import load_markerset
from study.mocap.synthetic.body_model import JOINTS, MARKERS, PARTS, nearest_pairs, unit


def test_the_body_has_the_shipped_marker_set():
    """Segments, parents, markers, joints and hinges are those of cmu41."""
    cmu = load_markerset("cmu41")
    ours = {part.name: (part.parent, set(part.markers)) for part in PARTS}
    assert ours == {segment.name: (segment.parent, set(segment.markers)) for segment in cmu.segments}
    joints = {(part.joint, part.parent, part.name, part.kind) for part in PARTS if part.joint}
    assert joints == {(joint.name, joint.parent, joint.child, joint.kind) for joint in cmu.joints}
    assert (len(PARTS), len(JOINTS), len(set(MARKERS))) == (15, 14, 41)


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
    pairs = nearest_pairs()
    assert {("LBWT", "RBWT"), ("LWRA", "LWRB"), ("LTOE", "LMT5")} <= set(pairs)
    assert {marker for pair in pairs for marker in pair} == set(MARKERS)


def test_unit():
    np.testing.assert_allclose(unit((3, 0, 4)), [0.6, 0, 0.8])

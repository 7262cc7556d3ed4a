import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.synthetic.body_model import PARTS
from study.mocap.synthetic.random_motion import draw_motion

PLACE = {part.name: i for i, part in enumerate(PARTS)}


def make(frames=3000, seed=5, reach=1.0, style="smooth", rate=120.0):
    return draw_motion(frames, rate, seed, height=1.75, reach=reach, style=style)


def turns(motion, part):
    """Rotations of a segment in its parent's axes, from the matrices of both."""
    child, parent = motion.rotations[PLACE[part.name]], motion.rotations[PLACE[part.parent]]
    return np.swapaxes(parent, 1, 2) @ child


@pytest.mark.parametrize("style", ["smooth", "independent"])
def test_rotations_are_proper(style):
    rotations = make(style=style).rotations
    np.testing.assert_allclose(
        rotations @ np.swapaxes(rotations, 2, 3), np.broadcast_to(np.eye(3), rotations.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)


@pytest.mark.parametrize("style", ["smooth", "independent"])
@pytest.mark.parametrize("part", [part for part in PARTS if part.joint], ids=lambda part: part.joint)
def test_joints_stay_in_their_natural_range(part, style):
    """Angles read back from the matrices stay in the range of motion, and use half of it at least."""
    relative = turns(make(style=style), part)
    if part.axis is None:
        angles = Rotation.from_matrix(relative).as_euler("YXZ", degrees=True).T
        limits = np.array(part.ranges)
    else:
        axis = np.array(part.axis) / np.linalg.norm(part.axis)
        np.testing.assert_allclose(relative @ axis, np.broadcast_to(axis, (len(relative), 3)), atol=1e-12)
        angles = np.degrees(Rotation.from_matrix(relative).as_rotvec() @ axis)[None]
        limits = np.array(part.ranges[:1])
    low, high = limits.T
    assert (angles.min(axis=1) >= low - 1e-9).all()
    assert (angles.max(axis=1) <= high + 1e-9).all()
    assert (np.ptp(angles, axis=1) >= 0.5 * (high - low) - 1e-9).all()


def test_a_joint_stays_where_it_is_in_both_segments():
    """The origin of the child is fixed in the parent's axes."""
    motion = make(frames=50)
    for part in PARTS[1:]:
        child, parent = PLACE[part.name], PLACE[part.parent]
        away = motion.origins[child] - motion.origins[parent]
        seen = np.einsum("tji,jt->it", motion.rotations[parent], away)
        np.testing.assert_allclose(seen, np.repeat(1.75 * np.array(part.at)[:, None], 50, axis=1), atol=1e-12)


def test_motion_is_smooth():
    """No angle changes faster than its range times the highest frequency; angles drawn anew do."""
    limit = 2 * np.pi * 0.7 / 120
    smooth, anew = make(), make(style="independent")
    assert np.abs(np.diff(smooth.phases, axis=1)).max() < limit
    assert np.abs(np.diff(anew.phases, axis=1)).max() > 1.5
    assert np.abs(smooth.phases).max() <= 1.0


def test_independent_poses_are_independent():
    """The lag-one correlation of 15 phases over 3000 frames: each within 4.5 of its standard errors of zero."""
    phases = make(style="independent").phases
    correlation = [np.corrcoef(row[1:], row[:-1])[0, 1] for row in phases]
    assert np.abs(correlation).max() < 4.5 / np.sqrt(3000)
    # uniform over the range
    np.testing.assert_allclose(phases.var(axis=1), 1 / 3, atol=4.5 * np.sqrt(4 / 45 / 3000))


def test_a_stiff_body():
    """With a reach of zero the joints do not rotate, but the body still moves."""
    motion = make(frames=200, reach=0.0)
    for part in PARTS[1:]:
        relative = turns(motion, part)
        np.testing.assert_allclose(relative, np.broadcast_to(relative[:1], relative.shape), atol=1e-12)
    assert np.ptp(motion.origins[0], axis=1).min() > 0.01


def test_more_frames_leave_the_first_as_they_were():
    np.testing.assert_array_equal(make(frames=50).origins, make(frames=80).origins[:, :, :50])

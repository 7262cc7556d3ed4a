import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.geometry.range_of_motion import cap_angle, rotation_range


@pytest.mark.parametrize("angle", [10.0, 60.0, 120.0])
def test_cap_angle_of_a_cap(rng, on_cap, angle):
    """On a uniformly filled cap it is the angle that holds 95 % of the area: cos = 1 - .95 (1 - cos φ)."""
    points, _ = on_cap(rng, 20_000, angle, radius=0.3, center=0.5)
    used = np.ones(len(points), dtype=bool)
    wanted = np.degrees(np.arccos(1 - 0.95 * (1 - np.cos(np.radians(angle)))))
    assert np.degrees(cap_angle(points.T, used, np.full(3, 0.5))) == pytest.approx(wanted, rel=0.02)


def test_unused_samples(rng, on_cap):
    """Unused samples do not widen the cap; without samples there is no angle."""
    points, _ = on_cap(rng, 500, 20.0)
    used = np.ones(600, dtype=bool)
    used[500:] = False
    y = np.concatenate([points, -points[:100]]).T
    assert cap_angle(y, used, np.zeros(3)) == cap_angle(points.T, used[:500], np.zeros(3))
    assert np.isnan(cap_angle(y, np.zeros(600, dtype=bool), np.zeros(3)))


def test_rotation_range_of_a_hinge(rng):
    """Of rotations about one axis, uniform within ±50°, 95 % are within 47.5° of their mean."""
    angles = np.radians(rng.uniform(-50, 50, 20_000))
    axis = np.array([0.6, 0.0, 0.8])
    rotation = (Rotation.from_euler("z", 30, degrees=True) * Rotation.from_rotvec(angles[:, None] * axis)).as_matrix()
    assert np.degrees(rotation_range(rotation.transpose(1, 2, 0))) == pytest.approx(47.5, abs=1.0)
    assert np.isnan(rotation_range(np.full((3, 3, 4), np.nan)))

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.geometry.moving_axes import nearest_rotation
from study.mocap.io.recording import RecordingError
from study.mocap.synthetic.body_model import PARTS
from study.mocap.synthetic.recipe import SKIN, Recipe
from study.mocap.synthetic.synthesize import synthesize

SEGMENT = np.array([i for i, part in enumerate(PARTS) for _ in part.markers])


def slid(**changes):
    """Displacements in the segments' axes (markers, 3, frames), and the truth."""
    recipe = {"frames": 400, "noise": 0.0, "rate": 50.0} | changes
    firm, truth = synthesize(Recipe(**recipe))
    soft, _ = synthesize(Recipe(**recipe, soft_tissue=0.02))
    rotation = truth.rotations[SEGMENT]
    return np.einsum("mtji,mjt->mit", rotation, soft.positions - firm.positions), truth


@pytest.mark.parametrize("gait", [False, True])
@pytest.mark.parametrize("skin", SKIN)
def test_skin_is_at_most_its_amplitude(skin, gait):
    moved, _ = slid(skin=skin, gait=gait)
    size = np.linalg.norm(moved, axis=1).max(axis=1)
    assert size.max() <= 0.02 + 1e-12
    assert np.median(size) > 0.004


@pytest.mark.parametrize("skin", ["angle", "velocity", "cluster", "random"])
def test_what_the_skin_moves_with(skin):
    """Linear in the rotation vector of the segment's joint, or in its rate; equal in a cluster; or in neither."""
    moved, truth = slid(skin=skin)
    thigh = truth.segments.index("left_thigh")
    relative = np.swapaxes(truth.rotations[0], 1, 2) @ truth.rotations[thigh]
    vector = Rotation.from_matrix(relative @ nearest_rotation(relative.sum(axis=0)).T).as_rotvec().T
    drive = np.gradient(vector, axis=1) if skin == "velocity" else vector
    one, two = moved[thigh == SEGMENT]
    fitted = one @ np.linalg.pinv(drive) @ drive
    explained = 1.0 - ((one - fitted) ** 2).sum() / (one**2).sum()
    assert explained < 0.9 if skin == "random" else explained > 1 - 1e-9
    assert np.allclose(one, two) == (skin == "cluster")


def test_a_law_that_does_not_exist():
    with pytest.raises(RecordingError, match="skin = loose of a synthetic body must be one of mixed, random, angle"):
        Recipe(skin="loose")
    with pytest.raises(RecordingError, match="independent and gait of a synthetic body exclude each other"):
        Recipe(independent=True, gait=True)


def test_gait_is_in_strides():
    """Rotations of the hip repeat with the stride, .8 to 1.1 per second, and are mostly flexion."""
    _, truth = slid(gait=True, frames=1000)
    thigh = truth.segments.index("right_thigh")
    relative = np.swapaxes(truth.rotations[0], 1, 2) @ truth.rotations[thigh]
    vector = Rotation.from_matrix(relative @ nearest_rotation(relative.sum(axis=0)).T).as_rotvec().T
    power = np.abs(np.fft.rfft(vector[1])) ** 2
    stride = np.argmax(power[1:]) + 1
    assert 0.75 < stride / (1000 / 50.0) < 1.15
    assert vector[1].std() > 2.0 * max(vector[0].std(), vector[2].std())
    assert np.degrees(np.abs(vector).max()) < 45.0

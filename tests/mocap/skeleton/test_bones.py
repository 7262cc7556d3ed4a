import numpy as np
import pytest

from study.mocap.skeleton.bones import bones, mirrored, side


def test_bones():
    """Two points are a bone and three a triangle; of four the middle one has the others; no bone occurs twice."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(5, 3, 7))
    points[4] = np.nan
    assert bones([[0, 1]], points, [""] * 5) == ((0, 1),)
    assert bones([[0, 1], [0, 1]], points, [""] * 5) == ((0, 1),)
    assert set(bones([[0, 1, 2]], points, [""] * 5)) == {(0, 1), (0, 2), (1, 2)}
    assert set(bones([[0, 1, 2, 3]], points, ["left", "right", "", "left"])) == {(2, 0), (2, 1), (2, 3)}
    assert bones([[], [3]], points, [""] * 5) == ()
    assert len(bones([[0, 1, 2, 4]], points, [""] * 5)) == 3


@pytest.mark.parametrize(
    ("name", "found"),
    [("left_knee", "left"), ("knee right", "right"), ("Left-Hip", "left"), ("cleft_chin", ""), ("waist", "")],
)
def test_side(name, found):
    """A side is a whole word of the name."""
    assert side(name) == found


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("left_knee", "right_knee"),
        ("Left_Knee", "Right_Knee"),
        ("KNEE RIGHT", "KNEE LEFT"),
        ("leftover_hip", "leftover_hip"),
        ("right_cleft", "left_cleft"),
        ("waist", "waist"),
    ],
)
def test_the_other_side(name, other):
    """The same words tell a side and are exchanged, capital letters or small, and back again."""
    assert mirrored(name) == other
    assert mirrored(other) == name
    assert (side(name) == side(other)) == (name == other)

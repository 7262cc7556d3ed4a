"""The scene: checks of its shapes, fewer frames, the floor."""

from dataclasses import replace

import numpy as np
import pytest

from study.mocap.io.recording import RecordingError
from study.mocap.skeleton.scene import Flag


@pytest.mark.parametrize("name", ["places", "centers", "ends", "flags", "errors", "orientations"])
def test_shapes_are_checked(scene, name):
    """An array of a wrong shape is refused by name."""
    wrong = getattr(scene, name)[:-1]
    with pytest.raises(RecordingError, match=f"{name} of the scene have shape"):
        replace(scene, **{name: wrong})


def test_bones_are_checked(scene):
    """A bone to a point that does not exist is refused, and so are missing doubts."""
    with pytest.raises(RecordingError, match=r"bone \(0, 99\)"):
        replace(scene, bones=((0, 99),))
    with pytest.raises(RecordingError, match="0 doubts for"):
        replace(scene, doubts=())


@pytest.mark.parametrize(
    ("rate", "frames", "result"), [(90.0, 90, 90.0), (60.0, 45, 45.0), (30.0, 30, 30.0), (500, 90, 90)]
)
def test_at_most(scene, rate, frames, result):
    """A scene with a lower rate has every second, third, ... frame and the same duration."""
    thinned = scene.at_most(rate)
    assert (thinned.frames, thinned.rate) == (frames, result)
    step = 90 // frames
    assert np.array_equal(thinned.centers, scene.centers[:, :, ::step], equal_nan=True)
    assert thinned.frames / thinned.rate == scene.frames / scene.rate


def test_floor(scene):
    """The floor is just below the lowest marker of nearly all frames."""
    lowest = np.nanmin(scene.places[:, 2])
    assert lowest - 0.03 < scene.floor < np.nanquantile(np.nanmin(scene.places[:, 2], axis=0), 0.1)
    assert np.isfinite(replace(scene, markers=(), places=np.empty((0, 3, 90))).floor)


def test_sides(scene):
    """Sides follow from names."""
    sides = dict(zip((*scene.joints, *scene.tips), scene.sides(), strict=True))
    assert sides["left_knee"] == "left"
    assert sides["right_foot"] == "right"
    assert sides["waist"] == ""


def test_flags_have_words():
    """Each flag says what it means."""
    assert [flag.text for flag in Flag] == ["from markers", "bridged: too few markers seen", "unknown"]

"""Joint centres beside the markers of a recording: the rest of its C3D file stays, labels do not collide."""

import ezc3d
import numpy as np
import pytest

from study.mocap.export.write_files import write_file
from study.mocap.io.reading import read_recording
from study.mocap.io.recording import Recording
from study.mocap.io.writing import write_recording


@pytest.fixture
def rich(motion, tmp_path):
    """A C3D file of the motion's markers with two analog channels, an event and a force plate's parameter."""
    path = write_recording(motion.recording, tmp_path / "rich.c3d")
    file = ezc3d.c3d(str(path))
    frames = motion.recording.frames
    file["parameters"]["ANALOG"]["RATE"]["value"] = [10 * motion.recording.rate]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = ["Fz1", "EMG"]
    file["parameters"]["ANALOG"]["UNITS"]["value"] = ["N", "V"]
    file["data"]["analogs"] = np.random.default_rng(1).normal(size=(1, 2, 10 * frames))
    file.add_parameter("EVENT", "LABELS", ["Foot Strike"])
    file.add_parameter("EVENT", "TIMES", np.array([[0.0], [0.31]]))
    file.add_parameter("FORCE_PLATFORM", "TYPE", [2])
    file.write(str(path))
    return path


def test_all_else_in_the_file_stays(motion, exported, figure_calibration, rich, tmp_path):
    """Markers, analog channels, events and parameters are the same to single precision."""
    recording = read_recording(rich)
    out = write_file(exported(recording, figure_calibration, source=rich), tmp_path / "out.c3d")
    before, after = ezc3d.c3d(str(rich)), ezc3d.c3d(str(out))
    count = len(recording.markers)
    np.testing.assert_allclose(after["data"]["points"][:, :count], before["data"]["points"], rtol=1e-6)
    np.testing.assert_allclose(after["data"]["analogs"], before["data"]["analogs"], rtol=1e-5, atol=1e-6)
    labels = after["parameters"]["POINT"]["LABELS"]["value"]
    assert labels == [*before["parameters"]["POINT"]["LABELS"]["value"], *motion.skeleton.joints]
    for group, name in (("EVENT", "LABELS"), ("EVENT", "TIMES"), ("ANALOG", "LABELS"), ("FORCE_PLATFORM", "TYPE")):
        one, other = (file["parameters"][group][name]["value"] for file in (before, after))
        np.testing.assert_array_equal(one, other)
    for name, center in zip(motion.skeleton.joints, motion.skeleton.centers, strict=True):
        np.testing.assert_allclose(after["data"]["points"][:3, labels.index(name)], 1000 * center, atol=1e-2)


def test_markers_read_in_another_unit(motion, exported, figure_calibration, rich, tmp_path):
    """If the file's own unit was overruled, its numbers cannot stand beside joints: the markers are written anew."""
    other = read_recording(rich)
    scaled = Recording(other.name, other.markers, 0.1 * other.positions, other.rate)
    out = write_file(exported(other, figure_calibration, source=rich), tmp_path / "one.c3d")
    assert ezc3d.c3d(str(out))["data"]["analogs"].size
    from dataclasses import replace

    small = replace(exported(other, figure_calibration, source=rich), recording=scaled)
    out = write_file(small, tmp_path / "two.c3d")
    assert not ezc3d.c3d(str(out))["data"]["analogs"].size
    np.testing.assert_allclose(read_recording(out).of("LFHD"), scaled.of("LFHD"), atol=1e-6)


@pytest.mark.parametrize("name", ["rich.trc", "none.c3d", "broken.c3d"])
def test_a_source_that_is_no_c3d_file(motion, exported, figure_calibration, tmp_path, name):
    """The markers are written from the recording."""
    source = tmp_path / name
    if name != "none.c3d":
        source.write_bytes(b"\x02\x50" + bytes(range(256)) * 20)
    out = write_file(exported(motion.recording, figure_calibration, source=source), tmp_path / "out.c3d")
    found = read_recording(out)
    np.testing.assert_allclose(found.of("LFHD"), motion.recording.of("LFHD"), atol=1e-6)
    np.testing.assert_allclose(found.of("neck"), motion.skeleton.center("neck"), atol=1e-6)


def test_a_marker_with_the_name_of_a_joint(motion, exported, figure_calibration):
    """Both are there, and the joint says that it is one."""
    recording = motion.recording
    markers = tuple("Left_Hip" if name == "RBAC" else name for name in recording.markers)
    other = exported(Recording("same", markers, recording.positions, recording.rate), figure_calibration)
    labels = other.with_joints().markers
    assert len(set(map(str.lower, labels))) == len(labels)
    assert "left_hip_joint" in labels
    np.testing.assert_array_equal(other.with_joints().of("left_hip_joint"), other.skeleton.center("left_hip"))

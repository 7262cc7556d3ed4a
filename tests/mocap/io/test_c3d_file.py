import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from study.mocap.io import c3d_file
from study.mocap.io.c3d_file import read_c3d
from study.mocap.io.c3d_header import LONG, read_header
from study.mocap.io.reading import read_recording
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.io.writing import write_recording


def refuse(path):
    raise ValueError("not today")


def without_ezc3d(monkeypatch):
    """Let ezc3d refuse every file."""
    monkeypatch.setattr(c3d_file, "ezc3d", SimpleNamespace(c3d=refuse))


@pytest.fixture(params=["ezc3d", "c3d"])
def either(request, monkeypatch):
    """Both ways of reading: with ezc3d, and with c3d if ezc3d refuses."""
    if request.param == "c3d":
        without_ezc3d(monkeypatch)


@pytest.fixture
def points():
    """(markers, 3, frames): numbers that single precision and whole tenths hold."""
    points = np.random.default_rng(1).integers(-9000, 9000, (3, 3, 7)) / 4.0
    points[1, :, 2] = np.nan
    return points


@pytest.mark.usefixtures("either")
class TestEitherLibrary:
    """Tests that pass with either library."""

    def test_contents(self, tmp_path, write_c3d, points):
        """Labels, unit, rate and numbers as another library wrote them; a negative residual is a missing sample."""
        found = read_c3d(write_c3d(tmp_path / "a.c3d", ["m:A", "m:B", "m:C"], points, rate=120.0, unit="cm"))
        assert list(found.labels) == ["m:A", "m:B", "m:C"]
        assert (found.unit, found.rate) == ("cm", 120.0)
        np.testing.assert_array_equal(found.points, points)

    def test_whole_numbers(self, tmp_path, write_c3d, points):
        """Coordinates stored in 16 bits, in units of POINT:SCALE."""
        found = read_c3d(write_c3d(tmp_path / "a.c3d", "ABC", np.round(points), scale=0.25))
        np.testing.assert_allclose(found.points, np.round(points), atol=0.25)
        assert np.isnan(found.points[1, :, 2]).all()

    def test_a_negative_residual_hides_what_is_there(self, tmp_path, write_c3d, points):
        path = write_c3d(tmp_path / "a.c3d", "ABC", np.nan_to_num(points, nan=1.0), residual=-1.0)
        with pytest.raises(RecordingError, match="none of its 3 markers has a sample"):
            read_recording(path)

    def test_angles_and_forces_are_no_markers(self, tmp_path, write_c3d, points):
        """Files that a gait model has processed hold angles and forces as points."""
        groups = [("ANGLES", ["B"]), ("FORCES", ["LForce", "C"])]
        found = read_c3d(write_c3d(tmp_path / "a.c3d", "ABC", points, groups=groups))
        assert list(found.labels) == ["A"]
        assert found.notes == ("2 points hold angles, forces and the like, not markers: left out",)
        np.testing.assert_array_equal(found.points, points[:1])

    def test_more_points_than_one_parameter_has_labels(self, tmp_path):
        """The labels after the 255th are in LABELS2."""
        labels = tuple(f"M{i}" for i in range(600))
        positions = np.random.default_rng(2).normal(size=(600, 3, 4))
        found = read_recording(write_recording(Recording("many", labels, positions, 60.0), tmp_path / "many.c3d"))
        assert found.markers == labels
        np.testing.assert_allclose(found.positions, positions, rtol=1e-6)

    def test_a_unit_that_is_not_given(self, tmp_path, write_c3d, points):
        recording = read_recording(write_c3d(tmp_path / "a.c3d", "ABC", points, unit="  "))
        assert recording.notes == ("the file does not give its unit: mm assumed",)

    def test_no_points(self, tmp_path, write_c3d):
        """A file of analog channels alone has none: its header and POINT:USED say zero."""
        path = write_c3d(tmp_path / "a.c3d", ["A"], np.ones((1, 3, 5)))
        data = bytearray(path.read_bytes())
        used = [found.end() + 4 for found in re.finditer(b"USED", data) if data[found.end() + 4] == 1]
        assert (data[2], len(used)) == (1, 1)
        data[2] = data[used[0]] = 0
        path.write_bytes(data)
        with pytest.raises(RecordingError, match="no markers in it"):
            read_recording(path)

    @pytest.mark.parametrize(
        ("points", "words"),
        [
            (np.ones((2, 3, 1)), "1 frame in it; motion needs at least 2"),
            (np.full((2, 3, 9), np.nan), "none of its 2 markers has a sample in any of its 9 frames"),
        ],
    )
    def test_nothing_to_work_with(self, tmp_path, write_c3d, points, words):
        with pytest.raises(RecordingError, match=words):
            read_recording(write_c3d(tmp_path / "a.c3d", "AB", points))

    @pytest.mark.parametrize("share", [0.55, 0.9, 0.999])
    def test_a_file_that_is_cut_short(self, tmp_path, write_c3d, share):
        """A file with too few frames is refused."""
        path = write_c3d(tmp_path / "a.c3d", "AB", np.ones((2, 3, 200)))
        whole = 1024 + 200 * 32
        assert len(path.read_bytes()) >= whole
        path.write_bytes(path.read_bytes()[: int(share * whole)])
        with pytest.raises(RecordingError, match=r"cut short: \d+ of 200 frames are there; get a whole copy"):
            read_c3d(path)


def test_more_frames_than_the_header_can_count(tmp_path):
    """A recording may have more frames than the 65535 that 16 bits hold."""
    positions = np.random.default_rng(3).normal(size=(1, 3, LONG + 10))
    path = write_recording(Recording("long", ("A",), positions, 1000.0), tmp_path / "long.c3d")
    assert read_header(path).frames == LONG
    found = read_recording(path)
    assert found.frames == LONG + 10
    np.testing.assert_allclose(found.positions, positions, rtol=1e-6)
    path.write_bytes(path.read_bytes()[:100_000])  # the missing frames are found without reading the others
    with pytest.raises(RecordingError, match=f"of {LONG + 10} frames are there"):
        read_recording(path)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "the file is empty"),
        (b"a text, not a recording\n" * 100, "not a C3D file"),
        (bytes(4096), "not a C3D file"),
        (b"\x02\x50", "cut short: its header is not complete"),
        (b"\x02\x50" + bytes(510), "cut short: its header is not complete"),
        (b"\x02\x50" + bytes(5000), "a damaged or incomplete C3D file; ezc3d: "),
        (
            b"\x02\x50" + b"\xff" * 5000,
            "its header promises 65535 frames of 65535 points .* 85.9 GB, but",
        ),
    ],
)
def test_what_is_not_a_c3d_file(tmp_path, data, words):
    """The message is one line with the file's name."""
    path = tmp_path / "a.c3d"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=words) as caught:
        read_recording(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_chain_of_parameters_that_does_not_hold_is_kept_from_ezc3d(tmp_path, monkeypatch, write_c3d, points):
    """ezc3d ends the whole program on some such files; c3d reads the rest of them."""
    path = write_c3d(tmp_path / "a.c3d", "ABC", points)
    assert read_header(path).sound
    data = bytearray(path.read_bytes())
    place = data.index(b"UNITS") + len("UNITS")
    distance = int.from_bytes(data[place : place + 2], "little")
    data[place + distance - 1] += 3  # the description is longer than its record
    path.write_bytes(data)
    assert not read_header(path).sound
    monkeypatch.setattr(c3d_file, "ezc3d", SimpleNamespace(c3d=lambda path: pytest.fail("ezc3d was asked")))
    np.testing.assert_array_equal(read_c3d(path).points, points)


CORRUPT = """
import sys
from pathlib import Path
import numpy as np
from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError

path, raw, rng, told = Path(sys.argv[1]), Path(sys.argv[1]).read_bytes(), np.random.default_rng(7), 0
for trial in range(600):
    data = bytearray(raw)
    for _ in range(1 + trial % 3):
        data[int(rng.integers(0, 1600))] = int(rng.integers(0, 256))
    path.write_bytes(data)
    try:
        read_recording(path)
    except RecordingError as error:
        told += 1
        assert "\\n" not in str(error) and str(error).isprintable(), str(error)
assert told > 20, told
"""


def test_damaged_files_end_no_program(tmp_path, small):
    """Six hundred files with wrong bytes in the header are read, or refused in one line."""
    path = write_recording(small(), tmp_path / "a.c3d")
    done = subprocess.run([sys.executable, "-c", CORRUPT, str(path)], capture_output=True, encoding="utf-8")
    assert (done.returncode, done.stderr) == (0, "")


def test_shared_recordings(shared_file):
    """The recordings have the markers, frames and heights that SOURCES.md gives."""
    for name, frames in (("cmu_135_02.c3d", 5202), ("cmu_85_02.c3d", 810)):
        recording = read_recording(shared_file(name))
        assert (len(recording.markers), recording.frames, recording.rate) == (41, frames, 120.0)
        assert recording.missing().max() == 0.0
        assert {"LFHD", "RMT5", "RBAC"} <= set(recording.markers)
        assert recording.notes == ()
        height = recording.of("LFHD")[2] - recording.of("LTOE")[2]
        assert 1.3 < np.quantile(height, 0.5) < 1.9


def test_both_libraries_agree_on_a_shared_recording(shared_file, monkeypatch):
    path = shared_file("cmu_85_02.c3d")
    by_ezc3d = read_recording(path)
    without_ezc3d(monkeypatch)
    by_c3d = read_recording(path)
    np.testing.assert_array_equal(by_c3d.positions, by_ezc3d.positions)
    assert (by_c3d.markers, by_c3d.rate) == (by_ezc3d.markers, by_ezc3d.rate)

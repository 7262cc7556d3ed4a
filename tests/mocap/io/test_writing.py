import sys
import warnings

import c3d
import numpy as np
import pytest
from trc import TRCData

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.io.writing import WRITERS, write_recording
from study.mocap.synthetic.recipe import Recipe
from study.mocap.synthetic.synthesize import synthesize


@pytest.mark.parametrize(
    ("ending", "tolerance"),
    # single precision of metres up to 4; half of the last decimal of a millimetre
    [("c3d", 3e-7), ("CSV", 0.5000001e-6), ("trc", 0.5000001e-7)],
)
def test_there_and_back(tmp_path, ending, tolerance):
    """Positions, gaps, labels, their order and the rate are the same after writing and reading."""
    recording, _ = synthesize(Recipe(frames=400, rate=59.94, gaps=0.15, seed=4))
    path = write_recording(recording, tmp_path / "new" / f"walk.{ending}")
    found = read_recording(path)
    assert (found.name, found.markers, found.notes) == ("walk", recording.markers, ())
    assert found.rate == pytest.approx(59.94, rel=1e-7)
    np.testing.assert_array_equal(np.isnan(found.positions), np.isnan(recording.positions))
    np.testing.assert_allclose(found.positions, recording.positions, rtol=0, atol=tolerance)


def test_another_library_reads_what_was_written(tmp_path, small):
    """Units are millimetres; a missing sample has a negative residual."""
    recording = small()
    path = write_recording(recording, tmp_path / "a.c3d")
    with open(path, "rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # c3d warns that there are no analog data
        reader = c3d.Reader(file)
        frames = np.array([points for _, points, _ in reader.read_frames()])
    assert [label.strip() for label in reader.point_labels] == list(recording.markers)
    assert (reader.point_rate, reader.get_string("POINT:UNITS").strip()) == (100.0, "mm")
    np.testing.assert_array_equal((frames[:, :, 3] < 0).T, ~recording.seen())
    seen = recording.seen().T
    wanted = 1000 * recording.positions.transpose(2, 0, 1)
    np.testing.assert_allclose(frames[:, :, :3][seen], wanted[seen], rtol=1e-6)


def test_a_trc_with_gaps_for_another_reader(tmp_path):
    """Millimetres, and nan for a missing sample: readers that split rows at white space would lose an empty cell."""
    positions = np.array([[[0.1, np.nan], [0.2, np.nan], [0.3, np.nan]], [[1.0, 1.5], [2.0, 2.5], [3.0, 3.5]]])
    path = write_recording(Recording("walk", ("A", "B"), positions, 50.0), tmp_path / "new.trc")
    data = TRCData()
    data.load(path)
    assert (data["Markers"], data["DataRate"], data["Units"], data["Time"]) == (["A", "B"], 50.0, "mm", [0.0, 0.02])
    np.testing.assert_allclose(data["A"], 1000 * positions[0].T)
    np.testing.assert_allclose(data["B"], 1000 * positions[1].T)


def test_a_table_for_people(tmp_path):
    recording = Recording("walk", ("A",), np.array([[[1.0, np.nan], [2.0, np.nan], [-0.5, np.nan]]]), 100.0)
    text = write_recording(recording, tmp_path / "walk.csv").read_text()
    assert text == "# rate: 100.0\n# unit: mm\nframe,A_X,A_Y,A_Z\n1,1000.000,2000.000,-500.000\n2,,,\n"


def test_the_same_bytes_twice(tmp_path):
    recording, _ = synthesize(Recipe(frames=30))
    for ending in WRITERS:
        once, twice = (write_recording(recording, tmp_path / f"{i}{ending}").read_bytes() for i in "ab")
        assert once == twice


def test_where_nothing_can_be_written(tmp_path, small):
    with pytest.raises(RecordingError, match=r"a recording is written to a file whose name ends in .c3d, .trc, .csv"):
        write_recording(small(), tmp_path / "walk.bvh")
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be written: "):
        write_recording(small(), tmp_path / "file" / "walk.c3d")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(RecordingError, match="cannot be written: Is a directory"):
        write_recording(small(), tmp_path / "folder.csv")


def test_a_file_that_was_there_stays_if_the_new_one_fails(tmp_path, small, monkeypatch):
    """A missing library, and a writer that breaks off, leave the old file and nothing else."""
    path = write_recording(small(), tmp_path / "walk.c3d")
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "ezc3d", None)
        with pytest.raises(RecordingError, match="writing it needs ezc3d"):
            write_recording(small(seed=4), path)

    def breaks_off(recording, path):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(WRITERS, ".c3d", breaks_off)
    with pytest.raises(RecordingError, match="cannot be written: No space left on device"):
        write_recording(small(seed=4), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]

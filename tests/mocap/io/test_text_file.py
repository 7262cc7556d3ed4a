import numpy as np
import pytest

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError

TRC = """PathFileType\t4\t(X/Y/Z)\twalk.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
100.00\t100.00\t3\t2\tmm\t100.00\t1\t3
Frame#\tTime\tm:A\t\t\tm:B\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.000\t100.5\t200\t300\t400\t500\t600
2\t0.010\t101\t201\t301\t\t\t
3\t0.020\t102\t202\t302\t402\t502\t602\t
"""

VICON = """Trajectories
120
,,m:A,,,m:B,,
Frame,Sub Frame,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm
1,0,100.5,200,300,400,500,600
2,0,101,201,301,,,
3,0,102,202,302,402,502,602

Model Outputs
120
,,m:Angle,,
Frame,Sub Frame,X,Y,Z
,,deg,deg,deg
1,0,1,2,3
"""

TABLE = """# rate: 50
# unit: mm
frame,B_x,A_X,A_Z,note,A_Y,B_z,B_y
1,400,100.5,300,,200,600,500
2,,101,301,,201,,
3,402,102,302,,202,602,502
"""

WANTED = np.array(
    [
        [[0.1005, 0.101, 0.102], [0.2, 0.201, 0.202], [0.3, 0.301, 0.302]],
        [[0.4, np.nan, 0.402], [0.5, np.nan, 0.502], [0.6, np.nan, 0.602]],
    ]
)


def read(folder, text, name="walk.csv", **options):
    path = folder / name
    path.write_text(text, encoding="utf-8") if isinstance(text, str) else path.write_bytes(text)
    return read_recording(path, **options)


@pytest.mark.parametrize(
    ("name", "text", "rate"),
    [
        ("walk.trc", TRC, 100.0),
        ("walk.trc", TRC.replace("\t400", "\t4e2").replace("\t\t\t\n", "\tNaN\tNaN\tNaN\n"), 100.0),
        ("walk.csv", VICON, 120.0),
        ("walk.csv", VICON.replace(",", ";"), 120.0),
        ("walk.csv", VICON.replace(",", "\t"), 120.0),
        ("walk.csv", TABLE, 50.0),
        ("walk.csv", TABLE.replace(",", ";").replace("100.5", "100,5"), 50.0),
        ("walk.tsv", TABLE.replace(",", "\t"), 50.0),
        ("walk.txt", TABLE.replace("# unit: mm\n", "").replace("_x", " [mm] x").replace(" [mm] x", "_x (mm)"), None),
        ("walk.csv", TABLE.replace(",", ", ").replace("400", '"400"'), 50.0),
        ("walk.csv", TABLE.replace("_", "."), 50.0),
        ("walk.csv", TABLE.replace("_", ":").replace("\n", "\r\n"), 50.0),
        ("walk.csv", "\ufeff" + TABLE, 50.0),
    ],
)
def test_the_same_markers_in_many_spellings(tmp_path, name, text, rate):
    """TRC, Vicon's export and tables in any order of columns."""
    found = read(tmp_path, text, name, unit=None if rate else "mm")
    assert set(found.markers) == {"A", "B"}
    np.testing.assert_allclose(found.select(["A", "B"]).positions, WANTED, rtol=1e-14)
    assert found.rate == (rate or 50.0)


def test_rate_by_a_column_of_seconds(tmp_path):
    text = "time,A_x,A_y,A_z\n0.5,1,2,3\n0.51,1,2,4\n0.52,1,2,5\n"
    assert read(tmp_path, text, unit="m").rate == pytest.approx(100.0)
    with pytest.raises(RecordingError, match=r"line 4: the step in time is 0.2 s, elsewhere 0.01 s"):
        read(tmp_path, text.replace("0.52", "0.71") + "0.72,1,2,3\n", unit="m")


def test_unit_in_the_header_of_columns(tmp_path):
    text = "# rate: 10\nA_x [cm],A_y [cm],A_z [cm]\n100,2,3\n100,2,4\n"
    np.testing.assert_allclose(read(tmp_path, text).of("A")[0], [1.0, 1.0])


def test_what_the_file_does_not_say_is_asked_for(tmp_path):
    text = "A_x,A_y,A_z\n1,2,3\n1,2,4\n"
    with pytest.raises(RecordingError, match="its unit is not given"):
        read(tmp_path, text)
    with pytest.raises(RecordingError, match="its rate in frames per second is not given"):
        read(tmp_path, text, unit="m")
    assert read(tmp_path, text, unit="m", rate=25.0).rate == 25.0


def test_an_empty_row_is_a_frame_without_markers(tmp_path):
    """A frame without any sample does not end the table."""
    found = read(tmp_path, "# rate: 5\n# unit: m\nA_x,A_y,A_z\n1,2,3\n,,\n\n1,2,4\n".replace("\n\n", "\n"))
    assert found.seen()[0].tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("walk.csv", "", "the file is empty"),
        ("walk.csv", "\n \n", "the file is empty"),
        ("walk.csv", b"\x00\x01\x02" * 50, "not a text file"),
        ("walk.csv", "# rate: 5\n", "it holds only comments"),
        ("walk.csv", "x,y,z\n1,2,3\n", "line 1: no columns such as LFHD_X, LFHD_Y, LFHD_Z; found x, y, z"),
        ("walk.csv", "A_x,A_y\n1,2\n", "line 1: marker A has no column for z"),
        ("walk.csv", "A_x,A_y,A_z,A_X\n1,2,3,4\n", "line 1: two columns have the name 'A_X'"),
        ("walk.csv", TABLE.replace("101", "1o1"), "line 5, column 3: '1o1' is not a number"),
        ("walk.csv", TABLE.replace("2,,101", "4,,101"), "line 5: frame 4 follows frame 1"),
        ("walk.csv", TABLE[:-10], "line 6 has 6 cells; 8 are needed; the line may be cut short"),
        ("walk.csv", TABLE.replace("500\n", "500,7\n"), "line 4, column 9: '7.0' has no header"),
        ("walk.csv", TABLE.replace("rate: 50", "rate: fast"), "its rate 'fast' is not a number"),
        ("walk.csv", "# rate: 5\n# unit: m\nA_x,A_y,A_z\n", "no frames in it"),
        ("walk.csv", "# rate: 5\n# unit: m\nA_x,A_y,A_z\n1,2,3\n", "1 frame in it"),
        ("walk.trc", "hello", "not a TRC file"),
        ("walk.trc", TRC[: TRC.index("3\t0.020")], "cut short: 2 of 3 frames are there"),
        ("walk.trc", TRC[:-14], "line 9 has 5 cells; 8 are needed"),
        ("walk.trc", TRC.replace("\t3\t2\tmm", "\t3\t5\tmm"), "line 4 has 2 labels, but line 3 gives 5 markers"),
        ("walk.trc", TRC.replace("NumFrames", "Frames"), "must give DataRate, NumFrames and NumMarkers"),
        ("walk.csv", "Trajectories\n120\n", "cut short: no rows after the line Trajectories"),
        ("walk.csv", VICON.replace("120", "fast"), "line 2: 'fast' should be the rate"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, name, text, words):
    """The message is one line with the file's name."""
    with pytest.raises(RecordingError, match=words) as caught:
        read(tmp_path, text, name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)

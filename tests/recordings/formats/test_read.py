"""Text formats of other programs, in small files written by their public descriptions.

Qualisys Track Manager User Manual, "TSV file formats"; OptiTrack documentation, "Data Export: CSV"; OpenSim
documentation, "Marker (.trc) Files".
"""

import re
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from study.recordings.formats.read import read_recording
from study.recordings.recording import RecordingError

WANTED = np.array(
    [
        [[0.1005, 0.101, 0.102], [0.2, 0.201, 0.202], [0.3, 0.301, 0.302]],
        [[0.4, np.nan, 0.402], [0.5, np.nan, 0.502], [0.6, np.nan, 0.602]],
    ]
)
"""Markers A and B in three frames, metres; B is missing in the second."""

QUALISYS = """NO_OF_FRAMES\t3
NO_OF_CAMERAS\t8
NO_OF_MARKERS\t2
FREQUENCY\t100
NO_OF_ANALOG\t0
ANALOG_FREQUENCY\t0
DESCRIPTION\t--
TIME_STAMP\t2026-01-02, 10:11:12.345\t100.5
DATA_INCLUDED\t3D
MARKER_NAMES\tA\tB
"""

TYPES = "TRAJECTORY_TYPES\tMeasured\tMeasured\n"

HEADS = "Frame\tTime\tA X\tA Y\tA Z\tB X\tB Y\tB Z\n"

ROWS = ["100.5\t200\t300\t400\t500\t600", "101\t201\t301\t{}\t{}\t{}", "102\t202\t302\t402\t502\t602"]


def qualisys(header=QUALISYS, counted=False, absent="", end=""):
    """A file of Qualisys Track Manager, with the columns Frame and Time or without."""
    rows = [row.format(absent, absent, absent) + end for row in ROWS]
    rows = [f"{i + 1}\t{i / 100:.5f}\t{row}" for i, row in enumerate(rows)] if counted else rows
    return header + "\n".join(rows) + "\n"


MOTIVE = """Format Version,1.23,Take Name,walk,Capture Frame Rate,120.000000,Export Frame Rate,60.000000,Capture Start \
Time,2026-01-02 10.11.12.345 AM,Total Frames in Take,3,Total Exported Frames,3,Rotation Type,Quaternion,Length \
Units,Millimeters,Coordinate Space,Global

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body Marker,\
Rigid Body Marker,Rigid Body Marker,Rigid Body Marker,Marker,Marker,Marker,Marker,Marker,Marker,Marker,Marker,Marker
,Name,Thigh,Thigh,Thigh,Thigh,Thigh,Thigh,Thigh,Thigh,Thigh:A,Thigh:A,Thigh:A,Thigh:A,Thigh:A,Thigh:A,Thigh:A,\
Thigh:B,Thigh:B,Thigh:B,Unlabeled 7,Unlabeled 7,Unlabeled 7
,ID,1,1,1,1,1,1,1,1,2,2,2,2,3,3,3,4,4,4,5,5,5
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,Position,Position,Position,Marker \
Quality,Position,Position,Position,Position,Position,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,,X,Y,Z,X,Y,Z,X,Y,Z
0,0.000000,0,0,0,1,9,9,9,0.1,8,8,8,1.0,100.5,200,300,400,500,600,7,7,7
1,0.016667,0,0,0,1,9,9,9,0.1,8,8,8,1.0,101,201,301,,,,,,
2,0.033333,0,0,0,1,9,9,9,0.1,8,8,9,1.0,102,202,302,402,502,602,,,
"""

TRC_AS_CSV = """PathFileType,4,(X/Y/Z),walk.trc,,,,
DataRate,CameraRate,NumFrames,NumMarkers,Units,OrigDataRate,OrigDataStartFrame,OrigNumFrames
100,100,3,2,mm,100,1,3
Frame#,Time,A,,,B,,
,,X1,Y1,Z1,X2,Y2,Z2
1,0.00,100.5,200,300,400,500,600
2,0.01,101,201,301,,,
3,0.02,102,202,302,402,502,602
"""

TWO_LINES = """Rate,100
Units,mm
Frame,Time,A,,,B,,
,,X1,Y1,Z1,X2,Y2,Z2
1,0.00,100.5,200,300,400,500,600
2,0.01,101,201,301,,,
3,0.02,102,202,302,402,502,602
"""

BTK = """Frame number,3
First frame,11
Point frequency,200
Analog frequency,1000

Left_Foot Strike,0.06
Right_Foot Off,0.055,0.07

Time,A,,,LHipAngles,,,B,,
s,mm,mm,mm,deg,deg,deg,mm,mm,mm
,X,Y,Z,X,Y,Z,X,Y,Z
0.05,100.5,200,300,12,3,4,400,500,600
0.055,101,201,301,13,3,4,,,
0.06,102,202,302,14,3,4,402,502,602

Time,Fz1
s,N
0.05,100
0.051,101

"""
"""As BTK's ``btkASCIIFileWriter`` lays it out: header, events, points of several types, analog channels."""

D_FLOW = """TimeStamp\tFrameNumber\tA.PosX\tA.PosY\tA.PosZ\tB.PosX\tB.PosY\tB.PosZ\tFP1.CopX
5.00\t11\t0.1005\t0.2\t0.3\t0.4\t0.5\t0.6\t1
5.01\t12\t0.101\t0.201\t0.301\t0\t0\t0\t1
5.02\t13\t0.102\t0.202\t0.302\t0.402\t0.502\t0.602\t1
"""


def read(folder, text, name="walk.csv", **options):
    (folder / name).write_text(text, encoding="utf-8")
    return read_recording(folder / name, **options)


@pytest.mark.parametrize(
    ("text", "name", "rate"),
    [
        (qualisys(), "walk.tsv", 100.0),
        (qualisys(counted=True), "walk.tsv", 100.0),
        (qualisys(QUALISYS + TYPES + HEADS, counted=True, absent="NULL"), "walk.tsv", 100.0),
        (qualisys(QUALISYS + HEADS, counted=True, absent="0.000", end="\t"), "walk.txt", 100.0),
        (qualisys(absent="0.000", end="\t"), "walk.tsv", 100.0),
        (qualisys().replace(".5\t", ",5\t").replace("FREQUENCY\t100", "FREQUENCY\t59,94"), "walk.tsv", 59.94),
        (MOTIVE, "walk.csv", 60.0),
        (TRC_AS_CSV, "walk.csv", 100.0),
        (TRC_AS_CSV.replace(",", "\t"), "walk.txt", 100.0),
        (TWO_LINES, "walk.csv", 100.0),
        (TWO_LINES.replace("Rate,100\n", ""), "walk.csv", 100.0),
        (TWO_LINES.replace("Frame,Time,A", ",,A").replace(",,X1", "Frame,Time,X1"), "walk.csv", 100.0),
        (TWO_LINES.replace(",", "\t").replace("X1\tY1\tZ1\tX2\tY2\tZ2", "X\tY\tZ\tX\tY\tZ"), "walk.tsv", 100.0),
        (D_FLOW, "walk.txt", 100.0),
        (BTK, "walk.csv", 200.0),
        (BTK.replace(",", "\t"), "walk.txt", 200.0),
        (BTK.replace(",", ";"), "walk.csv", 200.0),
        (BTK[BTK.index("Time,A") :], "walk.csv", 200.0),
        (BTK.replace(",mm", ",m").replace("Point frequency,200", "Point frequency,0"), "walk.csv", 200.0),
    ],
)
def test_the_same_markers_in_other_programs_formats(tmp_path, text, name, rate):
    found = read(tmp_path, text, name, unit="m" if text == D_FLOW else "mm" if ",m,m,m" in text else None)
    assert set(found.markers) == {"A", "B"}
    np.testing.assert_allclose(found.select(["A", "B"]).positions, WANTED, rtol=1e-14)
    assert found.rate == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("text", [qualisys(), MOTIVE, TRC_AS_CSV, TRC_AS_CSV.replace(",", "\t")])
@pytest.mark.parametrize("name", ["walk.csv", "walk.dat", "walk"])
def test_the_format_is_told_by_the_contents(tmp_path, text, name):
    """A name that says nothing, or something else, does not matter."""
    assert read(tmp_path, text, name).frames == 3


def test_c3d_by_its_contents(tmp_path, write_c3d):
    """A C3D file is read under a wrong name; a text that is called .c3d is read as what it is."""
    path = write_c3d(tmp_path / "walk.c3d", ["A", "B"], 1000 * WANTED)
    path.rename(tmp_path / "walk.txt")
    np.testing.assert_allclose(read_recording(tmp_path / "walk.txt").positions, WANTED, rtol=2e-7)
    assert read(tmp_path, TRC_AS_CSV, "walk.c3d").frames == 3
    with pytest.raises(RecordingError, match=r"walk.dat: a recording is a file whose name ends in .c3d"):
        read(tmp_path, "A_X,A_Y,A_Z\n1,2,3\n", "walk.dat")


def test_btk_tells_what_it_leaves_out(tmp_path):
    """Points in degrees, newtons and the like are no markers; nothing of the analog channels is read."""
    assert read(tmp_path, BTK).notes == ("1 points hold angles, forces and the like, not markers: left out",)


@pytest.mark.parametrize(
    ("text", "markers"),
    [
        (MOTIVE.replace("Thigh:B", "Shank:B"), ("A", "B")),
        (MOTIVE.replace("Thigh:B", "Thigh:C"), ("A", "C")),
        (MOTIVE.replace("Thigh:B", "Shank:A"), ("Thigh A", "Shank A")),
    ],
)
def test_rigid_bodies_are_segments_of_one_subject(tmp_path, text, markers):
    """Bodies of the Motive file are no subjects to choose from; a label that two bodies have gets the body's name."""
    text = text.replace("Thigh,Thigh:A,Thigh:A", "Thigh,Shank:Z,Thigh:A", 1)
    assert read(tmp_path, text).markers == markers


def test_motive_tells_what_it_leaves_out(tmp_path):
    """Measured markers are taken before solved ones; a marker with a number alone keeps its asset's name."""
    found = read(tmp_path, MOTIVE)
    assert found.notes == ("1 markers without a label are left out",)
    solved = MOTIVE.replace(",Marker,Marker,Marker", "")  # types end early: these columns have none
    found = read(tmp_path, solved)
    assert found.markers == ("A",)
    np.testing.assert_allclose(found.of("A")[2], [0.008, 0.008, 0.009], rtol=1e-14)
    assert "solved rigid bodies" in found.notes[-1]
    found = read(tmp_path, MOTIVE.replace("Thigh:A", "Thigh:Marker 001").replace("Thigh:B", "Shank:Marker1"))
    assert found.markers == ("Thigh Marker 001", "Shank Marker1")


def trc(header_rate=100, rate=100, frames=50, promised=None, skip=(), scale=1.0, digits=6):
    """A TRC file of one marker; its column Time has another rate than its header, if so asked."""
    lines = ["PathFileType\t4\t(X/Y/Z)\twalk.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"]
    lines += [f"{header_rate}\t{header_rate}\t{promised or frames}\t1\tmm", "Frame#\tTime\tA\t\t", "\t\tX1\tY1\tZ1"]
    kept = [i for i in range(frames) if i not in skip]
    lines += [f"{i + 1}\t{scale * i / rate:.{digits}f}\t{i}\t{2 * i}\t{i + 500}" for i in kept]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("made", "rate", "words"),
    [
        ({}, 100.0, None),
        ({"header_rate": 120, "rate": 120, "digits": 2}, 120.0, None),  # rounded to hundredths of a second
        ({"header_rate": 119.88, "rate": 120}, 119.88, None),
        ({"header_rate": 200}, 100.0, "its header gives 200 Hz, but its column Time 100 Hz: the column is believed"),
        ({"header_rate": 0}, 100.0, "its header gives 0 Hz, but its column Time 100 Hz: the column is believed"),
        ({"scale": 1000.0}, 100.0, "its column Time is in milliseconds"),
        ({"scale": 0.0, "header_rate": 60}, 60.0, None),
        ({"header_rate": 200, "skip": (20,)}, 100.0, "the column is believed"),
    ],
)
def test_a_rate_that_contradicts_the_times(tmp_path, made, rate, words):
    found = read(tmp_path, trc(**made), "walk.trc")
    assert found.rate == rate
    assert bool(found.notes) == (words is not None)
    assert words is None or any(words in note for note in found.notes)
    assert read(tmp_path, trc(**made), "walk.trc", rate=25.0).rate == 25.0


def test_uneven_times_are_not_believed(tmp_path):
    """Where the column Time jumps, it gives no rate."""
    text = trc(header_rate=100).replace("20\t0.190000", "20\t0.180100")
    found = read(tmp_path, text, "walk.trc")
    assert (found.rate, found.frames) == (100.0, 50)
    assert any("uneven steps" in note for note in found.notes)


def test_few_missing_frames_are_told_and_many_are_refused(tmp_path):
    """Of 500 frames one may be missing at the end, or left out between: times stay right."""
    found = read(tmp_path, trc(frames=499, promised=500), "walk.trc")
    assert (found.frames, found.notes) == (
        499,
        ("its header promises 500 frames, but 499 are there: the end may be cut off",),
    )
    found = read(tmp_path, trc(frames=500, skip=(123,)), "walk.trc")
    assert (found.frames, found.rate) == (500, 100.0)
    assert np.flatnonzero(~found.seen()[0]).tolist() == [123]
    np.testing.assert_allclose(found.of("A")[0, 400:], np.arange(400, 500) / 1000, rtol=1e-12)
    assert found.notes == ("1 of 500 frames are not in it, the first after frame 123: they count as missing",)
    with pytest.raises(RecordingError, match="cut short: 400 of 500 frames"):
        read(tmp_path, trc(frames=400, promised=500), "walk.trc")
    with pytest.raises(RecordingError, match="line 16: frame 32 follows frame 10"):
        read(tmp_path, trc(frames=100, skip=range(10, 31)), "walk.trc")


def test_frames_left_out_of_other_formats(tmp_path):
    """A counter that skips a frame of 20 is completed in every format that has one."""
    rows = [i for i in range(20) if i != 7]
    vicon = "Trajectories\n100\n,,A,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n"
    files = {
        "a.csv": vicon + "".join(f"{i + 1},0,{i + 50},2,3\n" for i in rows),
        "b.csv": "# unit: mm\nframe,time,A_x,A_y,A_z\n" + "".join(f"{i},{i / 100},{i + 50},2,3\n" for i in rows),
        "c.tsv": QUALISYS.replace("\tB", "").replace("FRAMES\t3", "FRAMES\t20")
        + "".join(f"{i + 1}\t{i / 100}\t{i + 50}\t2\t3\n" for i in rows),
    }
    for name, text in files.items():
        found = read(tmp_path, text, name)
        assert (found.frames, found.rate, np.flatnonzero(~found.seen()[0]).tolist()) == (20, 100.0, [7]), name
        assert found.of("A")[0, 19] == pytest.approx(0.069)


def test_a_c3d_file_that_lacks_its_last_frames(tmp_path, write_c3d):
    """A header that promises one frame more than there are is told; half a file is refused."""
    points = np.random.default_rng(1).normal(size=(2, 3, 500)) * 100
    path = write_c3d(tmp_path / "walk.c3d", ["A", "B"], points)
    data = bytearray(path.read_bytes())
    assert int.from_bytes(data[8:10], "little") == 500  # word 5 of the header: the last frame (c3d.org)
    data[8:10] = (501).to_bytes(2, "little")
    path.write_bytes(data)
    found = read_recording(path)
    assert found.frames == 500
    assert any("promises 501 frames, but 500 are there" in note for note in found.notes)
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(RecordingError, match="cut short"):
        read_recording(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (qualisys().replace("3D", "6D"), "it holds 6D data; export the trajectories"),
        (qualisys().replace("MARKER_NAMES\tA\tB", "MARKER_NAMES"), "no line MARKER_NAMES"),
        (qualisys().replace("FREQUENCY\t100", "FREQUENCY\tfast"), "no line FREQUENCY"),
        (qualisys().replace("\tA\tB", "\tA\tB\tC"), "line 11 has 6 cells; 9 are needed"),
        (qualisys().replace("FRAMES\t3", "FRAMES\t30"), "cut short: 3 of 30 frames"),
        (
            MOTIVE.replace(",Marker", ",Bone").replace("Rigid Body Marker", "Bone"),
            "no labelled markers in it, but bone",
        ),
        (MOTIVE.replace("Frame,Time", "Item,Time"), "no lines Type, Name and Frame above the rows"),
        (MOTIVE.replace(",Name,", ",Names,"), "no lines Type, Name and Frame above the rows"),
        (MOTIVE.replace(",101,201", ",1o1,201"), "line 9, column 15: '1o1' is not a number"),
        (TWO_LINES.replace(",A,", ",,"), "line 3, column 3: no label above the axes X1"),
    ],
)
def test_what_is_wrong_is_told(tmp_path, text, words):
    """The message is one line with the file's name."""
    with pytest.raises(RecordingError, match=words) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "walk.csv"))
    assert "\n" not in str(caught.value)


MARKERS = ("LFHD", "RFHD", "C7", "LFIN", "RTOE")

FACTOR = {"mm": 1000.0, "cm": 100.0, "m": 1.0}


def as_c3d(path, labels, points, unit, write_c3d):
    return write_c3d(path / "walk.c3d", labels, points, unit=unit)


def as_trc(path, labels, points, unit, write_c3d):
    count = points.shape[2]
    lines = ["PathFileType\t4\t(X/Y/Z)\twalk.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"]
    lines += [f"100\t100\t{count}\t{len(labels)}\t{unit}", "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t", "\t\tX1"]
    for i in range(count):
        cells = ["" if np.isnan(x) else repr(float(x)) for x in points[:, :, i].ravel()]
        lines.append("\t".join([str(i + 1), f"{i / 100}", *cells]))
    (path / "walk.trc").write_text("\n".join(lines))
    return path / "walk.trc"


def as_csv(path, labels, points, unit, write_c3d):
    lines = ["# rate: 100", f"# unit: {unit}", ",".join(f"{label}_{axis}" for label in labels for axis in "XYZ")]
    for i in range(points.shape[2]):
        lines.append(",".join("" if np.isnan(x) else repr(float(x)) for x in points[:, :, i].ravel()))
    (path / "walk.csv").write_text("\n".join(lines) + "\n")
    return path / "walk.csv"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    order=st.permutations(range(len(MARKERS))),
    prefix=st.sampled_from(["", "male:", "Subject 1:", "60-08:", "a:b:"]),
    unit=st.sampled_from(sorted(FACTOR)),
    form=st.sampled_from([as_c3d, as_trc, as_csv]),
)
def test_order_prefix_unit_and_format_do_not_matter(tmp_path, write_c3d, order, prefix, unit, form):
    """The same motion in two formats is the same recording."""
    rng = np.random.default_rng(11)
    positions = np.round(rng.normal(size=(len(MARKERS), 3, 6)), 4)
    positions[2, :, 1:3] = np.nan
    labels = [prefix + MARKERS[i] for i in order]
    path = form(tmp_path, labels, positions[list(order)] * FACTOR[unit], unit, write_c3d)
    found = read_recording(path)
    assert found.markers == tuple(MARKERS[i] for i in order)
    assert (found.name, found.rate, found.notes) == ("walk", 100.0, ())
    # C3D files hold single precision
    np.testing.assert_allclose(found.select(MARKERS).positions, positions, rtol=2e-7 if form is as_c3d else 1e-13)


def test_a_name_that_no_recording_has(tmp_path):
    with pytest.raises(RecordingError, match=r"walk.bvh: a recording is a file whose name ends in .c3d, .csv, .trc"):
        read_recording(tmp_path / "walk.bvh")


@pytest.mark.parametrize("name", ["walk.c3d", "walk.csv", "walk.trc"])
def test_a_file_that_is_not_there(tmp_path, name):
    with pytest.raises(RecordingError, match=f"{name}: cannot be read: No such file"):
        read_recording(tmp_path / name)
    (tmp_path / name).mkdir()
    with pytest.raises(RecordingError, match=f"{name}: cannot be read: Is a directory"):
        read_recording(tmp_path / name)


def test_options_reach_every_format(tmp_path, write_c3d):
    """Unit, rate and subject of the caller override the file."""
    points = np.ones((3, 3, 4))
    labels = ["a:A", "a:B", "b:A"]
    for form in (as_c3d, as_trc, as_csv):
        path = form(tmp_path, labels, points, "mm", write_c3d)
        with pytest.raises(RecordingError, match=r"2 subjects: a \(2 markers\), b"):
            read_recording(path)
        found = read_recording(path, subject="a", unit="m", rate=60.0)
        assert (found.markers, found.rate, found.of("A")[0, 0]) == (("A", "B"), 60.0, 1.0)


def test_the_extra_that_is_not_installed(tmp_path, monkeypatch):
    """The message has the command that installs the missing library."""
    monkeypatch.delitem(sys.modules, "study.recordings.formats.c3d", raising=False)
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    (tmp_path / "walk.c3d").write_bytes(b"\x02\x50")
    with pytest.raises(RecordingError, match=r"reading it needs ezc3d: pip install '.\[mocap\]'"):
        read_recording(tmp_path / "walk.c3d")


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


def read_of_text_file(folder, text, name="walk.csv", **options):
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
    found = read_of_text_file(tmp_path, text, name, unit=None if rate else "mm")
    assert set(found.markers) == {"A", "B"}
    np.testing.assert_allclose(found.select(["A", "B"]).positions, WANTED, rtol=1e-14)
    assert found.rate == (rate or 50.0)


def test_rate_by_a_column_of_seconds(tmp_path):
    text = "time,A_x,A_y,A_z\n0.5,1,2,3\n0.51,1,2,4\n0.52,1,2,5\n"
    assert read_of_text_file(tmp_path, text, unit="m").rate == pytest.approx(100.0)
    with pytest.raises(RecordingError, match=r"line 4: the step in time is 0.2 s, elsewhere 0.01 s"):
        read_of_text_file(tmp_path, text.replace("0.52", "0.71") + "0.72,1,2,3\n", unit="m")


def test_unit_in_the_header_of_columns(tmp_path):
    text = "# rate: 10\nA_x [cm],A_y [cm],A_z [cm]\n100,2,3\n100,2,4\n"
    np.testing.assert_allclose(read_of_text_file(tmp_path, text).of("A")[0], [1.0, 1.0])


def test_what_the_file_does_not_say_is_asked_for(tmp_path):
    text = "A_x,A_y,A_z\n1,2,3\n1,2,4\n"
    with pytest.raises(RecordingError, match="its unit is not given"):
        read_of_text_file(tmp_path, text)
    with pytest.raises(RecordingError, match="its rate in frames per second is not given"):
        read_of_text_file(tmp_path, text, unit="m")
    assert read_of_text_file(tmp_path, text, unit="m", rate=25.0).rate == 25.0


def test_an_empty_row_is_a_frame_without_markers(tmp_path):
    """A frame without any sample does not end the table."""
    found = read_of_text_file(tmp_path, "# rate: 5\n# unit: m\nA_x,A_y,A_z\n1,2,3\n,,\n\n1,2,4\n".replace("\n\n", "\n"))
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
        ("walk.trc", TRC.replace("NumFrames", "Frames"), "must give DataRate, NumFrames and NumMarkers"),
        ("walk.csv", "Trajectories\n120\n", "cut short: no rows after the line Trajectories"),
        ("walk.csv", VICON.replace("120", "fast"), "line 2: 'fast' should be the rate"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, name, text, words):
    """The message is one line with the file's name."""
    with pytest.raises(RecordingError, match=words) as caught:
        read_of_text_file(tmp_path, text, name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)


LABELS = "Frame#\tTime\tm:A\t\t\tm:B\t\t\n"
ODD_TRC = TRC.replace("\t3\t2\tmm", "\t3\t4\tmm")
"""A header of four markers above two labels, as where a program writes further columns without a name."""
WIDER = ODD_TRC.replace("\t600\n", "\t600\t1\t2\t3\t4\t5\t6\n").replace("301\t\t\t", "301\t\t\t\t1\t2\t3\t4\t5\t6")


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (TRC.replace("\t400", "\tNan").replace("\t500\t600\n", "\tNan\tnAn\n".replace("nAn", "NAN") + ""), ""),
        (ODD_TRC, "its header gives 4 markers, and 2 have a label"),
        (WIDER, "its header gives 4 markers, and 2 have a label: 2 groups of columns without a label are left out"),
        (TRC.replace("\t3\t2\tmm", "\t3\t1\tmm"), "its header gives 1 markers, and 2 have a label"),
        (WIDER.replace("\t4\tmm", "\t2\tmm"), "its header gives 2 markers, and 2 have a label: 2 groups of"),
    ],
)
def test_columns_of_a_trc_file_that_its_header_does_not_tell(tmp_path, text, note):
    """Labels stand above their columns: those of A and B are read, whatever else is in the file."""
    found = read_of_text_file(tmp_path, text, "walk.trc")
    assert found.markers == ("A", "B")
    np.testing.assert_allclose(found.of("A"), WANTED[0], rtol=1e-14)
    np.testing.assert_allclose(found.of("B")[:, 2], WANTED[1][:, 2], rtol=1e-14)
    assert len(found.notes) == bool(note)
    assert not note or found.notes[0].startswith(note)


BROKEN_BTK = [
    (BTK.replace("Time,A,,,", "Time,,,,"), "line 9, column 2: no label above the axes X"),
    (BTK.replace("100.5", "1oo.5"), "line 12, column 2: '1oo.5' is not a number"),
    (BTK.replace("600\n0.055", "600\n\n0.055"), "line 13 is empty, and further rows follow; remove the line"),
    (BTK.replace("600\n0.055", "600,7\n0.055"), "line 12, column 11: '7.0' has no header"),
    (BTK.replace(",500,600", ",500"), "line 12 has 9 cells; 10 are needed; the line may be cut short"),
    (BTK[: BTK.index("0.055,101")], "cut short: 1 of 3 frames"),
    (BTK[: BTK.index("0.05,100.5")], "cut short: 0 of 3 frames"),
    (BTK.replace("number,3", "number,30"), "cut short: 3 of 30 frames"),
    (BTK.replace("deg", "mm").replace(",mm,mm,mm\n", ",m,m,m\n"), "its markers are in several units, m and mm"),
    (BTK.replace("mm", "deg"), "no markers in it"),
    (BTK.replace("mm", "furlong"), "no markers in it"),
    (
        BTK.replace("Point frequency,200\n", "").replace("0.06,102", "0.07,102"),
        "the step in time is 0.005 s",
    ),
    (BTK.replace("Point frequency,200\n", "Point frequency,-5\n"), None),
    (BTK.replace("Point frequency,200\n", "Point frequency,nan\n"), None),
    (BTK.replace(",A,,", ",one:A,,").replace(",B,,", ",two:B,,"), "it holds 2 subjects: one"),
    (BTK.replace(",X,Y,Z,X,Y,Z,X,Y,Z", ",X,Y,Z,X,Z,Y,X,Y,Z"), "no columns such as LFHD_X"),
    (BTK.replace(",X,Y,Z,X,Y,Z,X,Y,Z\n", ""), "no columns such as LFHD_X"),
    (BTK.replace("s,mm,mm,mm,deg,deg,deg,mm,mm,mm", "s,mm,mm,mm,deg,deg,deg,mm,mm,"), None),
    (BTK.replace("100.5,200,300", ",,").replace("101,201,301", ",,"), None),
    (BTK.replace("0.055,101,201,301,13,3,4,,,", ",,,,,,,,,"), "line 13 is empty, and further rows follow"),
    (BTK.replace("402,502,602", "0,0,0").replace("400,500,600", "0,0,0"), None),
    (BTK + BTK, None),
    (BTK.replace("\n", "\r\n"), None),
    ("\n\n" + BTK, None),
    (BTK.replace("0.05,100.5", "zero,100.5"), "line 12, column 1: 'zero' is not a number"),
    (BTK.replace("Time,A", "A"), "no label above the axes"),
]
BROKEN_TRC = [
    (WIDER.replace("\tm:B", ""), None),
    (WIDER.replace("\tm:A", "\t"), None),
    (WIDER.replace(LABELS, "Frame#\tTime\tA\tB\n"), "line 4 has 2 labels, but line 3 gives 4 markers"),
    (WIDER.replace(LABELS, "Frame#\tTime\tA\t\tB\n"), "line 4 has 2 labels, but line 3 gives 4 markers"),
    (WIDER.replace(LABELS, "Frame#\tTime\n"), "line 4 has no labels"),
    (WIDER.replace(LABELS, "\n"), "line 4 has no labels"),
    (WIDER.replace("\tm:B", "\tm:A"), None),
    (WIDER.replace("\tm:B", "\tn:B"), "it holds 2 subjects: m"),
    (WIDER.replace("\t400", "\tNaNs"), "line 7, column 6: 'NaNs' is not a number"),
    (WIDER.replace("\t4\t5\t6", "\t4\tx\t6"), None),
    (WIDER.replace("\t500\t600\t1\t2\t3\t4\t5\t6", "\t500"), "line 7 has 7 cells; 8 are needed"),
    (WIDER.replace("\t3\t4\tmm", "\t3\t-4\tmm"), None),
    (WIDER.replace("\t3\t4\tmm", "\t3\tfour\tmm"), "line 2 and 3 must give DataRate, NumFrames and NumMarkers"),
    (WIDER.replace("\t3\t4\tmm", "\t40\t4\tmm"), "cut short: 3 of 40 frames are there"),
    (WIDER.replace("\t3\t4\tmm", "\t3\t4\tmiles"), "its unit 'miles' is not known"),
    (WIDER.replace("2\t0.010", "7\t0.010"), "line 8: frame 7 follows frame 1"),
    (WIDER.replace("\n1\t0.000", "\nx\t0.000"), None),
    (WIDER.replace("100.00", "0.00").replace("0.010", "0.000").replace("0.020", "0.000"), "its rate .* is 0; give one"),
    (WIDER[: WIDER.index("1\t0.000")], "cut short: 0 of 3 frames"),
    (WIDER.replace("\t", " "), None),
    (WIDER.replace("PathFileType", "PathFiletype"), "not a TRC file"),
]
BROKEN_BODIES = [
    (MOTIVE.replace("Thigh:A", old).replace("Thigh:B", new), words)
    for old, new, words in [
        ("Thigh:", "Thigh:", None),
        (":", ":", None),
        (":A", ":A", None),
        ("Thigh:A:B", "Thigh:A", None),
        ("Thigh:Thigh", "Thigh", None),
        ("Thigh: A", "Thigh :A", None),
        ("", "", None),
        ("\x1b[1m:A", "Thigh:B", None),
        ("Unlabeled:A", "Unlabeled:B", None),
        ("Thigh:Marker 001", "Thigh:Marker 001", None),
    ]
] + [
    (MOTIVE.replace("Rigid Body,", ","), None),
    (MOTIVE.replace("Rigid Body", "Trained Markerset"), None),
    (MOTIVE.replace(",Marker", ",Markers"), None),
    (MOTIVE.replace("Position", "Velocity"), "no labelled markers in it, but no positions"),
    (MOTIVE.replace("X,Y,Z,X,Y,Z,X,Y,Z", "X,Y,Z,X,Y,Z,X,Z,Y"), None),
    (MOTIVE.replace("0,0.000000", "a,0.000000"), "line 8, column 1: 'a' is not a number"),
    (MOTIVE.replace("1,0.016667", "5,0.016667"), "frame 5 follows frame 0"),
    (MOTIVE.replace("Millimeters", "Parsecs"), "its unit 'Parsecs' is not known"),
    (
        MOTIVE.replace("60.000000", "x").replace("120.000000", "x"),
        "its rate in frames",
    ),
    (MOTIVE[: MOTIVE.index("1,0.016667")], "1 frame in it"),
    (MOTIVE.replace(",100.5,200,300", ",100.5,200"), None),
]


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        (text, name, words)
        for broken, name in ((BROKEN_BTK, "walk.csv"), (BROKEN_TRC, "walk.trc"), (BROKEN_BODIES, "walk.csv"))
        for text, words in broken
    ],
)
def test_malformed_files_are_read_or_refused_in_one_line(tmp_path, text, name, words):
    """Twenty or more files each of BTK, of TRC with odd headers, and of rigid bodies.

    Where no words are asked for, a recording is as good as a message.
    """
    told = ""
    try:
        read_of_text_file(tmp_path, text, name)
    except RecordingError as error:
        told = str(error)
    assert not told or told.startswith(f"{tmp_path / name}: ")
    assert "\n" not in told
    assert words is None or re.search(words, told), told


UNHURRIED = settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@UNHURRIED
@given(text=st.sampled_from([BTK, WIDER, MOTIVE]), cut=st.integers(0, 900), new=st.text("0,\t\n:xX.-\x00é", max_size=4))
def test_text_put_in_anywhere_ends_in_one_line_at_most(tmp_path, text, cut, new):
    told = ""
    try:
        read_of_text_file(tmp_path, text[:cut] + new + text[cut + 1 :], "walk.trc" if text is WIDER else "walk.csv")
    except RecordingError as error:
        told = str(error)
    assert "\n" not in told

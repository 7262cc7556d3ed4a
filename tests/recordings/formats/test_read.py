"""Text formats of other programs, in small files written by their public descriptions.

Qualisys Track Manager User Manual, "TSV file formats"; OptiTrack documentation, "Data Export: CSV"; OpenSim
documentation, "Marker (.trc) Files".
"""

import re

import numpy as np
import pandas as pd
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

TRC = """PathFileType\t4\t(X/Y/Z)\twalk.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
100.00\t100.00\t3\t2\tmm\t100.00\t1\t3
Frame#\tTime\tm:A\t\t\tm:B\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.000\t100.5\t200\t300\t400\t500\t600
2\t0.010\t101\t201\t301\t\t\t
3\t0.020\t102\t202\t302\t402\t502\t602\t
"""
PLAIN_TRC = TRC.replace("m:", "").replace("\n\n", "\n").replace("602\t\n", "602\n")
TRC_AS_CSV = PLAIN_TRC.replace("\t", ",")
TWO_LINES = "Rate,100\nUnits,mm\n" + TRC_AS_CSV[TRC_AS_CSV.index("Frame#") :].replace("Frame#", "Frame")

ODD_TRC = TRC.replace("\t3\t2\tmm", "\t3\t4\tmm")
"""A header of four markers above two labels, as where a program writes further columns without a name."""
WIDER = ODD_TRC.replace("\t600\n", "\t600\t1\t2\t3\t4\t5\t6\n").replace("301\t\t\t", "301\t\t\t\t1\t2\t3\t4\t5\t6")
LABELS = "Frame#\tTime\tm:A\t\t\tm:B\t\t\n"

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
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_recording(folder / name, **options)


@pytest.mark.parametrize(
    ("text", "end", "rate", "unit"),
    [
        (qualisys(), "tsv", 100.0, None),
        (qualisys(counted=True), "tsv", 100.0, None),
        (qualisys(QUALISYS + TYPES + HEADS, counted=True, absent="NULL"), "tsv", 100.0, None),
        (qualisys(QUALISYS + HEADS, counted=True, absent="0.000", end="\t"), "txt", 100.0, None),
        (qualisys(absent="0.000", end="\t"), "tsv", 100.0, None),
        (qualisys().replace(".5\t", ",5\t").replace("FREQUENCY\t100", "FREQUENCY\t59,94"), "tsv", 59.94, None),
        (MOTIVE, "csv", 60.0, None),
        (TRC_AS_CSV, "csv", 100.0, None),
        (PLAIN_TRC, "txt", 100.0, None),
        (TWO_LINES, "csv", 100.0, None),
        (TWO_LINES.replace("Rate,100\n", ""), "csv", 100.0, None),
        (TWO_LINES.replace("Frame,Time,A", ",,A").replace(",,X1", "Frame,Time,X1"), "csv", 100.0, None),
        (TWO_LINES.replace(",", "\t").replace("X1\tY1\tZ1\tX2\tY2\tZ2", "X\tY\tZ\tX\tY\tZ"), "tsv", 100.0, None),
        (D_FLOW, "txt", 100.0, "m"),
        (BTK, "csv", 200.0, None),
        (BTK.replace(",", "\t"), "txt", 200.0, None),
        (BTK.replace(",", ";"), "csv", 200.0, None),
        (BTK[BTK.index("Time,A") :], "csv", 200.0, None),
        (BTK.replace(",mm", ",m").replace("Point frequency,200", "Point frequency,0"), "csv", 200.0, "mm"),
        (TRC, "trc", 100.0, None),
        (TRC.replace("\t400", "\t4e2").replace("\t\t\t\n", "\tNaN\tNan\tNAN\n"), "trc", 100.0, None),
        (VICON, "csv", 120.0, None),
        (VICON.replace(",", ";"), "csv", 120.0, None),
        (VICON.replace(",", "\t"), "csv", 120.0, None),
        (TABLE, "csv", 50.0, None),
        (TABLE.replace(",", ";").replace("100.5", "100,5"), "csv", 50.0, None),
        (TABLE.replace(",", "\t"), "tsv", 50.0, None),
        (TABLE.replace("# unit: mm\n", "").replace("_x", " [mm] x").replace(" [mm] x", "_x (mm)"), "txt", 50.0, "mm"),
        (TABLE.replace(",", ", ").replace("400", '"400"'), "csv", 50.0, None),
        (TABLE.replace("_", "."), "csv", 50.0, None),
        (TABLE.replace("_", ":").replace("\n", "\r\n"), "csv", 50.0, None),
        ("\ufeff" + TABLE, "csv", 50.0, None),
        (TABLE + "\n\n", "csv", 50.0, None),
        (MOTIVE + "\n \n", "csv", 60.0, None),
        (qualisys() + "\n\n", "tsv", 100.0, None),
    ],
)
def test_the_same_markers_in_other_programs_formats(tmp_path, text, end, rate, unit):
    """Qualisys, Motive, TRC, D-Flow, BTK and Vicon, and tables in any order of columns."""
    found = read(tmp_path, text, f"walk.{end}", unit=unit)
    assert set(found.markers) == {"A", "B"}
    np.testing.assert_allclose(found.select(["A", "B"]).positions, WANTED, rtol=1e-14)
    assert found.rate == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("text", [qualisys(), MOTIVE, TRC_AS_CSV, PLAIN_TRC])
@pytest.mark.parametrize("name", ["walk.csv", "walk.dat", "walk"])
def test_the_format_is_told_by_the_contents(tmp_path, text, name):
    """A name that says nothing, or something else, does not matter."""
    assert read(tmp_path, text, name).frames == 3


def test_c3d_by_its_contents(tmp_path, write_c3d):
    """A C3D file is read under a wrong name; a text that is called .c3d is read as what it is."""
    write_c3d(tmp_path / "walk.c3d", ["A", "B"], 1000 * WANTED).rename(tmp_path / "walk.txt")
    np.testing.assert_allclose(read_recording(tmp_path / "walk.txt").positions, WANTED, rtol=2e-7)
    assert read(tmp_path, TRC_AS_CSV, "walk.c3d").frames == 3


SHANK = MOTIVE.replace("Thigh,Thigh:A,Thigh:A", "Thigh,Shank:Z,Thigh:A", 1)


@pytest.mark.parametrize(
    ("text", "markers"),
    [
        (SHANK.replace("Thigh:B", "Shank:B"), ("A", "B")),
        (SHANK.replace("Thigh:B", "Thigh:C"), ("A", "C")),
        (SHANK.replace("Thigh:B", "Shank:A"), ("Thigh A", "Shank A")),
        # a marker with a number alone keeps its asset's name
        (
            MOTIVE.replace("Thigh:A", "Thigh:Marker 001").replace("Thigh:B", "Shank:Marker1"),
            ("Thigh Marker 001", "Shank Marker1"),
        ),
    ],
)
def test_rigid_bodies_are_segments_of_one_subject(tmp_path, text, markers):
    """Bodies of the Motive file are no subjects to choose from; a label that two bodies have gets the body's name."""
    assert read(tmp_path, text).markers == markers


def test_what_is_left_out_is_told(tmp_path):
    """Points in degrees, newtons and the like are no markers; measured markers are taken before solved ones."""
    assert read(tmp_path, BTK).notes == ("1 points hold angles, forces and the like, not markers: left out",)
    assert read(tmp_path, MOTIVE).notes == ("1 markers without a label are left out",)
    found = read(tmp_path, MOTIVE.replace(",Marker,Marker,Marker", ""))  # types end early: these columns have none
    assert found.markers == ("A",)
    np.testing.assert_allclose(found.of("A")[2], [0.008, 0.008, 0.009], rtol=1e-14)
    assert "solved rigid bodies" in found.notes[-1]


def trc(header_rate=100, rate=100, frames=50, promised=None, skip=(), scale=1.0, digits=6):
    """A TRC file of one marker; its column Time has another rate than its header, if so asked."""
    lines = ["PathFileType\t4\t(X/Y/Z)\twalk.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"]
    lines += [f"{header_rate}\t{header_rate}\t{promised or frames}\t1\tmm", "Frame#\tTime\tA\t\t", "\t\tX1\tY1\tZ1"]
    rows = [i for i in range(frames) if i not in skip]
    lines += [f"{i + 1}\t{scale * i / rate:.{digits}f}\t{i}\t{2 * i}\t{i + 500}" for i in rows]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "rate", "words"),
    [
        (trc(), 100.0, None),
        (trc(header_rate=120, rate=120, digits=2), 120.0, None),  # rounded to hundredths of a second
        (trc(header_rate=119.88, rate=120), 119.88, None),
        (trc(header_rate=200), 100.0, "its header gives 200 Hz, but its column Time 100 Hz: the column is believed"),
        (trc(header_rate=0), 100.0, "its header gives 0 Hz, but its column Time 100 Hz: the column is believed"),
        (trc(scale=1000.0), 100.0, "its column Time is in milliseconds"),
        (trc(scale=0.0, header_rate=60), 60.0, None),
        (trc(header_rate=200, skip=(20,)), 100.0, "the column is believed"),
        (
            trc(promised=500),
            100.0,
            "its header promises 500 frames, but 50 are there, and their numbers and times run on",
        ),
        (trc().replace("20\t0.190000", "20\t0.180100"), 100.0, "uneven steps"),  # a column that jumps gives no rate
    ],
)
def test_a_rate_that_contradicts_the_times(tmp_path, text, rate, words):
    found = read(tmp_path, text, "walk.trc")
    assert (found.rate, found.frames) == (rate, 50)
    assert any(words in note for note in found.notes) if words else not found.notes
    assert read(tmp_path, text, "walk.trc", rate=25.0).rate == 25.0


def test_few_missing_frames_are_told(tmp_path):
    """Of 500 frames one may be missing at the end, or left out between: times stay right."""
    found = read(tmp_path, trc(frames=499, promised=500), "walk.trc")
    assert found.frames == 499
    assert found.notes == ("its header promises 500 frames, but 499 are there: the end may be cut off",)
    found = read(tmp_path, trc(frames=500, skip=(123,)), "walk.trc")
    assert (found.frames, found.rate) == (500, 100.0)
    assert np.flatnonzero(~found.seen()[0]).tolist() == [123]
    np.testing.assert_allclose(found.of("A")[0, 400:], np.arange(400, 500) / 1000, rtol=1e-12)
    assert found.notes == ("1 of 500 frames are not in it, the first after frame 123: they count as missing",)


TWENTY = [i for i in range(20) if i != 7]


@pytest.mark.parametrize(
    ("name", "head", "row"),
    [
        ("a.csv", "Trajectories\n100\n,,A,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n", "{1},0,{2},2,3\n"),
        ("b.csv", "# unit: mm\nframe,time,A_x,A_y,A_z\n", "{0},{3},{2},2,3\n"),
        ("c.tsv", QUALISYS.replace("\tB", "").replace("FRAMES\t3", "FRAMES\t20"), "{1}\t{3}\t{2}\t2\t3\n"),
    ],
)
def test_frames_left_out_of_other_formats(tmp_path, name, head, row):
    """A counter that skips a frame of 20 is completed in every format that has one."""
    found = read(tmp_path, head + "".join(row.format(i, i + 1, i + 50, i / 100) for i in TWENTY), name)
    assert (found.frames, found.rate, np.flatnonzero(~found.seen()[0]).tolist()) == (20, 100.0, [7])
    assert found.of("A")[0, 19] == pytest.approx(0.069)


def test_a_c3d_file_that_lacks_its_last_frames(tmp_path, write_c3d):
    """A header that promises one frame more than there are is told."""
    points = np.random.default_rng(1).normal(size=(2, 3, 500)) * 100
    path = write_c3d(tmp_path / "walk.c3d", ["A", "B"], points)
    data = bytearray(path.read_bytes())
    assert int.from_bytes(data[8:10], "little") == 500  # word 5 of the header: the last frame (c3d.org)
    data[8:10] = (501).to_bytes(2, "little")
    found = read(tmp_path, bytes(data), "walk.c3d")
    assert found.frames == 500
    assert any("promises 501 frames, but 500 are there" in note for note in found.notes)


MARKERS = ("LFHD", "RFHD", "C7", "LFIN", "RTOE")
FACTOR = {"mm": 1000.0, "cm": 100.0, "m": 1.0}


def made(folder, form, labels, points, unit, write_c3d):
    """A file of markers in a format, its numbers in a unit."""
    path = folder / f"walk.{form}"
    if form == "c3d":
        return write_c3d(path, labels, points, unit=unit)
    columns = [f"{label}_{axis}" for label in labels for axis in "XYZ"]
    rows = pd.DataFrame(points.reshape(len(columns), -1).T, columns=columns)
    if form == "csv":
        path.write_text(f"# rate: 100\n# unit: {unit}\n" + rows.to_csv(index=False))
        return path
    head = "PathFileType\t4\t(X/Y/Z)\twalk.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
    head += f"100\t100\t{len(rows)}\t{len(labels)}\t{unit}\nFrame#\tTime\t" + "\t\t\t".join(labels) + "\t\t\n\t\tX1\n"
    rows.insert(0, "time", rows.index / 100)
    path.write_text(head + rows.set_index(rows.index + 1).to_csv(sep="\t", header=False))
    return path


UNHURRIED = settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@settings(UNHURRIED, max_examples=60)
@given(
    order=st.permutations(range(len(MARKERS))),
    prefix=st.sampled_from(["", "male:", "Subject 1:", "60-08:", "a:b:"]),
    unit=st.sampled_from(sorted(FACTOR)),
    form=st.sampled_from(["c3d", "trc", "csv"]),
)
def test_order_prefix_unit_and_format_do_not_matter(tmp_path, write_c3d, order, prefix, unit, form):
    """The same motion in two formats is the same recording."""
    positions = np.round(np.random.default_rng(11).normal(size=(len(MARKERS), 3, 6)), 4)
    positions[2, :, 1:3] = np.nan
    labels = [prefix + MARKERS[i] for i in order]
    found = read_recording(made(tmp_path, form, labels, positions[list(order)] * FACTOR[unit], unit, write_c3d))
    assert found.markers == tuple(MARKERS[i] for i in order)
    assert (found.name, found.rate, found.notes) == ("walk", 100.0, ())
    # C3D files hold single precision
    np.testing.assert_allclose(found.select(MARKERS).positions, positions, rtol=2e-7 if form == "c3d" else 1e-13)


@pytest.mark.parametrize("form", ["c3d", "trc", "csv"])
def test_options_reach_every_format(tmp_path, write_c3d, form):
    """Unit, rate and subject of the caller override the file."""
    path = made(tmp_path, form, ["a:A", "a:B", "b:A"], np.ones((3, 3, 4)), "mm", write_c3d)
    with pytest.raises(RecordingError, match=r"2 subjects: a \(2 markers\), b"):
        read_recording(path)
    found = read_recording(path, subject="a", unit="m", rate=60.0)
    assert (found.markers, found.rate, found.of("A")[0, 0]) == (("A", "B"), 60.0, 1.0)


def test_what_a_table_says_and_does_not_say(tmp_path):
    """Rate by a column of seconds, unit in the headers, a row without samples; what lacks is asked for."""
    text = "time,A_x,A_y,A_z\n0.5,1,2,3\n0.51,1,2,4\n0.52,1,2,5\n"
    assert read(tmp_path, text, unit="m").rate == pytest.approx(100.0)
    with pytest.raises(RecordingError, match=r"line 4: the step in time is 0.2 s, elsewhere 0.01 s"):
        read(tmp_path, text.replace("0.52", "0.71") + "0.72,1,2,3\n", unit="m")
    text = "# rate: 10\nA_x [cm],A_y [cm],A_z [cm]\n100,2,3\n100,2,4\n"
    np.testing.assert_allclose(read(tmp_path, text).of("A")[0], [1.0, 1.0])
    text = "A_x,A_y,A_z\n1,2,3\n1,2,4\n"
    with pytest.raises(RecordingError, match="its unit is not given"):
        read(tmp_path, text)
    with pytest.raises(RecordingError, match="its rate in frames per second is not given"):
        read(tmp_path, text, unit="m")
    with pytest.raises(RecordingError, match=r"its rate in frames per second is 10{39}; give one above 0"):
        read(tmp_path, trc(), name="walk.trc", rate=10**400)
    found = read(tmp_path, "# rate: 5\n# unit: m\nA_x,A_y,A_z\n1,2,3\n,,\n1,2,4\n")
    assert found.seen()[0].tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (ODD_TRC, "its header gives 4 markers, and 2 have a label"),
        (WIDER, "its header gives 4 markers, and 2 have a label: 2 groups of columns without a label are left out"),
        (TRC.replace("\t3\t2\tmm", "\t3\t1\tmm"), "its header gives 1 markers, and 2 have a label"),
        (WIDER.replace("\t4\tmm", "\t2\tmm"), "its header gives 2 markers, and 2 have a label: 2 groups of"),
    ],
)
def test_columns_of_a_trc_file_that_its_header_does_not_tell(tmp_path, text, note):
    """Labels stand above their columns: those of A and B are read, whatever else is in the file."""
    found = read(tmp_path, text, "walk.trc")
    assert found.markers == ("A", "B")
    np.testing.assert_allclose(found.positions, WANTED, rtol=1e-14)
    (said,) = found.notes
    assert said.startswith(note)


@pytest.mark.parametrize(
    ("text", "end", "words"),
    [
        (trc(frames=1, promised=500), "trc", "cut short: 1 of 500 frames"),
        (trc(frames=100, skip=range(10, 31)), "trc", "line 16: frame 32 follows frame 10"),
        (qualisys().replace("3D", "6D"), "csv", "it holds 6D data; export the trajectories"),
        (qualisys().replace("MARKER_NAMES\tA\tB", "MARKER_NAMES"), "csv", "no line MARKER_NAMES"),
        (qualisys().replace("FREQUENCY\t100", "FREQUENCY\tfast"), "csv", "no line FREQUENCY"),
        (qualisys().replace("\tA\tB", "\tA\tB\tC"), "csv", "line 11 has 6 cells; 9 are needed"),
        (qualisys().replace("FRAMES\t3", "FRAMES\t30"), "csv", "cut short: 3 of 30 frames"),
        (re.sub(",(Rigid Body )?Marker", ",Bone", MOTIVE), "csv", "no labelled markers in it, but bone"),
        (MOTIVE.replace(",Name,", ",Names,"), "csv", "no lines Type, Name and Frame above the rows"),
        (MOTIVE.replace(",101,201", ",1o1,201"), "csv", "line 9, column 15: '1o1' is not a number"),
        (MOTIVE.replace("Position", "Velocity"), "csv", "no labelled markers in it, but no positions"),
        (MOTIVE.replace("1,0.016667", "5,0.016667"), "csv", "frame 5 follows frame 0"),
        (MOTIVE.replace("Millimeters", "Parsecs"), "csv", "its unit 'Parsecs' is not known"),
        (MOTIVE.replace("60.000000", "x").replace("120.000000", "x"), "csv", "its rate in frames"),
        (MOTIVE[: MOTIVE.index("1,0.016667")], "csv", "1 frame in it"),
        (TWO_LINES.replace(",A,", ",,"), "csv", "line 3, column 3: no label above the axes X1"),
        ("\n \n", "csv", "the file is empty"),
        (b"\x00\x01\x02" * 50, "csv", "not a text file"),
        ("# rate: 5\n", "csv", "it holds only comments"),
        ("x,y,z\n1,2,3\n", "csv", "line 1: no columns such as LFHD_X, LFHD_Y, LFHD_Z; found x, y, z"),
        ("A_x,A_y\n1,2\n", "csv", "line 1: marker A has no column for z"),
        ("A_x,A_y,A_z,A_X\n1,2,3,4\n", "csv", "line 1: two columns have the name 'A_X'"),
        (TABLE.replace("2,,101", "4,,101"), "csv", "line 5: frame 4 follows frame 1"),
        (TABLE[:-10], "csv", "line 6 has 6 cells; 8 are needed; the line may be cut"),
        (TABLE.replace("500\n", "500,7\n"), "csv", "line 4, column 9: '7' has no header"),
        (TABLE.replace("rate: 50", "rate: fast"), "csv", "its rate 'fast' is not a number"),
        ("# rate: 5\n# unit: m\nA_x,A_y,A_z\n", "csv", "no frames in it"),
        ("hello", "trc", "not a TRC file"),
        (TRC[:-14], "trc", "line 9 has 5 cells; 8 are needed"),
        (TRC.replace("NumFrames", "Frames"), "trc", "must give DataRate, NumFrames and NumMarkers"),
        ("Trajectories\n120\n", "csv", "cut short: no rows after the line Trajectories"),
        (VICON.replace("120", "fast"), "csv", "line 2: 'fast' should be the rate"),
        (BTK.replace("Time,A,,,", "Time,,,,"), "csv", "line 9, column 2: no label above the axes X"),
        (BTK.replace("Time,A", "A"), "csv", "no label above the axes"),
        (BTK.replace("600\n0.055", "600\n\n0.055"), "csv", "line 13 is empty, and further rows follow; rem"),
        (BTK.replace("600\n0.055", "600,7\n0.055"), "csv", "line 12, column 11: '7' has no header"),
        (BTK.replace(",500,600", ",500"), "csv", "line 12 has 9 cells; 10 are needed; the line may be cut"),
        (BTK[: BTK.index("0.055,101")], "csv", "cut short: 1 of 3 frames"),
        (BTK[: BTK.index("0.05,100.5")], "csv", "cut short: 0 of 3 frames"),
        (BTK.replace("deg", "mm").replace(",mm,mm,mm\n", ",m,m,m\n"), "csv", "in several units, m and mm"),
        (BTK.replace("mm", "deg"), "csv", "no markers in it"),
        (BTK.replace("Point frequency,200\n", "").replace("0.06,102", "0.07,102"), "csv", "step in time is 0.005 s"),
        (BTK.replace(",A,,", ",one:A,,").replace(",B,,", ",two:B,,"), "csv", "it holds 2 subjects: one"),
        (BTK.replace(",X,Y,Z,X,Y,Z,X,Y,Z", ",X,Y,Z,X,Z,Y,X,Y,Z"), "csv", "no columns such as LFHD_X"),
        (BTK.replace(",X,Y,Z,X,Y,Z,X,Y,Z\n", ""), "csv", "no columns such as LFHD_X"),
        (WIDER.replace(LABELS, "Frame#\tTime\tA\tB\n"), "trc", "has 2 labels, but line 3 gives 4"),
        (WIDER.replace(LABELS, "Frame#\tTime\n"), "trc", "line 4 has no labels"),
        (WIDER.replace(LABELS, "\n"), "trc", "line 4 has no labels"),
        (WIDER.replace("\tm:B", "\tn:B"), "trc", "it holds 2 subjects: m"),
        (WIDER.replace("\t400", "\tNaNs"), "trc", "line 7, column 6: 'NaNs' is not a number"),
        (WIDER.replace("\t3\t4\tmm", "\t3\tfour\tmm"), "trc", "line 2 and 3 must give DataRate"),
        (WIDER.replace("\t3\t4\tmm", "\t3\t4\tmiles"), "trc", "its unit 'miles' is not known"),
        (re.sub(r"100\.00|0\.0[12]0", "0.000", WIDER), "trc", "its rate .* is 0; give one"),
        (WIDER[: WIDER.index("1\t0.000")], "trc", "cut short: 0 of 3 frames"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, one_line, text, end, words):
    """The message is one line with the file's name."""
    with one_line(RecordingError, words, start=f"{tmp_path}/walk.{end}: "):
        read(tmp_path, text, f"walk.{end}")


ODD = ["", "-5", "nan", "x", "\x1b[1m:A", "Unlabeled:A", "Thigh: A", "\r\n", "\n\n", "0,0,0"]


@UNHURRIED
@given(text=st.sampled_from([BTK, WIDER, MOTIVE]), cells=st.data())
def test_malformed_files_are_read_or_refused_in_one_line(tmp_path, text, cells):
    """A cell, a separator or a row's end becomes another one everywhere, or a few letters are put in anywhere."""
    words = sorted({"\n", *re.split(r"[,\t\n]", text)} - {""})
    if cells.draw(st.booleans()):
        text = text.replace(cells.draw(st.sampled_from(words)), cells.draw(st.sampled_from(words + ODD)))
    else:
        cut, new = cells.draw(st.integers(0, 900)), cells.draw(st.text("0,\t\n:xX.-\x00é", max_size=4))
        text = text[:cut] + new + text[cut + 1 :]
    name, told = "walk.trc" if text.startswith("PathFile") else "walk.csv", ""
    try:
        read(tmp_path, text, name)
    except RecordingError as error:
        told = str(error)
    assert not told or told.startswith(f"{tmp_path / name}: ")
    assert "\n" not in told

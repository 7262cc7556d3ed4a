"""Headers of C3D files with one or two wrong fields: each is read or refused in one line, at a bounded cost."""

import math
import re
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from study.recordings.formats import c3d
from study.recordings.formats.c3d import LONG, read_c3d, read_header
from study.recordings.formats.read import read_recording
from study.recordings.formats.write import write_recording
from study.recordings.markersets import choose
from study.recordings.recording import Recording, RecordingError


def refuse(path):
    raise ValueError("not today")


def without_ezc3d(monkeypatch):
    """Let ezc3d refuse every file."""
    monkeypatch.setattr(c3d, "ezc3d", SimpleNamespace(c3d=refuse))


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
        (bytes(4096), "not a C3D file"),
        (b"\x02\x50", "cut short: its header is not complete"),
        (b"\x02\x50" + bytes(510), "cut short: its header is not complete"),
        (b"\x02\x50" + bytes(5000), "a damaged or incomplete C3D file, which no reader can read; get a whole copy"),
        (b"\x02\x50" + b"\xff" * 5000, "its header promises 65535 frames of 65535 points .* 85.9 GB, but"),
    ],
)
def test_what_is_not_a_c3d_file(tmp_path, one_line, data, words):
    """The message is one line with the file's name."""
    path = tmp_path / "a.c3d"
    path.write_bytes(data)
    with one_line(RecordingError, words, start=f"{path}: "):
        read_recording(path)


@pytest.mark.parametrize(
    ("place", "number"),
    [(2, 2), (8, 6), (4, 1)],
    ids=["fewer points than POINT:USED", "fewer frames than POINT:FRAMES", "more analog samples than ANALOG:USED"],
)
def test_the_lighter_reader_is_first_where_the_header_does_not_agree(
    tmp_path, monkeypatch, write_c3d, points, place, number
):
    """Header, parameters and the file's size differ: ezc3d, which may fill the memory, comes second."""
    asked = []
    for name in ("_by_ezc3d", "_by_c3d"):
        monkeypatch.setattr(c3d, name, lambda path, name=name: asked.append(name) or refuse(path))
    path = write_c3d(tmp_path / "a.c3d", "ABC", points)
    data = bytearray(path.read_bytes())
    for plain in (True, False):
        assert read_header(path).plain == plain
        with pytest.raises(RecordingError, match="which no reader can read"):
            read_c3d(path)
        data[place : place + 2] = struct.pack("<H", number)
        path.write_bytes(data)
    assert asked == ["_by_ezc3d", "_by_c3d", "_by_c3d", "_by_ezc3d"]


def test_shared_recordings(shared_file):
    """The recordings have the frames and heights that SOURCES.md gives, and all markers of the set, and no others."""
    for name, frames in (("cmu_135_02.c3d", 5202), ("cmu_85_02.c3d", 810)):
        recording = read_recording(shared_file(name))
        assert (recording.frames, recording.rate, recording.notes) == (frames, 120.0, ())
        assert recording.missing().max() == 0.0
        found = choose(recording)
        assert (found.whole.name, found.extra, found.lacking, found.lost) == ("cmu41", (), {}, {})
        height = recording.of("LFHD")[2] - recording.of("LTOE")[2]
        assert 1.3 < np.quantile(height, 0.5) < 1.9


def test_both_libraries_agree_on_a_shared_recording(shared_file, monkeypatch):
    path = shared_file("cmu_85_02.c3d")
    by_ezc3d = read_recording(path)
    without_ezc3d(monkeypatch)
    by_c3d = read_recording(path)
    np.testing.assert_array_equal(by_c3d.positions, by_ezc3d.positions)
    assert (by_c3d.markers, by_c3d.rate) == (by_ezc3d.markers, by_ezc3d.rate)


POINTS, ANALOG, FIRST, LAST, GAP, SCALE, BLOCK, RATIO, RATE = 2, 4, 6, 8, 10, 12, 16, 18, 20
"""Places of the header's fields, bytes."""

FRAMES = 50


def records(data):
    """The parameters of a file, by the format's description: group, name, bytes of a value, and places in the file."""
    place, groups = (data[0] - 1) * 512 + 4, {}
    while True:
        length, group = struct.unpack_from("bb", data, place)
        if length == 0 or group == 0:
            return
        name = bytes(data[place + 2 : place + 2 + abs(length)]).decode()
        start = place + 2 + abs(length)  # negative if it is locked
        (distance,) = struct.unpack_from("<H", data, start)
        if group < 0:
            groups[-group] = name
        else:
            size, count = struct.unpack_from("bB", data, start + 2)
            yield f"{groups[group]}:{name}", size, start + 2, start + 4 + count
        place = start + distance
        if distance == 0:
            return


def places(path):
    """Places of the kind and of the values of each parameter of a file."""
    return {name: (place, values) for name, _, place, values in records(path.read_bytes())}


@pytest.fixture
def rich(tmp_path, write_rich):
    """A C3D file with analog channels, longer parameters and room at its end."""
    positions = np.random.default_rng(5).normal(size=(4, 3, FRAMES))
    return write_rich(Recording("rich", ("A", "B", "C", "D"), positions, 100.0), tmp_path / "rich.c3d")


def changed(path, *fields):
    """Write values of 16 bits (or floats, or single bytes) at places of a file."""
    data = bytearray(path.read_bytes())
    for place, value in fields:
        form = "<f" if isinstance(value, float) else "c" if isinstance(value, bytes) else "<H"
        struct.pack_into(form, data, place, value)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    "fields",
    [
        {POINTS: 20000, LAST: 20000},
        {POINTS: 2000, LAST: 2000, "POINT:USED": 2000, "POINT:FRAMES": 2000},
        {POINTS: 20000, LAST: 20000, "POINT:USED": 20000, "POINT:FRAMES": 20000},
        {POINTS: 20000, "POINT:USED": 20000, LAST: LONG},
        {ANALOG: 60000, LAST: 60000},
    ],
)
def test_a_header_that_promises_far_more_than_the_file_holds(rich, fields):
    """583 kB that promise gigabytes are refused before a library reserves memory for them."""
    with open(rich, "ab") as file:
        file.write(bytes(583_000 - rich.stat().st_size))
    known = places(rich)
    changed(rich, *((known[place][1] if place in known else place, value) for place, value in fields.items()))
    words = r"its header promises \d+ frames of \d+ points and \d+ analog samples, .* [MG]B, but the file has 583 kB"
    with pytest.raises(RecordingError, match=words):
        read_recording(rich)


def test_a_number_of_frames_that_a_parameter_corrects(rich):
    """If the header's last frame is wrong, but a parameter has the number that the file holds, that is read."""
    before = read_recording(rich)
    for last in (255, 32767, 65534, LONG):
        found = read_recording(changed(rich, (LAST, last)))
        np.testing.assert_array_equal(found.positions, before.positions)
    assert read_header(rich).frames == FRAMES


@pytest.mark.parametrize("rate", [-1e30, float("inf"), 1e30])
def test_a_rate_that_the_header_corrects(rich, rate):
    """A parameter that is no rate is told, and the header's rate is used."""
    found = read_recording(changed(rich, (places(rich)["POINT:RATE"][1], rate)))
    assert found.rate == 100.0
    assert found.notes[-1] == "its parameter POINT:RATE is no rate: 100 Hz of its header is used"


def test_a_unit_that_is_no_text(rich):
    """It counts as missing."""
    changed(rich, (places(rich)["POINT:UNITS"][0], b"\x01"))
    assert read_recording(rich).notes == ("the file does not give its unit: mm assumed",)


def test_every_description_may_be_damaged(rich, monkeypatch):
    """One that is longer than its record, of any parameter, hides no point, and is kept from ezc3d, which may crash."""
    before, raw = read_recording(rich), rich.read_bytes()
    assert read_header(rich).sound
    monkeypatch.setattr(c3d, "ezc3d", SimpleNamespace(c3d=lambda path: pytest.fail("ezc3d was asked")))
    names = 0
    for _, size, place, values in records(raw):
        dimensions = raw[place + 2 : values]
        data = bytearray(raw)
        data[values + abs(size) * math.prod(dimensions)] += 3
        rich.write_bytes(data)
        assert not read_header(rich).sound
        np.testing.assert_array_equal(read_recording(rich).positions, before.positions)
        names += 1
    assert names > 30


def test_what_ezc3d_does_not_survive_is_kept_from_it(rich):
    """It ends the whole program on some texts without a length, and counts for minutes what no file can hold."""
    known, raw = places(rich), rich.read_bytes()
    assert read_header(rich).sound
    for place, value in ((known["ANALOG:DESCRIPTIONS"][0] + 1, b"\x00"), (known["ROTATION:RATIO"][1], 65535)):
        rich.write_bytes(raw)
        assert not read_header(changed(rich, (place, value))).sound
        assert read_c3d(rich).points.shape == (4, 3, FRAMES)


MUTATE = """
import resource, sys
from pathlib import Path

from study.recordings.formats.read import read_recording
from study.recordings.recording import RecordingError

resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
path, raw, told, count = Path(sys.argv[1]), Path(sys.argv[1]).read_bytes(), 0, 0
for line in sys.stdin:
    data = bytearray(raw)
    for change in line.split(";"):
        place, new = change.split()
        data[int(place) : int(place) + len(new) // 2] = bytes.fromhex(new)
    path.write_bytes(data)
    count += 1
    try:
        read_recording(path)
    except RecordingError as error:
        told += 1
        assert "\\n" not in str(error) and str(error).isprintable(), str(error)
print(count, told)
"""


def survived(path, mutants):
    """Number of files that are refused, of those with other bytes at places: in one line, 4 GB, a minute of work."""
    pytest.importorskip("resource", reason="limits of memory and time need a POSIX system")
    script = "".join(";".join(f"{place} {new.hex()}" for place, new in mutant) + "\n" for mutant in mutants)
    command = [sys.executable, "-c", MUTATE, str(path)]
    done = subprocess.run(command, input=script, capture_output=True, encoding="utf-8")
    assert (done.returncode, done.stderr) == (0, "")
    count, told = map(int, done.stdout.split())
    assert count == len(mutants)
    return told


@pytest.mark.parametrize("analog", [False, True])
def test_damaged_files_end_no_program(tmp_path, small, rich, analog):
    """Three hundred files with one to three wrong bytes in header or parameters are read, or refused in one line."""
    rng, path = np.random.default_rng(7), rich if analog else write_recording(small(), tmp_path / "a.c3d")
    drawn = [[(rng.integers(1600), rng.bytes(1)) for _ in range(1 + trial % 3)] for trial in range(300)]
    assert survived(path, drawn) > 10


def test_every_field_of_the_header_and_of_the_parameters(rich):
    """Each field takes extreme values, some 900 files."""
    data = rich.read_bytes()
    words = [struct.pack("<H", value) for value in (0, 1, 2, 255, 32767, 32768, 65534, 65535)]
    numbers = [struct.pack("<f", value) for value in (0.0, -1.0, 1e30, -1e30, np.nan, np.inf, 1e-30, 70000.0)]
    mutants = [(place, new) for place in range(0, 24, 2) for new in words]
    for _, size, place, values in records(data):
        mutants += [(values, new) for new in {2: words, 4: numbers}.get(size, [])]
        mutants += [(place, bytes([kind])) for kind in (0, 1, 2, 4, 127, 255)]
        mutants += [(place + offset, bytes([count])) for offset in (1, 2) for count in (0, 1, 3, 7, 8, 255)]
    assert len(mutants) > 800
    assert survived(rich, [[mutant] for mutant in mutants]) < 0.8 * len(mutants)


def event_file(path, first, started):
    """A C3D file of 100 frames at 100 Hz with events, whose times count from ``started`` seconds before its start."""
    import ezc3d

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["LABELS"]["value"], point["UNITS"]["value"], point["RATE"]["value"] = ["A", "LTIB1", "LHJC"], ["mm"], [100.0]
    file.add_parameter("POINT", "MODELED_MARKERS", ["LTIB1", "LHJC"])
    file["header"]["points"]["first_frame"] = first
    points = np.ones((4, 3, 100))
    points[0] = np.arange(100.0)
    file["data"]["points"] = points
    told = [("Left", "Foot Strike"), ("General", "RTO"), ("Right", "Initial Contact"), ("General", "Start")]
    file.add_parameter("EVENT", "USED", [4])
    file.add_parameter("EVENT", "CONTEXTS", [context for context, _ in told])
    file.add_parameter("EVENT", "LABELS", [label for _, label in told])
    seconds = started + np.array([0.1, 0.4, 0.7, 0.8])
    file.add_parameter("EVENT", "TIMES", np.array([seconds // 60, seconds % 60]))
    file.write(str(path))
    return path


@pytest.mark.parametrize(("first", "started"), [(0, 0.0), (7000, 70.0), (7000, 0.0)])
def test_events_and_markers_of_a_model(tmp_path, either, first, started):
    """Strikes and offs have their side by context or label, and seconds from the file's first frame, by either library.

    Times may count from the trial's start or from the file's. Markers of a model are left out, but hips' centres.
    """
    found = read_recording(event_file(tmp_path / "a.c3d", first, started))
    events = found.laboratory.events
    assert [event[:2] for event in events] == [("left", "strike"), ("right", "off"), ("right", "strike")]
    np.testing.assert_allclose([event.time for event in events], [0.1, 0.4, 0.7], atol=1e-5)
    assert found.markers == ("A", "LHJC")
    part = read_recording(tmp_path / "a.c3d", frames="21-60").laboratory.events
    np.testing.assert_allclose([event.time for event in part], [0.2], atol=1e-5)


def test_rotation_offsets_that_are_not_applied_are_named(tmp_path, either):
    path = event_file(tmp_path / "a.c3d", 0, 0.0)
    assert not any("not applied" in note for note in read_recording(path).notes)
    import ezc3d

    file = ezc3d.c3d(str(path))
    for name, angle in (("LThighRotation", 0.16), ("RThighRotation", 0.0), ("RTibialTorsion", -0.2)):
        file.add_parameter("PROCESSING", name, [angle])
    file.write(str(path))
    (note,) = (note for note in read_recording(path).notes if "not applied" in note)
    assert "LTHIGHROTATION, RTIBIALTORSION of Plug-in Gait" in note


def test_loads_on_force_plates(shared_file):
    """A walk's two plates are loaded when Vicon's events say so, to 10 ms; their corners are in metres."""
    told = read_recording(shared_file("plug_in_gait/HC030A05.c3d")).laboratory
    loads = sorted(told.contacts, key=lambda load: load.start)
    times = {(event.side, event.kind): event.time for event in reversed(told.events)}
    strikes = [times[side, "strike"] for side in ("right", "left")]
    np.testing.assert_allclose([load.start for load in loads], strikes, atol=0.01)
    edges = [np.linalg.norm(load.corners[1] - load.corners[0]) for load in loads]
    np.testing.assert_allclose(edges, 0.464, atol=0.001)
    assert told.offsets.keys() == {"left foot flexion", "right foot flexion"}

"""Headers of C3D files with one or two wrong fields: each is read or refused in one line, at a bounded cost."""

import math
import struct
import subprocess
import sys

import ezc3d
import numpy as np
import pytest

from study.mocap.io.c3d_file import read_c3d
from study.mocap.io.c3d_header import LONG, read_header
from study.mocap.io.reading import read_recording
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.io.writing import write_recording

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


def values_at(data):
    return {name: values for name, _, _, values in records(data)}


@pytest.fixture
def rich(tmp_path):
    """A C3D file with analog channels, longer parameters and room at its end."""
    positions = np.random.default_rng(5).normal(size=(4, 3, FRAMES))
    path = write_recording(Recording("rich", ("A", "B", "C", "D"), positions, 100.0), tmp_path / "rich.c3d")
    file = ezc3d.c3d(str(path))
    file["parameters"]["ANALOG"]["RATE"]["value"] = [200.0]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = ["Fz"]
    file["parameters"]["ANALOG"]["UNITS"]["value"] = ["N"]
    file["data"]["analogs"] = np.zeros((1, 1, 2 * FRAMES))
    file.add_parameter("POINT", "LONG_FRAMES", [float(FRAMES)])
    file.write(str(path))
    return path


def changed(path, *fields):
    """Write values of 16 bits (or floats) at places of a file."""
    data = bytearray(path.read_bytes())
    for place, value in fields:
        struct.pack_into("<f" if isinstance(value, float) else "<H", data, place, value)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    "fields",
    [
        {POINTS: 20000, LAST: 20000},
        {POINTS: 20000, LAST: 20000, "POINT:USED": 20000, "POINT:FRAMES": 20000},
        {POINTS: 20000, "POINT:USED": 20000, LAST: LONG},
        {ANALOG: 60000, LAST: 60000},
    ],
)
def test_a_header_that_promises_far_more_than_the_file_holds(rich, fields):
    """583 kB that promise gigabytes are refused before a library reserves memory for them."""
    with open(rich, "ab") as file:
        file.write(bytes(583_000 - rich.stat().st_size))
    places = values_at(rich.read_bytes())
    changed(rich, *((places.get(place, place), value) for place, value in fields.items()))
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
    found = read_recording(changed(rich, (values_at(rich.read_bytes())["POINT:RATE"], rate)))
    assert found.rate == 100.0
    assert found.notes[-1] == "its parameter POINT:RATE is no rate: 100 Hz of its header is used"


def test_a_unit_that_is_no_text(rich):
    """It counts as missing."""
    data = bytearray(rich.read_bytes())
    place = next(place for name, _, place, _ in records(data) if name == "POINT:UNITS")
    data[place] = 1
    rich.write_bytes(data)
    assert read_recording(rich).notes == ("the file does not give its unit: mm assumed",)


def test_every_description_may_be_damaged(rich):
    """A description that is longer than its record, of any parameter, hides no point."""
    before, raw = read_recording(rich), rich.read_bytes()
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


def test_a_text_without_a_length_is_kept_from_ezc3d(rich):
    """ezc3d ends the whole program on some of them."""
    data = bytearray(rich.read_bytes())
    place = next(place for name, _, place, _ in records(data) if name == "ANALOG:DESCRIPTIONS")
    assert read_header(rich).sound
    data[place + 1] = 0
    rich.write_bytes(data)
    assert not read_header(rich).sound


def test_rotations_that_the_file_cannot_hold_are_kept_from_ezc3d(rich):
    """ezc3d counts them for minutes."""
    changed(rich, (values_at(rich.read_bytes())["ROTATION:RATIO"], 65535))
    assert not read_header(rich).sound
    assert read_c3d(rich).points.shape == (4, 3, FRAMES)


MUTATE = """
import resource, sys
from pathlib import Path

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import RecordingError

resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
path, raw, told, count = Path(sys.argv[1]), Path(sys.argv[1]).read_bytes(), 0, 0
for line in sys.stdin:
    place, new = line.split()
    data = bytearray(raw)
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


def test_every_field_of_the_header_and_of_the_parameters(rich):
    """Each field takes extreme values, some 900 files: read or refused in one line, in 4 GB and a minute of work."""
    resource = pytest.importorskip("resource", reason="limits of memory and time need a POSIX system")
    assert resource.RLIMIT_AS
    data = rich.read_bytes()
    words = [struct.pack("<H", value) for value in (0, 1, 2, 255, 32767, 32768, 65534, 65535)]
    numbers = [struct.pack("<f", value) for value in (0.0, -1.0, 1e30, -1e30, np.nan, np.inf, 1e-30, 70000.0)]
    mutants = [(place, new) for place in range(0, 24, 2) for new in words]
    for _, size, place, values in records(data):
        mutants += [(values, new) for new in {2: words, 4: numbers}.get(size, [])]
        mutants += [(place, bytes([kind])) for kind in (0, 1, 2, 4, 127, 255)]
        mutants += [(place + offset, bytes([count])) for offset in (1, 2) for count in (0, 1, 3, 7, 8, 255)]
    script = "".join(f"{place} {new.hex()}\n" for place, new in mutants)
    done = subprocess.run(
        [sys.executable, "-c", MUTATE, str(rich)], input=script, capture_output=True, encoding="utf-8"
    )
    assert (done.returncode, done.stderr) == (0, "")
    count, told = map(int, done.stdout.split())
    assert count == len(mutants) > 800
    assert told < 0.8 * count

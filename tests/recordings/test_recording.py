"""Tests of recording."""

import numpy as np
import pytest

from study.recordings.formats.read import read_recording
from study.recordings.formats.write import write_recording
from study.recordings.recording import (
    FileContents,
    Recording,
    RecordingError,
    assemble,
    describe,
    known_unit,
    name_points,
    recording_data,
    unit_doubt,
    whole_frames,
)


def contents(points=None, labels=("A", "B"), rate=100.0, unit="mm"):
    points = np.arange(1.0, 31.0).reshape(2, 3, 5) * 100 if points is None else points
    return FileContents(labels, points, rate, unit)


METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "MM": 1e-3, " millimeters ": 1e-3, "Metres": 1.0, "inches": 0.0254}


@pytest.mark.parametrize("unit", METRES)
def test_units(unit):
    """Units have several spellings."""
    recording = assemble(contents(contents().points / 1000 / METRES[unit], unit=unit), "walk")
    np.testing.assert_allclose(recording.positions, contents().points / 1000, rtol=1e-14)


def test_a_unit_that_cannot_be_right_is_doubted():
    """A body of a kilometre or a millimetre is doubted."""
    for unit, likely in (("m", "mm"), ("um", "mm")):
        (note,) = assemble(contents(unit=unit), "walk").notes
        assert f"so its unit is hardly {unit}: with --unit {likely} they are " in note
        assert not assemble(contents(unit=likely), "walk").notes
    assert "hardly m: give another with --unit" in unit_doubt(1e9, "m")
    assert assemble(contents(), "walk").notes == ()


def test_missing_samples():
    """NaN or infinite in any coordinate, or zero in all, is missing in all; zero in one is not."""
    points = contents().points.copy()
    points[0, 1, 0] = np.nan
    points[0, 2, 1] = np.inf
    points[0, :, 2] = 0.0
    points[0, 0, 3] = 0.0
    recording = assemble(contents(points), "walk")
    assert recording.seen()[0].tolist() == [False, False, False, True, True]
    assert np.isnan(recording.positions).sum() == 9
    points[1] = np.nan  # a marker without samples stays; joints that need it are flagged later
    assert assemble(contents(points), "walk").missing().tolist() == [0.6, 1.0]


def test_lines():
    """The lines are a headline, notes, problems, then one per marker, with gaps and extents counted by hand."""
    positions = np.zeros((3, 3, 100))
    positions[0] = np.linspace(0, [3.0, 4.0, 0.0], 100).T
    positions[0, :, 40:60] = positions[0, :, 70:73] = np.nan
    positions[1] = np.nan
    positions[2] = 1.0
    recording = Recording("walk", ("A", "LONGNAME", "C"), positions, 100.0, ("something was odd",))
    assert describe(recording) == [
        "walk: 3 markers, 100 frames at 100 Hz, 0.99 s, 41.0% of the samples missing",
        "note: something was odd",
        "without any sample: LONGNAME",
        "no marker is missing in 77 frames: 1-40, 61-70, 74-100; --frames 1-40 reads the longest",
        "move by less than 1 mm: C",
        "marker    missing  gaps  longest  extent",
        "A           23.0%     2   0.20 s  5.00 m",
        "LONGNAME   100.0%     1   1.00 s       -",
        "C            0.0%     0        -  0.00 m",
    ]


@pytest.mark.parametrize(
    ("seen", "stretches", "line"),
    [
        (["1111", "1111"], [(1, 4)], None),
        (
            ["1101", "1111"],
            [(1, 2), (4, 4)],
            "no marker is missing in 3 frames: 1-2, 4-4; --frames 1-2 reads the longest",
        ),
        (["0101", "1010"], [], "in every frame a marker is missing"),
        (["0110", "0000"], [(2, 3)], "no marker is missing in 2 frames: 2-3; --frames 2-3 reads the longest"),
        (["10101", "11111"], [(1, 1), (3, 3), (5, 5)], "no marker is missing in 3 frames: 1-1, 3-3, 5-5"),
        (
            ["101101110110", "111111111111"],
            [(1, 1), (3, 4), (6, 8), (10, 11)],
            "no marker is missing in 8 frames: 3-4, 6-8, 10-11 and 1 shorter stretches; --frames 6-8 reads the longest",
        ),
    ],
)
def test_whole_frames(seen, stretches, line):
    """Stretches counted by hand; a marker without any sample does not count."""
    mask = np.array([[mark == "1" for mark in row] for row in seen])
    assert whole_frames(mask) == stretches
    positions = np.random.default_rng(1).normal(size=(len(seen), 3, mask.shape[1]))
    positions[np.broadcast_to(~mask[:, None], positions.shape)] = np.nan
    told = Recording("a", ("A", "B"), positions, 10.0)
    assert recording_data(told)["whole"] == stretches
    about = [said for said in describe(told) if "missing in" in said or "every frame" in said]
    assert [said[: len(line or "")] for said in about] == [line][: len(about)]
    assert bool(about) == bool(line)


def test_a_range_of_frames(tmp_path, small):
    """Frames count from 1, and both ends belong to the range; what is no range is refused with what would be one."""
    path = write_recording(small(), tmp_path / "a.csv")
    whole, part = read_recording(path), read_recording(path, frames=" 3-7")
    np.testing.assert_array_equal(part.positions, whole.positions[:, :, 2:7])
    assert part.notes[-1] == "frames 3-7 of 12: they count from 1 here"
    assert read_recording(path, frames="1-12").frames == 12
    for text in ("", "3", "7-3", "0-5", "1-13", "3-3", "-3-5", "a-b", "1-5,7-9", "1 5", "1-" + 400 * "9"):
        with pytest.raises(RecordingError, match="give the first and the last of its 12 frames, such as 1-12"):
            read_recording(path, frames=text)


def test_nothing_moves():
    """If no marker moves, a line at the top says so."""
    still = Recording("chair", ("A", "B"), np.ones((2, 3, 9)), 100.0)
    assert describe(still)[1] == "no marker moves by more than 0 mm; joints cannot be found"


@pytest.mark.parametrize(
    ("labels", "markers"),
    [
        *(([f"{one}LFHD", f"{one}RFHD "], ["LFHD", "RFHD"]) for one in ("", "male:", "a:b:", "Subject 1:", "  male: ")),
        (["male:LFHD", "", "*110", "male:"], ["LFHD", "point 2", "*110", "male:"]),  # extra points stay
        (["Andr\u00e9:LFHD".encode("latin-1").decode("utf-8", "surrogateescape"), "A\x1b[2J"], ["LFHD", "A\ufffd[2J"]),
    ],
)
def test_names_of_points(labels, markers):
    """The prefix of the subject is left out, for any name; points without a label are numbered; all can be shown."""
    assert name_points(labels) == ([*range(len(labels))], markers, [])


def test_prefixes_and_doubles():
    """Prefixes of the file need no colon; neither of two points with one label is used: nothing tells the marker."""
    assert name_points(["bob_LFHD", "bob_C7"], prefixes=["bob_"])[1] == ["LFHD", "C7"]
    _, markers, notes = name_points(["m:A", "m:B", "m:A"])
    assert markers == ["A#1", "B", "A#2"]
    assert notes == ["the label A is on points 1, 3: nothing tells which is the marker, so none of them is used"]


def test_of_several_subjects_one_is_chosen():
    labels = ["male:A", "female:A", "female:B", "*1"]
    words = r"2 subjects: male \(1 markers\), female \(2 markers\); choose one with --subject, or"
    with pytest.raises(RecordingError, match=words):
        name_points(labels)
    assert name_points(labels, "female") == ([1, 2], ["A", "B"], ["2 points of other subjects are left out"])
    assert name_points(["André:LFHD"], "André")[1] == ["LFHD"]
    with pytest.raises(RecordingError, match=r"no subject 'child' in it; there are male"):
        name_points(labels, "child")
    with pytest.raises(RecordingError, match="the labels have no prefix"):
        name_points(["A"], "child")


def test_positions_are_kept_from_changes():
    """They are read-only, in one layout; the caller's own array stays writable."""
    own = np.zeros((1, 3, 2))
    recording = Recording("walk", ("A",), own, 100.0)
    with pytest.raises(ValueError, match="read-only"):
        recording.positions[0, 0, 0] = 1.0
    own[0, 0, 0] = 1.0
    assert Recording("walk", ("A",), np.zeros((2, 3, 1)).T, 100.0).positions.flags.c_contiguous


def test_select(small):
    """Markers come in the given order, with some frames; all else is the same."""
    recording = small()
    some = recording.select(["C7", "LFHD"], slice(2, 5))
    assert some.markers == ("C7", "LFHD")
    np.testing.assert_array_equal(some.of("C7"), recording.of("C7")[:, 2:5])
    every = recording.select(frames=np.array([3, 0]))
    np.testing.assert_array_equal(every.positions, recording.positions[:, :, [3, 0]])
    assert (every.name, every.rate) == (recording.name, recording.rate)
    with pytest.raises(RecordingError, match="no marker 'NOSE'; there are LFHD, RFHD, C7, LFIN"):
        recording.of("NOSE")


@pytest.mark.parametrize(
    ("markers", "shape", "rate", "words"),
    [
        (("A", "B"), (3, 3, 5), 100.0, r"shape \(3, 3, 5\); they must be \(2, 3, frames\)"),
        (("A", "B"), (2, 5, 3), 100.0, r"must be \(2, 3, frames\)"),
        (("A", "A"), (2, 3, 5), 100.0, "two markers have the label 'A'"),
        (("A", "B"), (2, 3, 5), 0.0, "rate is 0 frames per second"),
        (("A", "B"), (2, 3, 5), np.nan, "rate is nan"),
    ],
)
def test_what_does_not_fit_is_refused(markers, shape, rate, words):
    with pytest.raises(RecordingError, match=words):
        Recording("walk", markers, np.zeros(shape), rate)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("mm\0\0\0\0", "mm"),
        ("m\0\0xy", "m"),
        ("\0mm", "mm"),
        ("millimet", "mm"),
        ("METER", "m"),
        ("Inches.", "in"),
        ("mi", None),
        ("furlong", None),
        ("\0\0", None),
        ("", None),
    ],
)
def test_names_of_units(text, unit):
    """A name filled with NUL characters, or cut off after three letters or more, is known; others are not."""
    assert known_unit(text) == unit

import numpy as np
import pytest

from study.mocap.io.assembly import FileContents, assemble
from study.mocap.io.recording import RecordingError


def contents(points=None, labels=("A", "B"), rate=100.0, unit="mm"):
    points = np.arange(1.0, 31.0).reshape(2, 3, 5) * 100 if points is None else points
    return FileContents(labels, points, rate, unit)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("mm", 1e-3),
        ("cm", 1e-2),
        ("m", 1.0),
        ("MM", 1e-3),
        (" millimeters ", 1e-3),
        ("Metres", 1.0),
        ("inches", 0.0254),
    ],
)
def test_units(unit, factor):
    """Units have several spellings."""
    points = contents().points / 1000 / factor
    recording = assemble(contents(points, unit=unit), "walk")
    np.testing.assert_allclose(recording.positions, contents().points / 1000, rtol=1e-14)


def test_the_callers_unit_and_rate_go_first():
    recording = assemble(contents(), "walk", unit="m", rate=50.0)
    np.testing.assert_array_equal(recording.positions, contents().points)
    assert recording.rate == 50.0


def test_an_unsaid_unit_is_noted_or_asked_for():
    recording = assemble(contents(unit=None), "walk", usual_unit="mm")
    assert recording.notes == ("the file does not give its unit: mm assumed",)
    with pytest.raises(RecordingError, match="its unit is not given; give one of m, dm, cm, mm"):
        assemble(contents(unit=None), "walk")
    with pytest.raises(RecordingError, match="its unit 'parsec' is not known"):
        assemble(contents(unit="parsec"), "walk")


def test_a_unit_that_cannot_be_right_is_doubted():
    """A body of a kilometre or a millimetre is doubted."""
    assert "is its unit m right" in assemble(contents(unit="m"), "walk").notes[0]
    assert "is its unit um right" in assemble(contents(unit="um"), "walk").notes[0]
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


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (contents(np.empty((0, 3, 5)), ()), "no markers in it"),
        (contents(np.ones((2, 3, 1))), "1 frame in it; motion needs at least 2"),
        (contents(np.ones((2, 3, 0))), "no frames in it"),
        (contents(np.full((2, 3, 5), np.nan)), "none of its 2 markers has a sample in any of its 5 frames"),
        (contents(np.zeros((2, 3, 5))), "none of its 2 markers has a sample"),
        (contents(rate=None), "rate in frames per second is not given; give one"),
        (contents(rate=0.0), "rate in frames per second is 0; give one"),
    ],
)
def test_what_cannot_be_used(given, words):
    with pytest.raises(RecordingError, match=words) as caught:
        assemble(given, "walk")
    assert "\n" not in str(caught.value)


def test_a_marker_never_seen_is_kept():
    """A marker without samples stays in the recording; joints that need it are flagged later."""
    points = contents().points.copy()
    points[1] = np.nan
    assert assemble(contents(points), "walk").missing().tolist() == [0.0, 1.0]


def test_the_files_own_array_is_left_alone():
    given = contents()
    before = given.points.copy()
    assemble(given, "walk")
    np.testing.assert_array_equal(given.points, before)

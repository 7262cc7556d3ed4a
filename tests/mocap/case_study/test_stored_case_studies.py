"""Read stored case studies: the rows that count, and one line for a missing, a damaged or another table."""

import math

import pandas as pd
import pytest

from study.mocap.case_study.stored_case_studies import read_case_studies
from study.mocap.io.origin import digest_of, with_origin
from study.mocap.io.recording import RecordingError

NAME = "case-study-scatter.parquet"


def scatter(**changes):
    """A joint, and a hinge whose axis was dropped, with two numbers of random frames and one of consecutive ones."""
    rows = [
        ("neck", "random", False, 100, 0.004, 0.005),
        ("neck", "random", False, 500, 0.002, 0.004),
        ("neck", "window", False, 500, 0.040, 0.040),
        ("knee", "random", False, 100, math.inf, math.inf),
        ("knee", "random", False, 500, 0.030, 0.031),
        ("knee", "random", True, 100, 0.003, 0.006),
        ("knee", "random", True, 500, 0.001, 0.005),
    ]
    table = pd.DataFrame(rows, columns=["joint", "way", "dropped", "samples", "median", "error"])
    return with_origin(table, "walk", "0123456789ab").assign(**changes)


@pytest.fixture
def folder(tmp_path):
    """Store a table as a case study's, in a folder of this name."""

    def make(table, name="study"):
        (tmp_path / name).mkdir()
        table.to_parquet(tmp_path / name / NAME)
        return tmp_path / name

    return make


def test_rows(folder):
    """Random frames alone count; a hinge counts without its axis, and has the scatter with it in another column."""
    found = read_case_studies([folder(scatter())]).set_index(["joint", "samples"])
    assert len(found) == 4
    assert set(found["recording"]) == {"0123456789ab"}
    spreads = {("neck", 100): 0.004, ("neck", 500): 0.002, ("knee", 100): 0.003, ("knee", 500): 0.001}
    assert found["spread"].to_dict() == spreads
    assert found.loc[("knee", 100), "with_axes"] == math.inf
    assert found.loc[("knee", 500), "with_axes"] == 0.03
    assert found.loc[("knee", 500), "error"] == 0.005
    assert found.loc[("neck", 500), "with_axes"] == 0.002


@pytest.mark.parametrize(("stored", "doubted"), [({}, True), ({"doubted": False}, False), ({"doubted": True}, True)])
def test_doubts(folder, stored, doubted):
    """A table of before doubts were stored rests on errors without skin, so that all its joints are in doubt."""
    assert (read_case_studies([folder(scatter(**stored))])["doubted"] == doubted).all()


def test_several(folder):
    """The digest of the file tells recordings apart, not its name."""
    one, seed = folder(scatter(), "a"), folder(scatter(median=0.3, recording="copy"), "b")
    other = folder(scatter(median=0.5, digest="ba9876543210"), "c")
    found = read_case_studies([one, seed, other])
    assert found.groupby("recording")["spread"].max().to_dict() == {"0123456789ab": 0.3, "ba9876543210": 0.5}
    assert len(found) == 12


def test_digest(tmp_path):
    """The digest has twelve digits of SHA-256 (of "abc", FIPS 180-4 example); a byte changes it, a name does not."""
    for name, content in (("a", b"abc"), ("b", b"abc"), ("c", b"abd")):
        (tmp_path / name).write_bytes(content)
    assert digest_of(tmp_path / "a") == digest_of(tmp_path / "b") == "ba7816bf8f01"
    assert digest_of(tmp_path / "c") != digest_of(tmp_path / "a")
    with pytest.raises(RecordingError, match="none: cannot be read: No such file"):
        digest_of(tmp_path / "none")


@pytest.mark.parametrize("lacking", [["digest"], ["recording", "digest"]])
def test_tables_that_do_not_name_their_recording(folder, lacking):
    """A table without its origin gives one line with the folder and the remedy."""
    place = folder(scatter().drop(columns=lacking))
    with pytest.raises(RecordingError) as caught:
        read_case_studies([place])
    said = str(caught.value)
    assert said.startswith(f"{place}: a case study that does not name its recording: {NAME} has no columns recording")
    assert said.endswith(f"run the case study again: `study case-study FILE --out {place}`")
    assert "\n" not in said


def test_a_table_of_two_recordings(folder):
    """A table of two recordings is refused."""
    table = pd.concat([scatter(), scatter(digest="ba9876543210", joint="hip")], ignore_index=True)
    with pytest.raises(RecordingError, match="of 2 recordings, not of one; run the case study again"):
        read_case_studies([folder(table)])


def test_one_twice(folder):
    """The same case study is refused twice, also from another folder."""
    first, second = folder(scatter(), "a"), folder(scatter(), "b")
    for folders in ([first, first], [first, second]):
        with pytest.raises(RecordingError, match="the same case study; give it once"):
            read_case_studies(folders)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            scatter().drop(columns=["median", "error"]),
            "written by another version: median, error missing or of another type",
        ),
        (scatter(samples="many"), "written by another version: samples missing"),
        (scatter(dropped=1.0), "written by another version: dropped missing"),
        (scatter(way="window"), "not one row per joint"),
        (scatter(samples=100), "not one row per joint"),
    ],
)
def test_other_tables(folder, table, words):
    """A table of another version or another program is refused."""
    place = folder(table)
    with pytest.raises(RecordingError) as caught:
        read_case_studies([place])
    assert str(caught.value).startswith(f"{place / NAME}: {words}")
    assert str(caught.value).endswith(f"`study case-study FILE --out {place}` writes one")


def test_no_case_study(folder, tmp_path):
    """A missing folder, one without a case study, and a file are refused."""
    place = folder(scatter())
    (tmp_path / "empty").mkdir()
    for wrong in (tmp_path / "none", tmp_path / "empty", place / NAME):
        with pytest.raises(RecordingError, match="not the folder of a case study") as caught:
            read_case_studies([wrong])
        assert str(caught.value).startswith(f"{wrong}: ")


@pytest.mark.parametrize("keep", [0, 4, 0.5, 0.98])
def test_damage(folder, keep):
    """A file that is cut short is refused, wherever the cut is."""
    place = folder(scatter())
    whole = (place / NAME).read_bytes()
    (place / NAME).write_bytes(whole[: int(keep * len(whole)) if isinstance(keep, float) else keep])
    with pytest.raises(RecordingError, match="cannot be read: it is damaged, or not parquet"):
        read_case_studies([place])

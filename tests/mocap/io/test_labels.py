import pytest

from study.mocap.io.labels import name_points
from study.mocap.io.recording import RecordingError


@pytest.mark.parametrize("prefix", ["", "male:", "Subject 1:", "a:b:", "  male: "])
def test_prefixes_are_taken_off(prefix):
    """The prefix of the subject is left out, for any name."""
    found = name_points([f"{prefix}LFHD", f"{prefix}RFHD ", f"{prefix}C7"])
    assert found.markers == ("LFHD", "RFHD", "C7")
    assert (found.rows, found.notes) == ((0, 1, 2), ())


def test_prefixes_of_the_file_need_no_colon():
    assert name_points(["bob_LFHD", "bob_C7"], prefixes=["bob_"]).markers == ("LFHD", "C7")


def test_points_without_a_label_are_numbered_and_props_are_kept():
    """Extra points stay; a marker set leaves them out."""
    found = name_points(["male:LFHD", "", "*110", "male:"])
    assert found.markers == ("LFHD", "point 2", "*110", "male:")


def test_doubles_are_renamed_and_said():
    """Neither of two points with one label is used, as nothing tells which is the marker."""
    found = name_points(["m:A", "m:B", "m:A"])
    assert found.markers == ("A#1", "B", "A#2")
    assert found.notes == ("the label A is on points 1, 3: nothing tells which is the marker, so none of them is used",)


def test_of_several_subjects_one_is_chosen():
    labels = ["male:A", "female:A", "female:B", "*1"]
    with pytest.raises(
        RecordingError, match=r"2 subjects: male \(1 markers\), female \(2 markers\); choose one with --subject"
    ):
        name_points(labels)
    found = name_points(labels, "female")
    assert (found.rows, found.markers) == ((1, 2), ("A", "B"))
    assert found.notes == ("2 points of other subjects are left out",)
    with pytest.raises(RecordingError, match=r"no subject 'child' in it; there are male"):
        name_points(labels, "child")
    with pytest.raises(RecordingError, match="the labels have no prefix"):
        name_points(["A"], "child")


def test_labels_can_be_shown():
    """Bytes that are not UTF-8 are decoded, and control characters are replaced."""
    latin = "Andr\u00e9:LFHD".encode("latin-1").decode("utf-8", "surrogateescape")
    assert name_points([latin, "A\x1b[2J"]).markers == ("LFHD", "A�[2J")
    assert name_points(["André:LFHD"], "André").markers == ("LFHD",)

import numpy as np
import pytest

from study.mocap.io.reading import read_recording
from study.mocap.io.recording import Recording
from study.mocap.markersets.match import choose, match
from study.mocap.markersets.set_file import MarkerSetError, load_markerset

CMU = load_markerset("cmu41")


def recording(markers, never=()):
    positions = np.ones((len(markers), 3, 4))
    positions[[marker in never for marker in markers]] = np.nan
    return Recording("walk", tuple(markers), positions, 100.0)


def test_all_there():
    """Markers come in the order of the set; extra ones are named."""
    found = match(CMU, recording(["sword", *reversed(CMU.markers())]))
    assert found.recording.markers == CMU.markers()
    assert found.joints == CMU.joints
    assert (found.lacking, found.lost, found.extra) == ({}, {}, ("sword",))
    assert found.lines() == [
        "marker set cmu41: 41 of the recording's 42 markers belong to it, 14 of 14 joints can be found",
        "not in the marker set: sword",
    ]


def test_what_is_lacking_and_what_can_still_be_found():
    """A hand without its marker loses the wrist alone; a segment of two markers loses the joints fixed in it."""
    there = [m for m in CMU.markers() if m not in ("LFIN", "RTHI")]
    found = match(CMU, recording(there, never=["RBWT"]))
    assert found.lacking == {"pelvis": ("RBWT",), "left_hand": ("LFIN",), "right_thigh": ("RTHI",)}
    assert found.lost == {
        "left_wrist": "left_hand has none of LFIN",
        "right_knee": "right_thigh has 1 markers (RKNE); its pose needs 3, or 2 and right_hip",
        "right_ankle": "right_shank has 2 markers (RSHN, RANK); its pose needs 3, or 2 and right_knee",
    }
    assert len(found.joints) == 11
    assert found.markerset.segment("left_hand").markers == ()
    assert "RBWT" not in found.recording.markers
    assert "joint left_wrist cannot be found: left_hand has none of LFIN" in found.lines()


def test_a_root_of_two_markers_carries_nothing():
    found = match(CMU, recording([m for m in CMU.markers() if m not in ("RBWT", "LBWT")]))
    assert found.lost["left_hip"] == "pelvis has 2 markers (LFWT, RFWT); its pose needs 3"
    assert "left_knee" in found.lost, "a thigh of two markers needs the hip"
    assert "neck" not in found.lost, "the thorax has markers enough of its own"


def test_a_joint_seen_by_some_of_the_childs_markers():
    """Without the markers of a joint, the child's other markers do not help."""
    knee = next(joint for joint in CMU.joints if joint.name == "left_knee")
    others = tuple(joint for joint in CMU.joints if joint is not knee)
    some = CMU.model_copy(update={"joints": (*others, knee.model_copy(update={"markers": ("LANK",)}))})
    found = match(some, recording([m for m in CMU.markers() if m != "LANK"]))
    assert found.lost["left_knee"] == "left_shank has none of LANK"


def test_aliases_and_capitals():
    """Aliases are used and reported; a marker's own label goes before an alias."""
    labels = [{"LSHN": "LTIB", "C7": "c7"}.get(m, m) for m in CMU.markers()] + ["RTIB"]
    found = match(CMU, recording(labels))
    assert (found.labels["LSHN"], found.labels["C7"], found.labels["RSHN"]) == ("LTIB", "c7", "RSHN")
    assert found.extra == ("RTIB",)
    assert "labels: c7 is C7, LTIB is LSHN" in found.lines()


def test_an_alias_stands_in_for_a_marker_never_seen():
    found = match(CMU, recording([*CMU.markers(), "LTIB"], never=["LSHN"]))
    assert found.labels["LSHN"] == "LTIB"


@pytest.mark.parametrize("name", ["cmu41", "plug-in-gait"])
def test_the_fitting_set_is_chosen(name):
    """The right set is chosen, also if the other fits with aliases, or some markers are missing."""
    whole = load_markerset(name)
    markers = [marker for marker in whole.markers() if marker not in whole.optional]
    assert choose(recording(markers)).whole.name == name
    assert choose(recording([*markers[:-1], "extra"])).whole.name == name


def test_nothing_fits():
    with pytest.raises(
        MarkerSetError, match="no marker set fits: with none of cmu41, plug-in-gait can a joint"
    ) as caught:
        choose(recording(["A", "B"]))
    assert "\n" not in str(caught.value)


def test_doubled_labels_are_lacking(tmp_path, write_c3d):
    """A label on two points is not a marker; the joints that need it cannot be found."""
    labels = [*CMU.markers(), "LFIN"]
    path = write_c3d(tmp_path / "a.c3d", labels, np.random.default_rng(1).normal(1000, 300, (42, 3, 5)))
    found = match(CMU, read_recording(path))
    assert found.lacking == {"left_hand": ("LFIN",)}
    assert list(found.lost) == ["left_wrist"]


def test_shared_recordings(shared_file):
    """All labels of both recordings belong to the set."""
    for name in ("cmu_135_02.c3d", "cmu_85_02.c3d"):
        found = choose(read_recording(shared_file(name)))
        assert (found.whole.name, found.extra, found.lacking, found.lost) == ("cmu41", (), {}, {})

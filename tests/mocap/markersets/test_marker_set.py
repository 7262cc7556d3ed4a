import pytest
from pydantic import ValidationError

from study.mocap.markersets.marker_set import Joint, MarkerSet, Segment

PELVIS = Segment(name="pelvis", markers=("A", "B", "C"))
THIGH = Segment(name="thigh", markers=("D", "E"), parent="pelvis")
HIP = Joint(name="hip", parent="pelvis", child="thigh")


def test_what_it_holds():
    leg = MarkerSet(name="leg", segments=(PELVIS, THIGH), joints=(HIP,))
    assert leg.segment("thigh") is THIGH
    assert leg.markers() == ("A", "B", "C", "D", "E")
    assert leg.markers_for(HIP) == ("D", "E")
    assert leg.markers_for(HIP.model_copy(update={"markers": ("E",)})) == ("E",)
    with pytest.raises(KeyError):
        leg.segment("foot")


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"segments": ()}, "at least 1 item"),
        ({"segments": (THIGH,), "joints": ()}, "segments.thigh.parent: the first segment is a root"),
        (
            {"segments": (PELVIS, THIGH.model_copy(update={"parent": None}))},
            "hip.parent: the parent of segment thigh is none",
        ),
        (
            {"segments": (PELVIS, THIGH.model_copy(update={"parent": "foot"}))},
            "must be an earlier segment: pelvis",
        ),
        ({"segments": (PELVIS, THIGH.model_copy(update={"name": "pelvis"}))}, "two segments have this name"),
        ({"segments": (PELVIS, THIGH.model_copy(update={"markers": ("A",)}))}, "marker 'A' is on pelvis already"),
        ({"segments": (PELVIS, THIGH.model_copy(update={"markers": ("D", "D")}))}, "marker 'D' is on it twice"),
        ({"joints": (HIP, HIP)}, "two joints have this name"),
        ({"joints": (HIP, HIP.model_copy(update={"name": "hop"}))}, "joint hip has this child already"),
        ({"joints": (HIP.model_copy(update={"child": "thig"}),)}, "no such segment; did you mean 'thigh'"),
        ({"joints": (HIP.model_copy(update={"parent": "thigh"}),)}, "the parent of segment thigh is pelvis"),
        ({"joints": (HIP.model_copy(update={"child": "pelvis"}),)}, "the parent of segment pelvis is none"),
        ({"joints": (HIP.model_copy(update={"markers": ("A",)}),)}, "'A' is not on thigh, which has D, E"),
        ({"optional": ("Z",)}, "marker 'Z' is on no segment"),
        ({"aliases": {"Z": ("Y",)}}, "marker 'Z' is on no segment"),
        ({"aliases": {"A": ("B",)}}, "'B' is itself a marker"),
        ({"aliases": {"A": ("Y",), "B": ("Y",)}}, "'Y' is an alias of A"),
    ],
)
def test_parts_that_do_not_fit(parts, words):
    whole = {"name": "leg", "segments": (PELVIS, THIGH), "joints": (HIP,)} | parts
    with pytest.raises(ValidationError, match=words):
        MarkerSet(**whole)

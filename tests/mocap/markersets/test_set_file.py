import pytest

from study.mocap.markersets.marker_set import MarkerSet
from study.mocap.markersets.set_file import MarkerSetError, load_markerset, parse_markerset, shipped

LEG = """name = "leg"

[segments.pelvis]
markers = ["A", "B", "C"]

[segments.thigh]
parent = "pelvis"
markers = ["D", "E"]

[joints.hip]
parent = "pelvis"
child = "thigh"
markers = ["E"]

[aliases]
D = ["D1", "D2"]
"""


def test_a_file_says_it_all():
    leg = parse_markerset(LEG)
    assert [(s.name, s.parent, s.markers) for s in leg.segments] == [
        ("pelvis", None, ("A", "B", "C")),
        ("thigh", "pelvis", ("D", "E")),
    ]
    (hip,) = leg.joints
    assert (hip.name, hip.parent, hip.child, hip.markers, hip.kind) == ("hip", "pelvis", "thigh", ("E",), "ball")
    assert leg.aliases == {"D": ("D1", "D2")}


def test_all_faults_at_once_with_their_lines():
    text = LEG.replace("name =", "nam =").replace('child = "thigh"', 'kind = "bal"').replace('["D", "E"]', '"D"')
    with pytest.raises(MarkerSetError) as caught:
        parse_markerset(text, "leg.toml")
    assert str(caught.value).splitlines() == [
        "leg.toml: 5 faults",
        "  line 1: name: required, but missing",
        "  line 1: nam = 'leg': unknown key; did you mean 'name'? Known are " + ", ".join(MarkerSet.model_fields),
        "  line 8: segments.thigh.markers = 'D': must be a list, such as [\"D\"]",
        "  line 10: joints.hip.child: required, but missing",
        "  line 12: joints.hip.kind = 'bal': input should be 'ball' or 'hinge'",
    ]


def test_faults_of_the_schema_and_of_names_are_told_together():
    """A joint with an unknown segment and a doubled marker are told beside a wrong kind."""
    text = LEG.replace('child = "thigh"', 'child = "thihg"\nkind = "bal"').replace('["D", "E"]', '["D", "A"]')
    with pytest.raises(MarkerSetError) as caught:
        parse_markerset(text, "leg.toml")
    assert str(caught.value).splitlines() == [
        "leg.toml: 3 faults",
        "  line 8: segments.thigh.markers: marker 'A' is on pelvis already",
        "  line 12: joints.hip.child = 'thihg': no such segment; did you mean 'thigh'? Known are pelvis, thigh",
        "  line 13: joints.hip.kind = 'bal': input should be 'ball' or 'hinge'",
    ]


def test_several_roots():
    """Two bodies in one set: each has a root, and joints of its own."""
    arm = '\n[segments.arm]\nmarkers = ["P", "Q", "R"]\n[segments.hand]\nparent = "arm"\nmarkers = ["S"]\n'
    found = parse_markerset(
        LEG.replace("[joints.hip]", arm + '[joints.wrist]\nparent = "arm"\nchild = "hand"\n\n[joints.hip]')
    )
    assert [segment.name for segment in found.segments if segment.parent is None] == ["pelvis", "arm"]
    assert [joint.name for joint in found.joints] == ["wrist", "hip"]


@pytest.mark.parametrize("entry", ['across = ["X"]', 'across = ["X", "X"]', 'kind = "ball"\nacross = ["X", "Y"]'])
def test_points_across_a_hinge(entry):
    """They are two, and only a hinge has them."""
    text = LEG.replace(
        'markers = ["E"]\n', 'markers = ["E"]\n' + ("" if "kind" in entry else 'kind = "hinge"\n') + entry + "\n"
    )
    with pytest.raises(MarkerSetError, match="must name two points, the lateral and the medial one"):
        parse_markerset(text, "leg.toml")


def test_faults_between_parts_with_their_lines():
    text = LEG.replace('["E"]', '["A"]').replace('["A", "B", "C"]', "[]").replace("D = [", "X = [")
    with pytest.raises(MarkerSetError) as caught:
        parse_markerset(text, "leg.toml")
    assert str(caught.value).splitlines() == [
        "leg.toml: 3 faults",
        "  line 4: segments.pelvis.markers = []: must name at least one marker",
        "  line 13: joints.hip.markers: 'A' is not on thigh, which has D, E",
        "  line 16: aliases.X: marker 'X' is on no segment",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name = ", "leg: not TOML"),
        ("[" * 5000, "leg: not TOML"),
        ('name = "leg"\nsegments = 3', "must be tables such as"),
        ('name = "leg"\n[segments]\npelvis = 3', "segments"),
        ('name = "leg"', "segments: required, but missing"),
    ],
)
def test_what_is_no_marker_set(text, words):
    with pytest.raises(MarkerSetError, match=words):
        parse_markerset(text, "leg")


def test_shipped_ones_by_name():
    assert {"cmu41", "plug-in-gait"} <= set(shipped())
    for name in shipped():
        assert load_markerset(name).name == name
    for name in ("cmu41", "plug-in-gait"):
        found = load_markerset(name)
        assert found.name == name
        assert len(found.segments) == 15
        assert {joint.name for joint in found.joints} == {
            "waist",
            "neck",
            *(f"{s}_{j}" for s in ("left", "right") for j in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")),
        }
        hinges = {joint.name for joint in found.joints if joint.kind == "hinge"}
        assert hinges == {"left_elbow", "right_elbow", "left_knee", "right_knee"}
    assert len(load_markerset("cmu41").markers()) == 41
    gait = load_markerset("plug-in-gait")
    assert len(set(gait.markers()) - set(gait.optional)) == 39


def test_a_path(tmp_path):
    (tmp_path / "leg.toml").write_text(LEG)
    assert load_markerset(tmp_path / "leg.toml").name == "leg"
    (tmp_path / "leg.toml").write_text(LEG, encoding="utf-8-sig")
    assert load_markerset(tmp_path / "leg.toml").name == "leg"
    with pytest.raises(MarkerSetError, match=r"none.toml: cannot be read: No such file"):
        load_markerset(str(tmp_path / "none.toml"))


def test_an_unknown_name_is_told_with_the_known():
    with pytest.raises(
        MarkerSetError,
        match=r"no marker set 'cmu42': did you mean 'cmu41'\? Known are cast, cgm2, cmu41, .*; or give the path",
    ):
        load_markerset("cmu42")

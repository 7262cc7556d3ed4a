"""Tests of markersets."""

import numpy as np
import pytest
from pydantic import ValidationError

from study.recordings import markersets
from study.recordings.recording import Recording
from study.recordings.skeleton.anatomy import legs

PELVIS = markersets.Segment(name="pelvis", markers=("A", "B", "C"))

THIGH = markersets.Segment(name="thigh", markers=("D", "E"), parent="pelvis")

HIP = markersets.Joint(name="hip", parent="pelvis", child="thigh")


def thigh(**changes):
    return {"segments": (PELVIS, THIGH.model_copy(update=changes))}


def hip(**changes):
    return {"joints": (HIP.model_copy(update=changes),)}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"segments": ()}, "at least 1 item"),
        ({"segments": (THIGH,), "joints": ()}, "segments.thigh.parent: the first segment is a root"),
        (thigh(parent=None), "hip.parent: the parent of segment thigh is none"),
        (thigh(parent="foot"), "must be an earlier segment: pelvis"),
        (thigh(name="pelvis"), "two segments have this name"),
        (thigh(markers=("D", "D")), "marker 'D' is on it twice"),
        ({"joints": (HIP, HIP)}, "two joints have this name"),
        ({"joints": (HIP, HIP.model_copy(update={"name": "hop"}))}, "joint hip has this child already"),
        (hip(parent="thigh"), "the parent of segment thigh is pelvis"),
        (hip(child="pelvis"), "the parent of segment pelvis is none"),
        (hip(kind="hinge", across=("X",)), "must name two points, the lateral and the medial one"),
        (hip(kind="hinge", across=("X", "X")), "must name two points, the lateral and the medial one"),
        (hip(across=("X", "Y")), "and is for a hinge alone"),
        ({"optional": ("Z",)}, "marker 'Z' is on no segment"),
        ({"aliases": {"A": ("B",)}}, "'B' is itself a marker"),
        ({"aliases": {"A": ("Y",), "B": ("Y",)}}, "'Y' is an alias of A"),
    ],
)
def test_parts_that_do_not_fit(parts, words):
    whole = {"name": "leg", "segments": (PELVIS, THIGH), "joints": (HIP,)} | parts
    with pytest.raises(ValidationError, match=words):
        markersets.MarkerSet(**whole)


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


@pytest.mark.parametrize(
    ("changes", "lines"),
    [
        (
            {"name =": "nam =", 'child = "thigh"': 'kind = "bal"', '["D", "E"]': '"D"'},
            [
                "  line 1: name: required, but missing",
                "  line 1: nam = 'leg': unknown key; did you mean 'name'? Known are "
                + ", ".join(markersets.MarkerSet.model_fields),
                "  line 8: segments.thigh.markers = 'D': must be a list, such as [\"D\"]",
                "  line 10: joints.hip.child: required, but missing",
                "  line 12: joints.hip.kind = 'bal': input should be 'ball' or 'hinge'",
            ],
        ),
        (  # of the schema, and of names
            {'child = "thigh"': 'child = "thihg"\nkind = "bal"', '["D", "E"]': '["D", "A"]'},
            [
                "  line 8: segments.thigh.markers: marker 'A' is on pelvis already",
                "  line 12: joints.hip.child = 'thihg': no such segment; did you mean 'thigh'? Known are pelvis, thigh",
                "  line 13: joints.hip.kind = 'bal': input should be 'ball' or 'hinge'",
            ],
        ),
        (
            {'["E"]': '["A"]', '["A", "B", "C"]': "[]", "D = [": "X = ["},
            [
                "  line 4: segments.pelvis.markers = []: must name at least one marker",
                "  line 13: joints.hip.markers: 'A' is not on thigh, which has D, E",
                "  line 16: aliases.X: marker 'X' is on no segment",
            ],
        ),
    ],
)
def test_all_faults_at_once_with_their_lines(changes, lines):
    text = LEG
    for old, new in changes.items():
        text = text.replace(old, new)
    with pytest.raises(markersets.MarkerSetError) as caught:
        markersets.parse_markerset(text, "leg.toml")
    assert str(caught.value).splitlines() == [f"leg.toml: {len(lines)} faults", *lines]


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
    with pytest.raises(markersets.MarkerSetError, match=words):
        markersets.parse_markerset(text, "leg")


def test_a_path_with_and_without_a_byte_order_mark(tmp_path):
    for encoding in ("utf-8", "utf-8-sig"):
        (tmp_path / "leg.toml").write_text(LEG, encoding=encoding)
        assert markersets.load_markerset(tmp_path / "leg.toml").name == "leg"
    with pytest.raises(markersets.MarkerSetError, match=r"none.toml: cannot be read: No such file"):
        markersets.load_markerset(str(tmp_path / "none.toml"))
    with pytest.raises(markersets.MarkerSetError, match=r"no marker set 'cmu42': did you mean 'cmu41'"):
        markersets.load_markerset("cmu42")


CMU = markersets.load_markerset("cmu41")


def labels_of(words):
    """Labels from words: ~ stands for L and R, ^ for L and r, first all of the left, then all of the right."""
    both = [[word.replace("~", a).replace("^", b) for word in words.split()] for a, b in (("L", "L"), ("R", "r"))]
    return list(dict.fromkeys(both[0] + both[1]))


PIG_TOP = labels_of("~FHD ~BHD C7 T10 CLAV STRN RBAK")
PIG_ARM = labels_of("~SHO ~UPA ~ELB ~FRM ~WRA ~WRB ~FIN")
PIG_LEG = labels_of("~ASI ~PSI ~THI ~KNE ~TIB ~ANK ~HEE ~TOE")


def matched(name, labels):
    """The match of a shipped set with a recording of these labels."""
    return markersets.match(markersets.load_markerset(name), recording(labels))


def recording(markers, never=()):
    positions = np.ones((len(markers), 3, 4))
    positions[[marker in never for marker in markers]] = np.nan
    return Recording("walk", tuple(markers), positions, 100.0)


def test_all_there():
    """Markers come in the order of the set, each with its own positions; extra ones are named."""
    labels = ("sword", *reversed(CMU.markers()))
    source = Recording("walk", labels, np.random.default_rng(1).normal(size=(42, 3, 4)), 100.0)
    found = markersets.match(CMU, source)
    assert (found.recording.markers, found.extra) == (CMU.markers(), ("sword",))
    np.testing.assert_array_equal(found.recording.positions, source.select(CMU.markers()).positions)


def test_what_is_lacking_and_what_can_still_be_found():
    """A hand without its marker loses the wrist alone; a segment of two markers loses the joints fixed in it."""
    there = [m for m in CMU.markers() if m not in ("LFIN", "RTHI")]
    found = markersets.match(CMU, recording(there, never=["RBWT"]))
    assert found.lacking == {"pelvis": ("RBWT",), "left_hand": ("LFIN",), "right_thigh": ("RTHI",)}
    assert found.lost == {
        "left_wrist": "left_hand has none of LFIN",
        "right_knee": "right_thigh has 1 marker (RKNE); its pose needs 3, or 2 and right_hip",
        "right_ankle": "right_shank has 2 markers (RSHN, RANK); its pose needs 3, or 2 and right_knee",
    }
    assert len(found.joints) == 11
    assert found.markerset.segment("left_hand").markers == ()
    assert "RBWT" not in found.recording.markers
    assert "joint left_wrist cannot be found: left_hand has none of LFIN" in found.lines()


def test_a_root_of_two_markers_carries_nothing():
    found = markersets.match(CMU, recording([m for m in CMU.markers() if m not in ("RBWT", "LBWT")]))
    assert found.lost["left_hip"] == "pelvis has 2 markers (LFWT, RFWT); its pose needs 3"


def test_a_joint_seen_by_some_of_the_childs_markers():
    """Without the markers of a joint, the child's other markers do not help."""
    parts = (j.model_copy(update={"markers": ("LANK",)}) if j.name == "left_knee" else j for j in CMU.joints)
    some = CMU.model_copy(update={"joints": tuple(parts)})
    found = markersets.match(some, recording([m for m in CMU.markers() if m != "LANK"]))
    assert found.lost["left_knee"] == "left_shank has none of LANK"


def test_aliases_and_capitals():
    """Aliases are used and reported; a marker's own label goes before an alias, but for one never seen."""
    labels = [{"LSHN": "LTIB", "C7": "c7"}.get(m, m) for m in CMU.markers()] + ["RTIB"]
    found = markersets.match(CMU, recording(labels))
    assert (found.labels["LSHN"], found.labels["C7"], found.labels["RSHN"]) == ("LTIB", "c7", "RSHN")
    assert found.extra == ("RTIB",)
    assert "labels: c7 is C7, LTIB is LSHN" in found.lines()
    stands_in = markersets.match(CMU, recording([*CMU.markers(), "LTIB"], never=["LSHN"]))
    assert stands_in.labels["LSHN"] == "LTIB"


def test_the_set_of_a_match_knows_the_same_labels():
    """A calibration has the set of its match: it once knew no alias, and found no marker LTIB in another recording."""
    labels = [{"LSHN": "LTIB", "RSHN": "RTIB", "LFWT": "LASI"}.get(m, m) for m in CMU.markers()]
    found = matched("plug-in-gait", labels)
    again = markersets.match(found.markerset, found.source)
    assert found.labels["LASI"] == "LASI"
    assert found.labels["RASI"] == "RFWT"
    assert again.labels == found.labels


@pytest.mark.parametrize("spell", ["{}", "Subj01_{}", "walker.{}", "Anna {}", "m-{}"])
@pytest.mark.parametrize("written", [str, str.lower, lambda m: f"{m[0]}_{m[1:]}", lambda m: f"{m[0]}.{m[1:].title()}"])
def test_labels_are_compared_without_case_signs_and_prefix(spell, written):
    """However the labels of a set are spelt, they lead to it, with the recording's own labels."""
    labels = [spell.format(written(m)) for m in PIG_LEG]
    found = markersets.choose(recording([*labels, "*17", "wand"]))
    assert (found.whole.name, len(found.joints)) == ("plug-in-gait", 6)
    assert found.labels["LTHI"] == spell.format(written("LTHI"))
    assert found.extra == ("*17", "wand")


def test_a_side_is_no_prefix_and_the_first_of_two_spellings_counts():
    """Left markers alone keep their side; of two labels of one spelling one is used, and once."""
    assert "knee" not in markersets.spellings(["L_knee", "L_thigh", "L_toe"])
    found = markersets.match(CMU, recording([*CMU.markers(), "C_7", "c7"]))
    assert (found.labels["C7"], found.extra) == ("C7", ("C_7", "c7"))
    found = markersets.match(CMU, recording(["c_7", "C.7", *(m for m in CMU.markers() if m != "C7")]))
    assert (found.labels["C7"], found.extra) == ("c_7", ("C.7",))


def test_a_label_is_one_marker():
    """Of two markers that it could be, by an alias or by its spelling, it is the first; the other one is lacking."""
    leg = markersets.MarkerSet(
        name="leg", segments=(PELVIS, THIGH), joints=(HIP,), aliases={"D": ("b-",), "E": ("C_",)}
    )
    found = markersets.match(leg, recording(["A", "b", "c"]))
    assert found.labels == {"A": "A", "B": "b", "C": "c"}
    assert found.lacking == {"thigh": ("D", "E")}


@pytest.mark.parametrize(
    "labels", ["~ASIS ~PSIS ~TH1 ~TH2 ~TH3", "~ASI ~PSI LTH1 LTH2 LTH3", "~ASI ~PSI ~TH1 ~TH2 ~TH3 ~TB1 ~TB2 ~TB3 CLAV"]
)
def test_a_joint_whose_markers_are_all_there_is_enough(labels):
    """A pelvis and a thigh with all their markers are found, though most of the set's joints are not."""
    found = markersets.choose(recording(labels_of(labels)))
    assert "left_hip" in {joint.name for joint in found.joints}
    assert markersets.clusters(found.extra) == []


@pytest.mark.parametrize("name", markersets.shipped())
def test_the_fitting_set_is_chosen(name):
    """The right set is chosen, also if the other fits with aliases, or some markers are missing.

    Knees and elbows are hinges, and no other joints; no marker has the name of an output of a program's model.
    """
    whole = markersets.load_markerset(name)
    assert all((joint.kind == "hinge") == joint.name.endswith(("knee", "elbow")) for joint in whole.joints)
    assert not any(map(markersets.is_output, whole.markers()))
    markers = [marker for marker in whole.markers() if marker not in whole.optional]
    assert markersets.choose(recording(markers)).whole.name == name
    assert markersets.choose(recording([*markers[:-1], "extra"])).whole.name == name


CGM_LEG = PIG_LEG + labels_of("~THAP ~THAD ~TIAP ~TIAD")
GAIT2354 = (
    "Sternum Top.Head V.Sacral ~.Acromium ~.ASIS ~.Thigh.Upper ~.Thigh.Front ~.Thigh.Rear ~.Shank.Upper ~.Shank.Front "
    "~.Shank.Rear ~.Heel ~.Midfoot.Sup ~.Midfoot.Lat ~.Toe.Tip"
)
RAJAGOPAL = (
    "C7 CLAV ~ACR ~ASH ~PSH ~LEL ~MEL ~UA1 ~UA2 ~UA3 ~FAsuperior ~FAradius ~FAulna ~ASI ~PSI ~HJC ~TH1 ~TH2 ~TH3 ~LFC "
    "~MFC ~KJC ~TB1 ~TB2 ~TB3 ~LMAL ~MMAL ~AJC ~CAL ~TOE ~MT5"
)
AUGMENTED = (
    "^.ASIS ^.PSIS ^_knee ^_mknee ^_ankle ^_mankle ^_toe ^_5meta ^_calc ^_shoulder C7 ^_thigh1 ^_thigh2 ^_thigh3 ^_sh1 "
    "^_sh2 ^_sh3 ~HJC ^_lelbow ^_melbow ^_lwrist ^_mwrist"
)
RAW = (
    "C7 r_shank_antsup L_shank(ant_sup) r_sh2 r_sh3 r_sh4 L_sh2 L_sh3 r_thigh4 r_thigh5 L_thigh4 ~_Sternum ~_Shoulder "
    "^.ASIS ^.PSIS ^_knee ^_mknee ^_ankle ^_mankle ^_toe ^_5meta ^_calc ^_thigh1 ^_thigh2 ^_thigh3"
)
UWA = "C7 T10 CLAV STRN ~ASI ~PSI ~TH1 ~TH2 ~TH3 ~LFC ~MFC ~TB1 ~TB2 ~TB3 ~LMAL ~MMAL ~CAL ~MT1 ~MT5"
VISUAL3D = "CV7 TV2 TV7 SJN SXS LV1 LV3 LV5 ~CAJ ~IAS ~IPS ~FTC ~FLE ~FME ~FAX ~TTC ~FAL ~TAM ~FCC ~FM1 ~FM2 ~FM5"
LEARDINI = "C7 T2 MAI IJ PX L1 L3 L5 ~A ~ASIS ~PSIS ~GT ~LE ~ME ~HF ~TT ~LM ~MM ~CA ~FM ~SM ~VM"
CLUSTERS = "~ASI ~PSI ~TH1 ~TH2 ~TH3 ~TB1 ~TB2 ~TB3 ~TOE ~HEE ~D5M ~KNE ~MKNE ~ANK ~MMA"

PUBLISHED = {
    "Vicon's Plug-in Gait, whole body": (PIG_TOP + PIG_ARM + PIG_LEG, "plug-in-gait", 14, 0),
    "Vicon's Plug-in Gait, legs": (PIG_LEG, "plug-in-gait", 6, 0),
    "pyCGM2, CGM2.3 legs": (CGM_LEG + labels_of("~KNM ~MED"), "cgm2", 6, 2),
    "pyCGM2, CGM2.4 legs": (CGM_LEG + labels_of("~SMH ~FMH ~VMH"), "cgm2", 6, 0),
    "pyCGM2, CGM2.3 as first published": (PIG_LEG + labels_of("~THIAP ~THIAD ~TIBAP ~TIBAD"), "cgm2", 6, 0),
    "OpenSim, Gait2354 example": (labels_of(GAIT2354), "gait2392", 7, 0),
    "OpenSim, Rajagopal 2016": (labels_of(RAJAGOPAL), "hamner", 11, 8),
    "OpenCap, augmented": ([f"{m}_study" for m in labels_of(AUGMENTED)], "opencap", 11, 2),
    "OpenCap's laboratory, raw": (labels_of(RAW), "stanford", 7, 0),
    "UWA, clusters": (labels_of(UWA), "cast", 7, 4),
    "Rizzoli, Visual3D's labels": (labels_of(VISUAL3D), "rizzoli", 7, 3),
    "Rizzoli, Leardini's labels": (labels_of(LEARDINI), "rizzoli", 7, 3),
    "Plug-in Gait with clusters": (PIG_TOP + labels_of(CLUSTERS), "plug-in-gait-clusters", 8, 2),
}
"""Labels as the publishers of the sets give them, the set that fits, its joints, and how many labels it has no use for.

These are computed joint centres, malleoli, and vertebrae of the loin, none of which is on a segment or across a hinge.
"""


@pytest.mark.parametrize("source", PUBLISHED)
def test_published_labels(source):
    """The labels that each set's publisher gives lead to the set and its joints; unlabelled points do no harm."""
    labels, name, joints, others = PUBLISHED[source]
    found = markersets.choose(recording([*labels, *(f"*{i}" for i in range(60))]))
    assert (found.whole.name, len(found.joints), len(found.extra) - 60) == (name, joints, others)


def test_some_markers_of_another_set_are_no_match(one_line):
    """One joint of fourteen is no reason to choose a set; the message names it, and the clusters that nobody uses."""
    labels = ["C7", "T10", "CLAV", "STRN", *labels_of("~ASI ~PSI ~QQ1 ~QQ2 ~QQ3"), *(f"*{i}" for i in range(9))]
    with pytest.raises(markersets.MarkerSetError, match="no marker set fits: with ") as caught:
        markersets.choose(recording(labels))
    assert "1 of 14 joints can be found; --markerset" in str(caught.value) or "1 of 7 joints" in str(caught.value)
    assert "unused clusters are LQQ1-LQQ3, RQQ1-RQQ3" in str(caught.value)
    words = f"no marker set fits: with none of {', '.join(markersets.shipped())} can a joint"
    with one_line(markersets.MarkerSetError, words):
        markersets.choose(recording(["A", "B"]))


def test_a_better_set_and_unused_clusters():
    """A set that a user named is taken, with a word on the one that finds more, and on clusters."""
    labels = PUBLISHED["UWA, clusters"][0]
    lines = markersets.with_better(matched("plug-in-gait", labels)).lines()
    assert lines[-1] == "marker set cast fits better: 7 of 7 joints can be found with it"
    assert lines[-2].startswith("clusters that it does not use: LTH1-LTH3, LTB1-LTB3, RTH1-RTH3, RTB1-RTB3")
    assert markersets.with_better(matched("cast", labels)).remarks == ()


def test_a_wrong_label_is_answered_with_the_nearest():
    lines = matched("plug-in-gait", [{"LTHI": "LTHIGH", "RANK": "RANKL"}.get(m, m) for m in PIG_LEG]).lines()
    assert "segment left_thigh lacks LTHI (did you mean LTHIGH?)" in lines
    assert "segment right_shank lacks RANK (did you mean RANKL?)" in lines
    lines = matched("plug-in-gait", ["RTHIGH" if m == "LTHI" else m for m in PIG_LEG]).lines()
    assert "segment left_thigh lacks LTHI" in lines, "a label of the other side is no hint"


def test_what_programs_computed_is_not_listed_one_by_one():
    """Sixty outputs of a model take a line of six and a number."""
    kinds = "~HipAngles ~KneeMoment ~AnklePower ~GroundReactionForce ~NormalisedGRF ~HJC ~FEO ~TIP"
    outputs = [*labels_of(kinds), "PELO", "TRXA", "CentreOfMass", "CentreOfMassFloor", "LHJC_reg"]
    lines = markersets.match(CMU, recording([*CMU.markers(), *outputs, "sword"])).lines()
    assert lines[-2] == "not in the marker set: sword"
    assert lines[-1].startswith("of another program's model, not markers: LHipAngles, LKneeMoment, ")
    assert lines[-1].endswith(f"and {len(outputs) - 6} more")


def test_a_segment_without_any_marker_is_told_once():
    """Its joint says what it needs; only a near label is worth a second line."""
    hips = [m for m in PIG_LEG if m[1:] in ("ASI", "PSI", "THI", "KNE")]
    lines = matched("plug-in-gait", hips).lines()
    assert not any("left_shank lacks" in line for line in lines)
    assert sum("left_shank has none of LTIB, LANK" in line for line in lines) == 1
    words = "segment left_shank lacks LTIB, LANK (did you mean LANKL?)"
    assert words in matched("plug-in-gait", [*hips, "LANKL"]).lines()


def test_numbers_at_the_end_make_clusters():
    labels = "LTH1 LTH3 x LTH2 C7 T10 T1 L1 L2 L3 thigh_1 thigh_2"
    assert markersets.clusters(labels.split()) == ["LTH1-LTH3"]


def test_landmarks_are_matched_and_used_by_hinges_alone():
    """A landmark has its label, is no marker of a segment, and is gone with the other one of its pair."""
    for lacking, across in ((None, ("LLFC", "LMFC")), ("LMFC", ())):
        found = matched("cast", [label for label in labels_of(UWA) if label != lacking])
        assert next(joint for joint in found.joints if joint.name == "left_knee").across == across
        assert set(across) <= set(found.recording.markers)
        assert not {"LLFC", "LMFC"} & set(found.markerset.markers())


def test_points_of_the_body_that_no_segment_has_are_named_apart():
    """Malleoli that a set lacks place ankles and axes nevertheless, so they are not named as of no use."""
    lines = matched("plug-in-gait", [*PIG_TOP, *PIG_LEG, "LMED", "sword"]).lines()
    assert "not in the marker set, but points of the body: LMED" in lines
    assert "not in the marker set: sword" in lines


CLUSTERED = labels_of("~_THIGH_1 ~_THIGH_2 ~_THIGH_3 ~_THIGH_4 ~_SHANK_1 ~_SHANK_2 ~_SHANK_3 ~_SHANK_4")
LABORATORIES = {
    "Visual3D, clusters": (
        CLUSTERED + labels_of("~_ASIS ~_PSIS ~_FOOT_1 ~_FOOT_2 ~_FOOT_3 ~_LAT_KNEE ~_MED_KNEE"),
        6,
        7,
    ),
    "Visual3D, a cluster on the pelvis": ([*CLUSTERED, "PELVIS_1", "PELVIS_2", "PELVIS_3"], 4, 0),
    "Visual3D, short": (labels_of("~ASI ~PSI ~TH1 ~TH2 ~TH3 ~TH4 ~SK1 ~SK2 ~SK3 ~SK4 ~FT1 ~FT2 ~FT3"), 6, 7),
    "Helen Hayes, short": ([*labels_of("~SHO ~ELB ~WRI ~ASI ~THI ~KNE ~SHA ~ANK ~HEE ~TOE"), "VSAC"], 6, 7),
    "Helen Hayes, Cortex": ([*labels_of("~.ASIS ~.Thigh ~.Knee ~.Shank ~.Ankle ~.Heel ~.Toe"), "V.Sacral"], 6, 7),
    "Codamotion": (
        labels_of("~.ASIS ~.PSIS ~.Ant.Fem ~.Post.Fem ~.Knee ~.Ant.Tib ~.Post.Tib ~.Ankle ~.Heel ~.Toe"),
        6,
        7,
    ),
}
"""Labels of sets that are known by their pattern, the joints found, and the parts of pelvis and legs."""


@pytest.mark.parametrize("source", LABORATORIES)
def test_sets_by_side_segment_and_number(source):
    """Clusters and wands are found by the pattern of their labels; each marker is on the segment that it names."""
    labels, joints, parts = LABORATORIES[source]
    found = markersets.choose(recording([*labels, *(f"*{i}" for i in range(20))]))
    assert (found.whole.name, len(found.joints), len(legs(found.markerset))) == ("by-name", joints, parts)
    for segment in found.whole.segments:
        sides = {label[0] for label in segment.markers}
        assert sides == {segment.name[0].upper()} or segment.name == "pelvis"
    assert markersets.place_markerset(recording(labels), "by-name").whole == found.whole


def test_plug_in_gait_is_not_taken_away():
    """Plug-in Gait's files are never CMU's, with missing and with further markers."""
    rng = np.random.default_rng(1)
    whole = PIG_TOP + PIG_ARM + PIG_LEG
    for further in ([], labels_of("~MT5"), labels_of("~MT1 ~MT5"), labels_of("~MMA ~MKNE"), ["T12", "T2"]):
        for share in (0.0, 0.1, 0.2, 0.3):
            kept = [label for label in whole if label in PIG_LEG or rng.random() >= share]
            found = markersets.choose(recording([*kept, *further]))
            assert found.whole.name != "cmu41"
            assert "pelvis" in legs(found.markerset)
    assert markersets.choose(recording([*CMU.markers()])).whole.name == "cmu41"


def test_points_of_the_oxford_model_are_no_markers():
    """LTIB1-LTIB3 are a cluster's markers, but not beside other points of the Oxford foot model."""
    model = labels_of("~TIB1 ~TIB2 ~TIB3 ~FOF0 ~HDF0")
    found = markersets.choose(recording(PIG_TOP + PIG_ARM + PIG_LEG + model))
    assert found.whole.name == "plug-in-gait"
    assert set(model) <= set(found.extra)
    assert markersets.measured(model[:3]) == model[:3]


def test_a_set_names_landmarks():
    """Four lines name the epicondyles and malleoli of a leg; a name that is no point of the body is refused."""
    text = (
        markersets.shipped_text("cast")
        + "[landmarks]\n"
        + "".join(
            f'"left {point}" = "{label}"\n'
            for point, label in (("lateral epicondyle", "QA"), ("medial epicondyle", "QB"), ("lateral malleolus", "QC"))
        )
    )
    named = markersets.parse_markerset(text)
    found = markersets.landmarks(["LLFC", "qa", "QB", "QC"], named.landmarks)
    assert found["left lateral epicondyle"] == "qa"
    assert found["left medial epicondyle"] == "QB"
    placed = markersets.match(named, recording([*named.markers(), "QA", "QB", "QC"]))
    assert placed.markerset.landmarks == named.landmarks
    with pytest.raises(markersets.MarkerSetError, match="no such point of the body; did you mean 'left heel'"):
        markersets.parse_markerset(text + '"left heal" = "QD"\n')

"""A marker set: the markers on each segment of the body, and the joints between the segments.

It is read from a TOML file, shipped or a user's own. A file with faults gives one message with all of them, those of
the schema and those between names.

Matched to a recording, a set gets the label of each marker; what is missing, and the joints that can be found, follow.
Laboratories write one label in many ways. It is compared without case, dots, underscores and spaces, and without a
prefix that most labels of a recording have. Points of the body are known by the labels of the common sets.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar, cast

from pydantic import Field, ValidationError, model_validator

from study.recordings.recording import Recording
from study.text import columns, did_you_mean, nearest
from study.toml import ConfigError, Fault, Frozen, Listed, as_tuple, report, toml_tables, toml_text

Name = Annotated[str, Field(pattern=r"^\S(.*\S)?$")]
Names = Listed[Name]


class Segment(Frozen):
    """A part of the body that is taken to be rigid, and its markers."""

    name: Name
    markers: Names
    """The markers on it; none if a recording lacks them all."""
    parent: Name | None = None
    """The segment to which its joint connects it; None for a root, of which a set may have several."""


class Joint(Frozen):
    """A joint between two segments."""

    name: Name
    parent: Name
    """Name of the segment in which the joint is fixed."""
    child: Name
    """Name of the segment that rotates about it."""
    markers: Names = ()
    """The child's markers that the joint is fitted to; all of them if none are named."""
    kind: Literal["ball", "hinge"] = "ball"
    across: Names = ()
    """Two points, lateral and medial, midway between which a hinge lies along its axis; none if no points show that."""


class MarkerSetParts(Frozen):
    """The parts of a marker set, each checked alone; `MarkerSet` also checks that they fit together."""

    name: Name
    about: str = ""
    """A description: who uses the set."""
    segments: Annotated[Listed[Segment], Field(min_length=1)]
    joints: Listed[Joint] = ()
    optional: Names = ()
    """Markers that a recording may lack without a message."""
    aliases: dict[str, Names] = Field(default_factory=dict)
    """Other labels of a marker in recordings."""
    landmarks: dict[str, Name] = Field(default_factory=dict)
    """Labels of points of the body, such as "left lateral epicondyle", that the labels themselves do not tell."""


class MarkerSet(MarkerSetParts):
    """Segments, parents before children, and the joints between them.

    Raises:
        pydantic.ValidationError: if its parts do not fit together.
    """

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if faults := list(misfits(self)):
            raise ValueError("; ".join(f"{fault.place()}: {fault.words}" for fault in faults))
        return self

    def segment(self, name: str) -> Segment:
        """The segment of this name (KeyError if there is none)."""
        return {segment.name: segment for segment in self.segments}[name]

    def markers(self) -> tuple[str, ...]:
        """All markers, segment by segment."""
        return tuple(marker for segment in self.segments for marker in segment.markers)

    def between(self) -> tuple[str, ...]:
        """Points on no segment between which hinges lie; no pose and no centre is fitted to them."""
        return tuple(dict.fromkeys(x for joint in self.joints for x in joint.across if x not in self.markers()))

    def markers_for(self, joint: Joint) -> tuple[str, ...]:
        """The child's markers that a joint is fitted to."""
        return joint.markers or self.segment(joint.child).markers


def misfits(parts: MarkerSetParts) -> Iterator[Fault]:
    """Faults between the parts of a marker set."""
    yield from _segments(parts)
    yield from _joints(parts)
    owner = {marker: segment.name for segment in parts.segments for marker in segment.markers}
    for marker in parts.optional:
        if marker not in owner:
            yield Fault(("optional",), f"marker {marker!r} is on no segment")
    known = [*owner, *(point for joint in parts.joints for point in joint.across)]
    meaning = dict.fromkeys(known, "")
    for marker, labels in parts.aliases.items():
        if marker not in known:
            yield Fault(("aliases", marker), f"marker {marker!r} is on no segment")
        for label in labels:
            if label in meaning:
                words = f"{label!r} is {f'an alias of {meaning[label]}' if meaning[label] else 'itself a marker'}"
                yield Fault(("aliases", marker), words)
            meaning[label] = marker
    for point in parts.landmarks:
        if point not in LANDMARKS.values():
            yield Fault(("landmarks", point), f"no such point of the body; {did_you_mean(point, LANDMARKS.values())}")


def _segments(parts: MarkerSetParts) -> Iterator[Fault]:
    """Faults of the segments: doubled names and markers, parents that do not come before their children."""
    owner: dict[str, str] = {}
    before: list[str] = []
    for segment in parts.segments:
        here = ("segments", segment.name)
        if segment.name in before:
            yield Fault(here, "two segments have this name")
        if segment.parent not in (None, *before):
            earlier = f"must be an earlier segment: {', '.join(before)}"
            words = earlier if before else "the first segment is a root and has no parent"
            yield Fault((*here, "parent"), words, segment.parent)
        for marker in segment.markers:
            if marker in owner:
                words = f"marker {marker!r} is on it twice" if owner[marker] == segment.name else ""
                yield Fault((*here, "markers"), words or f"marker {marker!r} is on {owner[marker]} already")
            owner[marker] = segment.name
        before.append(segment.name)


def _joints(parts: MarkerSetParts) -> Iterator[Fault]:
    """Faults of the joints: unknown segments, a child that is not its parent's, markers that are not the child's."""
    known = {segment.name: segment for segment in parts.segments}
    names: set[str] = set()
    children: dict[str, str] = {}
    for joint in parts.joints:
        here = ("joints", joint.name)
        if joint.name in names:
            yield Fault(here, "two joints have this name")
        names.add(joint.name)
        for key, value in (("parent", joint.parent), ("child", joint.child)):
            if value not in known:
                yield Fault((*here, key), f"no such segment; {did_you_mean(value, known)}", value)
        if joint.child not in known or joint.parent not in known:
            continue
        child = known[joint.child]
        if child.parent != joint.parent:
            words = f"the parent of segment {child.name} is {child.parent or 'none'}; a joint has both as its segments"
            yield Fault((*here, "parent"), words, joint.parent)
        if child.name in children:
            yield Fault((*here, "child"), f"joint {children[child.name]} has this child already", child.name)
        children[child.name] = joint.name
        if joint.across and (joint.kind != "hinge" or len(set(joint.across)) != 2):
            words = "must name two points, the lateral and the medial one, and is for a hinge alone"
            yield Fault((*here, "across"), words, list(joint.across))
        for marker in joint.markers:
            if marker not in child.markers:
                on = ", ".join(child.markers) or "none"
                yield Fault((*here, "markers"), f"{marker!r} is not on {child.name}, which has {on}")


_Part = TypeVar("_Part", Segment, Joint)


def name_faults(
    tables: Mapping[str, Sequence[Mapping[str, object]]], optional: object, faults: Sequence[Fault]
) -> list[Fault]:
    """Faults between the parts of a document that can be read; those that may follow from the others are left out.

    Args:
        tables: those of the segments and those of the joints, each with its name.
        optional: the entry of this name.
        faults: of the schema, found already.
    """
    if any(len(fault.path) < 3 and fault.path[0] in tables for fault in faults):
        return []  # a whole table, whose names are not known
    segments = tuple(_loosely(Segment, table, {"markers": ()}) for table in tables["segments"])
    joints = tuple(_loosely(Joint, table, {"parent": "", "child": ""}) for table in tables["joints"])
    words = tuple(word for word in optional if isinstance(word, str)) if isinstance(optional, list) else ()
    parts = MarkerSetParts.model_construct(name="", segments=segments, joints=joints, optional=words, aliases={})
    seen = {fault.path for fault in faults}
    # without all markers nobody knows which of them are on no segment
    vague = any(path[0] == "segments" and path[2:3] == ("markers",) for path in seen)
    further = [fault for fault in misfits(parts) if fault.path not in seen]
    return [fault for fault in further if not (vague and (fault.path[0] == "optional" or fault.path[-1] == "markers"))]


def _loosely(model: type[_Part], table: Mapping[str, object], blank: Mapping[str, object]) -> _Part:
    """A part with the entries that are right, and blanks for those that are not."""
    try:
        return model.model_validate(table)
    except ValidationError as error:
        wrong = {entry["loc"][0] for entry in error.errors()}
    right = {key: as_tuple(value) for key, value in table.items() if key in model.model_fields and key not in wrong}
    return model.model_construct(**{**blank, **right})  # type: ignore[arg-type]


FOLDER = Path(__file__).parent
"""The folder of the shipped files: this room of the package."""
_TABLES: dict[str, type[Segment | Joint]] = {"segments": Segment, "joints": Joint}


class MarkerSetError(ConfigError):
    """A marker set cannot be used; the message gives every reason."""


def shipped() -> list[str]:
    """Names of the shipped marker sets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def shipped_text(name: str) -> str:
    """The file of a shipped marker set, as a start for a user's own.

    Raises:
        MarkerSetError: if no shipped marker set has this name.
    """
    return toml_text(_shipped_path(name, "`study markersets` describes them"))


def described() -> list[str]:
    """A line for each shipped marker set: name, numbers of markers and joints, and what it is."""
    sets = [load_markerset(name) for name in shipped()]
    return list(columns([s.name, f"{len(s.markers())} markers", f"{len(s.joints)} joints", s.about] for s in sets))


def load_markerset(name: str | Path) -> MarkerSet:
    """Read a marker set.

    Args:
        name: of a shipped one, or the path of a file.

    Raises:
        MarkerSetError: if there is no such file, or with every fault in it.
    """
    path = Path(name)
    if path.suffix != ".toml" and len(path.parts) == 1:
        path = _shipped_path(str(name), "or give the path of a .toml file")
    return parse_markerset(toml_text(path, MarkerSetError), str(path))


def _shipped_path(name: str, remedy: str) -> Path:
    if name not in shipped():
        raise MarkerSetError(f"no marker set {name!r}: {did_you_mean(name, shipped())}; {remedy}")
    return FOLDER / f"{name}.toml"


def parse_markerset(text: str, source: str = "marker set") -> MarkerSet:
    """Read a marker set from TOML, with a table ``[segments.NAME]`` for each segment and ``[joints.NAME]`` per joint.

    Args:
        text: the document.
        source: what to call it in messages.

    Raises:
        MarkerSetError: with every fault, its line, place, value and what is allowed.
    """
    raw = toml_tables(text, source, MarkerSetError)
    faults: list[Fault] = []
    document: dict[str, object] = dict(raw)
    keys: dict[tuple[str, ...], list[str]] = {(): list(MarkerSetParts.model_fields)}
    rows: dict[str, list[dict[str, object]]] = {}
    for key, model in _TABLES.items():
        tables = raw.get(key, {})
        if not isinstance(tables, dict):
            faults.append(Fault((key,), f"must be tables such as [{key}.NAME]", tables))
            tables = {}
        # in the file's order, each with its name as an entry, which may say another
        rows[key] = [{"name": n, **table} if isinstance(table, dict) else table for n, table in tables.items()]
        document |= {key: rows[key]} if key in raw else {}
        keys[key,] = [field for field in model.model_fields if field != "name"]
    try:
        parts = MarkerSetParts.model_validate(document)
    except ValidationError as error:
        for fault in report(error, keys):
            path = list(fault.path)
            if len(path) > 1 and isinstance(path[1], int) and path[0] in rows:  # a name in place of its number
                row = rows[str(path[0])][path[1]]
                path[1] = cast("str | int", row["name"]) if isinstance(row, dict) else path[1]
            faults.append(Fault(tuple(path), fault.words, fault.value))
        faults += name_faults(rows, raw.get("optional"), faults)
    else:
        faults += misfits(parts)
        words = "must name at least one marker"
        faults += [Fault(("segments", s.name, "markers"), words, []) for s in parts.segments if not s.markers]
    if faults:
        raise MarkerSetError.listing(source, text, faults)
    return MarkerSet.model_validate(document)


_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_STEMS = {
    "asis": "asi asis ias",
    "psis": "psi psis ips",
    "lateral epicondyle": "kne knee lfc fle lepi lek le kneelat latknee kneelateral lkne lknee",
    "medial epicondyle": "mkne mknee knm mfc fme mepi mek me kneemed medknee kneemedial",
    "lateral malleolus": "ank ankle lmal fal lm anklelat latankle anklelateral latmal",
    "medial malleolus": "mankle mank med mma mmal tam mm anklemed medankle anklemedial medmal man",
    "heel": "hee heel cal calc fcc ca",
    "first metatarsal": "mt1 fm1 fmh 1mt",
    "fifth metatarsal": "mt5 fm5 vmh d5m 5meta 5mt",
    "toe": "toe mt2 fm2 smh 2mt",
    "thigh marker": "thi thigh",
    "shank marker": "tib shn shin sha shank",
    "hip centre": "hjc",
}
"""The points of one side of the body, and their labels in common marker sets, behind the letter of a side."""
_MIDDLE = {"sacrum": "sacr sacrum vsacral vsac"}
LANDMARKS = {
    letter + label: f"{side} {point}"
    for letter, side in (("l", "left"), ("r", "right"))
    for point, labels in _STEMS.items()
    for label in labels.split()
} | {label: point for point, labels in _MIDDLE.items() for label in labels.split()}
"""Points of the body by the `plain` forms of their labels."""


_BONES = "pel|trx|hed|[lr](pel|fe|ti|fo|to|hu|ra|hn|cl)"  # of Plug-in Gait, each with the points o, a, l and p
_QUANTITIES = "angles?|forces?|moments?|powers?|grf|centreofmass|centerofmass|com|progressangles"
_OUTPUT = re.compile(
    rf"^({_BONES})[oalp]$|({_QUANTITIES})(floor)?$|^[lr]?[hkaesw]jc|(joint|hip|knee|ankle)cent(re|er)$"
)


def plain(label: str) -> str:
    """A label as it is compared: small letters and digits alone."""
    return re.sub(r"[\W_]+", "", label).casefold()


def spellings(labels: Sequence[str]) -> dict[str, str]:
    """The labels by their `plain` forms, with and without the prefix that more than half of them have.

    Of two labels with one form the first counts, and a whole label goes before one without its prefix. A side is no
    prefix.
    """
    heads = [(re.match(r"[^\W_]+[\W_]+", label) or [""])[0] for label in labels]
    head, count = Counter(heads).most_common(1)[0] if heads else ("", 0)
    result: dict[str, str] = {}
    for label in labels:
        result.setdefault(plain(label), label)
    if head and 2 * count > len(labels) and plain(head) not in _SIDES:
        for label in labels:
            result.setdefault(plain(label.removeprefix(head)), label)
    return result


def landmarks(labels: Sequence[str], named: Mapping[str, str] | None = None) -> dict[str, str]:
    """The points of the body that labels stand for: the label of each, such as LASI for "left asis".

    A marker set may name labels of its own (``named``), which go first.
    Of two labels of one point the one whose form comes first in the table counts. A label may end in ``_study``, as
    OpenCap's do, and that of a hip's centre in the name of a method, as in ``LHJC_reg``.
    """
    spelt = {form.removesuffix("study"): label for form, label in reversed(spellings(labels).items())}
    spelt |= {form[:4]: label for form, label in spelt.items() if re.match("[lr]hjc.", form) and form[:4] not in spelt}
    found = {point: spelt[form] for form, point in reversed(LANDMARKS.items()) if form in spelt}
    return found | {point: spelt[form] for point, x in (named or {}).items() if (form := plain(x)) in spelt}


_OXFORD = re.compile(r"[lr](fof|hdf)[0-3]"), re.compile(r"[lr]tib[1-3]$")
"""Points of the Oxford foot model alone, and those of it that have the names of a cluster's markers."""


def measured(labels: Sequence[str]) -> list[str]:
    """The labels without points of the Oxford foot model that are called as a cluster's markers, LTIB1-LTIB3."""
    model, points = _OXFORD
    oxford = any(model.match(plain(label)) for label in labels)
    return [label for label in labels if not (oxford and points.match(plain(label)))]


def is_output(label: str) -> bool:
    """True for the label of what a program computed: angles, forces, centres of joints and of mass, axes of bones."""
    return bool(_OUTPUT.search(plain(label)))


def opposite(one: str, other: str) -> bool:
    """True if two labels begin with the letters of different sides."""
    first, second = (_SIDES.get(plain(label)[:1]) for label in (one, other))
    return None not in (first, second) and first != second


def side(name: str) -> str:
    """Side of the body that a point's name shows: "left", "right", or "" if it shows none."""
    words = name.lower().replace("-", "_").replace(" ", "_").split("_")
    return next((word for word in ("left", "right") if word in words), "")


def mirrored(name: str) -> str:
    """A joint's name on the other side of the body, with its capitals; the same if it tells no side."""
    own = side(name)

    def other(word: re.Match[str]) -> str:
        turned = "right" if own == "left" else "left"
        return turned.upper() if word[0].isupper() else turned.capitalize() if word[0][0].isupper() else turned

    return re.sub(rf"(?<![^_ -])({own})(?![^_ -])", other, name, flags=re.IGNORECASE) if own else name


def side_of(labels: Iterable[str]) -> str:
    """The side, left or right, on which all labels begin; "" if they do not agree, or there are none."""
    sides = {_SIDES.get(plain(label)[:1], "") for label in labels}
    return sides.pop() if len(sides) == 1 else ""


_NUMBERED = re.compile(r"(.*[^\W\d_]{2}[\W_]?)(\d+)$")
"""A label of two letters or more and a number."""


def clusters(labels: Sequence[str]) -> list[str]:
    """Groups of three or more labels that differ by a number at the end alone, such as LTH1-LTH3."""
    groups: dict[str, list[tuple[int, str]]] = {}
    for label in labels:
        if (numbered := _NUMBERED.match(label)) is not None:
            groups.setdefault(numbered[1], []).append((int(numbered[2]), label))
    return [f"{min(group)[1]}-{max(group)[1]}" for group in groups.values() if len(group) > 2]


_LISTED, _FEW = 24, 6
"""Most labels that a line lists: of markers, and of points that other programs computed."""
_ENOUGH = 4
"""Joints that show that a recording is of a part of a set's body."""


@dataclass(frozen=True, eq=False)
class Match:
    """A recording and a marker set on it."""

    whole: MarkerSet
    """The whole marker set."""
    source: Recording
    """The whole recording."""
    labels: dict[str, str]
    """The recording's label of each marker that it has."""
    lacking: dict[str, tuple[str, ...]]
    """The missing markers of each segment that lacks any; optional ones do not count."""
    lost: dict[str, str]
    """The reason for each joint that cannot be found."""
    remarks: tuple[str, ...] = ()
    """Sentences about sets that fit better."""

    @cached_property
    def markerset(self) -> MarkerSet:
        """The set with the markers that the recording has and the joints that can be found; all segments remain."""
        whole = self.whole

        def there(markers: Sequence[str]) -> tuple[str, ...]:
            return tuple(marker for marker in markers if marker in self.labels)

        joints = []
        for joint in whole.joints:
            if joint.name not in self.lost:
                across = joint.across if there(joint.across) == joint.across else ()
                joints.append(joint.model_copy(update={"markers": there(joint.markers), "across": across}))
        segments = [Segment(name=s.name, markers=there(s.markers), parent=s.parent) for s in whole.segments]
        known = {point for part in segments for point in part.markers}
        known |= {point for joint in joints for point in joint.across}
        aliases = {marker: names for marker, names in whole.aliases.items() if marker in known}
        parts = {"segments": tuple(segments), "joints": tuple(joints), "aliases": aliases}
        parts |= {"landmarks": whole.landmarks}
        return MarkerSet.model_validate({"name": whole.name, "about": whole.about} | parts)

    @cached_property
    def recording(self) -> Recording:
        """The recording with the markers of the set alone, under their names and in the order of the set."""
        chosen = self.source.select(list(self.labels.values()))
        return replace(chosen, markers=tuple(self.labels))

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints that can be found."""
        return self.markerset.joints

    @property
    def extra(self) -> tuple[str, ...]:
        """Labels of the recording that are not markers of the set."""
        used = set(self.labels.values())
        return tuple(marker for marker in self.source.markers if marker not in used)

    def lines(self, calibrated: bool = False) -> list[str]:
        """The match in lines of text; ``calibrated`` if the marker set is that of a calibration, and was not chosen."""
        name, what = self.whole.name + " of the calibration" * calibrated, "calibration" if calibrated else "marker set"
        belong = f"{len(self.labels)} of the recording's {len(self.source.markers)} markers belong to it"
        lines = [f"marker set {name}: {belong}, {len(self.joints)} of {len(self.whole.joints)} joints can be found"]
        renamed = [f"{label} is {marker}" for marker, label in self.labels.items() if label != marker]
        lines += [f"labels: {', '.join(renamed)}"] * bool(renamed)
        for segment, gone in self.lacking.items():
            missed = [self._missed(marker) for marker in gone]  # joints tell of segments without any marker
            if self.labels.keys() & self.whole.segment(segment).markers or missed != list(gone):
                lines.append(f"segment {segment} lacks {', '.join(missed)}")
        lines += [f"joint {joint} cannot be found: {why}" for joint, why in self.lost.items()]
        outputs = [label for label in self.extra if is_output(label)]
        known = landmarks(self.source.markers, self.whole.landmarks)
        points = [label for label in known.values() if label in self.extra]
        others = [label for label in self.extra if label not in (*outputs, *points)]
        lines += [f"not in the {what}, but points of the body: {_listed(points, _LISTED)}"] * bool(points)
        lines += [f"not in the {what}: {_listed(others, _LISTED)}"] * bool(others)
        lines += [f"of another program's model, not markers: {_listed(outputs, _FEW)}"] * bool(outputs)
        unused = [] if calibrated else clusters(self.extra)
        lines += [f"clusters that it does not use: {', '.join(unused)}; a set of your own can"] * bool(unused)
        return [*lines, *self.remarks]

    def data(self) -> dict[str, object]:
        """The match for other programs.

        Returns:
            ``name``; ``labels``, the recording's label of each marker; ``lacking`` markers by segment; ``joints`` that
            can be found; ``lost`` joints, each with the reason; ``extra`` labels.
        """
        data: dict[str, object] = {"name": self.whole.name, "labels": self.labels, "lacking": self.lacking}
        return data | {"joints": [joint.name for joint in self.joints], "lost": self.lost, "extra": self.extra}

    def _missed(self, marker: str) -> str:
        """A missing marker, with the label of the recording that it may have."""
        label = nearest(marker, [label for label in self.extra if not opposite(marker, label)])
        return marker if label is None else f"{marker} (did you mean {label}?)"


def _listed(labels: Sequence[str], most: int) -> str:
    """Labels with commas between them, as many as there is room for, and the number of the rest."""
    rest = len(labels) - most
    return ", ".join(labels) if rest < 2 else f"{', '.join(labels[:most])} and {rest} more"


def match(markerset: MarkerSet, recording: Recording) -> Match:
    """Match a marker set to a recording.

    A marker without any sample counts as missing. The parent of a joint needs three markers for its pose, or two if its
    own joint to its parent is found, which is then the third point. The child needs one marker.
    """
    visible = [label for label, share in zip(recording.markers, recording.missing(), strict=True) if share < 1]
    visible = measured(visible)
    spelt = spellings(visible)
    labels: dict[str, str] = {}
    for m in (*markerset.markers(), *markerset.between()):
        names = (m, *markerset.aliases.get(m, ()))
        label = m if m in visible else next((spelt[plain(name)] for name in names if plain(name) in spelt), None)
        if label is not None and label not in labels.values():
            labels[m] = label
    given = {*labels, *markerset.optional}
    lacks = {s.name: tuple(marker for marker in s.markers if marker not in given) for s in markerset.segments}
    lacking = {name: markers for name, markers in lacks.items() if markers}
    return Match(markerset, recording, labels, lacking, _lost(markerset, set(labels)))


BY_NAME = "by-name"
"""Name of the marker set that is made of a recording's labels: side, segment and number."""
_PARTS = {"thigh": "thigh|thi|th|femur|fem|upleg", "shank": "shank|shk|sha|sh|sk|tibia|tib|tb|ti|leg|calf"}
_PARTS |= {"foot": "foot|ft", "pelvis": "pelvis|pelv|pel"}
_WHERE = r"ant|post|front|rear|back|upper|lower|up|lo|prox|dist|sup|inf|lat|med|ap|ad|[a-h]|\d{1,2}"
_CLUSTERED = re.compile(
    rf"(?P<side>left|right|[lr])?(?P<before>{_WHERE})?(?P<part>{'|'.join(_PARTS.values())})"
    rf"(?P<where>{_WHERE})?(?P<after>left|right|[lr])?"
)
_OF_PARTS = {
    "pelvis": ("asis", "psis"),
    "thigh": ("thigh marker", "lateral epicondyle"),
    "shank": ("shank marker", "lateral malleolus"),
    "foot": ("heel", "first metatarsal", "fifth metatarsal", "toe"),
}
"""Points of the body on each part of a leg, for parts with fewer than three markers of a cluster."""


def set_by_name(labels: Sequence[str]) -> MarkerSet | None:
    """Make a marker set of pelvis and legs from labels such as R_THIGH_1 or R.Ant.Fem: side, segment, number or place.

    A thigh or shank with fewer than three such markers gets the lateral point at its end. Epicondyles and malleoli
    beside clusters are points between which hinges lie.

    Returns:
        The set; None if the labels show no pelvis and no thigh on it.
    """
    groups: dict[str, list[str]] = {}
    for form, label in spellings(labels).items():
        part = _CLUSTERED.fullmatch(form)
        if part is None or label in (marker for group in groups.values() for marker in group):
            continue
        kind = next(name for name, words in _PARTS.items() if re.fullmatch(words, part["part"]))
        side = _SIDES.get(part["side"] or part["after"] or "", "")
        if kind == "pelvis" or side:
            groups.setdefault(kind if kind == "pelvis" else f"{side}_{kind}", []).append(label)
    points = landmarks(labels)

    def of(name: str, kind: str, ends: Sequence[str]) -> list[str]:
        whose = (name,) if kind != "pelvis" else ("left", "right")
        return [points[f"{side} {end}"] for end in ends for side in whose if f"{side} {end}" in points]

    pelvis = [*of("", "pelvis", _OF_PARTS["pelvis"]), *([points["sacrum"]] if "sacrum" in points else [])]
    segments = [Segment(name="pelvis", markers=tuple(dict.fromkeys([*pelvis, *groups.get("pelvis", [])])))]
    joints: list[Joint] = []
    for side in ("left", "right"):
        above = "pelvis"
        for kind, joint in (("thigh", "hip"), ("shank", "knee"), ("foot", "ankle")):
            own = groups.get(f"{side}_{kind}", [])
            own += of(side, kind, _OF_PARTS[kind]) if len(own) < 3 or kind == "foot" else []
            name, ends = f"{side}_{kind}", tuple[str, ...]()
            if not own:
                break
            if kind == "shank" and {f"{side} lateral epicondyle", f"{side} medial epicondyle"} <= points.keys():
                ends = points[f"{side} lateral epicondyle"], points[f"{side} medial epicondyle"]
            segments.append(Segment(name=name, markers=tuple(dict.fromkeys(own)), parent=above))
            turns: Literal["ball", "hinge"] = "hinge" if kind == "shank" else "ball"
            joints.append(Joint(name=f"{side}_{joint}", parent=above, child=name, kind=turns, across=ends))
            above = name
    if len(segments[0].markers) < 3 or not joints:
        return None
    about = "made of the labels: pelvis and legs, by side, segment and number"
    return MarkerSet(name=BY_NAME, about=about, segments=tuple(segments), joints=tuple(joints))


def choose(recording: Recording, candidates: Sequence[str] | None = None) -> Match:
    """Choose the marker set that explains a recording best: the most joints, then the most labels, then fewest aliases.

    Beside the shipped sets stands one that is made of the labels (`set_by_name`).

    A set is chosen only if most of its joints can be found, or most of those whose segments the recording shows (at
    least four of these, or with most of the recording's markers), or if all its markers on both sides of a joint are
    there and it leaves no cluster of the recording unused.

    Args:
        recording: a recording.
        candidates: names or paths of marker sets; the shipped ones if None.

    Raises:
        MarkerSetError: if none of them fits.
    """
    names = shipped() if candidates is None else list(candidates)
    sets = [load_markerset(name) for name in names]
    if candidates is None and (made := set_by_name(measured(recording.markers))) is not None:
        sets.append(made)
    matches = sorted((match(one, recording) for one in sets), key=_quality, reverse=True)
    if fitting := [placed for placed in matches if _fits(placed)]:
        return fitting[0]
    labels = ", ".join(recording.markers[:8]) + (", ..." if len(recording.markers) > 8 else "")
    if matches and matches[0].joints:
        best = matches[0]
        unused, name = clusters(best.extra), best.whole.name
        words = f"with {name}, the nearest, {_share(best)} can be found; --markerset {name} uses it nevertheless"
        words += f"; unused clusters are {', '.join(unused)}" if unused else ""
    else:
        tried = ", ".join(sorted(placed.whole.name for placed in matches)) or "none"
        words = f"with none of {tried} can a joint be found among the labels {labels}"
    remedy = "write your own: `study markersets cmu41 > mine.toml` gives a start, --markerset mine.toml uses it"
    raise MarkerSetError(f"{recording.name}: no marker set fits: {words}; {remedy}")


def with_better(placed: Match) -> Match:
    """The match with a remark if a shipped set finds more joints than the one that a user named."""
    others = [match(load_markerset(name), placed.source) for name in shipped()]
    better = [other for other in others if len(other.joints) > len(placed.joints) and _fits(other)]
    if not better:
        return placed
    best = max(better, key=_quality)
    return replace(placed, remarks=(f"marker set {best.whole.name} fits better: {_share(best)} can be found with it",))


def place_markerset(recording: Recording, markerset: str | None = None) -> Match:
    """Place a marker set on a recording: the named one, or the shipped one that fits best.

    Raises:
        MarkerSetError: if the marker set cannot be read, or no joint can be found with it.
    """
    if markerset is None:
        return choose(recording)
    made = set_by_name(measured(recording.markers)) if markerset == BY_NAME else None
    placed = match(made or load_markerset(markerset), recording)
    if not placed.joints:
        reasons = "; ".join(f"{joint}: {reason}" for joint, reason in list(placed.lost.items())[:3])
        words = f"no joint of marker set {markerset} can be found ({reasons}, ...)"
        remedy = "leave --markerset out to choose the shipped one that fits best"
        raise MarkerSetError(f"{recording.name}: {words}; {remedy}")
    return with_better(placed)


def _fits(placed: Match) -> bool:
    """True if a set fits a recording well enough to be chosen without being named."""
    count = len(placed.joints)
    if 2 * count > len(placed.whole.joints):
        return True
    shown = [j for j in placed.whole.joints if any(m in placed.labels for m in placed.whole.segment(j.child).markers)]
    most = 2 * len(placed.labels) > len(placed.source.markers)
    if 2 * count > len(shown) and (count >= _ENOUGH or (count > 1 and most)):
        return True
    complete = [j for j in placed.joints if j.parent not in placed.lacking and j.child not in placed.lacking]
    return bool(complete) and not clusters(placed.extra)


def _share(placed: Match) -> str:
    return f"{len(placed.joints)} of {len(placed.whole.joints)} joints"


def _quality(placed: Match) -> tuple[int, int, int, int]:
    """Order by how well a set fits: joints, labels that it explains, those by their own names, gaps in its segments."""
    own = sum(plain(label).endswith(plain(marker)) for marker, label in placed.labels.items())
    shown = (s.name for s in placed.whole.segments if any(marker in placed.labels for marker in s.markers))
    gaps = sum(len(placed.lacking.get(name, ())) for name in shown)
    return len(placed.joints), len(placed.labels), own, -gaps


def _lost(markerset: MarkerSet, seen: set[str]) -> dict[str, str]:
    """Joints that cannot be found, each with the reason."""
    joint_above = {joint.child: joint for joint in markerset.joints}
    order = {segment.name: number for number, segment in enumerate(markerset.segments)}
    lost: dict[str, str] = {}
    for joint in sorted(markerset.joints, key=lambda joint: order[joint.child]):
        parent = markerset.segment(joint.parent)
        has = [marker for marker in parent.markers if marker in seen]
        above = joint_above.get(parent.name)
        helped = above is not None and above.name not in lost
        if not any(marker in seen for marker in markerset.markers_for(joint)):
            lost[joint.name] = f"{joint.child} has none of {', '.join(markerset.markers_for(joint))}"
        elif len(has) + helped < 3:
            words = f"{parent.name} has {len(has)} marker{'s' * (len(has) != 1)} ({', '.join(has) or 'none'})"
            lost[joint.name] = f"{words}; its pose needs 3" + (f", or 2 and {above.name}" if above else "")
    return {joint.name: lost[joint.name] for joint in markerset.joints if joint.name in lost}

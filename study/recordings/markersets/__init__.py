"""A marker set: the markers on each segment of the body, and the joints between the segments.

It is read from a TOML file, shipped or a user's own. A file with faults gives one message with all of them, those of
the schema and those between names.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

from pydantic import Field, ValidationError, model_validator

from study.text import columns, did_you_mean
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

    def landmarks(self) -> tuple[str, ...]:
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


def _segments(parts: MarkerSetParts) -> Iterator[Fault]:
    """Faults of the segments: doubled names and markers, parents that do not come before their children."""
    owner: dict[str, str] = {}
    before: list[str] = []
    for number, segment in enumerate(parts.segments):
        here = ("segments", segment.name)
        if segment.name in before:
            yield Fault(here, "two segments have this name")
        if number == 0 and segment.parent is not None:
            yield Fault((*here, "parent"), "the first segment is a root and has no parent", segment.parent)
        elif segment.parent is not None and segment.parent not in before:
            words = f"must be an earlier segment: {', '.join(before)}"
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


def name_faults(document: Mapping[str, object], faults: Sequence[Fault]) -> list[Fault]:
    """Faults between the parts of a document that can be read; those that may follow from the others are left out.

    Args:
        document: the sections as lists of tables, each with its name.
        faults: of the schema, found already.
    """
    unreadable = {fault.path[0] for fault in faults if len(fault.path) < 3 and fault.path[0] in ("segments", "joints")}
    if unreadable:  # a whole table, whose names are not known
        return []
    parts = MarkerSetParts.model_construct(
        name="",
        segments=tuple(_loosely(Segment, table, {"markers": ()}) for table in _tables(document, "segments")),
        joints=tuple(_loosely(Joint, table, {"parent": "", "child": ""}) for table in _tables(document, "joints")),
        optional=_names(document.get("optional")),
        aliases={},
    )
    if not parts.segments:
        return []
    seen = {fault.path for fault in faults}
    # without all markers nobody knows which of them are on no segment
    vague = any(path[0] == "segments" and path[2:3] == ("markers",) for path in seen)
    further = [fault for fault in misfits(parts) if fault.path not in seen]
    return [fault for fault in further if not (vague and (fault.path[0] == "optional" or fault.path[-1] == "markers"))]


def _loosely(model: type[_Part], table: Mapping[str, object], blank: Mapping[str, object]) -> _Part:
    """A part with the entries that are right, and blanks for those that are not."""
    wrong: set[object] = set()
    try:
        return model.model_validate(table)
    except ValidationError as error:
        wrong = {entry["loc"][0] for entry in error.errors() if entry["loc"]}
    right = {key: value for key, value in table.items() if key in model.model_fields and key not in wrong}
    right = {key: as_tuple(value) for key, value in right.items()}
    return model.model_construct(**{**blank, **right})  # type: ignore[arg-type]


def _tables(document: Mapping[str, object], section: str) -> list[Mapping[str, object]]:
    tables = document.get(section)
    return [table for table in tables if isinstance(table, Mapping)] if isinstance(tables, list) else []


def _names(value: object) -> tuple[str, ...]:
    return tuple(word for word in value if isinstance(word, str)) if isinstance(value, list) else ()


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
    sections = {key: _with_names(key, raw[key], faults) for key in _TABLES if key in raw}
    document: dict[str, object] = raw | sections
    try:
        parts = MarkerSetParts.model_validate(document)
    except ValidationError as error:
        faults += [_by_name(fault, sections) for fault in report(error, _known_keys(sections))]
        faults += name_faults(document, faults)
    else:
        faults += misfits(parts)
        faults += [
            Fault(("segments", segment.name, "markers"), "must name at least one marker", [])
            for segment in parts.segments
            if not segment.markers
        ]
    if faults:
        raise MarkerSetError.listing(source, text, faults)
    return MarkerSet.model_validate(document)


def _with_names(key: str, tables: object, faults: list[Fault]) -> list[object]:
    """The tables of a section in the file's order, each with its name as an entry."""
    if not isinstance(tables, dict):
        faults.append(Fault((key,), f"must be tables such as [{key}.NAME]", tables))
        return []
    return [{"name": name, **table} if isinstance(table, dict) else table for name, table in tables.items()]


def _known_keys(sections: Mapping[str, list[object]]) -> dict[tuple[str, ...], list[str]]:
    """The keys that each table of a document may have."""
    keys: dict[tuple[str, ...], list[str]] = {(): list(MarkerSetParts.model_fields)}
    for section in sections:
        keys[section,] = [key for key in _TABLES[section].model_fields if key != "name"]
    return keys


def _by_name(fault: Fault, sections: Mapping[str, list[object]]) -> Fault:
    """The same fault, with the name of a segment or joint in place of its number."""
    path = list(fault.path)
    if len(path) > 1 and path[0] in _TABLES and isinstance(path[1], int):
        table = sections[str(path[0])][path[1]]
        path[1] = table["name"] if isinstance(table, dict) else path[1]
    return Fault(tuple(path), fault.words, fault.value)

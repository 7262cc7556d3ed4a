"""A marker set: the markers on each segment of the body, and the joints between the segments."""

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from study.experiment.config_faults import Fault
from study.experiment.toml_model import Frozen, Listed
from study.text.nearest import did_you_mean

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
        if found := list(misfits(self)):
            raise ValueError("; ".join(f"{fault.place()}: {fault.words}" for fault in found))
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

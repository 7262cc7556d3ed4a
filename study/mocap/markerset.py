"""A marker set: which markers sit on which segment of the body, and between which segments the joints are."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from study.experiment.laws import Frozen

Name = Annotated[str, Field(min_length=1)]


class MarkerSetError(Exception):
    """A marker set that cannot be used; the message says why, all of it."""


def _tuples(value: object) -> object:
    """Lists as TOML has them, to tuples, which a frozen config holds."""
    return tuple(value) if isinstance(value, list) else value


Names = Annotated[tuple[Name, ...], BeforeValidator(_tuples)]


class Segment(Frozen):
    """A part of the body taken to be rigid."""

    name: Name
    markers: Names
    """The markers fixed to it."""
    parent: str | None = None
    """The segment it hangs on; None for the root."""


class Joint(Frozen):
    """Where two segments meet."""

    name: Name
    parent: Name
    """Name of the segment in whose frame the joint is fixed."""
    child: Name
    """Name of the segment that turns about it."""
    markers: Names = ()
    """The child's markers that see the joint; all of the child's if none are named."""
    kind: Literal["ball", "hinge"] = "ball"


class MarkerSet(Frozen):
    """Segments, parents before children, and the joints between them."""

    name: Name
    segments: Annotated[tuple[Segment, ...], BeforeValidator(_tuples), Field(min_length=1)]
    joints: Annotated[tuple[Joint, ...], BeforeValidator(_tuples)] = ()

    def segment(self, name: str) -> Segment:
        """The segment of this name (KeyError if there is none)."""
        return {segment.name: segment for segment in self.segments}[name]

    def markers(self) -> tuple[str, ...]:
        """All markers, segment by segment."""
        return tuple(marker for segment in self.segments for marker in segment.markers)

    def seeing(self, joint: Joint) -> tuple[str, ...]:
        """The child's markers that are used for a joint."""
        return joint.markers or self.segment(joint.child).markers

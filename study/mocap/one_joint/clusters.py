"""Two clusters of markers as a marker set of one joint: the labels that a user gave, looked up in a recording."""

from collections.abc import Sequence
from dataclasses import dataclass

from study.mocap.io.recording import Recording, RecordingError
from study.mocap.markersets.marker_set import Joint, MarkerSet, Segment
from study.text.nearest import did_you_mean

PARENT, CHILD, JOINT = "parent", "child", "joint"
"""Names of the two segments and of the joint."""


@dataclass(frozen=True)
class Clusters:
    """The markers on the two segments of a joint, by their labels in the recording."""

    parent: tuple[str, ...]
    """At least three: their pose gives the axes of the answer."""
    child: tuple[str, ...]
    """At least one; with three or more the child has a pose, and the joint a second opinion."""
    across: tuple[str, ...] = ()
    """The lateral and the medial point, midway between which a hinge lies along its axis, or none."""

    @property
    def markers(self) -> tuple[str, ...]:
        """All markers, the parent's first."""
        return self.parent + self.child

    @property
    def every(self) -> tuple[str, ...]:
        """All markers, and the points for the axis."""
        return tuple(dict.fromkeys(self.markers + self.across))

    def markerset(self, hinge: bool) -> MarkerSet:
        """The marker set with these two segments and one joint between them."""
        return MarkerSet(
            name="one joint",
            segments=(
                Segment(name=PARENT, markers=self.parent),
                Segment(name=CHILD, markers=self.child, parent=PARENT),
            ),
            joints=(
                Joint(name=JOINT, parent=PARENT, child=CHILD, kind="hinge" if hinge else "ball", across=self.across),
            ),
        )


def find_clusters(recording: Recording, parent: str, child: str, across: str = "") -> Clusters:
    """Look up the markers of two segments in a recording.

    Args:
        recording: that has them.
        parent: labels with commas between them; a subject's prefix and the case of letters do not matter.
        child: likewise.
        across: likewise, the lateral and the medial point of a hinge; empty if there are none.

    Raises:
        RecordingError: one line: unknown labels, with the nearest ones of the recording; markers without any sample; a
            marker that is named twice; fewer than three markers of the parent, none of the child, or one or more than
            two for the axis.
    """
    given = {f"--{PARENT}": _split(parent), f"--{CHILD}": _split(child), "--across": _split(across)}
    known = {label.casefold(): label for label in reversed(recording.markers)}
    found: dict[str, list[str]] = {}
    unknown: dict[str, list[str]] = {}
    for option, names in given.items():
        for name in names:
            label = _label(name, recording.markers, known)
            if label is None:
                unknown.setdefault(option, []).append(name)
            else:
                found.setdefault(option, []).append(label)
    if unknown:
        listed = "; ".join(f"{option} {', '.join(map(repr, names))}" for option, names in unknown.items())
        wrong = [name for names in unknown.values() for name in names]
        remedy = did_you_mean(wrong, recording.markers)
        raise RecordingError(f"{recording.name}: no marker of this name: {listed}; {remedy}")
    clusters = Clusters(*(tuple(found.get(option, ())) for option in given))
    _require_usable(recording, clusters)
    return clusters


def _split(names: str) -> list[str]:
    return [name.strip() for name in names.split(",") if name.strip()]


def _label(name: str, markers: Sequence[str], small: dict[str, str]) -> str | None:
    """The recording's label for a name as a user gives it; None if there is none."""
    for each in (name, name.rpartition(":")[2].strip()):
        if each in markers:
            return each
        if each.casefold() in small:
            return small[each.casefold()]
    return None


def _require_usable(recording: Recording, clusters: Clusters) -> None:
    """Refuse clusters that cannot fix a joint whatever the motion."""
    if twice := [label for label in dict.fromkeys(clusters.markers) if clusters.markers.count(label) > 1]:
        raise RecordingError(
            f"{recording.name}: {', '.join(twice)} is named twice; name each marker once, on the segment that it is on"
        )
    if clusters.across and len(set(clusters.across)) != 2:
        raise RecordingError(f"{recording.name}: --across names {len(set(clusters.across))} points; it takes two")
    never = [label for label in clusters.every if recording.missing()[recording.row(label)] == 1.0]
    if never:
        raise RecordingError(
            f"{recording.name}: {', '.join(never)} has no sample in any frame; name other markers of the segment"
        )
    if not clusters.child:
        raise RecordingError(f"{recording.name}: --child names no marker; one is enough, three give a second opinion")
    if len(clusters.parent) < 3:
        words = f"--parent names {len(clusters.parent)} markers; its axes need 3"
        swap = "; --child has enough: exchange the two, the joint is the same point" if len(clusters.child) > 2 else ""
        raise RecordingError(f"{recording.name}: {words}{swap}")

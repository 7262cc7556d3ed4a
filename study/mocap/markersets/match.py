"""Match a marker set to a recording: the label of each marker, what is missing, and the joints that can be found."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from study.mocap.io.recording import Recording
from study.mocap.markersets.marker_set import Joint, MarkerSet, Segment
from study.mocap.markersets.set_file import MarkerSetError, load_markerset, shipped


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

    @cached_property
    def markerset(self) -> MarkerSet:
        """The set with the markers that the recording has and the joints that can be found; all segments remain."""
        return _reduced(self.whole, self.labels, self.lost)

    @cached_property
    def recording(self) -> Recording:
        """The recording with the markers of the set alone, under their names and in the order of the set."""
        chosen = self.source.select(list(self.labels.values()))
        return Recording(chosen.name, tuple(self.labels), chosen.positions, chosen.rate, chosen.notes)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints that can be found."""
        return self.markerset.joints

    @property
    def extra(self) -> tuple[str, ...]:
        """Labels of the recording that are not markers of the set."""
        used = set(self.labels.values())
        return tuple(marker for marker in self.source.markers if marker not in used)

    def lines(self) -> list[str]:
        """The match in lines of text."""
        lines = [
            f"marker set {self.whole.name}: {len(self.labels)} of the recording's {len(self.source.markers)} markers "
            f"belong to it, {len(self.joints)} of {len(self.whole.joints)} joints can be found"
        ]
        renamed = [f"{label} is {marker}" for marker, label in self.labels.items() if label != marker]
        lines += [f"labels: {', '.join(renamed)}"] * bool(renamed)
        lines += [f"segment {segment} lacks {', '.join(markers)}" for segment, markers in self.lacking.items()]
        lines += [f"joint {joint} cannot be found: {why}" for joint, why in self.lost.items()]
        return lines + [f"not in the marker set: {', '.join(self.extra)}"] * bool(self.extra)


def match(markerset: MarkerSet, recording: Recording) -> Match:
    """Match a marker set to a recording.

    A marker without any sample counts as missing. The parent of a joint needs three markers for its pose, or two if its
    own joint to its parent is found, which is then the third point. The child needs one marker.
    """
    visible = [label for label, share in zip(recording.markers, recording.missing(), strict=True) if share < 1]
    upper = {label.upper(): label for label in reversed(visible)}
    labels = {m: label for m in markerset.markers() if (label := _label(markerset, m, upper)) is not None}
    lacking = {
        segment.name: lacks
        for segment in markerset.segments
        if (lacks := tuple(m for m in segment.markers if m not in labels and m not in markerset.optional))
    }
    return Match(markerset, recording, labels, lacking, _lost(markerset, set(labels)))


def choose(recording: Recording, candidates: Sequence[str] | None = None) -> Match:
    """Choose the marker set that fits a recording best: the most joints, then the most markers, then fewest aliases.

    Args:
        recording: a recording.
        candidates: names or paths of marker sets; the shipped ones if None.

    Raises:
        MarkerSetError: if no joint can be found with any of them.
    """
    names = shipped() if candidates is None else list(candidates)
    matches = [match(load_markerset(name), recording) for name in names]
    best = max(matches, key=_quality, default=None)
    if best is None or not best.joints:
        tried = ", ".join(found.whole.name for found in matches) or "none"
        labels = ", ".join(recording.markers[:8]) + (", ..." if len(recording.markers) > 8 else "")
        words = f"no marker set fits: with none of {tried} can a joint be found among the labels {labels}"
        remedy = "write your own: `study markersets cmu41 > mine.toml` gives a start, --markerset mine.toml uses it"
        raise MarkerSetError(f"{recording.name}: {words}; {remedy}")
    return best


def _quality(found: Match) -> tuple[int, int, int, int]:
    aliases = sum(marker != label for marker, label in found.labels.items())
    return len(found.joints), len(found.labels), -sum(map(len, found.lacking.values())), -aliases


def _label(markerset: MarkerSet, marker: str, labels: dict[str, str]) -> str | None:
    """The recording's label of a marker, its name or an alias; None if the recording lacks it.

    Args:
        markerset: with the aliases.
        marker: of the set.
        labels: those of markers with samples, by their capitals.
    """
    names = (marker, *markerset.aliases.get(marker, ()))
    return next((labels[name.upper()] for name in names if name.upper() in labels), None)


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
            words = f"{parent.name} has {len(has)} markers ({', '.join(has) or 'none'})"
            lost[joint.name] = f"{words}; its pose needs 3" + (f", or 2 and {above.name}" if above else "")
    return {joint.name: lost[joint.name] for joint in markerset.joints if joint.name in lost}


def _reduced(whole: MarkerSet, labels: dict[str, str], lost: dict[str, str]) -> MarkerSet:
    def there(markers: Sequence[str]) -> tuple[str, ...]:
        return tuple(marker for marker in markers if marker in labels)

    return MarkerSet(
        name=whole.name,
        about=whole.about,
        segments=tuple(Segment(name=s.name, markers=there(s.markers), parent=s.parent) for s in whole.segments),
        joints=tuple(
            Joint(name=j.name, parent=j.parent, child=j.child, markers=there(j.markers), kind=j.kind)
            for j in whole.joints
            if j.name not in lost
        ),
    )

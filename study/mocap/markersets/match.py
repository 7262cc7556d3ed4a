"""A marker set laid on a recording: which label is which marker, what is lacking, which joints can still be found."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from study.mocap.io.recording import Recording
from study.mocap.markersets.marker_set import Joint, MarkerSet, Segment
from study.mocap.markersets.set_file import MarkerSetError, load_markerset, shipped


@dataclass(frozen=True, eq=False)
class Match:
    """What a recording has of a marker set."""

    whole: MarkerSet
    """The marker set as it was given."""
    source: Recording
    labels: dict[str, str]
    """For each marker of the set that the recording has: the recording's label."""
    lacking: dict[str, tuple[str, ...]]
    """For each segment that lacks any: the markers that it lacks, optional ones left out."""
    lost: dict[str, str]
    """For each joint that cannot be found: why."""

    @cached_property
    def markerset(self) -> MarkerSet:
        """The set with the markers that are there and the joints that can be found; its segments all remain."""
        return _reduced(self.whole, self.labels, self.lost)

    @cached_property
    def recording(self) -> Recording:
        """The recording with the set's markers alone, under the set's names, in the set's order."""
        chosen = self.source.select(list(self.labels.values()))
        return Recording(chosen.name, tuple(self.labels), chosen.positions, chosen.rate, chosen.notes)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints that can be found."""
        return self.markerset.joints

    @property
    def extra(self) -> tuple[str, ...]:
        """Labels of the recording that are no markers of the set."""
        used = set(self.labels.values())
        return tuple(marker for marker in self.source.markers if marker not in used)

    def lines(self) -> list[str]:
        """What a user should know of it."""
        lines = [
            f"marker set {self.whole.name}: {len(self.labels)} of the recording's {len(self.source.markers)} markers "
            f"placed, {len(self.joints)} of {len(self.whole.joints)} joints can be found"
        ]
        renamed = [f"{label} is {marker}" for marker, label in self.labels.items() if label != marker]
        lines += [f"labels: {', '.join(renamed)}"] * bool(renamed)
        lines += [f"segment {segment} lacks {', '.join(markers)}" for segment, markers in self.lacking.items()]
        lines += [f"joint {joint} cannot be found: {why}" for joint, why in self.lost.items()]
        return lines + [f"not in the marker set: {', '.join(self.extra)}"] * bool(self.extra)


def match(markerset: MarkerSet, recording: Recording) -> Match:
    """Lay a marker set on a recording.

    A marker that is never seen counts as lacking. The segment in whose frame a joint is fixed needs three markers, or
    two if its own joint to its parent is found, which then serves as the third point; the child needs one.
    """
    visible = [label for label, share in zip(recording.markers, recording.missing(), strict=True) if share < 1]
    upper = {label.upper(): label for label in reversed(visible)}
    seen = {m: label for m in markerset.markers() if (label := _label(markerset, m, upper)) is not None}
    lacking = {
        segment.name: lacks
        for segment in markerset.segments
        if (lacks := tuple(m for m in segment.markers if m not in seen and m not in markerset.optional))
    }
    return Match(markerset, recording, seen, lacking, _lost(markerset, set(seen)))


def choose(recording: Recording, candidates: Sequence[str] | None = None) -> Match:
    """Find the marker set that fits a recording best: the most joints, then markers placed, then fewest aliases.

    Args:
        recording: whose labels count.
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
        raise MarkerSetError(f"{recording.name}: {words}; write one (copy study/mocap/markersets/cmu41.toml)")
    return best


def _quality(found: Match) -> tuple[int, int, int, int]:
    aliases = sum(marker != label for marker, label in found.labels.items())
    return len(found.joints), len(found.labels), -sum(map(len, found.lacking.values())), -aliases


def _label(markerset: MarkerSet, marker: str, labels: dict[str, str]) -> str | None:
    """The label of a marker: its own name or an alias; None if it is not there.

    Args:
        markerset: whose aliases count.
        marker: of the set.
        labels: those of markers that are ever seen, by what they are in capitals.
    """
    names = (marker, *markerset.aliases.get(marker, ()))
    return next((labels[name.upper()] for name in names if name.upper() in labels), None)


def _lost(markerset: MarkerSet, seen: set[str]) -> dict[str, str]:
    """Joints that cannot be found, with the reason, parents first."""
    hangs = {joint.child: joint for joint in markerset.joints}
    order = {segment.name: place for place, segment in enumerate(markerset.segments)}
    lost: dict[str, str] = {}
    for joint in sorted(markerset.joints, key=lambda joint: order[joint.child]):
        parent = markerset.segment(joint.parent)
        has = [marker for marker in parent.markers if marker in seen]
        above = hangs.get(parent.name)
        helped = above is not None and above.name not in lost
        if not any(marker in seen for marker in markerset.seeing(joint)):
            lost[joint.name] = f"{joint.child} has none of {', '.join(markerset.seeing(joint))}"
        elif len(has) + helped < 3:
            words = f"{parent.name} has {len(has)} markers ({', '.join(has) or 'none'})"
            lost[joint.name] = f"{words}; its frame needs 3" + (f", or 2 and {above.name}" if above else "")
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

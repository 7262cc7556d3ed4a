"""Name markers by the labels of points: without subjects' prefixes, and each name once."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from study.mocap.io.recording import RecordingError


@dataclass(frozen=True)
class MarkerNames:
    """The points of a file that are markers, and their names."""

    rows: tuple[int, ...]
    """Numbers of these points in the file, from 0."""
    markers: tuple[str, ...]
    """Their names, each different."""
    notes: tuple[str, ...]
    """Messages about points that were left out or renamed."""


def name_points(labels: Sequence[str], subject: str | None = None, prefixes: Sequence[str] = ()) -> MarkerNames:
    """Name the points of a file.

    A label is a marker's name, perhaps after a subject's name and a colon (``male:LFHD``). Two points with one label
    are both renamed (``LFHD#1``, ``LFHD#2``): nothing tells which of them is the marker, and a marker that is sometimes
    another one does more harm than a missing one.

    Args:
        labels: one per point, as in the file; empty for a point without a label.
        subject: the subject whose markers to take, if the file has several.
        prefixes: of the labels, if the file gives them, such as ``male:``.

    Raises:
        RecordingError: if there are several subjects and none is chosen, or the chosen one is missing.
    """
    parts = [_split(printable(label.strip()), [printable(each.strip()) for each in prefixes]) for label in labels]
    rows = _of_subject([owner for owner, _ in parts], subject)
    names = [parts[row][1] or f"point {row + 1}" for row in rows]
    notes = []
    if len(rows) < len(labels):
        notes.append(f"{len(labels) - len(rows)} points of other subjects are left out")
    doubles = [name for name, count in Counter(names).items() if count > 1]
    for name in doubles:
        places = [i for i, other in enumerate(names) if other == name]
        points = ", ".join(str(rows[i] + 1) for i in places)
        notes.append(
            f"the label {name} is on points {points}: nothing tells which is the marker, so none of them is used"
        )
        for number, i in enumerate(places, start=1):
            names[i] = f"{name}#{number}"
    return MarkerNames(tuple(rows), tuple(names), tuple(notes))


def printable(text: str) -> str:
    """A label, or the name of a file, without unprintable characters."""
    try:
        text.encode()
    except UnicodeEncodeError:  # surrogates stand for bytes that are not UTF-8, such as é or ü in an old file
        text = text.encode("utf-8", "surrogateescape").decode("latin-1")
    return "".join(c if c.isprintable() else "�" for c in text)


def _split(label: str, prefixes: Sequence[str]) -> tuple[str, str]:
    """A label's subject and marker."""
    for prefix in prefixes:
        if prefix and label.startswith(prefix) and len(label) > len(prefix):
            return prefix.rstrip(":"), label[len(prefix) :].strip()
    owner, colon, name = label.rpartition(":")
    return (owner.strip(), name.strip()) if colon and name.strip() else ("", label)


def _of_subject(owners: Sequence[str], subject: str | None) -> list[int]:
    """Rows of the points of the subject, or of all points if there is only one subject.

    These include points without a prefix, such as a prop or an unlabelled reflection.
    """
    counts = Counter(owner for owner in owners if owner)
    listed = ", ".join(f"{owner} ({count} markers)" for owner, count in counts.items())
    if subject is None:
        if len(counts) > 1:
            raise RecordingError(f"it holds {len(counts)} subjects: {listed}; choose one with --subject")
        return list(range(len(owners)))
    if subject not in counts:
        raise RecordingError(f"no subject {subject!r} in it; there are {listed or 'none, the labels have no prefix'}")
    return [row for row, owner in enumerate(owners) if owner == subject]

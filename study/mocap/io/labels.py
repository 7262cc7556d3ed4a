"""Labels of points, as files have them, to names of markers: subjects' prefixes, doubles, points without a label."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from study.mocap.io.recording import RecordingError


@dataclass(frozen=True)
class Naming:
    """Which points of a file are markers, and what they are called."""

    rows: tuple[int, ...]
    """Places in the file of the points that are kept."""
    markers: tuple[str, ...]
    """Their names, each once."""
    notes: tuple[str, ...]
    """What was left out or renamed."""


def name_points(labels: Sequence[str], subject: str | None = None, prefixes: Sequence[str] = ()) -> Naming:
    """Name the points of a file.

    A label is a marker's, perhaps after a subject's name and a colon (``male:LFHD``). Two points with one label are
    both renamed (``LFHD#1``, ``LFHD#2``): which of them is meant cannot be told, and a marker that is sometimes the
    wrong one is worse than one that is missing.

    Args:
        labels: one per point, as in the file; an empty one for a point without.
        subject: whose markers to take, where the file has several subjects.
        prefixes: what the file itself says labels begin with, such as ``male:``.

    Raises:
        RecordingError: if there are several subjects and none is chosen, or the chosen one is not there.
    """
    parts = [_split(_printable(label), [_printable(prefix) for prefix in prefixes]) for label in labels]
    rows = _of_subject([owner for owner, _ in parts], subject)
    names = [parts[row][1] or f"point {row + 1}" for row in rows]
    notes = []
    if len(rows) < len(labels):
        notes.append(f"{len(labels) - len(rows)} points of other subjects are left out")
    doubles = [name for name, count in Counter(names).items() if count > 1]
    for name in doubles:
        places = [i for i, other in enumerate(names) if other == name]
        points = ", ".join(str(rows[i] + 1) for i in places)
        notes.append(f"the label {name} is on points {points}: which is meant cannot be told, so none of them is used")
        for number, i in enumerate(places, start=1):
            names[i] = f"{name}#{number}"
    return Naming(tuple(rows), tuple(names), tuple(notes))


def _printable(label: str) -> str:
    """A label without blanks about it and without characters that cannot be shown."""
    try:
        label.encode()
    except UnicodeEncodeError:  # bytes that are not UTF-8, carried along as surrogates: an old file's é or ü
        label = label.encode("utf-8", "surrogateescape").decode("latin-1")
    return "".join(c if c.isprintable() else "�" for c in label.strip())


def _split(label: str, prefixes: Sequence[str]) -> tuple[str, str]:
    """A label's subject and marker."""
    for prefix in prefixes:
        if prefix and label.startswith(prefix) and len(label) > len(prefix):
            return prefix.rstrip(":"), label[len(prefix) :].strip()
    owner, colon, name = label.rpartition(":")
    return (owner.strip(), name.strip()) if colon and name.strip() else ("", label)


def _of_subject(owners: Sequence[str], subject: str | None) -> list[int]:
    """Rows of the points that belong to the subject, or to the only one there is.

    Where there is one subject, points without a prefix (a prop, an unlabelled reflection) are kept as extras.
    """
    counts = Counter(owner for owner in owners if owner)
    listed = ", ".join(f"{owner} ({count} markers)" for owner, count in counts.items())
    if subject is None:
        if len(counts) > 1:
            raise RecordingError(f"it holds {len(counts)} subjects: {listed}; say whose markers to take (subject)")
        return list(range(len(owners)))
    if subject not in counts:
        raise RecordingError(f"no subject {subject!r} in it; there are {listed or 'none, the labels have no prefix'}")
    return [row for row, owner in enumerate(owners) if owner == subject]

"""Output of the commands on recordings: their results as data, for `--json`, printed lines, and the folder of files."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from study.recordings.recording import Recording, RecordingError, extents, gaps

if TYPE_CHECKING:
    import pandas as pd

    from study.recordings.case_study import CaseStudy
    from study.recordings.markersets import MarkerSet
    from study.recordings.markersets.match import Match


def recording_data(recording: "Recording", match: "Match | None") -> dict[str, object]:
    """Describe a recording.

    Args:
        recording: as it was read.
        match: the marker set that fits it best; None if none does.

    Returns:
        ``recording``, ``rate``, ``frames``, ``duration`` (seconds), ``missing`` (share of all samples), ``notes``;
        ``markers``, each with ``marker``, the numbers of ``missing`` frames, of ``gaps`` and of frames in the
        ``longest`` one, and ``extent`` (metres); ``markerset``, as in `match_data`, or null.
    """
    seen = recording.seen()
    markers = [
        {"marker": marker, **dict(zip(("missing", "gaps", "longest"), gaps(row), strict=True)), "extent": float(far)}
        for marker, row, far in zip(recording.markers, seen, extents(recording), strict=True)
    ]
    return {
        "recording": recording.name,
        "rate": recording.rate,
        "frames": recording.frames,
        "duration": recording.duration,
        "missing": float(1.0 - np.mean(seen)),
        "notes": list(recording.notes),
        "markers": markers,
        "markerset": None if match is None else match_data(match),
    }


def joints_data(match: "Match", table: "pd.DataFrame") -> dict[str, object]:
    """Describe joints that were found.

    Args:
        match: the recording and its marker set.
        table: a row per joint.

    Returns:
        ``recording``, ``notes``, ``markerset`` (as in `match_data`), and ``joints``: the rows of the table.
    """
    source = match.source
    head = {"recording": source.name, "notes": list(source.notes), "markerset": match_data(match)}
    return head | {"joints": table.to_dict("records")}


def match_data(match: "Match") -> dict[str, object]:
    """Describe how a marker set fits a recording.

    Returns:
        ``name``; ``labels``, the recording's label of each marker; ``lacking`` markers by segment; ``joints`` that can
        be found; ``lost`` joints, each with the reason; ``extra`` labels.
    """
    return {
        "name": match.whole.name,
        "labels": match.labels,
        "lacking": match.lacking,
        "joints": [joint.name for joint in match.joints],
        "lost": match.lost,
        "extra": list(match.extra),
    }


def case_study_data(case: "CaseStudy") -> dict[str, object]:
    """Describe a case study: ``recording``, ``frames``, ``subsets``, ``laws`` and ``joints`` as in its tables."""
    return {
        "recording": case.recording,
        "frames": case.frames,
        "subsets": case.subsets,
        "laws": case.laws.to_dict("records"),
        "joints": case.joints.to_dict("records"),
        "skipped": dict(case.skipped),
    }


def markerset_data(markerset: "MarkerSet") -> dict[str, object]:
    """Describe a marker set: ``name``, ``about``, ``segments``, ``joints``, ``optional`` markers and ``aliases``."""
    return markerset.model_dump()


RESULTS = Path("results") / "recordings"
"""The folder with a folder for each recording's results."""


def results_folder(name: str, out: Path | None = None) -> Path:
    """The folder for the results of a recording: ``out`` if given, else a folder of `RESULTS`.

    Any name, even ``..``, gives a folder directly below `RESULTS`.

    Raises:
        RecordingError: if there is a file of that name.
    """
    plain = re.sub(r"[^\w.-]+", "-", name).strip(".-") or "recording"
    folder = RESULTS / plain[:100] if out is None else out
    if folder.exists() and not folder.is_dir():
        raise RecordingError(f"{folder}: is a file, not a folder; choose another with --out")
    return folder


def print_match(match: "Match") -> None:
    """Print the notes about a recording, and how the marker set fits it."""
    print_lines(f"note: {note}" for note in match.source.notes)
    print_lines(match.lines())


def print_lines(lines: Iterable[object]) -> None:
    """Print lines to the standard output."""
    for line in lines:
        typer.echo(str(line))

"""The first steps of each command on a recording: read it, place a marker set on it, find the folder of its results."""

import re
from collections.abc import Iterable
from pathlib import Path

import typer

from study.mocap.commands.options import Reading
from study.mocap.io.recording import Recording, RecordingError
from study.mocap.markersets.match import Match, choose, match, with_better
from study.mocap.markersets.set_file import MarkerSetError, load_markerset

RESULTS = Path("results") / "recordings"
"""The folder with a folder for each recording's results."""


def open_recording(file: Path, markerset: str | None = None, reading: Reading | None = None) -> Match:
    """Read a recording and place a marker set on it.

    Args:
        file: of the recording.
        markerset: name or path of a marker set; the shipped one that fits best if None.
        reading: unit, rate and subject, if the file lacks them.

    Raises:
        RecordingError: if the recording cannot be read.
        MarkerSetError: if the marker set cannot be read, or no joint can be found with it.
    """
    return place_markerset((reading or Reading()).read(file), markerset)


def place_markerset(recording: Recording, markerset: str | None = None) -> Match:
    """Place a marker set on a recording; the arguments and errors are those of `open_recording`."""
    if markerset is None:
        return choose(recording)
    found = match(load_markerset(markerset), recording)
    if not found.joints:
        reasons = "; ".join(f"{joint}: {reason}" for joint, reason in list(found.lost.items())[:3])
        raise MarkerSetError(
            f"{recording.name}: no joint of marker set {markerset} can be found ({reasons}, ...); "
            "leave --markerset out to choose the shipped one that fits best"
        )
    return with_better(found)


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


def print_match(found: Match) -> None:
    """Print the notes about a recording, and how the marker set fits it."""
    print_lines(f"note: {note}" for note in found.source.notes)
    print_lines(found.lines())


def print_lines(lines: Iterable[object]) -> None:
    """Print lines to the standard output."""
    for line in lines:
        typer.echo(str(line))

"""Commands about recordings: the options that several of them have, and how they print and where they write."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from study.options import echo

if TYPE_CHECKING:
    from study.recordings.markersets import Match

File = Annotated[Path, typer.Argument(metavar="FILE", help="a recording: .c3d, .trc, .csv, .tsv or .txt")]
_SET = "name of a shipped marker set, or a file [default: the shipped one that fits best]"
MarkerSetName = Annotated[str | None, typer.Option("--markerset", help=_SET)]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the results [default: results/recordings/<name>]")]
_UNIT = "m, cm, mm, in or ft, if the file lacks its unit or has a wrong one"
Unit = Annotated[str | None, typer.Option("--unit", help=_UNIT)]
_RATE = "frames per second, if the file lacks its rate or has a wrong one"
Rate = Annotated[float | None, typer.Option("--rate", help=_RATE)]
Subject = Annotated[str | None, typer.Option("--subject", help="the subject to read, if the file has several")]
_FRAMES = "read these frames alone, from 1, both ends included; `study recording` says which are whole"
FrameRange = Annotated[str | None, typer.Option("--frames", metavar="1-499", help=_FRAMES)]

_HIPS = (
    "hips that motion leaves in doubt: as they are, or by regression from the pelvis' spines, or the file's LHJC, RHJC"
)
HipCentres = Annotated[Literal["motion", "regression"], typer.Option("--hips", help=_HIPS)]

RESULTS = Path("results") / "recordings"
"""The folder with a folder for each recording's results."""


def results_folder(name: str, out: Path | None = None) -> Path:
    """The folder for the results of a recording: ``out`` if given, else a folder of `RESULTS`.

    Any name, even ``..``, gives a folder directly below `RESULTS`.

    Raises:
        RecordingError: if there is a file of that name.
    """
    from study.recordings.recording import RecordingError

    plain = re.sub(r"[^\w.-]+", "-", name).strip(".-") or "recording"
    folder = RESULTS / plain[:100] if out is None else out
    if folder.exists() and not folder.is_dir():
        raise RecordingError(f"{folder}: is a file, not a folder; choose another with --out")
    return folder


def print_match(match: "Match", calibrated: bool = False) -> None:
    """Print the notes about a recording, and how the marker set, or that of a calibration, fits it."""
    echo(f"note: {note}" for note in match.source.notes)
    echo(match.lines(calibrated))

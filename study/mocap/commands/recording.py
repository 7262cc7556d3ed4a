"""The command `study recording`: the contents of a recording."""

import typer

from study.mocap.commands.options import File, Reading, grouped
from study.runs.commands import Json


@grouped
def recording(file: File, *, as_json: Json = False, reading: Reading) -> None:
    """Describe a recording.

    Prints its markers, frames and rate, the gaps of each marker, and the marker set that fits best.

    With --json: recording, rate, frames, duration, missing, notes, markers and markerset (null if none fits).
    """
    from study.mocap.commands.as_data import recording_data
    from study.mocap.commands.open_recording import print_lines
    from study.mocap.io.describe import describe
    from study.mocap.markersets.match import choose
    from study.mocap.markersets.set_file import MarkerSetError
    from study.text.json_text import json_text

    found = reading.read(file)
    try:
        match, reason = choose(found), ""
    except MarkerSetError as error:  # a recording that no marker set fits can be described, too
        match, reason = None, str(error).removeprefix(f"{found.name}: ")
    if as_json:
        typer.echo(json_text(recording_data(found, match)))
    else:
        print_lines([*describe(found), *([reason] if match is None else match.lines())])

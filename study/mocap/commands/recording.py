"""The command `study recording`: the contents of a recording."""

import typer

from study.mocap.commands.options import File, Reading, grouped


@grouped
def recording(file: File, reading: Reading) -> None:
    """Describe a recording.

    Prints its markers, frames and rate, the gaps of each marker, and the marker set that fits best.
    """
    from study.mocap.commands.open_recording import print_lines
    from study.mocap.io.describe import describe
    from study.mocap.markersets.match import choose
    from study.mocap.markersets.set_file import MarkerSetError

    found = reading.read(file)
    print_lines(describe(found))
    try:
        print_lines(choose(found).lines())
    except MarkerSetError as error:  # a recording that no marker set fits can be described, too
        typer.echo(str(error).removeprefix(f"{found.name}: "))

"""The command `study markersets`: the marker sets that come with the program."""

from typing import Annotated

import typer


def markersets(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="print this one [default: list all]")] = None,
) -> None:
    """List the shipped marker sets, or print one.

    `study markersets cmu41 > mine.toml` is a start for a marker set of your own, which --markerset mine.toml uses.
    """
    from study.mocap.commands.open_recording import print_lines
    from study.mocap.markersets.set_file import described, shipped_text

    if name is None:
        print_lines(described())
    else:
        typer.echo(shipped_text(name), nl=False)

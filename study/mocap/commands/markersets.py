"""The command `study markersets`: the marker sets that come with the program."""

from typing import Annotated

import typer

from study.runs.commands import Json


def markersets(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="print this one [default: list all]")] = None,
    as_json: Json = False,
) -> None:
    """List the shipped marker sets, or print one.

    `study markersets cmu41 > mine.toml` is a start for a marker set of your own, which --markerset mine.toml uses.

    With --json: markersets, each with name, about, segments, joints, optional and aliases.
    """
    from study.mocap.commands.as_data import markerset_data
    from study.mocap.commands.open_recording import print_lines
    from study.mocap.markersets.set_file import described, load_markerset, shipped, shipped_text
    from study.text.json_text import json_text

    if as_json:
        names = shipped() if name is None else [name]
        typer.echo(json_text({"markersets": [markerset_data(load_markerset(each)) for each in names]}))
    elif name is None:
        print_lines(described())
    else:
        typer.echo(shipped_text(name), nl=False)

"""The command `study fetch`: a recording from a public library."""

from typing import Annotated

import typer

from study.runs.commands import Json


def fetch(
    library: Annotated[str, typer.Argument(metavar="LIBRARY", help="cmu")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="subject and trial of the recording, such as 60_08")],
    as_json: Json = False,
) -> None:
    """Download a recording from a public library.

    Prints its path in the cache; a recording that is there is not downloaded again.

    With --json: library, name, file and terms.
    """
    from study.mocap.io import fetch as libraries
    from study.text.json_text import json_text

    try:
        path = libraries.fetch(library, name)
    except libraries.DownloadError as error:  # a failure, not a mistake of the user
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    terms = libraries.LIBRARIES[library].terms
    if as_json:
        typer.echo(json_text({"library": library, "name": name, "file": path, "terms": terms}))
        return
    typer.echo(f"{library}: {terms}", err=True)
    typer.echo(str(path))

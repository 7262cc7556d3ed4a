"""The command `study fetch`: a recording from a public library."""

from typing import Annotated

import typer


def fetch(
    library: Annotated[str, typer.Argument(metavar="LIBRARY", help="cmu")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="subject and trial of the recording, such as 60_08")],
) -> None:
    """Download a recording from a public library.

    Prints its path in the cache; a recording that is there is not downloaded again.
    """
    from study.mocap.io import fetch as libraries

    try:
        path = libraries.fetch(library, name)
    except libraries.DownloadError as error:  # a failure, not a mistake of the user
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    typer.echo(f"{library}: {libraries.LIBRARIES[library].terms}", err=True)
    typer.echo(str(path))

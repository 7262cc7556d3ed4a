"""Commands about recordings, and the options that several of them have."""

from pathlib import Path
from typing import Annotated

import typer

File = Annotated[Path, typer.Argument(metavar="FILE", help="a recording: .c3d, .trc, .csv, .tsv or .txt")]
_SET = "name of a shipped marker set, or a file [default: the shipped one that fits best]"
MarkerSetName = Annotated[str | None, typer.Option("--markerset", help=_SET)]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the results [default: results/recordings/<name>]")]
_UNIT = "m, cm, mm, in or ft, if the file lacks its unit or has a wrong one"
Unit = Annotated[str | None, typer.Option("--unit", help=_UNIT)]
_RATE = "frames per second, if the file lacks its rate or has a wrong one"
Rate = Annotated[float | None, typer.Option("--rate", help=_RATE)]
Subject = Annotated[str | None, typer.Option("--subject", help="the subject to read, if the file has several")]

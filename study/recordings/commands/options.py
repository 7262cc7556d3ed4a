"""Options that the commands on recordings share, and options in groups: a dataclass as one parameter of a command."""

import functools
import inspect
from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from study.recordings.recording import Recording


File = Annotated[Path, typer.Argument(metavar="FILE", help="a recording: .c3d, .trc, .csv, .tsv or .txt")]
MarkerSetName = Annotated[
    str | None,
    typer.Option(
        "--markerset", help="name of a shipped marker set, or a file [default: the shipped one that fits best]"
    ),
]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the results [default: results/recordings/<name>]")]


@dataclass(frozen=True)
class Reading:
    """The options that say how to read a recording."""

    unit: str | None = field(
        default=None, metadata={"help": "m, cm, mm, in or ft, if the file lacks its unit or has a wrong one"}
    )
    rate: float | None = field(
        default=None, metadata={"help": "frames per second, if the file lacks its rate or has a wrong one"}
    )
    subject: str | None = field(default=None, metadata={"help": "the subject to read, if the file has several"})

    def read(self, file: Path) -> "Recording":
        """Read a recording."""
        from study.recordings.formats.read import read_recording

        return read_recording(file, unit=self.unit, rate=self.rate, subject=self.subject)


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command one option for each field of the dataclasses among its parameters.

    The option has the field's name, type and default; its help is the entry "help" of the field's metadata. The command
    itself receives an instance of the dataclass.
    """
    signature = inspect.signature(command, eval_str=True)
    groups = {name: fields(p.annotation) for name, p in signature.parameters.items() if is_dataclass(p.annotation)}

    @functools.wraps(command)
    def with_options(**values: object) -> None:
        for name, parts in groups.items():
            group = signature.parameters[name].annotation
            values[name] = group(**{part.name: values.pop(part.name) for part in parts})
        command(**values)

    parameters: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        if name in groups:
            parameters += map(_option, groups[name])
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    with_options.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return with_options


def _option(part: "Field[object]") -> inspect.Parameter:
    """The parameter for a field of a dataclass, as typer reads it."""
    option = typer.Option(f"--{part.name.replace('_', '-')}", help=part.metadata["help"])
    return inspect.Parameter(
        part.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=part.default,
        annotation=Annotated[part.type, option],
    )

"""The ground of all commands: exit codes, ``--json``, help by groups, and streams that show control characters."""

from collections.abc import Iterable
from enum import IntEnum
from typing import TYPE_CHECKING, Annotated, Any, TextIO, cast

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter

Json = Annotated[bool, typer.Option("--json", help="print one JSON object, with null where there is no number")]


def echo(lines: Iterable[object]) -> None:
    """Print lines; a path is printed as it is."""
    for line in lines:
        typer.echo(line)


class ExitCode(IntEnum):
    """Exit code of a command; `EXIT_CODES` has the meanings."""

    COMPLETE = 0
    FAILURE = 1
    USAGE = 2
    TOO_MANY_FAILURES = 3
    BUDGET = 4
    TOO_LONG = 5
    INTERRUPTED = 130
    NO_READER = 141


EXIT_CODES: dict[int, str] = {
    ExitCode.COMPLETE: "complete",
    ExitCode.FAILURE: "failed: no such run, a damaged table, runs that differ, a violated property, a failed figure",
    ExitCode.USAGE: "wrong usage, or a fault in a config or another file that was given",
    ExitCode.TOO_MANY_FAILURES: "complete, but too many fits failed, one is not ok or uses outliers, or a chain failed",
    ExitCode.BUDGET: "stopped by --budget before every cell had enough trials",
    ExitCode.TOO_LONG: "planned, and the run would take more than a week",
    ExitCode.INTERRUPTED: "interrupted by Ctrl-C or SIGTERM; `study run` resumes",
    ExitCode.NO_READER: "the program that reads the standard output, such as `head`, has ended",
}
"""Meaning of each exit code."""


_OTHER = "Commands"
"""Title of the commands without a group."""


class GroupedHelp(TyperGroup):
    """A command line that lists its commands by group, in the order in which they were added, and the exit codes.

    The group of a command is its ``rich_help_panel``, which typer itself heeds only where it prints with colours and
    boxes.
    """

    def format_commands(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write a section for each group; the names are aligned over all of them."""
        commands = [(name, command) for name in self.list_commands(ctx) if (command := self.get_command(ctx, name))]
        width = max((len(name) for name, _ in commands), default=0)
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, command in commands:
            if not command.hidden:
                words = command.get_short_help_str(formatter.width - 6 - width)
                panel = getattr(command, "rich_help_panel", None)  # a mark of typer's, if it has no group
                title = panel if isinstance(panel, str) else _OTHER
                groups.setdefault(title, []).append((name.ljust(width), words))
        for title, rows in groups.items():
            with formatter.section(title):
                formatter.write_dl(rows)

    def format_epilog(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write the exit codes."""
        super().format_epilog(ctx, formatter)
        with formatter.section("Exit codes"):
            formatter.write_dl([(str(int(code)), words) for code, words in EXIT_CODES.items()])


_SAFE = "\t\n"
_CONTROLS = [*range(0x20), *range(0x7F, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
_SHOWN = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _CONTROLS if chr(code) not in _SAFE}
"""What is printed for characters that move the cursor, colour, or turn the direction of text."""


class ShownStream:
    r"""A text stream that prints ``\x1b`` where a file name or a marker's label would send an escape sequence.

    Args:
        stream: the stream that is written to; all else that a stream has is its own, but for its buffer, through which
            bytes would pass unseen.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text; returns its length."""
        self.stream.write(text if text.isprintable() else text.translate(_SHOWN))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        if name == "buffer":
            raise AttributeError("a stream of shown text has no buffer")
        return getattr(self.stream, name)


def shown(stream: TextIO) -> TextIO:
    """A stream that shows control characters; the same if it does already."""
    return cast(TextIO, ShownStream(stream)) if stream and not isinstance(stream, ShownStream) else stream


def unchanged(stream: Any) -> Any:
    """The stream itself, for a progress bar, which moves the cursor."""
    return stream.stream if isinstance(stream, ShownStream) else stream

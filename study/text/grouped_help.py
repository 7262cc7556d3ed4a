"""Help of a command line whose commands stand in titled groups, with its exit codes at the end."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from typer.core import TyperGroup

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter

_OTHER = "Commands"
"""Title of the commands without a group."""


class GroupedHelp(TyperGroup):
    """A command line that lists its commands by group, in the order in which they were added.

    The group of a command is its ``rich_help_panel``, which typer itself heeds only where it prints with colours and
    boxes. The exit codes are the ``exit_codes`` of a subclass.
    """

    exit_codes: ClassVar[Mapping[int, str]] = {}
    """Meaning of each exit code, in words."""

    def format_commands(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write a section for each group; the names are aligned over all of them."""
        commands = [(name, command) for name in self.list_commands(ctx) if (command := self.get_command(ctx, name))]
        width = max((len(name) for name, _ in commands), default=0)
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, command in commands:
            if not command.hidden:
                words = command.get_short_help_str(formatter.width - 6 - width)
                groups.setdefault(_title(command), []).append((name.ljust(width), words))
        for title, rows in groups.items():
            with formatter.section(title):
                formatter.write_dl(rows)

    def format_epilog(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write the exit codes."""
        super().format_epilog(ctx, formatter)
        if self.exit_codes:
            with formatter.section("Exit codes"):
                formatter.write_dl([(str(int(code)), words) for code, words in self.exit_codes.items()])


def _title(command: object) -> str:
    panel = getattr(command, "rich_help_panel", None)
    return panel if isinstance(panel, str) else _OTHER

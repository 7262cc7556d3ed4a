"""Options in groups: a command has an option for each field of a dataclass, and receives the dataclass."""

import inspect
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from study.mocap.commands.options import grouped


@dataclass(frozen=True)
class Speed:
    """A group of three options."""

    per_second: float = field(default=2.5, metadata={"help": "metres per second"})
    name: str | None = field(default=None, metadata={"help": "of the runner"})
    uphill: bool = field(default=False, metadata={"help": "on a slope"})


@pytest.fixture
def run():
    """Call a command with a group; its output comes back."""
    app = typer.Typer(rich_markup_mode=None)

    @app.command()
    @grouped
    def walk(
        file: Annotated[Path, typer.Argument()], *, count: Annotated[int, typer.Option()] = 3, speed: Speed
    ) -> None:
        """Walk along a file."""
        typer.echo(f"{file} {count} {speed}")

    def call(*arguments):
        done = CliRunner().invoke(app, list(arguments))
        return done.exit_code, done.output

    return call


def test_values(run):
    """Given options and defaults arrive in the group, others in their parameters."""
    assert run("a") == (0, f"a 3 {Speed()}\n")
    assert run("a", "--per-second", "4", "--count", "1", "--name", "x", "--uphill") == (
        0,
        f"a 1 {Speed(4.0, 'x', True)}\n",
    )


def test_help(run):
    """Each field has its option with its type, default and help; the group itself has none."""
    said = run("--help")[1]
    assert "Walk along a file." in said
    for words in ("--per-second <float>", "metres per second", "[default: 2.5]", "--name <str>", "of the runner"):
        assert words in said
    assert "--uphill" in said
    assert "--no-uphill" not in said
    assert "--speed" not in said


def test_wrong_values(run):
    """A value of another type is a mistake of the user, with the option's name."""
    code, said = run("a", "--per-second", "fast")
    assert code == 2
    assert "--per-second" in said


def test_order():
    """The options of a group stand where the group stands."""

    @grouped
    def walk(first: int, speed: Speed, last: int) -> None:
        """Walk."""

    assert list(inspect.signature(walk).parameters) == ["first", "per_second", "name", "uphill", "last"]

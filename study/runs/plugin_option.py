"""The option ``--plugin`` of commands that must know the estimators of a user's own files."""

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer


def _load(paths: list[Path] | None) -> list[Path] | None:
    """Load the files before anything else of a command is read, because configs name what they register."""
    if paths:
        from study.estimators.own.plugin_file import load

        for path in paths:
            load(path)
    return paths


_HELP = "Python file with estimators of your own; may be given several times"
Plugins = Annotated[
    list[Path] | None, typer.Option("--plugin", metavar="FILE", help=_HELP, is_eager=True, callback=_load)
]


def with_plugins(command: Callable[..., None]) -> Callable[..., None]:
    """The same command with the option ``--plugin``, whose files are loaded when the option is read."""

    @functools.wraps(command)
    def called(*arguments: object, plugin: object = None, **named: object) -> None:
        command(*arguments, **named)

    option = inspect.Parameter("plugin", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Plugins)
    signature = inspect.signature(command)
    vars(called)["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), option])
    called.__annotations__ = {**command.__annotations__, "plugin": Plugins}
    return called

"""Commands about configs and runs, for `study.cli`, with their exit codes; the worker of a cluster."""

import os.path
from enum import IntEnum
from pathlib import Path
from typing import Annotated

import typer

RUNS = Path("results")
"""Folder of the runs, below the current one."""


def run_folder(argument: str) -> Path:
    """The folder of a run, given itself, as the config of a run in `RUNS`, or as the name of a shipped config."""
    path = Path(argument)
    if os.path.isdir(path) or path.suffix not in ("", ".toml"):
        return path
    from study.experiment.config import load
    from study.experiment.shipped_configs import shipped_configs

    config = path if path.suffix else shipped_configs().get(argument)
    return path if config is None else RUNS / load(config).run_name()


_FOLDER = "folder of a run, or the config of a run in results/, such as configs/paper.toml, or paper if it is shipped"
Folder = Annotated[Path, typer.Argument(metavar="RUN", parser=run_folder, help=_FOLDER)]
CONFIG_HELP = "config file, or name of a shipped config (see `study configs`)"
Config = Annotated[Path, typer.Argument(metavar="CONFIG", help=CONFIG_HELP)]
Jobs = Annotated[int, typer.Option("--jobs", "-j", min=1, max=1024, help="number of workers")]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object, with null where there is no number")]


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
    ExitCode.TOO_MANY_FAILURES: "complete, but too many fits failed; or a fit is not ok, or uses outliers",
    ExitCode.BUDGET: "stopped by --budget before every cell had enough trials",
    ExitCode.TOO_LONG: "planned, and the run would take more than a week",
    ExitCode.INTERRUPTED: "interrupted by Ctrl-C or SIGTERM; `study run` resumes",
    ExitCode.NO_READER: "the program that reads the standard output, such as `head`, has ended",
}
"""Meaning of each exit code."""


def configs() -> None:
    """List the shipped configs. `study plan` and `study run` take them by name."""
    from study.experiment.shipped_configs import shipped_configs, summary_line
    from study.text.columns import columns

    for line in columns([name, summary_line(path)] for name, path in shipped_configs().items()):
        typer.echo(line)


def plan(config: Config, jobs: Jobs = 2, as_json: Json = False) -> None:
    """Predict a study's size and time without running it.

    The exit code is 5 if the run would take more than a week.

    With --json: run, jobs, and parts, a list of title, cells, units, trials, draws, samples, fits, bytes and seconds;
    one part, or two if the config has [precision].
    """
    from study.experiment.config import load
    from study.experiment.shipped_configs import config_file
    from study.runs.plan import extremes, warning
    from study.runs.plan import plan as make_plan
    from study.text.columns import columns
    from study.text.json_text import json_text

    study = load(config_file(config))
    plans = {title: make_plan(part, jobs) for title, part in extremes(study).items()}
    if as_json:
        parts = [{"title": title, **vars(found)} for title, found in plans.items()]
        typer.echo(json_text({"run": study.run_name(), "jobs": jobs, "parts": parts}))
    else:
        typer.echo(f"{study.run_name()}")
        for title, found in plans.items():
            if title:
                typer.echo(f"  {title}")
            for line in columns(found.lines(), indent=2):
                typer.echo(line)
    if (words := warning(study, next(iter(plans.values())), jobs)) is not None:  # the first is the least work
        typer.echo(words, err=True)
        raise typer.Exit(ExitCode.TOO_LONG)


def worker(
    scheduler: Annotated[str, typer.Argument(metavar="ADDRESS", help="address of a Dask scheduler: tcp://host:8786")],
    options: Annotated[list[str] | None, typer.Argument(metavar="-- OPTION…", help="see `dask worker --help`")] = None,
) -> None:
    """Start a Dask worker whose results equal those of this machine.

    They are equal to the last bit.
    """
    from study.runs.workers.dask_cluster import serve

    serve(scheduler, options or [])

"""Commands about configs and runs, for `study.cli`, with their exit codes; the worker of a cluster."""

from enum import IntEnum
from typing import Annotated

import typer

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

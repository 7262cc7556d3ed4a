"""Commands that judge the claims and write the page, for `study.cli`."""

from pathlib import Path
from typing import Annotated

import typer

from study.runs.commands import Jobs, Json, run_folder

Folders = Annotated[
    list[Path],
    typer.Argument(metavar="RUN", parser=run_folder, help="folders of runs, or their configs, each of another config"),
]
Cost = Annotated[Path | None, typer.Option("--cost", help="table that `study cost` stores, for the claims on cost")]
_RECORDING = "folder that `study case-study` wrote; may be given several times"
Recordings = Annotated[list[Path] | None, typer.Option("--recording", metavar="DIR", help=_RECORDING)]
Page = Annotated[Path | None, typer.Option("--out", help="file of the page [default: RUN/report.html]")]
Bench = Annotated[Path | None, typer.Option("--bench", help="table that `make bench` stores")]


def claims(folders: Folders, cost: Cost = None, recording: Recordings = None, as_json: Json = False) -> None:
    """Judge the paper's claims by runs.

    The verdicts and the numbers behind them are printed, and stored in the first run's folder, where that run must be
    finished. If no claim can be judged, earlier verdicts stay. If the folder cannot be written, the exit code is 1.

    With --json: runs, a list of names; verdicts, the count of each; claims, a list of the columns of the stored table:
    number, name, section, statement, quantity, value, error, trials, verdict, finding, criterion, remark, reads, runs
    and figure.
    """
    from study.analysis.claims import as_data, judge_all, key, printed, save, stored
    from study.mocap.case_study.stored_case_studies import read_case_studies
    from study.runs.storage.run_folder import Run
    from study.text.json_text import json_text

    runs = [Run.open(folder) for folder in folders]
    runs[0].manifest()  # without a sound one, no verdict could be stored
    spreads = read_case_studies(recording) if recording else None
    known = key(runs, cost, spreads)
    before = stored(runs[0], known)
    judged = judge_all(runs, cost, spreads) if before is None else before
    try:
        if before is None:
            save(runs[0], judged, known)
    finally:  # verdicts that cannot be stored are printed all the same
        for line in [json_text(as_data(runs, judged))] if as_json else printed(judged):
            typer.echo(line)


def report(
    folders: Folders,
    out: Page = None,
    cost: Cost = None,
    recording: Recordings = None,
    bench: Bench = None,
    jobs: Jobs = 2,
) -> None:
    """Write one HTML page about runs.

    It has the claims, figures, tables and provenance, and needs no other file.
    """
    from study.analysis.claims import judge_all, key, stored
    from study.mocap.case_study.stored_case_studies import read_case_studies
    from study.report.page import render, save
    from study.report.speed import read_bench
    from study.runs.storage.run_folder import Run

    runs = [Run.open(folder) for folder in folders]
    measured = read_bench(bench) if bench else None
    spreads = read_case_studies(recording) if recording else None
    judged = stored(runs[0], key(runs, cost, spreads))
    if judged is None:
        judged = judge_all(runs, cost, spreads)
    typer.echo(str(save(render(runs, judged, measured, jobs), out or runs[0].folder / "report.html")))

"""The command `study coverage`."""

from pathlib import Path
from typing import Annotated

import typer

_CONFIG = "config of a coverage study, such as configs/coverage.toml"
Config = Annotated[Path, typer.Argument(metavar="CONFIG", help=_CONFIG)]
Jobs = Annotated[int, typer.Option("--jobs", "-j", min=1, max=1024, help="number of threads")]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the results; results/NAME if absent")]


def coverage(config: Config, jobs: Jobs = 2, out: Out = None) -> None:
    """Measure how often intervals hold the truth.

    The table is stored as coverage.parquet and coverage.csv, with its figure, and printed.
    """
    from study.coverage.config import read_design
    from study.coverage.coverage_text import printed
    from study.coverage.fig_coverage import draw
    from study.coverage.measure import measure
    from study.figures.style import save
    from study.runs.commands import RUNS
    from study.runs.storage.atomic_write import save_frame

    design = read_design(config)
    folder = out or RUNS / design.name
    table = measure(design, jobs)
    for suffix in ("parquet", "csv"):
        save_frame(table, folder / f"coverage.{suffix}")
    fewer = ", fewer for large N" if table["trials"].nunique() > 1 else ""
    stamp = f"{design.name} · seed {design.seed} · {int(table['trials'].max()):,} trials a cell{fewer}"
    for path in save(draw(table, stamp), folder / "fig_coverage"):
        typer.echo(str(path))
    for line in printed(table):
        typer.echo(line)

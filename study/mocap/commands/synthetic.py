"""The command `study synthetic`: a recording of a body whose joints are known."""

from pathlib import Path
from typing import Annotated

import typer

from study.mocap.commands.options import grouped
from study.mocap.synthetic.recipe import SKIN, Recipe
from study.runs.commands import Json

Out = Annotated[
    Path | None,
    typer.Option(
        "--out", help=".c3d, .trc or .csv [default: results/recordings/synthetic-<seed>/synthetic-<seed>.c3d]"
    ),
]


@grouped
def synthetic(*, out: Out = None, as_json: Json = False, recipe: Recipe) -> None:
    """Make a recording of a synthetic body.

    Writes the recording, and tables of the true joints beside it. With --json: recording, frames, rate and files.
    """
    from study.mocap.commands.open_recording import print_lines, results_folder
    from study.mocap.io.recording import RecordingError
    from study.mocap.io.writing import write_recording
    from study.mocap.synthetic.body_truth import write_truth
    from study.mocap.synthetic.synthesize import synthesize
    from study.text.json_text import json_text

    if recipe.skin != SKIN[0] and not recipe.soft_tissue:
        raise RecordingError(f"--skin {recipe.skin}: skin moves by 0 m; give its largest motion with --soft-tissue")
    made, truth = synthesize(recipe)
    path = write_recording(made, out or results_folder(made.name) / f"{made.name}.c3d")
    paths = [path, *write_truth(truth, path)]
    data = {"recording": made.name, "frames": made.frames, "rate": made.rate, "files": paths}
    print_lines([json_text(data)] if as_json else paths)

"""The command `study case-study`: the paper's precision study, section 9.1, on a recording."""

from typing import Annotated

import typer

from study.mocap.commands.options import File, MarkerSetName, Out, Reading, grouped
from study.runs.commands import Json

Subsets = Annotated[int, typer.Option("--subsets", help="subsets of each size and joint, a multiple of four")]
Seed = Annotated[int, typer.Option("--seed", help="seed of the subsets")]


@grouped
def case_study(
    file: File,
    *,
    markerset: MarkerSetName = None,
    out: Out = None,
    subsets: Subsets = 400,
    seed: Seed = 1,
    as_json: Json = False,
    reading: Reading,
) -> None:
    """Repeat the paper's precision study, section 9.1.

    Fits each joint to many parts of a recording; writes tables of the scatter, and figure 7.

    With --json: recording, frames, subsets; laws and joints, as in the tables; skipped, and files.
    """
    from study.figures.style import save
    from study.mocap.case_study import fig7_case, precision_study
    from study.mocap.commands.as_data import case_study_data
    from study.mocap.commands.open_recording import open_recording, print_lines, print_match, results_folder
    from study.mocap.io.origin import digest_of, with_origin
    from study.mocap.joints.fit_joints import find_joints
    from study.runs.storage.atomic_write import save_frame
    from study.text.json_text import json_text

    match, digest = open_recording(file, markerset, reading), digest_of(file)
    folder = results_folder(match.source.name, out)
    if not as_json:
        print_match(match)
    case = precision_study.case_study(find_joints(match.markerset, match.recording), match.recording, subsets, seed)
    print_lines([] if as_json else fig7_case.printed(case))
    paths = []
    for name, table in {"scatter": case.scatter, "joints": case.joints, "laws": case.laws}.items():
        path = folder / f"case-study-{name}.parquet"
        save_frame(with_origin(table, case.recording, digest), path)
        paths.append(path)
    paths += save(fig7_case.draw(fig7_case.prepare(case)), folder / "fig7_case")
    print_lines([json_text(case_study_data(case) | {"files": paths})] if as_json else paths)

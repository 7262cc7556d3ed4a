"""The command `study joints`: phase 1, the joints of a recording, or of several trials of one session."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from study.mocap.commands.options import MarkerSetName, Out, Reading, grouped
from study.runs.commands import Json

if TYPE_CHECKING:
    from study.mocap.io.recording import Recording

Files = Annotated[
    list[Path],
    typer.Argument(metavar="FILE...", help="a recording, or several of one session: .c3d, .trc, .csv, .tsv or .txt"),
]
Static = Annotated[
    Path | None, typer.Option("--static", help="a trial that gives the shapes of the segments, such as a static one")
]
Force = Annotated[bool, typer.Option("--force", help="merge trials even if they seem to show different subjects")]


@grouped
def joints(
    files: Files,
    *,
    static: Static = None,
    force: Force = False,
    markerset: MarkerSetName = None,
    out: Out = None,
    as_json: Json = False,
    reading: Reading,
) -> None:
    """Find the joints of a recording: phase 1.

    Writes their table, and a calibration with which `study skeleton` draws other recordings of the same subject.
    Several trials of a session give one calibration: each joint comes from the trials that moved it.

    With --json: recording, notes, markerset, joints (the columns of the table), files, and for one recording
    without_pose.
    """
    if len(files) == 1 and static is None:
        if force:
            raise typer.BadParameter("--force: there is nothing to overrule with one recording")
        _one(files[0], markerset, out, as_json, reading)
    else:
        trials = [reading.read(file) for file in files]
        _several(trials, None if static is None else reading.read(static), markerset, out, force, as_json)


def _one(file: Path, markerset: str | None, out: Path | None, as_json: bool, reading: Reading) -> None:
    """The joints of one recording."""
    from study.mocap.commands.as_data import joints_data
    from study.mocap.commands.open_recording import open_recording, print_lines, print_match, results_folder
    from study.mocap.joints.fit_joints import find_joints
    from study.mocap.joints.joint_report import agreement_lines, joint_lines
    from study.mocap.joints.joint_table import joint_table
    from study.mocap.joints.method_agreement import agreement_table
    from study.mocap.skeleton.calibrate import calibration_from
    from study.mocap.skeleton.calibration_file import save_calibration
    from study.runs.storage.atomic_write import save_frame
    from study.text.json_text import json_text

    match = open_recording(file, markerset, reading)
    folder = results_folder(match.source.name, out)
    found = find_joints(match.markerset, match.recording)
    compared = agreement_table(found, match.recording)
    calibration = calibration_from(found, match.recording)
    if not as_json:
        print_match(match)
        print_lines([*joint_lines(found), *agreement_lines(compared), *calibration.warnings()])
    table = joint_table(found).merge(compared, on="joint")
    table["warnings"] = ["; ".join(place.warnings) for place in calibration.joints]
    save_frame(table, folder / "joints.parquet")
    paths = [folder / "joints.parquet", save_calibration(calibration, folder / "calibration.json")]
    if as_json:
        typer.echo(json_text(joints_data(match, table) | {"without_pose": found.without_pose, "files": paths}))
    else:
        print_lines(paths)


def _several(
    trials: "list[Recording]",
    static: "Recording | None",
    markerset: str | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """The joints of a session."""
    from study.mocap.commands.as_data import joints_data
    from study.mocap.commands.open_recording import place_markerset, print_lines, print_match, results_folder
    from study.mocap.io.recording import one_after_another
    from study.mocap.markersets.match import match
    from study.mocap.session.session import calibrate_session
    from study.mocap.session.session_text import session_lines, session_table
    from study.mocap.skeleton.calibration_file import save_calibration
    from study.runs.storage.atomic_write import save_frame
    from study.text.json_text import json_text

    every = [*trials, *([] if static is None else [static])]
    names = ", ".join(trial.name for trial in every)
    together = place_markerset(one_after_another(every, names), markerset)
    folder = results_folder("-".join(trial.name for trial in every), out)
    named = [match(together.whole, trial).recording for trial in every]
    session = calibrate_session(
        together.markerset, named[: len(trials)], None if static is None else named[-1], force=force
    )
    table = session_table(session)
    if not as_json:
        print_match(together)
        print_lines(session_lines(session))
    save_frame(table, folder / "joints.parquet")
    paths = [folder / "joints.parquet", save_calibration(session.merged.calibration, folder / "calibration.json")]
    if as_json:
        typer.echo(json_text(joints_data(together, table) | {"files": paths}))
    else:
        print_lines(paths)

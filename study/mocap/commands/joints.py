"""The command `study joints`: phase 1, the joints of a recording, or of several trials of one session."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from study.mocap.commands.options import MarkerSetName, Out, Reading, grouped

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
    reading: Reading,
) -> None:
    """Find the joints of a recording: phase 1.

    Writes their table, and a calibration with which `study skeleton` draws other recordings of the same subject.
    Several trials of a session give one calibration: each joint comes from the trials that moved it.
    """
    if len(files) == 1 and static is None:
        if force:
            raise typer.BadParameter("--force: there is nothing to overrule with one recording")
        _one(files[0], markerset, out, reading)
    else:
        trials = [reading.read(file) for file in files]
        _several(trials, None if static is None else reading.read(static), markerset, out, force)


def _one(file: Path, markerset: str | None, out: Path | None, reading: Reading) -> None:
    """The joints of one recording."""
    from study.mocap.commands.open_recording import open_recording, print_lines, print_match, results_folder
    from study.mocap.joints.fit_joints import find_joints
    from study.mocap.joints.joint_report import agreement_lines, joint_lines
    from study.mocap.joints.joint_table import joint_table
    from study.mocap.joints.method_agreement import agreement_table
    from study.mocap.skeleton.calibrate import calibration_from
    from study.mocap.skeleton.calibration_file import save_calibration
    from study.runs.storage.atomic_write import save_frame

    match = open_recording(file, markerset, reading)
    folder = results_folder(match.source.name, out)
    print_match(match)
    found = find_joints(match.markerset, match.recording)
    print_lines(joint_lines(found))
    compared = agreement_table(found, match.recording)
    print_lines(agreement_lines(compared))
    table = folder / "joints.parquet"
    save_frame(joint_table(found).merge(compared, on="joint"), table)
    calibration = calibration_from(found, match.recording)
    print_lines([table, save_calibration(calibration, folder / "calibration.json")])


def _several(
    trials: "list[Recording]", static: "Recording | None", markerset: str | None, out: Path | None, force: bool
) -> None:
    """The joints of a session."""
    from study.mocap.commands.open_recording import place_markerset, print_lines, print_match, results_folder
    from study.mocap.io.recording import one_after_another
    from study.mocap.markersets.match import match
    from study.mocap.session.session import calibrate_session
    from study.mocap.session.session_text import session_lines, session_table
    from study.mocap.skeleton.calibration_file import save_calibration
    from study.runs.storage.atomic_write import save_frame

    every = [*trials, *([] if static is None else [static])]
    names = ", ".join(trial.name for trial in every)
    together = place_markerset(one_after_another(every, names), markerset)
    folder = results_folder("-".join(trial.name for trial in every), out)
    print_match(together)
    named = [match(together.whole, trial).recording for trial in every]
    session = calibrate_session(
        together.markerset, named[: len(trials)], None if static is None else named[-1], force=force
    )
    print_lines(session_lines(session))
    table = folder / "joints.parquet"
    save_frame(session_table(session), table)
    print_lines([table, save_calibration(session.merged.calibration, folder / "calibration.json")])

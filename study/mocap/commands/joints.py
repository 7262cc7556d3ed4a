"""The command `study joints`: phase 1, the joints of a recording."""

from typing import Any

import typer

from study.mocap.commands.options import File, MarkerSetName, Out, Reading, grouped
from study.runs.commands import Json


@grouped
def joints(
    file: File, *, markerset: MarkerSetName = None, out: Out = None, as_json: Json = False, reading: Reading
) -> None:
    """Find the joints of a recording: phase 1.

    Writes their table, and a calibration with which `study skeleton` draws other recordings of the same subject.

    With --json: recording, notes, markerset, joints (the columns of the table), without_pose and files.
    """
    from study.mocap.commands.as_data import match_data
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
    if not as_json:
        print_match(match)
        print_lines([*joint_lines(found), *agreement_lines(compared)])
    table = joint_table(found).merge(compared, on="joint")
    save_frame(table, folder / "joints.parquet")
    calibration = calibration_from(found, match.recording)
    paths = [folder / "joints.parquet", save_calibration(calibration, folder / "calibration.json")]
    if not as_json:
        print_lines(paths)
        return
    data: dict[str, Any] = {
        "recording": match.source.name,
        "notes": list(match.source.notes),
        "markerset": match_data(match),
    }
    data |= {"joints": table.to_dict("records"), "without_pose": found.without_pose, "files": paths}
    typer.echo(json_text(data))

"""The command `study joints`: phase 1, the joints of a recording."""

from study.mocap.commands.options import File, MarkerSetName, Out, Reading, grouped


@grouped
def joints(file: File, *, markerset: MarkerSetName = None, out: Out = None, reading: Reading) -> None:
    """Find the joints of a recording: phase 1.

    Writes their table, and a calibration with which `study skeleton` draws other recordings of the same subject.
    """
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
    calibration = calibration_from(found, match.recording)
    print_lines(calibration.warnings())
    table = joint_table(found).merge(compared, on="joint")
    table["warnings"] = ["; ".join(place.warnings) for place in calibration.joints]
    save_frame(table, folder / "joints.parquet")
    print_lines([folder / "joints.parquet", save_calibration(calibration, folder / "calibration.json")])

"""Joint angles as OpenSim's motion files (.mot).

Source: OpenSim documentation, "Motion (.mot) Files".
"""

from pathlib import Path

from study.mocap.export.joint_angles import joint_angles
from study.mocap.export.motion import ExportedMotion


def write_mot(motion: ExportedMotion, path: Path) -> None:
    """Write joint angles in degrees, and the root's place in metres.

    OpenSim's readers cannot read a missing number, nor the numbers after it. So angles that are known in no frame are
    left out, and an angle that is unknown in a frame keeps its last value; the table of angles shows these frames.

    Raises:
        OSError: if the file cannot be written.
    """
    table = joint_angles(motion).dropna(axis=1, how="all").ffill().bfill()
    header = [
        motion.skeleton.name,
        "version=1",
        f"nRows={len(table)}",
        f"nColumns={len(table.columns)}",
        "inDegrees=yes",
        "endheader",
    ]
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(header) + "\n")
        table.to_csv(file, sep="\t", index=False, float_format="%.6f", lineterminator="\n")

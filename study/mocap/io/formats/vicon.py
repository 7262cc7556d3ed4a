"""Read the text export of Vicon Nexus."""

from study.mocap.io.assembly import FileContents
from study.mocap.io.formats.rows import Rows, as_points, find_delimiter, until_blank, with_all_frames
from study.mocap.io.recording import RecordingError


def read_vicon(lines: list[str], start: int) -> FileContents:
    """Read an export of Vicon Nexus: Trajectories, rate, labels, axes, units, then rows up to an empty line."""
    if len(lines) < start + 6:
        raise RecordingError(f"the file is cut short: no rows after the line Trajectories (line {start + 1})")
    delimiter = find_delimiter(lines[start + 3])
    try:
        rate = float(lines[start + 1].strip().strip(delimiter))
    except ValueError:
        raise RecordingError(f"line {start + 2}: {lines[start + 1][:40]!r} should be the rate") from None
    axes = [cell.strip().lower() for cell in lines[start + 3].split(delimiter)]
    heads = [cell.strip().strip('"') for cell in lines[start + 2].split(delimiter)]
    heads += [""] * (len(axes) - len(heads))
    # velocities and accelerations (X', X'') may follow the coordinates
    places = [i for i in range(len(axes) - 2) if axes[i : i + 3] == ["x", "y", "z"]]
    units = [cell.strip() for cell in lines[start + 4].split(delimiter)]
    rows = until_blank(lines, start + 5)
    numbers = Rows(rows, start + 6, delimiter).numbers(len(axes))
    numbers, notes = with_all_frames(numbers[:, 0], numbers, start + 6)
    unit = next((units[i] for i in places if i < len(units) and units[i]), None)
    columns = [column for i in places for column in (i, i + 1, i + 2)]
    return FileContents([heads[i] for i in places], as_points(numbers[:, columns]), rate, unit, notes=notes)

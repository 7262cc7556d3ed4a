"""Write a recording to a file: C3D, TRC, or a table with a column per coordinate."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from study.mocap.io.c3d_header import LONG
from study.mocap.io.recording import Recording, RecordingError
from study.runs.storage.atomic_write import replacing


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Write a recording as C3D, TRC or CSV; the suffix of the path decides.

    The folder is made if there is none. The file is there whole, or as it was.

    Returns:
        The path.

    Raises:
        RecordingError: if the suffix is another, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITERS:
        raise RecordingError(f"{path}: a recording is written to a file whose name ends in {', '.join(WRITERS)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing_named(path) as temporary:
            WRITERS[path.suffix.lower()](recording, temporary)
    except ModuleNotFoundError as error:
        raise RecordingError(f"{path}: writing it needs {error.name}: pip install '.[mocap]'") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


@contextlib.contextmanager
def replacing_named(path: Path) -> Iterator[Path]:
    """Give a temporary name with the same end, in small letters; see `replacing`."""
    with replacing(path) as temporary:
        named = temporary.with_suffix(path.suffix.lower())  # ezc3d wants a name that ends in .c3d
        try:
            with open(named, "wb"):  # ezc3d does not say why it cannot write
                pass
            yield named
            os.replace(named, temporary)
        finally:
            named.unlink(missing_ok=True)


def _write_c3d(recording: Recording, path: Path) -> None:
    """Write millimetres in single precision, as is usual in C3D files; a missing sample has the residual -1."""
    import ezc3d

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["LABELS"]["value"] = list(recording.markers)
    point["UNITS"]["value"] = ["mm"]
    point["RATE"]["value"] = [recording.rate]
    if recording.frames >= LONG:  # more than the header can hold
        file.add_parameter("POINT", "LONG_FRAMES", [float(recording.frames)])
    points = np.ones((4, *recording.positions.shape[::2]))
    points[:3] = 1000 * recording.positions.transpose(1, 0, 2)
    file["data"]["points"] = points
    file.write(str(path))


def _write_trc(recording: Recording, path: Path) -> None:
    """Write millimetres to four decimals, a label above its three columns; a missing sample is nan.

    OpenSim refuses a row that ends in empty cells, and readers that split at white space shift the markers behind them.
    """
    count, frames, rate = len(recording.markers), recording.frames, f"{recording.rate:.10g}"
    keys = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame")
    values = (rate, rate, frames, count, "mm", rate, 1, frames)
    header = [
        f"PathFileType\t4\t(X/Y/Z)\t{recording.name}.trc",
        "\t".join((*keys, "OrigNumFrames")),
        "\t".join(map(str, values)),
        "Frame#\tTime\t" + "\t".join(f"{marker}\t\t" for marker in recording.markers),
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, count + 1)),
        "",
    ]
    table = pd.DataFrame(1000 * recording.positions.reshape(-1, frames).T)
    times = pd.Series(np.arange(frames) / recording.rate).map("{:.6f}".format)
    table.insert(0, "time", times)
    table.insert(0, "frame", np.arange(1, frames + 1))
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(header) + "\n")
        table.to_csv(file, sep="\t", header=False, index=False, na_rep="nan", float_format="%.4f", lineterminator="\n")


def _write_csv(recording: Recording, path: Path) -> None:
    """Write millimetres to three decimals; the cells of missing samples are empty."""
    columns = [f"{marker}_{axis}" for marker in recording.markers for axis in "XYZ"]
    rows = recording.positions.reshape(-1, recording.frames).T
    table = pd.DataFrame(1000 * rows, columns=columns)
    table.insert(0, "frame", np.arange(1, recording.frames + 1))
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(f"# rate: {recording.rate!r}\n# unit: mm\n")
        table.to_csv(file, index=False, float_format="%.3f", lineterminator="\n")


WRITERS: dict[str, Callable[[Recording, Path], None]] = {".c3d": _write_c3d, ".trc": _write_trc, ".csv": _write_csv}
"""The writer of each end of a name."""

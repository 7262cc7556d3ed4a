"""Get and store recordings: download one from a public library, once, and write one as C3D, TRC or a table.

The library of the CMU Graphics Lab is at mocap.cs.cmu.edu; its recordings may be used freely, but not resold. It asks
for this acknowledgement: "The data used in this project was obtained from mocap.cs.cmu.edu. The database was created
with funding from NSF EIA-0196217."
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from study.recordings.recording import Recording, RecordingError, written
from study.text import did_you_mean

_TIMEOUT = 30.0  # seconds


class DownloadError(RecordingError):
    """A download failed although the library may have the recording; it may work at another time or place."""


_TERMS = "free for research and in products, not to be resold; acknowledge mocap.cs.cmu.edu, NSF EIA-0196217"
LIBRARIES = {"cmu": _TERMS}
"""The known libraries, and their terms of use in short."""
CMU = "http://mocap.cs.cmu.edu/subjects"
"""Address of the folder with all recordings of the library cmu."""
_NAME = re.compile(r"([0-9]{1,3})[_-]([0-9]{1,2})(\.c3d)?")
"""Names that its recordings can have: subject and trial."""


def fetch(library: str, name: str, *, base: str | None = None, folder: Path | None = None) -> Path:
    """Download a recording from a library, or find it in the cache.

    Args:
        library: ``cmu``.
        name: of the recording, such as 60_08: subject and trial.
        base: address of the library's folder; if None, STUDY_CMU_URL of the environment, or else the library's own.
        folder: for the file; the user's cache folder if None.

    Returns:
        Path of the file.

    Raises:
        RecordingError: one line: no such library, not a name of this library, no such recording.
        DownloadError: one line: no network, a server that refuses, a file cut short, a cache that cannot be written.
    """
    try:
        import pooch
        import requests

        from study.recordings.formats.c3d import read_c3d
    except ModuleNotFoundError as error:
        raise RecordingError(f"downloading needs {error.name}: pip install '.[mocap]'") from None
    if library not in LIBRARIES:
        raise RecordingError(f"no library {library!r}: {did_you_mean(library, LIBRARIES)}")
    parts = _NAME.fullmatch(name)
    if parts is None:
        raise RecordingError(f"{name!r} cannot be a recording of {library}; give a name such as 60_08")
    subject, trial = (parts[i].lstrip("0").zfill(2) for i in (1, 2))
    address = (base or os.environ.get("STUDY_CMU_URL") or CMU).rstrip("/")
    folder = Path(pooch.os_cache("sphere-fit-study")) / library if folder is None else folder
    url, target = f"{address}/{subject}/{subject}_{trial}.c3d", folder / f"{subject}_{trial}.c3d"
    pooch.get_logger().setLevel("WARNING")  # else it reports every download and suggests a checksum

    def download(address: str, output: str, _: object) -> None:
        """Download a file and read it; the library publishes no checksums."""
        pooch.HTTPDownloader(timeout=_TIMEOUT)(address, output, None)
        read_c3d(Path(output))

    kind: type[RecordingError] = DownloadError
    try:
        pooch.retrieve(url, known_hash=None, fname=target.name, path=folder, downloader=download)
    except requests.HTTPError as error:
        status = getattr(error.response, "status_code", None)
        if status == 404:
            kind, words = RecordingError, f"there is no recording {name}"
        else:
            words = f"the server answered {status}; try again later"
    except (requests.ConnectionError, requests.Timeout, requests.exceptions.ChunkedEncodingError) as error:
        words = f"the server cannot be reached, or broke off ({_reason(error)}); check the network"
    except requests.RequestException as error:
        words = f"cannot be downloaded: {_reason(error)}"
    except RecordingError as error:
        words = f"the server sent something else than a recording: {error}"
    except OSError as error:
        words = f"cannot be written to {folder}: {error.strerror or error}"
    else:
        return target
    raise kind(f"{url}: {words}")


def _reason(error: BaseException) -> str:
    """The first line of the innermost cause of an error."""
    while error.__context__ is not None:
        error = error.__context__
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return str(text).splitlines()[0][:120]


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
    return written(path, lambda temporary: WRITERS[path.suffix.lower()](recording, temporary))


def _write_c3d(recording: Recording, path: Path) -> None:
    """Write millimetres in single precision, as is usual in C3D files; a missing sample has the residual -1."""
    import ezc3d

    from study.recordings.formats.c3d import LONG

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
    file["data"]["meta_points"]["residuals"] = np.where(recording.seen(), 0.0, -1.0)[None]  # else zero, beside nan
    file.write(str(path))


def _write_trc(recording: Recording, path: Path) -> None:
    """Write millimetres to four decimals, a label above its three columns; a missing sample is nan.

    OpenSim refuses a row that ends in empty cells, and readers that split at white space shift the markers behind them.
    """
    count, frames, rate = len(recording.markers), recording.frames, f"{recording.rate:.10g}"
    keys = "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"
    values = map(str, (rate, rate, frames, count, "mm", rate, 1, frames))
    labels = "Frame#\tTime\t" + "\t".join(f"{marker}\t\t" for marker in recording.markers)
    axes = "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, count + 1))
    header = [f"PathFileType\t4\t(X/Y/Z)\t{recording.name}.trc", keys, "\t".join(values), labels, axes, ""]
    table = pd.DataFrame(1000 * recording.positions.reshape(-1, frames).T)
    table.insert(0, "time", pd.Series(np.arange(frames) / recording.rate).map("{:.6f}".format))
    table.insert(0, "frame", np.arange(1, frames + 1))
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(header) + "\n")
        table.to_csv(file, sep="\t", header=False, index=False, na_rep="nan", float_format="%.4f", lineterminator="\n")


def _write_csv(recording: Recording, path: Path) -> None:
    """Write millimetres to three decimals; the cells of missing samples are empty."""
    columns = [f"{marker}_{axis}" for marker in recording.markers for axis in "XYZ"]
    table = pd.DataFrame(1000 * recording.positions.reshape(-1, recording.frames).T, columns=columns)
    table.insert(0, "frame", np.arange(1, recording.frames + 1))
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(f"# rate: {recording.rate!r}\n# unit: mm\n")
        table.to_csv(file, index=False, float_format="%.3f", lineterminator="\n")


WRITERS: dict[str, Callable[[Recording, Path], None]] = {".c3d": _write_c3d, ".trc": _write_trc, ".csv": _write_csv}
"""The writer of each end of a name."""

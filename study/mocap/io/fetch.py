"""Download recordings from a public library by name, once, into the user's cache folder.

The library of the CMU Graphics Lab is at mocap.cs.cmu.edu; its recordings may be used freely, but not resold. It asks
for this acknowledgement: "The data used in this project was obtained from mocap.cs.cmu.edu. The database was created
with funding from NSF EIA-0196217."
"""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from study.mocap.io.recording import RecordingError
from study.text.nearest import did_you_mean

_TIMEOUT = 30.0  # seconds


class DownloadError(RecordingError):
    """A download failed although the library may have the recording; it may work at another time or place."""


@dataclass(frozen=True)
class Library:
    """A library: its address, and the names of its recordings."""

    base: str
    """Address of the folder with all recordings."""
    name: re.Pattern[str]
    """Names that its recordings can have."""
    example: str
    """One of these names."""
    where: Callable[[re.Match[str]], str]
    """The path of a recording below the base, from its name."""
    terms: str
    """Terms of use, in short."""


def _cmu_place(found: re.Match[str]) -> str:
    subject, trial = found["subject"].lstrip("0").zfill(2), found["trial"].lstrip("0").zfill(2)
    return f"{subject}/{subject}_{trial}.c3d"


LIBRARIES = {
    "cmu": Library(
        base="http://mocap.cs.cmu.edu/subjects",
        name=re.compile(r"(?P<subject>[0-9]{1,3})[_-](?P<trial>[0-9]{1,2})(\.c3d)?"),
        example="60_08",
        where=_cmu_place,
        terms="free for research and in products, not to be resold; acknowledge mocap.cs.cmu.edu, NSF EIA-0196217",
    )
}
"""The known libraries."""


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

        from study.mocap.io.c3d_file import read_c3d
    except ModuleNotFoundError as error:
        raise RecordingError(f"downloading needs {error.name}: pip install '.[mocap]'") from None
    if library not in LIBRARIES:
        raise RecordingError(f"no library {library!r}: {did_you_mean(library, LIBRARIES)}")
    source = LIBRARIES[library]
    found = source.name.fullmatch(name)
    if found is None:
        raise RecordingError(f"{name!r} cannot be a recording of {library}; give a name such as {source.example}")
    place = source.where(found)
    address = (base or os.environ.get(f"STUDY_{library.upper()}_URL") or source.base).rstrip("/")
    folder = Path(pooch.os_cache("sphere-fit-study")) / library if folder is None else folder
    url, target = f"{address}/{place}", folder / Path(place).name
    if target.is_file():
        return target
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

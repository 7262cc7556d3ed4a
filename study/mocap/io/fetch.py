"""Recordings from a public library, by name: downloaded once, kept in the user's cache folder.

The library of the CMU Graphics Lab is at mocap.cs.cmu.edu; its recordings may be used freely, but not sold on. It asks
for the words: "The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding
from NSF EIA-0196217."
"""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from study.mocap.io.recording import RecordingError

_SECONDS = 30.0


class DownloadError(RecordingError):
    """A download that failed although the library may have the recording: another time, or elsewhere, it may not."""


@dataclass(frozen=True)
class Library:
    """Where recordings are, and how they are called there."""

    base: str
    """Address below which they are."""
    name: re.Pattern[str]
    example: str
    where: Callable[[re.Match[str]], str]
    """The file's place below the base."""
    terms: str


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
"""The libraries that recordings can be had from."""


def fetch(library: str, name: str, *, base: str | None = None, folder: Path | None = None) -> Path:
    """Get a recording from a library, or from the cache if it was there before.

    Args:
        library: ``cmu``.
        name: of the recording, as 60_08: subject and trial.
        base: address below which the library's files are; the environment's STUDY_CMU_URL, or else the library's own,
            if None.
        folder: where to keep it; the user's cache folder if None.

    Returns:
        Path of the file.

    Raises:
        RecordingError: one line: no such library, a name that it cannot have, no such recording.
        DownloadError: one line: no network, a server that refuses, cut short, a cache that cannot be written.
    """
    try:
        import pooch
        import requests

        from study.mocap.io.c3d_file import read_c3d
    except ModuleNotFoundError as error:
        raise RecordingError(f"downloading needs {error.name}: pip install '.[mocap]'") from None
    if library not in LIBRARIES:
        raise RecordingError(f"no library {library!r}; there are {', '.join(LIBRARIES)}")
    source = LIBRARIES[library]
    found = source.name.fullmatch(name)
    if found is None:
        raise RecordingError(f"{name!r} is no recording of {library}; they are called as {source.example} is")
    place = source.where(found)
    address = (base or os.environ.get(f"STUDY_{library.upper()}_URL") or source.base).rstrip("/")
    folder = Path(pooch.os_cache("sphere-fit-study")) / library if folder is None else folder
    url, target = f"{address}/{place}", folder / Path(place).name
    if target.is_file():
        return target
    pooch.get_logger().setLevel("WARNING")  # it tells of every download, and suggests a checksum

    def download(address: str, output: str, _: object) -> None:
        """Download, and accept only what can be read: no checksums are published."""
        pooch.HTTPDownloader(timeout=_SECONDS)(address, output, None)
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
        words = f"the server cannot be reached, or broke off ({_reason(error)}); is there a network?"
    except requests.RequestException as error:
        words = f"cannot be downloaded: {_reason(error)}"
    except RecordingError as error:
        words = f"what the server sent is no recording: {error}"
    except OSError as error:
        words = f"cannot be kept in {folder}: {error.strerror or error}"
    else:
        return target
    raise kind(f"{url}: {words}")


def _reason(error: BaseException) -> str:
    """What lies at the bottom of a library's error, in few words."""
    while error.__context__ is not None:
        error = error.__context__
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return str(text).splitlines()[0][:120]

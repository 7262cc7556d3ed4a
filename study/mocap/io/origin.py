"""The origin of a stored table: the name of the recording's file, and a digest of its bytes.

The digest decides: a renamed or copied file is the same recording, another file of the same name is not.
"""

import hashlib
from pathlib import Path

import pandas as pd

from study.mocap.io.recording import RecordingError

ORIGIN = ("recording", "digest")
"""The columns: the file's stem, and the first `DIGITS` hexadecimal digits of its SHA-256."""
DIGITS = 12


def digest_of(file: Path) -> str:
    """The first `DIGITS` hexadecimal digits of a file's SHA-256.

    Raises:
        RecordingError: if the file cannot be read.
    """
    try:
        with file.open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()[:DIGITS]
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror or error}") from None


def with_origin(table: pd.DataFrame, recording: str, digest: str) -> pd.DataFrame:
    """The table with the columns `ORIGIN` before its own, the same in every row."""
    return pd.DataFrame(dict(zip(ORIGIN, (recording, digest), strict=True)), index=table.index).join(table)

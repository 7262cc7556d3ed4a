"""Digests of files: SHA-256 of their bytes, computed once per process as long as a file stays as it is."""

import hashlib
import json
import os
import time
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from study.runs.storage.atomic_write import RunError
from study.text.regular_file import regular

_SETTLED = 0.1
"""A file that did not change for so many seconds gets another time stamp at its next change; clocks are finer."""


def of_file(path: Path) -> str | None:
    """SHA-256 of a file's bytes, hexadecimal; None if there is no such file.

    Raises:
        RunError: if it cannot be read.
    """
    try:
        found = os.stat(regular(path))
        if time.time() - max(found.st_mtime, found.st_ctime) < _SETTLED:
            return _computed(path)
        return _remembered(os.path.abspath(path), found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror or error}; make it readable, or remove it") from None


def of_json(content: Mapping[str, object]) -> str:
    """SHA-256 of a JSON object, hexadecimal; the order of its keys counts."""
    return hashlib.sha256(json.dumps(content, ensure_ascii=False).encode(errors="surrogatepass")).hexdigest()


@lru_cache(maxsize=1024)
def _remembered(path: str, inode: int, size: int, modified: int, changed: int) -> str:
    return _computed(Path(path))


def _computed(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

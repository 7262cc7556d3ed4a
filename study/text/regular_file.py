"""Files that end: pipes and devices are refused, since to read one may take for ever."""

import errno
import os
import stat
from pathlib import Path


def regular(path: Path) -> Path:
    """The path of a table, which is not opened.

    Raises:
        OSError: if it is a pipe or a device, or not there.
    """
    kind = os.stat(path).st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):  # to open a folder fails by itself, with the system's words
        raise OSError(errno.EINVAL, "not a regular file; store what the pipe or device gives in one")
    return path

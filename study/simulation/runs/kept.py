"""Results that are made from a run's tables alone, such as pictures; its folder keeps them, so they are made once.

    RUN/kept/<name>    a line with the key, the name and the SHA-256 of the rest, then the rest

The key says what a result was made of: the bytes of every table, this program and its libraries, and what was asked.
A result is used again only where the key is the same, and its own bytes are those that were written under its name. The
folder is no part of the run: it may be removed at any time, and is neither verified, nor compared, nor archived.
"""

import contextlib
import hashlib
import os
import platform
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from study import files
from study.files import RunError, write
from study.simulation.runs.provenance import packages
from study.simulation.runs.run_folder import Run

FOLDER = "kept"
_PACKAGE = Path(__file__).parents[2]


def key(runs: Sequence[Run], *asked: str | int | None) -> str | None:
    """Key of all that a result is made of.

    Args:
        runs: the runs whose tables it may read.
        asked: what else it depends on, such as its name, or the digest of another file.

    Returns:
        A digest; None where a table is missing or not as its manifest says, so that no kept result may be used.
    """
    try:
        found = {"program": _program(), "asked": asked, "runs": [_content(run) for run in runs]}
    except (RunError, OSError):
        return None
    return files.of_json(found)


def _content(run: Run) -> tuple[str, dict[str, str]]:
    """Config and digests of a run's tables, each compared with its file; verdicts are results themselves."""
    tables = {name: digest for name, digest in run.manifest()["tables"].items() if name != "claims"}
    there = {path.stem for path in run.folder.glob("*.parquet")} - {"claims"}
    if there != set(tables):
        raise RunError(f"{run.folder}: tables without a digest, or digests without a table")
    for name in tables:
        run.check(name)
    return (run.folder / "config.toml").read_text(encoding="utf-8"), tables


@cache
def _program() -> tuple[str, ...]:
    """This program's sources, the libraries' versions, and the processor for which code is generated."""
    sources = sorted(_PACKAGE.rglob("*.py"))
    digest = hashlib.sha256()
    for path in sources:
        text = path.read_bytes()
        digest.update(f"{path.relative_to(_PACKAGE).as_posix()} {len(text)}\n".encode() + text)
    versions = (f"{name} {version}" for name, version in packages().items())
    target = os.environ.get("NUMBA_CPU_NAME", "native")
    return (digest.hexdigest(), platform.python_version(), platform.machine(), target, *versions)


def find(run: Run, name: str, known: str | None) -> bytes | None:
    """Read a result; None if there is none of this key, or its bytes have changed.

    Args:
        run: the run in whose folder it is kept.
        name: its name.
        known: its key; see `key`.
    """
    if known is None:
        return None
    try:
        head, _, content = (run.folder / FOLDER / name).read_bytes().partition(b"\n")
    except OSError:
        return None
    return content if head.decode("ascii", "replace") == _head(known, name, content) else None


def keep(run: Run, name: str, known: str | None, content: bytes) -> None:
    """Keep a result in place of an earlier one, if the folder can be written: it can be made again in any case."""
    if known is not None:
        with contextlib.suppress(OSError):
            (run.folder / FOLDER).mkdir(exist_ok=True)
            write(run.folder / FOLDER / name, f"{_head(known, name, content)}\n".encode() + content)


def _head(known: str, name: str, content: bytes) -> str:
    return f"{known} {name} {hashlib.sha256(content).hexdigest()}"

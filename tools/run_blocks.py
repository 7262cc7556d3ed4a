"""Run the code blocks of the documents, and compare what they print with what the documents say.

    python tools/run_blocks.py docs/*.md                   # fails where a block prints something else
    python tools/run_blocks.py --write docs/fitting.md     # writes what the blocks print into the document
    python tools/run_blocks.py --made docs/*.md            # looks at the made parts alone, and runs no block

The blocks of a document are run in their order in one temporary folder:

- ``console``: lines that begin with ``$ `` are commands of the shell, and the lines below each are its output.
- ``python``: run in one namespace; a ``text`` block directly below is what the block prints.
- any block whose first line is a comment of a file's name alone (``# my.py``) is saved under that name.
- a block below the comment ``<!-- skip: next -->`` is not run.
- a picture of ``assets/`` that a block saves under its name is stored by ``--write``.
- between ``<!-- made: x -->`` and ``<!-- end -->`` stands what ``tools/made_pages.py`` prints for x.

A line ``…`` in an output stands for any number of lines. What depends on the machine is not compared: times (`MASKS`),
and lines that commands print only where they wait (`WAITING`).
"""

import argparse
import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from bound_numbers import replaced
from number_tables import markdown

DOCS = Path(__file__).resolve().parents[1] / "docs"
MASKS = re.compile(r"\d[\d.,]* ?(?:s|ms|µs|min|MB|kB|data sets)\b")
"""Times, sizes of files, work done in a time."""
WAITING = re.compile(r"study: compiling loops|\S+: (?:[\d,]+/[\d,]+ units|\d+%|begun), [\d:]+ passed\b")
"""Beginning of a line that commands print where no code is cached yet, or once a minute on a slow machine."""
BLOCK = re.compile(
    r"^(?P<skip><!-- skip: next -->\n+)?```(?P<language>console|python|text|toml)\n(?P<code>.*?)^```$", re.M | re.S
)
FILE = re.compile(r"# ([\w-]+\.(?:py|toml|csv))\n")
PICTURE = re.compile(r"\]\((assets/[\w/-]+\.png)\)")
MADE = re.compile(r"(?<=<!-- made: )(\w+) -->\n(.*?)(?=<!-- end -->)", re.DOTALL)
LONGEST = 3600
"""Seconds after which a command is stopped: it hangs, on the slowest machine too."""


class OutputError(Exception):
    """A block prints something else than its document says."""


def alike(stored: str, printed: str) -> bool:
    """True if an output is the stored one, machine-dependent numbers and runs of blanks aside."""
    lines = [r"(?:.*\n)*?" if line == "…" else re.escape(line) + r"\n" for line in _plain(stored)]
    return re.fullmatch("".join(lines), "".join(f"{line}\n" for line in _plain(printed))) is not None


def _plain(text: str) -> list[str]:
    return [" ".join(MASKS.sub("#", line).split()) for line in text.strip("\n").splitlines()]


def run(path: Path, write: bool = False) -> None:
    """Run the blocks of a document in a temporary folder.

    Args:
        path: the Markdown file.
        write: store what the blocks print, instead of comparing it.

    Raises:
        OutputError: if a block prints something else than the document says.
    """
    text = path.read_text(encoding="utf-8")
    blocks = [block for block in BLOCK.finditer(text) if not block["skip"]]
    edits: list[tuple[int, int, str]] = []
    names: dict[str, object] = {"__name__": "__main__"}
    printed, ended = "", -1
    with tempfile.TemporaryDirectory() as folder:
        for block in blocks:
            code, language, line = block["code"], block["language"], text.count("\n", 0, block.start("language")) + 1
            if language in ("python", "toml") and (file := FILE.match(code)):
                (Path(folder) / file[1]).write_text(code, encoding="utf-8")
            elif language == "python":
                with contextlib.redirect_stdout(io.StringIO()) as output, contextlib.chdir(folder):
                    exec(compile("\n" * line + code, str(path), "exec"), names)
                printed, ended = output.getvalue(), block.end()
            elif language == "console":
                edits.append((*block.span("code"), _console(f"{path}:{line}", code, folder, write)))
            elif language == "text" and ended >= 0 and not text[ended : block.start()].strip():
                new = _checked(f"{path}:{line}: this block of Python", code, printed, write)
                edits.append((*block.span("code"), new))
        for name in PICTURE.findall(text):
            made = Path(folder) / Path(name).name
            if not made.exists():
                raise OutputError(f"{path}: no block saves {made.name}, which the page shows")
            if write:
                (DOCS / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(made, DOCS / name)
    if write and (new := replaced(text, edits)) != text:
        path.write_text(new, encoding="utf-8")


def make(path: Path, write: bool = False) -> None:
    """Make the parts of a document that come from the package, which takes no run; see `run`."""
    text = path.read_text(encoding="utf-8")
    edits: list[tuple[int, int, str]] = []
    for part in MADE.finditer(text):
        import made_pages  # only pages with made parts need the packages that it loads

        edits.append((*part.span(2), f"\n{markdown(getattr(made_pages, part[1])()).strip()}\n\n"))
    if (new := replaced(text, edits)) != text:
        if not write:
            raise OutputError(f"{path}: a made table is not up to date")
        path.write_text(new, encoding="utf-8")


def fault(path: Path, write: bool, made: bool) -> str:
    """What a document has that is not so; nothing if all is well.

    Args:
        path: the Markdown file.
        write: store what is printed or made, instead of comparing it.
        made: look at its made parts alone.
    """
    try:
        make(path, write)
        if not made:
            run(path, write)
    except OutputError as error:
        return f"{error}\nTo store what is printed or made: python tools/run_blocks.py --write {path}"
    return ""


def _console(place: str, block: str, folder: str, write: bool) -> str:
    """Run the commands of a block; returns the block with their outputs."""
    parts = re.split(r"^(\$ .*\n?(?:> .*\n?)*)", block, flags=re.MULTILINE)
    new = ""
    for command, stored in zip(parts[1::2], parts[2::2], strict=True):
        lines = re.sub(r"^[$>] ", "", command, flags=re.MULTILINE)
        new += command + _checked(f"{place}: {lines.strip()}", stored, _shell(lines, folder), write)
    return new


def _shell(command: str, folder: str) -> str:
    """What a command prints."""
    roots = os.pathsep.join(filter(None, [str(DOCS.parent), os.environ.get("PYTHONPATH")]))
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    settings = {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb", "PATH": path, "PYTHONPATH": roots}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "encoding": "utf-8", "timeout": LONGEST}
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=os.environ | settings, **pipes)
    lines = (line for line in done.stdout.splitlines() if not WAITING.match(line))
    return "".join(line.rstrip() + "\n" for line in lines)


def _checked(place: str, stored: str, printed: str, write: bool) -> str:
    """An output as the document is to have it."""
    if alike(stored, printed):
        return stored
    if not write or "…" in stored.splitlines():
        raise OutputError(f"{place}\nprints\n{printed}\nand the document says\n{stored}")
    return printed.strip("\n") + "\n" if printed.strip() else ""


def main() -> None:
    """Compare, or write, in a process for each document."""
    options = argparse.ArgumentParser(description="Run the code blocks of documents.")
    options.add_argument("--write", action="store_true", help="store the outputs instead of comparing them")
    options.add_argument("--made", action="store_true", help="look at the parts made from the package alone")
    options.add_argument("files", nargs="+", type=Path)
    given = options.parse_args()
    check = partial(fault, write=given.write, made=given.made)
    if given.made:
        faults = list(map(check, given.files))
    else:
        with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:  # blocks print, and change folders
            faults = list(pool.map(check, given.files))
    sys.exit("\n".join(filter(None, faults)) or None)


if __name__ == "__main__":
    main()

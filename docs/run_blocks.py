"""Run the code blocks of the documents, and compare what they print with what the documents say.

    python docs/run_blocks.py docs/fitting.md             # fails at the first block that prints something else
    python docs/run_blocks.py --write docs/fitting.md     # writes what the blocks print into the document

The blocks of a document are run in their order in one temporary folder:

- ``console``: lines that begin with ``$ `` are commands of the shell, and the lines below each are its output.
- ``python``: run in one namespace; a ``text`` block directly below is what the block prints.
- any block whose first line is a comment of a file's name alone (``# my.py``) is saved under that name.
- a block below the comment ``<!-- skip: next -->`` is not run.
- between ``<!-- made: x -->`` and ``<!-- end -->`` stands what ``docs/made_pages.py`` prints for x.

A line ``…`` in an output stands for any number of lines. What depends on the machine (`MASKS`) is not compared.
"""

import argparse
import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from sybil import Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, SkipParser

DOCS = Path(__file__).resolve().parent
MASKS = re.compile(
    r"\d[\d.,]* ?(?:s|ms|µs|min|MB|kB|data sets)\b"  # times, sizes of files, work done in a time
)
COMPILING = "study: compiling loops"
"""Beginning of a line that commands print where no code is cached yet."""
FILE = re.compile(r"# ([\w-]+\.(?:py|toml|csv))\n")
MADE = re.compile(r"(<!-- made: ([\w.]+) -->\n).*?(<!-- end -->)", re.DOTALL)
LONGEST = 600
"""Seconds after which a command is stopped."""


class OutputError(Exception):
    """A block prints something else than its document says."""


def alike(stored: str, printed: str) -> bool:
    """True if an output is the stored one, machine-dependent numbers and runs of blanks aside."""
    lines = [r"(?:.*\n)*?" if line == "…" else re.escape(line) + r"\n" for line in _plain(stored)]
    return re.fullmatch("".join(lines), "".join(f"{line}\n" for line in _plain(printed))) is not None


def _plain(text: str) -> list[str]:
    return [" ".join(MASKS.sub("#", line).split()) for line in text.strip("\n").splitlines()]


class Page:
    """A document whose blocks are run.

    Attributes:
        path: of the document.
        folder: the temporary folder that the blocks are run in.
        write: outputs are stored instead of compared.
        edits: the new outputs, each with the start and the end of the old one.
    """

    def __init__(self, path: Path, folder: Path, write: bool) -> None:
        self.path, self.folder, self.write = path, folder, write
        self.edits: list[tuple[int, int, str]] = []
        self.names: dict[str, object] = {"__name__": "__main__"}
        self.printed, self.ended = "", -1

    def run(self) -> int:
        """Run all blocks; returns their number."""
        languages = {"console": self.console, "python": self.python, "text": self.text, "toml": self.toml}
        parsers = [CodeBlockParser(language=name, evaluator=run) for name, run in languages.items()]
        document = Sybil(parsers=[*parsers, SkipParser()], patterns=["*"]).parse(self.path)
        examples = list(document.examples())
        for example in examples:
            example.evaluate()
        text = document.text
        for start, end, new in sorted(self.edits, reverse=True):
            text = text[:start] + new + text[end:]
        made = MADE.sub(lambda found: found[1] + _made(found[2]) + found[3], text)
        if made != text and not self.write:
            raise OutputError(
                f"{self.path}: a made table is not up to date; run docs/run_blocks.py --write {self.path}"
            )
        if made != document.text:
            self.path.write_text(made, encoding="utf-8")
        return len(examples)

    def console(self, example: Example) -> None:
        """Run the commands of a block, and compare or store their outputs."""
        start = example.region.start + example.parsed.offset
        parts = re.split(r"^(\$ .*\n?(?:> .*\n?)*)", str(example.parsed), flags=re.MULTILINE)
        new = ""
        for command, stored in zip(parts[1::2], parts[2::2], strict=True):
            lines = re.sub(r"^[$>] ", "", command, flags=re.MULTILINE)
            new += command + self._checked(example, lines, stored, self._shell(lines))
        if self.write:
            self.edits.append((start, start + len(example.parsed), new))

    def python(self, example: Example) -> None:
        """Run a block of Python, and keep what it prints; or save it, if it is a file."""
        if self._saved(example):
            return
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.chdir(self.folder):
            exec(compile("\n" * (example.line) + example.parsed, str(self.path), "exec"), self.names)
        self.printed, self.ended = printed.getvalue(), example.region.end

    def text(self, example: Example) -> None:
        """Compare the output of the block of Python above, if there is one directly above."""
        if self.ended < 0 or example.document.text[self.ended : example.region.start].strip():
            return
        start = example.region.start + example.parsed.offset
        new = self._checked(example, "this block of Python", str(example.parsed), self.printed)
        if self.write:
            self.edits.append((start, start + len(example.parsed), new))

    def toml(self, example: Example) -> None:
        """Save a block that is a file."""
        self._saved(example)

    def _saved(self, example: Example) -> bool:
        found = FILE.match(example.parsed)
        if found:
            (self.folder / found[1]).write_text(example.parsed, encoding="utf-8")
        return bool(found)

    def _shell(self, command: str) -> str:
        scripts, root = Path(sys.executable).parent, str(DOCS.parent)
        roots = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
        path = f"{scripts}{os.pathsep}{os.environ['PATH']}"
        settings = {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb", "PATH": path, "PYTHONPATH": roots}
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=self.folder,
            env=os.environ | settings,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            timeout=LONGEST,
        )
        lines = (line for line in done.stdout.splitlines() if not line.startswith(COMPILING))
        return "".join(line.rstrip() + "\n" for line in lines)

    def _checked(self, example: Example, what: str, stored: str, printed: str) -> str:
        if alike(stored, printed):
            return stored
        if not self.write or "…" in stored.splitlines():
            place = f"{self.path}:{example.line}: {what.strip()}"
            raise OutputError(f"{place}\nprints\n{printed}\nand the document says\n{stored}")
        return printed.strip("\n") + "\n" if printed.strip() else ""


def _made(name: str) -> str:
    """The text between the marks of a made part."""
    sys.path.insert(0, str(DOCS))
    import made_pages  # only pages with made parts need the packages that it loads

    return f"\n{getattr(made_pages, name)().strip()}\n\n"


def run(path: Path, write: bool = False) -> int:
    """Run the blocks of a document in a temporary folder.

    Args:
        path: the Markdown file.
        write: store what the blocks print, instead of comparing it.

    Returns:
        The number of blocks.

    Raises:
        OutputError: if a block prints something else than the document says.
    """
    with tempfile.TemporaryDirectory() as folder:
        return Page(path, Path(folder), write).run()


if __name__ == "__main__":
    options = argparse.ArgumentParser(description="Run the code blocks of documents.")
    options.add_argument("--write", action="store_true", help="store the outputs instead of comparing them")
    options.add_argument("files", nargs="+", type=Path)
    given = options.parse_args()
    for each in given.files:
        try:
            print(f"{each}: {run(each, given.write)} blocks", flush=True)
        except OutputError as error:
            sys.exit(str(error))

"""Single-token mutants of a module: those that its tests do not notice are printed, and counted.

    make mutants MODULE=study/toml.py TESTS=tests/cli/test_mistakes.py

In a mutant one operator, comparison, number or word is another. The tests run on a copy of the repository, once for
each mutant; a run that takes ten times as long as that of the module itself counts as noticed.
"""

import argparse
import io
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAIRS = ("+ -", "* /", "< <=", "> >=", "== !=", "+= -=", "*= /=", "and or", "min max", "any all", "True False")
OTHER = {a: b for pair in PAIRS for a, b in (pair.split(), pair.split()[::-1])}
OTHER |= {"not": "", "**": "*", "//": "/", "%": "*", "break": "continue"}
SKIPPED = shutil.ignore_patterns(".git", ".venv", "build", "site", ".*_cache")


def mutated(token):
    """What stands in a token's place in the mutant; None for tokens that stay."""
    if token.type == tokenize.NUMBER:
        return f"({token.string} + 1)"
    return OTHER.get(token.string) if token.type in (tokenize.OP, tokenize.NAME) else None


def mutants(text):
    """Line, token, its replacement, and text of each mutant that is a program."""
    lines = text.splitlines(keepends=True)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        new, (row, start), end = mutated(token), token.start, token.end[1]
        if new is not None:
            line = lines[row - 1]
            whole = "".join([*lines[: row - 1], line[:start] + new + line[end:], *lines[row:]])
            try:
                compile(whole, "mutant", "exec")
            except SyntaxError:
                continue
            yield row, token.string, new, whole


def passes(copy, tests, limit=None):
    """True if the tests pass in a copy of the repository, within so many seconds."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    with subprocess.Popen(command, cwd=copy, env={**os.environ, "PYTHONPATH": str(copy)}, **options) as process:
        try:
            return process.wait(limit) == 0
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return False


def main():
    """Print the mutants that live."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module", help="a file of the package")
    parser.add_argument("tests", nargs="+", help="files of tests that hold it, and options of pytest")
    parser.add_argument("--most", type=int, default=40, help="number of mutants, drawn at random if there are more")
    given, options = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(shutil.copytree(ROOT, Path(folder) / "copy", ignore=SKIPPED))
        path, begun = copy / given.module, time.monotonic()
        text = path.read_text(encoding="utf-8")
        if not passes(copy, given.tests + options):
            sys.exit(f"{' '.join(given.tests)}: fails before any mutation; mend it first")
        limit, every = 10.0 * (time.monotonic() - begun), list(mutants(text))
        chosen = sorted(random.Random(0).sample(every, min(given.most, len(every))))
        alive = 0
        for row, old, new, whole in chosen:
            path.write_text(whole, encoding="utf-8")
            if passes(copy, given.tests + options, limit):
                alive += 1
                print(f"{given.module}:{row}: {old} → {new or 'nothing'}: {text.splitlines()[row - 1].strip()}")
        print(f"{len(chosen) - alive} of {len(chosen)} mutants noticed, of {len(every)} that there are")


if __name__ == "__main__":
    main()

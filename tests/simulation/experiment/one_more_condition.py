"""The `study` command in a package whose table of conditions has two entries more, and nothing else has changed.

Not a test: `test_conditions.py` starts it, with the commands to run as JSON. The first entry, ``shift``, is a number
and concerns how draws are placed; the second, ``family``, is a word and has draws of its own. Neither has any effect
on the points, for nothing asks for their values. Only the first says that posteriors take account of it.
"""

import json
import sys
import types
from pathlib import Path

import study

ENTRIES = """
SHIFT = Condition(
    name="shift", symbol="δ", meaning="shift δ", unit="length", allowed=lambda v: v >= 0, rule="at least 0",
    default=0.0, silent=True, digits=3, by_posterior=True,
)
FAMILY = Condition(
    name="family", symbol="F", meaning="family of the noise", allowed=lambda v: v in ("normal", "other"),
    rule="normal or other", kind=str, default="normal", silent=True, own_draws=True, law=False,
)
"""


def patched():
    """The module of the table, made from its source with the entries appended."""
    path = Path(study.__file__).parent / "simulation" / "experiment" / "conditions.py"
    before, after = path.read_text(encoding="utf-8").split("\nCONDITIONS = {")
    names, rest = after.split(")}", 1)
    module = types.ModuleType("study.simulation.experiment.conditions")
    assert module.__name__ not in sys.modules
    sys.modules[module.__name__] = module  # where the dataclass looks for the types of its fields
    source = f"{before}{ENTRIES}\nCONDITIONS = {{{names}, SHIFT, FAMILY)}}{rest}"
    exec(compile(source, path, "exec"), module.__dict__)


def call(arguments):
    """Run a command; its exit status."""
    from study.cli import main  # which finds the patched table

    sys.argv = ["study", *arguments]
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    return 0


if __name__ == "__main__":
    patched()
    for command in json.loads(sys.argv[1]):
        status = call(command)
        print(f"exit {status}\0", file=sys.__stdout__, flush=True)  # a command shows this character in another form

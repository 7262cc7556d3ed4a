"""The rooms of the package: each imports only from those above it, and each file holds one idea."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import study

PACKAGE = Path(study.__file__).parent
ROOMS = [
    "text",
    "sphere",
    "estimators",
    "experiment",
    "statistics",
    "runs",
    "posterior",
    "analysis",
    "figures",
    "mocap",
    "report",
    "cli",
]
FILES = sorted(PACKAGE.rglob("*.py"))
LIBRARY = set(study.__all__) - {"__version__"}
NAMES = [str(path.relative_to(PACKAGE)) for path in FILES]


def room(parts):
    """The room of a module, given its dotted path below the package; None for the package itself."""
    return parts[0] if parts and parts[0] != "__init__" else None


def imported(path, text):
    """Modules of the package that a file imports, as (line, dotted path below the package)."""
    here = ["study", *path.relative_to(PACKAGE).with_suffix("").parts]
    nodes = list(ast.walk(ast.parse(text)))
    whole = any(isinstance(node, ast.Import) and "study" in {name.name for name in node.names} for node in nodes)
    for node in nodes:
        if isinstance(node, ast.Import):
            for name in node.names:
                parts = name.name.split(".")
                if parts[0] == "study" and len(parts) > 1:
                    yield node.lineno, parts[1:]
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level] if node.level else []
            parts = base + (node.module or "").split(".") * bool(node.module)
            if parts[:1] == ["study"]:
                yield from ((node.lineno, parts[1:] or [name.name]) for name in node.names)
        elif whole and isinstance(node, ast.Attribute) and ast.unparse(node.value) == "study":
            yield node.lineno, ["estimators"] if node.attr in LIBRARY else [node.attr]


def breaches(path, text):
    """Imports of a file from rooms that are not above its own."""
    own = room(path.relative_to(PACKAGE).with_suffix("").parts)
    if own is None:
        return []
    found = []
    for line, parts in imported(path, text):
        other = room(parts)
        if parts != ["__version__"] and other not in ROOMS[: ROOMS.index(own) + 1]:
            found.append(f"line {line}: {'.'.join(parts)}")
    return found


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_imports_go_up(path):
    """A room imports itself and the rooms above it, in the order of the data's way."""
    assert breaches(path, path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("sphere/cap.py", "from study.estimators import fit"),
        ("sphere/cap.py", "import study.runs.storage.run_folder"),
        ("sphere/cap.py", "from study import estimators"),
        ("sphere/cap.py", "from ..experiment import config"),
        ("sphere/cap.py", "import study\nstudy.fit([])"),
        ("experiment/work.py", "def f():\n    from study.runs.storage.run_folder import Run"),
        ("runs/runner.py", "from study.analysis.summary import summary"),
        ("analysis/summary.py", "from study.cli import app"),
    ],
)
def test_the_scan_sees(file, code):
    """The scan above finds each way of importing from below, also within a function."""
    assert breaches(PACKAGE / file, code)


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("runs/runner.py", "from study.experiment import config"),
        ("runs/runner.py", "from study.runs import tables"),
        ("runs/runner.py", "from . import tables"),
        ("runs/runner.py", "import studying.cli\nfrom elsewhere.study import cli"),
    ],
)
def test_the_scan_lets_pass(file, code):
    """Imports from above, from the same room and from elsewhere are allowed."""
    assert not breaches(PACKAGE / file, code)


def test_rooms_are_known():
    """Every folder and file of the package is one of the rooms."""
    found = {room(path.relative_to(PACKAGE).with_suffix("").parts) for path in FILES}
    assert found - {None} <= set(ROOMS)


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_files_are_short(path):
    """No file is longer than 350 lines."""
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 350


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_files_say_what_they_are(path):
    """Every file begins with a sentence that says what it is for."""
    doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert doc
    assert len(doc.splitlines()[0]) > 15


def test_the_package_is_light():
    """`import study` imports none of the heavy libraries; the first use of a function does, and works."""
    code = (
        "import sys, study\n"
        "heavy = {'numpy', 'numba', 'scipy', 'matplotlib', 'pandas', 'pyarrow'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "assert callable(study.fit) and callable(study.crlb)\n"
        "assert 'numba' in sys.modules\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=PACKAGE.parent, capture_output=True, encoding="utf-8"
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_public_names_exist():
    """Everything in study.__all__ is there, and nothing else is made up."""
    for name in study.__all__:
        assert getattr(study, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = study.nothing

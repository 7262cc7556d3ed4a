"""The rooms of the package: each imports only from those before it, and each file holds one idea."""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

import study

PACKAGE = Path(study.__file__).parent
THEORY = PACKAGE.parent / "docs" / "theory.md"
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
    "coverage",
    "mocap",
    "report",
    "cli",
]
SUB_ROOMS = {
    "runs": ["storage", "workers", "adaptive"],
    "mocap": [
        "geometry",
        "io",
        "markersets",
        "joints",
        "one_joint",
        "skeleton",
        "session",
        "live",
        "export",
        "view",
        "synthetic",
        "case_study",
        "commands",
    ],
    "sphere": ["random"],
    "estimators": ["geometric", "form", "robust", "intervals", "answer", "own"],
    "analysis": ["claims", "verification", "points", "archive"],
    "experiment": ["noise", "designs"],
    "figures": ["paper"],
    "report": ["explorer"],
}
"""Rooms within rooms, in their order; files beside them may stand anywhere that makes no circle."""
FILES = sorted(PACKAGE.rglob("*.py"))
LIBRARY = set(study.__all__) - {"__version__"}
NAMES = [str(path.relative_to(PACKAGE)) for path in FILES]
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
MODULES = {tuple(p for p in path.relative_to(PACKAGE).with_suffix("").parts if p != "__init__") for path in FILES}
LONGEST = 400
MOST_PARAMETERS = 7
MOST_MODULES = 16
MOST_ANY = 200
MOST_UNFORMATTED = 10


def parts_of(path):
    """The dotted path of a file below the package, as a tuple."""
    return path.relative_to(PACKAGE).with_suffix("").parts


def room(parts):
    """The room of a module, given its dotted path below the package; None for the package itself."""
    return parts[0] if parts and parts[0] != "__init__" else None


def imported(path, tree):
    """Modules of the package that a file imports, as (line, dotted path below the package)."""
    here = ["study", *parts_of(path)]
    nodes = list(ast.walk(tree))
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
                for name in node.names:
                    inner = (*parts[1:], name.name)
                    yield node.lineno, list(inner) if inner in MODULES or not parts[1:] else parts[1:]
        elif whole and isinstance(node, ast.Attribute) and ast.unparse(node.value) == "study":
            yield node.lineno, ["estimators"] if node.attr in LIBRARY else [node.attr]


def breaches(path, text):
    """Imports of a file from rooms that do not stand before its own, or from later sub-rooms of its room."""
    own = parts_of(path)
    if room(own) is None:
        return []
    found = []
    for line, parts in imported(path, ast.parse(text)):
        other = room(parts)
        if parts != ["__version__"] and other not in ROOMS[: ROOMS.index(own[0]) + 1]:
            found.append(f"line {line}: {'.'.join(parts)}")
        order = SUB_ROOMS.get(own[0], [])
        both = [parts[1:2], list(own[1:2])]
        if other == own[0] and all(some and some[0] in order for some in both):
            theirs, mine = (order.index(some[0]) for some in both)
            if theirs > mine:
                found.append(f"line {line}: {'.'.join(parts)}")
    return found


def circles(graph):
    """Groups of modules that import each other, directly or through others (Tarjan's components of more than one)."""
    number, least, stack, found = {}, {}, [], []

    def visit(module):
        number[module] = least[module] = len(number)
        stack.append(module)
        for other in graph.get(module, ()):
            if other not in number:
                visit(other)
            if other in stack:
                least[module] = min(least[module], least[other])
        if least[module] == number[module]:
            group = stack[stack.index(module) :]
            del stack[stack.index(module) :]
            if len(group) > 1:
                found.append(sorted(".".join(each) for each in group))

    for module in graph:
        if module not in number:
            visit(module)
    return found


def functions(tree):
    """Functions of a file with their numbers of parameters; ``self`` and ``cls`` do not count."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args
            names = [each.arg for each in [*given.posonlyargs, *given.args, *given.kwonlyargs]]
            count = len(names) - (names[:1] in (["self"], ["cls"])) + bool(given.vararg) + bool(given.kwarg)
            yield node, count


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_imports_follow_the_data(path):
    """A room imports itself and the rooms before it, in the order of the data's way; so does a sub-room."""
    assert breaches(path, path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("sphere/cap.py", "from study.estimators import fit"),
        ("sphere/cap.py", "import study.runs.runner"),
        ("sphere/cap.py", "from study import estimators"),
        ("sphere/cap.py", "from ..experiment import config"),
        ("sphere/cap.py", "import study\nstudy.fit([])"),
        ("experiment/design.py", "def f():\n    from study.runs.runner import run"),
        ("runs/runner.py", "from study.analysis.summary import summary"),
        ("analysis/summary.py", "from study.cli import app"),
        ("mocap/geometry/rigid.py", "from study.mocap.joints import segments"),
        ("mocap/io/recording.py", "from study.mocap.view.camera import Camera"),
        ("runs/storage/lock.py", "def f():\n    import study.runs.adaptive.time_budget"),
    ],
)
def test_the_scan_finds_breaches(file, code):
    """The scan above finds each way of importing from a later room, also within a function."""
    assert breaches(PACKAGE / file, code)


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("runs/runner.py", "from study.experiment import config"),
        ("runs/runner.py", "from study.runs import plan"),
        ("runs/runner.py", "from . import plan"),
        ("runs/runner.py", "import studying.cli\nfrom elsewhere.study import cli"),
        ("mocap/view/camera.py", "from study.mocap.io.recording import Recording"),
    ],
)
def test_the_scan_allows_the_rest(file, code):
    """Imports from earlier rooms, from the same room and from elsewhere are allowed."""
    assert not breaches(PACKAGE / file, code)


def test_no_circles():
    """No modules import each other, directly or through others, lazy imports included."""
    graph = {}
    for path, tree in TREES.items():
        own = tuple(part for part in parts_of(path) if part != "__init__")
        if own:  # the package itself offers what its rooms hold
            others = {tuple(parts) for _, parts in imported(path, tree)}
            graph[own] = sorted((others & MODULES) - {own, ()})
    assert circles(graph) == []


def test_circles_are_found():
    """The search finds a circle of two and one of three, and no other."""
    graph = {("a",): [("b",)], ("b",): [("c",)], ("c",): [("b",), ("d",)], ("d",): [("e",)], ("e",): [("f",)]}
    assert circles(graph) == [["b", "c"]]
    graph["f",] = [("d",)]
    assert sorted(circles(graph)) == [["b", "c"], ["d", "e", "f"]]


def test_rooms_are_known():
    """Every folder and file of the package is one of the rooms, every folder within a room one of its sub-rooms."""
    assert {room(parts_of(path)) for path in FILES} - {None} == set(ROOMS)
    for name, order in SUB_ROOMS.items():
        assert {path.parent.name for path in (PACKAGE / name).glob("*/__init__.py")} <= set(order)
    inner = {path.parent.parent.name for path in PACKAGE.glob("*/*/__init__.py")}
    assert inner <= set(SUB_ROOMS)


def test_rooms_are_small():
    """No folder holds more than sixteen modules."""
    count = defaultdict(int)
    for path in FILES:
        count[str(path.parent)] += path.name != "__init__.py"
    assert {folder: number for folder, number in count.items() if number > MOST_MODULES} == {}


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_files_are_short(path):
    """No file is longer than 400 lines."""
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_functions_take_few_parameters(path):
    """No function takes more than seven parameters; the options of a command are its parameters, however many."""
    if path.name in ("cli.py", "commands.py") or path.parent.name == "commands":
        return
    found = [f"line {node.lineno}: {node.name} takes {count}" for node, count in functions(TREES[path])]
    assert [line for line in found if int(line.rsplit(" ", 1)[1]) > MOST_PARAMETERS] == []


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_files_and_what_is_in_them_are_described(path):
    """Every file begins with a sentence that says what it is; no docstring opens with a question's word."""
    doc = ast.get_docstring(TREES[path])
    assert doc
    assert len(doc.splitlines()[0]) > 15
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
            first = (ast.get_docstring(node) or "").split("\n")[0]
            assert not re.match(r"(What|Whether|How|Where|Which|Who)\b", first), first


def test_class_names_are_unique():
    """No two classes of the package have the same name; a type of a figure's own frame is private to its file."""
    places = defaultdict(list)
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path.relative_to(PACKAGE)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_types_are_named_and_lines_are_formatted():
    """`Any` stands where there is no type, and few lines escape the formatter."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in FILES)
    assert len(re.findall(r"\bAny\b", text)) <= MOST_ANY
    assert text.count("fmt: skip") <= MOST_UNFORMATTED


def cited(text):
    """Numbers of sections, statements and equations that a text cites of the theory page."""
    number = r"\(?(\d+(?:\.\d+)?)\)?"
    for match in re.finditer(rf"[Tt]heory(?:\.md)?\s+(?:§+|table\s+)?\s*{number}", text):
        yield match[1]
        rest = text[match.end() :]
        while more := re.match(rf"(?:,| and)\s+§?{number}", rest):
            yield more[1]
            rest = rest[more.end() :]


def test_cited_theory_exists():
    """Every number of the theory page that code, tests or documents cite is there."""
    theory = THEORY.read_text(encoding="utf-8")
    known = set(re.findall(r"^## (\d+) ", theory, re.MULTILINE))
    known |= set(re.findall(r"^\*\*(\d+\.\d+)\*\*", theory, re.MULTILINE))
    known |= set(re.findall(r"\((\d\.\d+)\)[.,;]?\s", theory))
    known |= set(re.findall(r"\\tag\{(\d+\.\d+)\}", theory))
    root = THEORY.parent.parent
    pages = [*root.glob("*.md"), *root.glob("docs/*.md"), *root.glob("configs/*.toml")]
    code = [*FILES, *root.glob("tests/**/*.py"), *root.glob("benchmarks/*.py")]
    wrong = []
    for path in [*code, *pages]:
        found = set(cited(path.read_text(encoding="utf-8"))) - known
        wrong += [f"{path.relative_to(root)}: theory {number}" for number in sorted(found)]
    assert wrong == []


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("(theory §5.2)", ["5.2"]),
        ("theory 8.1 and 8.2", ["8.1", "8.2"]),
        ("theory (3.1), §5", ["3.1", "5"]),
        ("theory table 5.1", ["5.1"]),
        ("theory predicts 3", []),
    ],
)
def test_citations_are_found(text, numbers):
    """The search finds each way of citing."""
    assert list(cited(text)) == numbers


def test_the_package_is_light():
    """`import study` imports none of the heavy libraries; a function brings what it needs, a fit the compiler."""
    code = (
        "import logging, sys, study\n"
        "logging.disable()\n"
        "heavy = {'numpy', 'numba', 'scipy', 'matplotlib', 'pandas', 'pyarrow'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "assert callable(study.fit) and callable(study.crlb)\n"
        "assert 'numpy' in sys.modules and 'numba' not in sys.modules\n"
        "study.fit([[0, 1], [1, 0], [-1, 0.0]])\n"
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

"""The house: wings that import one way, described files, and functions of few parameters."""

import ast
import graphlib
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

import study

PACKAGE = Path(study.__file__).parent
THEORY = PACKAGE.parent / "docs" / "theory.md"
GROUND = {"arrays", "files", "instruction_set", "options", "style", "text", "toml", "words"}
"""Files that every wing stands on; they import each other alone."""
WINGS = {"fits": set(), "simulation": {"fits"}, "recordings": {"fits"}}
"""For each wing the others that it may import."""
ORDER = {
    "fits": "loops points estimators errors evidence answers registry spheres space_circle plan check certify fitting",
    "simulation": "experiment statistics runs posterior analysis claims figures report compile_loops folders library "
    "commands",
    "recordings": "recording formats rigid markersets joints skeleton one_joint session live export events gait view "
    "synthetic case_study api commands live_commands",
}
ORDER = {name: chapters.split() for name, chapters in ORDER.items()}
"""Chapters and folders of a wing in the order of the data: each imports only those before it."""
FILES = sorted(PACKAGE.rglob("*.py"))
LIBRARY = set(study.__all__) - {"__version__"}
MODULES = {tuple(p for p in path.relative_to(PACKAGE).with_suffix("").parts if p != "__init__") for path in FILES}
MOST_PARAMETERS = 7


@cache
def trees():
    """Each file of the package, parsed."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}


def parts_of(path):
    """The dotted path of a file below the package, as a tuple."""
    return path.relative_to(PACKAGE).with_suffix("").parts


def wing(parts):
    """The wing or ground file of a module, given its dotted path below the package; None for the package itself."""
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
            place = study._PLACES.get(node.attr, "study.fits") if node.attr in LIBRARY else f"study.{node.attr}"
            yield node.lineno, place.split(".")[1:]


def breaches(path, tree):
    """Imports of a file that climb: from the ground, into another wing, or against the order within one."""
    own = parts_of(path)
    if wing(own) is None or own == ("cli",):
        return []
    allowed = GROUND | ({own[0]} | WINGS[own[0]] if own[0] in WINGS else set())
    order = ORDER.get(own[0], [])
    result = []
    for line, parts in imported(path, tree):
        climbs = parts != ["__version__"] and wing(parts) not in allowed
        inside = wing(parts) == own[0] and parts[1:2] and parts[1] in order and own[1] in order
        if climbs or (inside and order.index(parts[1]) > order.index(own[1])):
            result.append(f"line {line}: {'.'.join(parts)}")
    return result


def functions(tree):
    """Functions of a file with their numbers of parameters; ``self`` and ``cls`` do not count."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args
            names = [one.arg for one in [*given.posonlyargs, *given.args, *given.kwonlyargs]]
            others = given.kwarg is not None and not (given.kwarg.annotation and "Never" in ast.unparse(given.kwarg))
            count = len(names) - (names[:1] in (["self"], ["cls"])) + bool(given.vararg) + others  # Never takes nothing
            yield node, count


def test_imports_follow_the_data():
    """The ground imports itself; a wing imports the ground, itself in the order of the data, and the fits."""
    found = {str(path): breaches(path, tree) for path, tree in trees().items()}
    assert {name: lines for name, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    ("file", "code", "climbs"),
    [
        ("toml.py", "from study.fits import fit", True),
        ("fits/points/cap.py", "from study.simulation.experiment import config", True),
        ("fits/points/cap.py", "import study.recordings.recording", True),
        ("fits/points/cap.py", "from study import simulation", True),
        ("fits/points/cap.py", "from ...simulation import statistics", True),
        ("fits/points/cap.py", "from study.fits.estimators.lls import lls", True),
        ("fits/evidence/judge.py", "from study.fits import registry", True),
        ("files.py", "import study\nstudy.fit([])", True),
        ("fits/points/cap.py", "import study\nstudy.find_joints([])", True),
        ("recordings/live.py", "from study.simulation.runs.schemas import read", True),
        ("simulation/claims/bias.py", "from study.recordings.rigid import superpose", True),
        ("simulation/experiment/designs.py", "def f():\n    from study.simulation.runs.runner import run", True),
        ("simulation/runs/runner.py", "from study.simulation.analysis.summary import summary", True),
        ("simulation/analysis/summary.py", "from study.cli import app", True),
        ("recordings/rigid.py", "from study.recordings.joints import find", True),
        ("recordings/recording.py", "from study.recordings.view.figure import Camera", True),
        ("simulation/statistics.py", "def f():\n    import study.simulation.runs.adaptive", True),
        ("simulation/runs/runner.py", "from study.simulation.experiment import config", False),
        ("simulation/runs/runner.py", "from study.simulation.runs import plan", False),
        ("simulation/runs/runner.py", "from . import plan", False),
        ("simulation/runs/runner.py", "import studying.cli\nfrom elsewhere.study import cli", False),
        ("recordings/view/figure.py", "from study.recordings.recording import Recording", False),
        ("recordings/view/figure.py", "import study\nstudy.fit([])", False),
    ],
)
def test_the_scan_finds_breaches(file, code, climbs):
    """The scan above finds each way of importing what stands later; what stands before, or elsewhere, is allowed."""
    assert bool(breaches(PACKAGE / file, ast.parse(code))) == climbs


def test_no_circles():
    """No modules import each other, directly or through others, lazy imports included."""
    graph = {}
    for path, tree in trees().items():
        own = tuple(part for part in parts_of(path) if part != "__init__")
        if own:  # the package itself offers what its wings hold
            graph[own] = ({tuple(parts) for _, parts in imported(path, tree)} & MODULES) - {own, ()}
    graphlib.TopologicalSorter(graph).prepare()  # a CycleError names the modules


def test_every_place_is_known():
    """Every file and folder is of the ground or a wing, and has its place in the order of its wing."""
    assert {wing(parts_of(path)) for path in FILES} - {None, "cli"} == GROUND | set(WINGS)
    for name, order in ORDER.items():
        inside = {path.stem for path in (PACKAGE / name).glob("*.py")} - {"__init__"}
        assert inside | {path.parent.name for path in (PACKAGE / name).glob("*/__init__.py")} == set(order)


PRIVATE = {"numba.core": "jit instruction_set", "numba.cpython": "jit", "joblib.externals": "workers"}
"""Parts of other packages that are not public, and the files that use them and say why."""


@pytest.mark.parametrize("name", PRIVATE)
def test_private_doors_are_few(name):
    """What other packages do not promise is used in one file each, or two."""
    users = {path.stem for path in FILES if re.search(rf"\b{re.escape(name)}\b", path.read_text(encoding="utf-8"))}
    assert users == set(PRIVATE[name].split())


def test_functions_take_few_parameters():
    """No function takes more than seven parameters; options of a command, and of `study.fit`, are its parameters."""
    plain = [path for path in FILES if "commands" not in str(path) and path.name != "cli.py"]
    counts = {(path, node.name, node.lineno): count for path in plain for node, count in functions(trees()[path])}
    counts = {place: count for place, count in counts.items() if place[:2] != (PACKAGE / "fits" / "registry.py", "fit")}
    assert {place: count for place, count in counts.items() if count > MOST_PARAMETERS} == {}


def test_files_and_what_is_in_them_are_described():
    """Every file begins with a sentence that says what it is; no docstring opens with a question's word."""
    for path, tree in trees().items():
        assert len((ast.get_docstring(tree) or "").split("\n")[0]) > 15, path
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
                first = (ast.get_docstring(node) or "").split("\n")[0]
                assert not re.match(r"(What|Whether|How|Where|Which|Who)\b", first), (path, first)


def test_class_names_are_unique():
    """No two classes of the package have the same name; a type of a figure's own frame is private to its file."""
    places = defaultdict(list)
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path.relative_to(PACKAGE)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_lines_are_formatted():
    """No line escapes the formatter."""
    assert [str(path) for path in FILES if "fmt: skip" in path.read_text(encoding="utf-8")] == []


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
        missing = set(cited(path.read_text(encoding="utf-8"))) - known
        wrong += [f"{path.relative_to(root)}: theory {number}" for number in sorted(missing)]
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

"""Named streams: a name is its numbers, and no generator comes from anywhere else."""

import ast
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import study
from study.experiment.streams import lanes, stream

PACKAGE = Path(study.__file__).parent
NAMES = [
    (1, "draw", 1),
    (2, "draw", 1),
    (1, "draw", 1.0),
    (1, "draw", "1"),
    (1, "draw", 1, 0),
    (1, 1, "draw"),
    (1, "draw1"),
    (1, "draw", np.nextafter(1.0, 2.0).item()),
    (1,),
    (2**64 + 1, "draw", 1),
]


@pytest.mark.parametrize("name", NAMES, ids=str)
def test_same_name_same_numbers(name):
    """A stream is made again, bit for bit, from its name."""
    np.testing.assert_array_equal(stream(*name).random(100), stream(*name).random(100))


@pytest.mark.parametrize(("left", "right"), list(combinations(NAMES, 2)), ids=str)
def test_different_names_share_no_number(left, right):
    """Names that differ in a type, an order, the last bit or the seed give streams without a common number.

    Two of 2 × 1000 uniform numbers of 53 bits are equal in 1 of 10¹⁰ cases.
    """
    assert not set(stream(*left).random(1000)) & set(stream(*right).random(1000))


@pytest.mark.parametrize(("left", "right"), list(combinations(NAMES, 2)), ids=str)
def test_different_names_share_no_lane(left, right):
    """The same of generators side by side: no word of 64 bits that one begins with is among the other's."""
    one, other = lanes(*left), lanes(*right)
    assert not np.intersect1d(one[:3], other[:3]).size
    np.testing.assert_array_equal(one, lanes(*left))


def test_siblings_are_uncorrelated():
    """The first numbers of 10 000 siblings are uniform and do not follow the number in their names.

    Both statistics are normal; 4.5 standard errors are passed in 7 of 10⁶ cases.
    """
    first = np.array([stream(1, "draw", i).random() for i in range(10_000)])
    assert abs(first.mean() - 0.5) < 4.5 / np.sqrt(12 * len(first))
    assert abs(np.corrcoef(first[:-1], first[1:])[0, 1]) < 4.5 / np.sqrt(len(first))


MODULES = {"random", "secrets", "numpy.random"}


def makers(tree):
    """Lines of a syntax tree that make a generator, or import a module that can."""
    for node in ast.walk(tree):
        match node:
            case ast.Call() if ast.unparse(node.func).split(".")[-1] == "Generator":
                yield node.lineno
            case ast.Attribute() if ast.unparse(node.value) in ("np.random", "numpy.random"):
                if node.attr != "Generator":
                    yield node.lineno
            case ast.ImportFrom(module=module) if module in MODULES:
                yield node.lineno
            case ast.Import(names=names) if {name.name for name in names} & MODULES:
                yield node.lineno


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_generators_are_made_in_one_place(path):
    """No file but streams.py makes a generator, seeds one, or draws from a global one.

    The check of an estimator of one's own, below the study, has data sets with fixed seeds that are stored nowhere.
    """
    if path.parent == PACKAGE / "estimators" / "own":
        return
    found = list(makers(ast.parse(path.read_text(encoding="utf-8"))))
    if path == PACKAGE / "experiment" / "streams.py":
        assert found
    else:
        assert not found, f"{path}: lines {found}"


@pytest.mark.parametrize(
    "code",
    [
        "rng = np.random.default_rng(1)",
        "np.random.seed(1)",
        "np.random.RandomState(1)",
        "Generator(bits)",
        "np.random.SeedSequence(1)",
        "from numpy.random import PCG64",
        "import random",
        "numpy.random.normal()",
    ],
)
def test_the_scan_sees(code):
    """The scan above finds each way of making a generator."""
    assert list(makers(ast.parse(code)))


def test_the_scan_lets_annotations_pass():
    """A generator as an argument, and the word as a type, are allowed."""
    assert not list(makers(ast.parse("def f(rng: np.random.Generator) -> Generator[int]: return rng.random()")))

"""The example in the docstring of each public name is run as a user would run it, and prints what it says."""

import doctest
import inspect

import pytest

import study
from study.fits import registry

NAMES = [
    name for name in study.__all__ if inspect.isclass(getattr(study, name)) or inspect.isfunction(getattr(study, name))
]
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.DONT_ACCEPT_TRUE_FOR_1


def test_names_without_a_docstring():
    """All names have docstrings of their own, but the table of estimators and the version."""
    assert set(study.__all__) - set(NAMES) == {"ESTIMATORS", "__version__"}


@pytest.mark.parametrize("name", NAMES)
def test_example(name, monkeypatch, tmp_path):
    """The docstring of a name, or one of its public methods, has an example, and all of them are right."""
    monkeypatch.chdir(tmp_path)
    thing = getattr(study, name)
    examples = doctest.DocTestFinder(recurse=True).find(thing, name, globs={})
    assert any(test.name == name and test.examples for test in examples)
    lines = []
    for test in examples:
        doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=lines.append)
    registry.remove(["centroid"])  # of the example of `study.register`
    assert "".join(lines) == ""

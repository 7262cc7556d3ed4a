"""Small studies, for tests of designs and draws."""

import pytest

from study.fits import registry
from study.simulation.experiment.compute import compute, stack
from study.simulation.experiment.config import parse
from tests.configs import config


@pytest.fixture(scope="session")
def make_study():
    """A study of a small config."""
    return lambda top=None, **design: parse(config(top, **design))


@pytest.fixture(scope="session")
def rows():
    """The error rows of a whole study, by column."""
    return lambda study: stack([compute(study, unit).errors for unit in study.units()])


@pytest.fixture
def forgotten():
    """Take out what a test registered, by files or by itself."""
    yield
    for path, _ in registry.loaded():
        registry.unload(path)
    for kind in registry.REGISTRIES:
        for name in list(kind.origins):
            kind.remove(name)

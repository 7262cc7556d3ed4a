"""Fixtures for tests of configs, designs and draws: they write small configs."""

import pytest

from study.simulation.experiment.config import parse


@pytest.fixture(scope="session")
def make_text(config_writer):
    """Write a small config: keyword arguments go into the design, ``top`` beside it; None leaves a key out."""
    head = {"name": "test", "seed": 1, "dimension": 3, "estimators": ["lls"]}
    return config_writer(head, {"kind": "grid", "trials": 2, "samples": 10, "noise": 0.1, "angle": 90})


@pytest.fixture(scope="session")
def make_study(make_text):
    """A study of the same arguments."""
    return lambda top=None, **design: parse(make_text(top, **design))

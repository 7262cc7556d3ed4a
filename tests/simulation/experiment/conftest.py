"""Fixtures for tests of configs, designs and draws: they write small configs."""

import pytest

from study.simulation.experiment.config import parse


def _toml(value):
    """A value as TOML; dictionaries become inline tables."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


@pytest.fixture(scope="session")
def make_text():
    """Write a small config: keyword arguments go into the design, ``top`` beside it; None leaves a key out."""

    def make(top=None, **design):
        head = {"name": "test", "seed": 1, "dimension": 3, "estimators": ["lls"]} | (top or {})
        body = {"kind": "grid", "trials": 2, "samples": 10, "noise": 0.1, "angle": 90} | design
        lines = [f"{key} = {_toml(value)}" for key, value in head.items() if value is not None]
        lines += ["[design]", *(f"{key} = {_toml(value)}" for key, value in body.items() if value is not None)]
        return "\n".join(lines) + "\n"

    return make


@pytest.fixture(scope="session")
def make_study(make_text):
    """A study of the same arguments."""
    return lambda top=None, **design: parse(make_text(top, **design))

"""A writer of small configs, for tests of designs and of runs."""

import pytest


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
def config_writer():
    """Make a function that writes configs from defaults, which its arguments replace: those named go into the design.

    The argument ``top`` has what stands beside the design; None leaves a key out.
    """

    def writer(head, body):
        def make(top=None, **design):
            lines = [f"{key} = {_toml(v)}" for key, v in (head | (top or {})).items() if v is not None]
            lines += ["[design]", *(f"{key} = {_toml(v)}" for key, v in (body | design).items() if v is not None)]
            return "\n".join(lines) + "\n"

        return make

    return writer

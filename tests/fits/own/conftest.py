"""Fixtures for tests of one's own estimators: files that register some, and a registry as it was afterwards."""

import pytest

from study.fits import registry as plugin_file
from study.fits import registry as register


@pytest.fixture(autouse=True)
def registry():
    """Take out what a test registered."""
    yield
    for path, _ in plugin_file.loaded():
        plugin_file.unload(path)
    register.remove(list(register.ORIGINS))


@pytest.fixture
def write_plugin(tmp_path):
    """Write a file of estimators with NumPy and the package imported on its first two lines; its path."""

    def write(text, name="my.py"):
        path = tmp_path / name
        path.write_text(f"import numpy as np\nimport study\n{text}\n", encoding="utf-8")
        return path

    return write

"""Shipped configs are found by name from any folder, in a checkout and in an installed package."""

import re
from importlib import resources
from pathlib import Path

import pytest

import study
from study.experiment.config import load
from study.experiment.config_faults import ConfigError
from study.experiment.shipped_configs import config_file, shipped_config, shipped_configs, summary_line

ROOT = Path(study.__file__).parents[1]


def test_all_are_found(monkeypatch, tmp_path):
    """Every config has its name, from whatever folder; the file is readable."""
    monkeypatch.chdir(tmp_path)
    found = shipped_configs()
    assert "paper" in found
    assert list(found) == sorted(found)
    for name, path in found.items():
        if name != "coverage":  # a study of another kind, which `study coverage` reads
            assert load(path).name == name
        assert name == path.stem
        assert shipped_config(name) == path


def test_those_of_an_installed_package(monkeypatch, tmp_path):
    """Configs inside the package come before a folder beside it, which may be anybody's."""
    package = tmp_path / "study"
    for folder, name in ((package / "configs", "inside"), (tmp_path / "configs", "beside")):
        folder.mkdir(parents=True)
        (folder / f"{name}.toml").write_text("")
    monkeypatch.setattr(resources, "files", lambda name: package)
    assert list(shipped_configs()) == ["inside"]
    (package / "configs" / "inside.toml").unlink()
    (package / "configs").rmdir()
    assert list(shipped_configs()) == ["beside"]
    (tmp_path / "configs" / "beside.toml").unlink()
    (tmp_path / "configs").rmdir()
    assert shipped_configs() == {}


def test_the_file_that_is_meant(monkeypatch, tmp_path):
    """A file is itself, also one without a suffix; a name with a suffix is a file, whether there or not."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper").write_text("")
    assert config_file(Path("paper")) == Path("paper")
    (tmp_path / "paper").unlink()
    assert config_file(Path("paper")) == shipped_config("paper")
    assert config_file(Path("paper.toml")) == Path("paper.toml")


@pytest.mark.parametrize("name", ["papre", "configs/paper"])
def test_a_wrong_name(name):
    """It is answered with the nearest name and the list."""
    words = f"{name}: neither a file nor a shipped config; did you mean 'paper'? Known are anisotropic, bias, "
    with pytest.raises(ConfigError, match=re.escape(words)):
        shipped_config(name)
    with pytest.raises(ConfigError, match="known are anisotropic, bias, "):
        shipped_config("zzz")


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.toml")), ids=lambda path: path.stem)
def test_each_begins_with_its_summary(path):
    """The first line is a comment of one sentence."""
    line = summary_line(path)
    assert line.endswith(".")
    assert 20 < len(line) < 100
    assert ". " not in line


def test_no_summary(tmp_path):
    """A config without a comment has none."""
    path = tmp_path / "plain.toml"
    path.write_text('name = "plain"\n')
    assert summary_line(path) == ""

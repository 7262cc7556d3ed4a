"""The configs that come with the package, found by name from any folder.

In an installed package they are its data; in a checkout they stand in the folder ``configs`` beside it.
"""

import os.path
from importlib import resources
from pathlib import Path

from study.experiment.config_faults import ConfigError
from study.text.nearest import did_you_mean


def shipped_configs() -> dict[str, Path]:
    """Files of the shipped configs by name, in the order of the alphabet."""
    package = Path(str(resources.files("study")))
    folder = next((each for each in (package / "configs", package.parent / "configs") if each.is_dir()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.toml"), key=lambda p: p.stem)}


def shipped_config(name: str) -> Path:
    """The file of a shipped config.

    Raises:
        ConfigError: if there is no such config; the message offers the nearest name and lists all.
    """
    known = shipped_configs()
    if name not in known:
        raise ConfigError(f"{name}: neither a file nor a shipped config; {did_you_mean(Path(name).name, known)}")
    return known[name]


def config_file(argument: Path) -> Path:
    """The file that a user means: the given one, or a shipped config if there is no such file and no suffix."""
    return argument if argument.suffix or os.path.exists(argument) else shipped_config(str(argument))


def summary_line(path: Path) -> str:
    """The first comment line of a config; empty if it has none."""
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    return first.removeprefix("#").strip() if first.startswith("#") else ""

"""Reading of TOML, and faults of a config, each with its line, its place, its value and the values allowed.

Models of TOML documents: a frozen section, and its lists, which become tuples.
"""

import json
import pathlib
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from study.text import listed, nearest
from study.words import key_remedy

Path = tuple[str | int, ...]
Keys = tuple[str, ...]
M = TypeVar("M", bound=BaseModel)
Check = Callable[[M], Iterable["Fault"]]
_MISSING = object()
_MOST_FAULTS = 50
"""Most faults that a message shows."""
_MOST_LEVELS = 50
_TOO_DEEP = f"tables or lists stand in each other more than {_MOST_LEVELS} deep; no document here needs more than ten"
_MARK = "\N{ZERO WIDTH NO-BREAK SPACE}"
"""The mark with which some editors begin a file in UTF-8."""


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        path: keys and indices that lead to the entry.
        words: the sentence about it.
        value: its value, which the message shows if it is given.
        wants: entries of which one would settle it, because it is missing.
        means: the known entry nearest to an unknown one.
    """

    path: Path
    words: str
    value: object = _MISSING
    wants: tuple[Path, ...] = ()
    means: Path | None = None

    def place(self) -> str:
        """The key as a user would write it: ``design.angle[2]``."""
        text = ""
        for part in self.path:
            text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
        text = text if len(text) <= 120 else text[:117] + "..."
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text) or "the file"


class ConfigError(Exception):
    """A config that cannot be used; the message has all of its faults."""

    @classmethod
    def listing(cls, source: str, text: str, faults: Sequence[Fault]) -> "ConfigError":
        """One message for all faults, in the order of the file; of very many the first ones are shown."""
        lines = _lines(text)
        placed = [(_line(lines, fault.path), fault) for fault in faults]
        shown = [f"{source}: {'1 fault' if len(faults) == 1 else f'{len(faults):,} faults'}"]
        for line, fault in sorted(placed, key=lambda entry: entry[0])[:_MOST_FAULTS]:
            value = "" if fault.value is _MISSING else f" = {shorten(fault.value)}"
            shown.append(f"  line {line}: {fault.place()}{value}: {fault.words}")
        return cls("\n".join(shown + [f"  and {len(faults) - _MOST_FAULTS:,} more"] * (len(faults) > _MOST_FAULTS)))


def toml_text(path: pathlib.Path, kind: type[ConfigError] = ConfigError) -> str:
    """The text of a TOML file; an error of a kind if it cannot be read."""
    from study.files import regular  # whose libraries take long to load

    try:
        return regular(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text; save it as UTF-8"
        raise kind(f"{path}: cannot be read: {reason}") from None


def toml_tables(text: str, source: str, kind: type[ConfigError] = ConfigError) -> dict[str, Any]:
    """The tables of a TOML document; an error of a kind, which names the source, if it is none."""
    try:
        tables = tomllib.loads(text.removeprefix(_MARK))
    except ValueError as error:  # for numbers of thousands of digits, too
        raise kind(f"{source}: not TOML: {error}") from None
    except RecursionError:
        raise kind(f"{source}: {_TOO_DEEP}") from None
    level: list[object] = [tables]
    for _ in range(_MOST_LEVELS):
        held = [list(value.values()) if isinstance(value, dict) else value for value in level]
        level = [inner for values in held if isinstance(values, list) for inner in values]
    if level:
        raise kind(f"{source}: {_TOO_DEEP}")
    return tables


def read_document(path: pathlib.Path, model: type[M], known: Mapping[Keys, list[str]], check: Check[M]) -> M:
    """Read a TOML file.

    Args:
        path: the file.
        model: its model.
        known: known keys by the path of their table.
        check: finds entries that do not go together, where each is fine by itself.

    Raises:
        ConfigError: with every fault, its place and its value.
    """
    text = toml_text(path)
    try:
        document = model.model_validate(toml_tables(text, str(path)))
    except ValidationError as error:
        raise ConfigError.listing(str(path), text, report(error, known)) from None
    if faults := list(check(document)):
        raise ConfigError.listing(str(path), text, faults)
    return document


_PLAINLY = {
    "too_short": "must have a value",
    # of a name, which becomes one of a folder
    "string_pattern_mismatch": "must be small letters, digits and hyphens, 61 at most, such as 'my-study'",
}


def report(
    error: ValidationError,
    known: Mapping[Keys, list[str]],
    path_of: Callable[[Sequence[str | int]], Path] = tuple,
) -> list[Fault]:
    """Turn the errors of a schema into faults, with the nearest known key for each unknown one.

    Args:
        error: the errors.
        known: known keys by the path of their table, without the numbers of entries in lists.
        path_of: the path in the file for a location in the schema, which also names members of unions.
    """
    faults: dict[Path, Fault] = {}
    for entry in error.errors(include_url=False):
        path = path_of(entry["loc"])
        words = entry["msg"].removeprefix("Value error, ")
        value: object = _MISSING if entry["type"] == "missing" else entry["input"]
        wants: tuple[Path, ...] = ()
        means = None
        if entry["type"] == "extra_forbidden" and len(faults) > _MOST_FAULTS:
            words = "unknown key"  # to search a known one for each of thousands would take minutes
        elif entry["type"] == "extra_forbidden":
            names = known.get(tuple(part for part in path[:-1] if isinstance(part, str)), [])
            key = str(path[-1])
            known_elsewhere = "unknown key: not one of this kind of design"
            elsewhere = {".".join(table): keys for table, keys in known.items() if table}
            words = known_elsewhere if key in names else f"unknown key; {key_remedy(key, names, elsewhere)}"
            means = (*path[:-1], nearest(key, names) or "")
        elif entry["type"] == "missing":
            words, wants = "required, but missing", (path,)
        elif entry["type"] == "tuple_type":
            words = f"must be a list, such as [{json.dumps(value)}]" if isinstance(value, str) else "must be a list"
        elif entry["type"] in ("model_type", "model_attributes_type"):
            words = f"must be one table, whose entries follow a line [{path[-1]}]"
        elif entry["type"] in _PLAINLY:
            words = _PLAINLY[entry["type"]]
        elif entry["type"] in ("union_tag_invalid", "union_tag_not_found"):
            context = entry["ctx"]
            path = (*path, str(context["discriminator"]).strip("'"))
            tags = ", ".join(map(repr, known.get(tuple(map(str, path)), [])))
            words = f"must be one of {context.get('expected_tags') or tags}"
            value = context.get("tag", _MISSING)
            if value is _MISSING:
                words, wants = f"required, but missing; {words}", (path,)
        faults.setdefault(path, Fault(path, words[0].lower() + words[1:], value, wants, means))
    return list(faults.values())


def distinct(faults: Sequence[Fault]) -> list[Fault]:
    """Leave out what follows from another fault: a second one of an entry, and a missing entry that is misspelt."""
    first: dict[Path, Fault] = {}
    for fault in faults:
        first.setdefault(fault.path, fault)
    meant = {fault.means for fault in first.values()}
    return [fault for fault in first.values() if not meant & set(fault.wants)]


def _lines(text: str) -> dict[Path, int]:
    """The first line, from 1, of each table and key of a TOML document."""
    lines: dict[Path, int] = {}
    section: Path = ()
    counts: dict[tuple[str, ...], int] = {}  # of the entries so far of each array of tables
    for number, line in enumerate(text.splitlines(), start=1):
        if header := re.match(r"\s*\[+([^\[\]]+)\]+\s*(#.*)?$", line):
            names = tuple(part.strip().strip("\"'") for part in header[1].split("."))
            if line.lstrip().startswith("[["):
                if names in counts:
                    counts = {key: n for key, n in counts.items() if key == names or key[: len(names)] != names}
                counts[names] = counts.get(names, 0) + 1
            heads = [names[: depth + 1] for depth in range(len(names))]
            section = tuple(part for head in heads for part in (head[-1], counts.get(head, 0) - 1) if part != -1)
            lines.setdefault(section, number)
        elif key := re.match(r"\s*([\w.\"'-]+)\s*=", line):
            lines.setdefault((*section, *(part.strip("\"'") for part in key[1].split("."))), number)
    return lines


def _line(lines: Mapping[Path, int], path: Path) -> int:
    """Line of a key; of its table, or 1, if the key is not there."""
    return next((lines[path[:depth]] for depth in range(len(path), 0, -1) if path[:depth] in lines), 1)


def shorten(value: object) -> str:
    """A value for a message, cut to 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


T = TypeVar("T")


class Frozen(BaseModel):
    """A section of a document: immutable, typed strictly, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def as_tuple(value: object) -> object:
    """A tuple, which a frozen model holds, of a list, which TOML has; anything else as it is."""
    return tuple(value) if isinstance(value, list) else value


def each_once(values: tuple[T, ...]) -> tuple[T, ...]:
    """The values, of which none may be there twice: a second one would be lost, or count twice."""
    twice = [repr(v) if isinstance(v, str) else f"{v:.12g}" for v, count in Counter(values).items() if count > 1]
    if twice:
        raise ValueError(f"{listed(twice)} given more than once; give each value once")
    return values


Listed = Annotated[tuple[T, ...], BeforeValidator(as_tuple)]
"""A list of any length."""
Distinct = Annotated[Listed[T], Field(min_length=1), AfterValidator(each_once)]
"""A list of at least one value, each of them there once."""

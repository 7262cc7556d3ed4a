"""Marker sets as files: TOML in, a `MarkerSet` out, or one message with every fault; the shipped ones by name."""

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from study.experiment.config_faults import ConfigError, Fault, report
from study.mocap.markersets.marker_set import Joint, MarkerSet, Schema, Segment, misfits

FOLDER = Path(__file__).parent
"""Where the shipped ones are, beside the package in a checkout."""
_TABLES: dict[str, type[Segment | Joint]] = {"segments": Segment, "joints": Joint}


class MarkerSetError(ConfigError):
    """A marker set that cannot be used; the message says why, all of it."""


def shipped() -> list[str]:
    """Names of the shipped marker sets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_markerset(name: str | Path) -> MarkerSet:
    """Read a marker set.

    Args:
        name: of a shipped one, or the path of a file.

    Raises:
        MarkerSetError: if there is no such file, or with every fault in it.
    """
    path = Path(name)
    if path.suffix != ".toml" and len(path.parts) == 1:
        path = FOLDER / f"{name}.toml"
        if not path.is_file():
            known = ", ".join(shipped()) or f"none (they belong in {FOLDER})"
            raise MarkerSetError(f"no marker set {str(name)!r}; there are {known}; or give the path of a .toml file")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise MarkerSetError(f"{path}: cannot be read: {reason}") from None
    return parse_markerset(text, str(path))


def parse_markerset(text: str, source: str = "marker set") -> MarkerSet:
    """Read a marker set from TOML, with a table ``[segments.NAME]`` for each segment and ``[joints.NAME]`` per joint.

    Args:
        text: the document.
        source: what to call it in messages.

    Raises:
        MarkerSetError: with every fault, its line, place, value and what is allowed.
    """
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise MarkerSetError(f"{source}: not TOML: {error}") from None
    faults: list[Fault] = []
    document: dict[str, Any] = dict(raw)
    for key in _TABLES:
        if key in raw:
            document[key] = _named(key, raw[key], faults)
    try:
        parts = Schema.model_validate(document)
    except ValidationError as error:
        faults += [_renamed(fault, document) for fault in report(error, _known(document))]
    else:
        faults += misfits(parts)
        faults += [
            Fault(("segments", segment.name, "markers"), "must name at least one marker", [])
            for segment in parts.segments
            if not segment.markers
        ]
    if faults:
        raise MarkerSetError.listing(source, text, faults)
    return MarkerSet.model_validate(document)


def _named(key: str, tables: object, faults: list[Fault]) -> list[object]:
    """The tables of a section, each with its name in it, in the file's order."""
    if not isinstance(tables, dict):
        faults.append(Fault((key,), f"must be tables such as [{key}.NAME]", tables))
        return []
    return [{"name": name, **table} if isinstance(table, dict) else table for name, table in tables.items()]


def _known(document: dict[str, Any]) -> dict[tuple[str, ...], list[str]]:
    """The keys that each part of a document can have."""
    keys: dict[tuple[str, ...], list[str]] = {(): list(Schema.model_fields)}
    for section, part in _TABLES.items():
        allowed = [key for key in part.model_fields if key != "name"]
        keys |= {(section, str(i)): allowed for i in range(len(document.get(section, ())))}
    return keys


def _renamed(fault: Fault, document: dict[str, Any]) -> Fault:
    """The same fault with the name of a segment or joint for its number."""
    path = list(fault.path)
    if len(path) > 1 and path[0] in _TABLES and isinstance(path[1], int):
        entry = document[str(path[0])][path[1]]
        path[1] = entry["name"] if isinstance(entry, dict) else path[1]
    return Fault(tuple(path), fault.words, fault.value)

"""Read marker sets from TOML files: a `MarkerSet`, or one message with every fault; shipped ones go by their name."""

from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from study.experiment.config_faults import ConfigError, Fault, report, toml_tables, toml_text
from study.mocap.markersets.marker_set import Joint, MarkerSet, MarkerSetParts, Segment, misfits
from study.mocap.markersets.name_faults import name_faults
from study.text.columns import columns
from study.text.nearest import did_you_mean

FOLDER = Path(__file__).parent
"""The folder of the shipped files: this room of the package."""
_TABLES: dict[str, type[Segment | Joint]] = {"segments": Segment, "joints": Joint}


class MarkerSetError(ConfigError):
    """A marker set cannot be used; the message gives every reason."""


def shipped() -> list[str]:
    """Names of the shipped marker sets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def shipped_text(name: str) -> str:
    """The file of a shipped marker set, as a start for a user's own.

    Raises:
        MarkerSetError: if no shipped marker set has this name.
    """
    return toml_text(_shipped_path(name, "`study markersets` describes them"))


def described() -> list[str]:
    """A line for each shipped marker set: name, numbers of markers and joints, and what it is."""
    sets = [load_markerset(name) for name in shipped()]
    return list(columns([s.name, f"{len(s.markers())} markers", f"{len(s.joints)} joints", s.about] for s in sets))


def load_markerset(name: str | Path) -> MarkerSet:
    """Read a marker set.

    Args:
        name: of a shipped one, or the path of a file.

    Raises:
        MarkerSetError: if there is no such file, or with every fault in it.
    """
    path = Path(name)
    if path.suffix != ".toml" and len(path.parts) == 1:
        path = _shipped_path(str(name), "or give the path of a .toml file")
    return parse_markerset(toml_text(path, MarkerSetError), str(path))


def _shipped_path(name: str, remedy: str) -> Path:
    if name not in shipped():
        raise MarkerSetError(f"no marker set {name!r}: {did_you_mean(name, shipped())}; {remedy}")
    return FOLDER / f"{name}.toml"


def parse_markerset(text: str, source: str = "marker set") -> MarkerSet:
    """Read a marker set from TOML, with a table ``[segments.NAME]`` for each segment and ``[joints.NAME]`` per joint.

    Args:
        text: the document.
        source: what to call it in messages.

    Raises:
        MarkerSetError: with every fault, its line, place, value and what is allowed.
    """
    raw = toml_tables(text, source, MarkerSetError)
    faults: list[Fault] = []
    sections = {key: _with_names(key, raw[key], faults) for key in _TABLES if key in raw}
    document: dict[str, object] = raw | sections
    try:
        parts = MarkerSetParts.model_validate(document)
    except ValidationError as error:
        faults += [_by_name(fault, sections) for fault in report(error, _known_keys(sections))]
        faults += name_faults(document, faults)
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


def _with_names(key: str, tables: object, faults: list[Fault]) -> list[object]:
    """The tables of a section in the file's order, each with its name as an entry."""
    if not isinstance(tables, dict):
        faults.append(Fault((key,), f"must be tables such as [{key}.NAME]", tables))
        return []
    return [{"name": name, **table} if isinstance(table, dict) else table for name, table in tables.items()]


def _known_keys(sections: Mapping[str, list[object]]) -> dict[tuple[str, ...], list[str]]:
    """The keys that each table of a document may have."""
    keys: dict[tuple[str, ...], list[str]] = {(): list(MarkerSetParts.model_fields)}
    for section, tables in sections.items():
        allowed = [key for key in _TABLES[section].model_fields if key != "name"]
        keys |= {(section, str(i)): allowed for i in range(len(tables))}
    return keys


def _by_name(fault: Fault, sections: Mapping[str, list[object]]) -> Fault:
    """The same fault, with the name of a segment or joint in place of its number."""
    path = list(fault.path)
    if len(path) > 1 and path[0] in _TABLES and isinstance(path[1], int):
        table = sections[str(path[0])][path[1]]
        path[1] = table["name"] if isinstance(table, dict) else path[1]
    return Fault(tuple(path), fault.words, fault.value)

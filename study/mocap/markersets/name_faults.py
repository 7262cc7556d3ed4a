"""Faults between the names of a marker set whose file breaks the schema, too, so that a user hears of both at once."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

from pydantic import ValidationError

from study.experiment.config_faults import Fault
from study.experiment.toml_model import as_tuple
from study.mocap.markersets.marker_set import Joint, MarkerSetParts, Segment, misfits

_Part = TypeVar("_Part", Segment, Joint)


def name_faults(document: Mapping[str, object], faults: Sequence[Fault]) -> list[Fault]:
    """Faults between the parts of a document that can be read; those that may follow from the others are left out.

    Args:
        document: the sections as lists of tables, each with its name.
        faults: of the schema, found already.
    """
    unreadable = {fault.path[0] for fault in faults if len(fault.path) < 3 and fault.path[0] in ("segments", "joints")}
    if unreadable:  # a whole table, whose names are not known
        return []
    parts = MarkerSetParts.model_construct(
        name="",
        segments=tuple(_loosely(Segment, table, {"markers": ()}) for table in _tables(document, "segments")),
        joints=tuple(_loosely(Joint, table, {"parent": "", "child": ""}) for table in _tables(document, "joints")),
        optional=_names(document.get("optional")),
        aliases={},
    )
    if not parts.segments:
        return []
    seen = {fault.path for fault in faults}
    # without all markers nobody knows which of them are on no segment
    vague = any(path[0] == "segments" and path[2:3] == ("markers",) for path in seen)
    found = [fault for fault in misfits(parts) if fault.path not in seen]
    return [fault for fault in found if not (vague and (fault.path[0] == "optional" or fault.path[-1] == "markers"))]


def _loosely(model: type[_Part], table: Mapping[str, object], blank: Mapping[str, object]) -> _Part:
    """A part with the entries that are right, and blanks for those that are not."""
    wrong: set[object] = set()
    try:
        return model.model_validate(table)
    except ValidationError as error:
        wrong = {entry["loc"][0] for entry in error.errors() if entry["loc"]}
    right = {key: value for key, value in table.items() if key in model.model_fields and key not in wrong}
    right = {key: as_tuple(value) for key, value in right.items()}
    return model.model_construct(**{**blank, **right})  # type: ignore[arg-type]


def _tables(document: Mapping[str, object], section: str) -> list[Mapping[str, object]]:
    tables = document.get(section)
    return [table for table in tables if isinstance(table, Mapping)] if isinstance(tables, list) else []


def _names(value: object) -> tuple[str, ...]:
    return tuple(each for each in value if isinstance(each, str)) if isinstance(value, list) else ()

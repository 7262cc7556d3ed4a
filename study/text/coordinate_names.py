"""Columns of a table that are coordinates, by their names: x, Y [mm], pos_z, Easting, Northing, Height."""

import re
from collections.abc import Sequence

_UNITS = "nm|um|µm|μm|mm|cm|dm|m|km|in|inch|inches|ft|feet|px|pixels?|(?:milli|centi|micro|kilo)?met(?:er|re)s?"
_NAME = re.compile(rf"(.*?)(?:\s*[\[({{<].*[\])}}>]|(?:\s*[_/,.-]\s*|\s+)(?:{_UNITS}))?", re.IGNORECASE)
"""A name and its unit, such as x [mm], X(m), x_mm, x mm, x/mm."""
_LENGTH = re.compile(rf"[\[({{<]?\s*({_UNITS})\s*[\])}}>]?", re.IGNORECASE)
_AROUND = ["pos", "position", "p", "pt", "point", "points", "coord", "coordinate", "coordinates", "koordinate"]
_AROUND += ["loc", "location", "vertex", "axis"]
_WORDS = [
    {"east", "easting", "eastings", "rechtswert"},
    {"north", "northing", "northings", "hochwert"},
    {"up", "height", "elevation", "elev", "altitude", "alt", "höhe", "hoehe"},
]
_RANKS: list[list[set[str]]] = [
    [{letter}, {f"points{axis}"} | {name for word in _AROUND for name in (word + letter, letter + word)}, _WORDS[axis]]
    for axis, letter in enumerate("xyz")
]
"""Names of each coordinate without unit and blanks: the plainest first, which is taken where there are others, too."""
_INITIALS = [["e"], ["n"], ["u", "h"]]
"""Names that mean coordinates only where all three are there."""
_ANGLES = {"lat", "latitude"}, {"lon", "long", "lng", "longitude"}


def coordinate_places(names: Sequence[str]) -> list[int]:
    """Places of the columns called x, y and z, or x and y, in this order; none if the names do not tell.

    A name may be a capital, have a unit (``x [mm]``, ``X_m``), a word such as pos or point around it, or be East,
    North and Up, or Easting, Northing and Height. The plainest name of a coordinate counts, and must be the only one.
    """
    stems = [_stem(name) for name in names]
    groups = [
        next((places for known in ranks if (places := [i for i, stem in enumerate(stems) if stem in known])), [])
        for ranks in _RANKS
    ]
    if not any(groups):
        groups = [[i for i, stem in enumerate(stems) if stem in initials] for initials in _INITIALS]
        return [places[0] for places in groups] if [len(places) for places in groups] == [1, 1, 1] else []
    counts = [len(places) for places in groups]
    return [places[0] for places in groups if places] if counts in ([1, 1, 0], [1, 1, 1]) else []


def angles(names: Sequence[str]) -> list[str]:
    """The columns of latitude and longitude, which are no lengths; none unless both are there."""
    pair = [next((name for name in names if _stem(name) in known), "") for known in _ANGLES]
    return pair if all(pair) else []


def length_unit(cell: str) -> str:
    """The unit of length that a cell consists of, such as mm or [mm]; empty if it is anything else."""
    unit = _LENGTH.fullmatch(cell.strip())
    return unit[1].lower() if unit else ""


def _stem(name: str) -> str:
    """A name without its unit, blanks and marks, in small letters."""
    whole = _NAME.fullmatch(" ".join(name.split()))
    return re.sub(r"[\s_.:/-]+", "", whole[1] if whole else name).lower()

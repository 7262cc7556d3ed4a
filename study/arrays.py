"""Columns of a table that are coordinates, by their names: x, Y [mm], pos_z, Easting, Northing, Height.

Arrays of real numbers from what a user passes: lists, masked arrays, data frames.

Names of the array types that functions take and return; a docstring gives the shape.
"""

import re
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

_UNITS = "nm|um|µm|μm|mm|cm|dm|m|km|in|inch|inches|ft|feet|px|pixels?|(?:milli|centi|micro|kilo)?met(?:er|re)s?"
_NAME = re.compile(rf"(.*?)(?:\s*[\[({{<].*[\])}}>]|(?:\s*[_/,.-]\s*|\s+)(?:{_UNITS}))?", re.IGNORECASE)
"""A name and its unit, such as x [mm], X(m), x_mm, x mm, x/mm."""
_LENGTH = re.compile(rf"[\[({{<]?\s*({_UNITS})\s*[\])}}>]?", re.IGNORECASE)
_SPELLINGS = [("micro", "u"), ("µ", "u"), ("μ", "u"), ("milli", "m"), ("centi", "c"), ("kilo", "k"), ("inches", "in")]
_SPELLINGS += [("inch", "in"), ("feet", "ft"), ("pixels", "px"), ("pixel", "px"), ("meters", "m"), ("metres", "m")]
_SPELLINGS += [("meter", "m"), ("metre", "m")]
"""Spellings of units, or of parts of them, and what is short for them; a plural stands before its singular."""
_NAMED_UNIT = re.compile(rf".*[\s_/,.\-\[({{<]{_LENGTH.pattern}", re.IGNORECASE)
_ANGLE = re.compile(r".*[\s_/,.\-\[({<](?:deg(?:rees?)?|m?rad(?:ians?)?|gon|arcmin|arcsec|°)\s*[\])}>]?", re.IGNORECASE)
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


def has_angle(name: str) -> bool:
    """True if the name of a column ends in a unit of angle, such as x (deg), y_rad or z [°]."""
    return bool(_ANGLE.fullmatch(name.strip()))


def length_unit(cell: str) -> str:
    """The unit of length that a cell consists of, such as mm or [mm]; empty if it is anything else."""
    return _short(_LENGTH.fullmatch(cell.strip()))


def unit_in(name: str) -> str:
    """The unit of length in the name of a column, such as mm in x [mm]; empty if there is none."""
    return _short(_NAMED_UNIT.fullmatch(name.strip()))


def _short(unit: re.Match[str] | None) -> str:
    """The abbreviation of a unit, however it is spelt; empty without one."""
    text = unit[1].lower() if unit else ""
    for long, short in _SPELLINGS:
        text = text.replace(long, short)
    return text


def _stem(name: str) -> str:
    """A name without its unit, blanks and marks, in small letters."""
    whole = _NAME.fullmatch(" ".join(name.split()))
    return re.sub(r"[\s_.:/-]+", "", whole[1] if whole else name).lower()


_USUAL = 3
"""Most columns of a data frame that are coordinates although their names do not say so."""


def real_array(values: ArrayLike, name: str) -> NDArray[Any]:
    """Return an array of real numbers, in which masked values are NaN.

    Args:
        values: numbers in any form that NumPy takes; or a data frame, of which the columns called x, y and z (or x
            and y; see `coordinate_places`) are taken, else all of two or three.
        name: the argument's name, for the message.

    Raises:
        TypeError: if they are text, truth values, complex numbers or objects. The message names the dtype and, for a
            data frame, the columns.
        ValueError: if they form no array, because rows have different lengths; or if a data frame has more than three
            columns, and their names do not say which are coordinates.
    """
    values = _coordinates(values, name)
    try:
        array = np.asarray(values)
    except ValueError as error:
        remedy = "give rows equally many numbers, and sets equally many rows, NaN where some are missing"
        raise ValueError(f"{name} form no array: {remedy}") from error
    if array.dtype.kind not in "fiu":
        array = _from_frame(values, array, name)
    if isinstance(values, np.ma.MaskedArray):  # a mask means missing, which is NaN here
        array = np.where(np.ma.getmaskarray(values), np.nan, array)
    return array


def _coordinates(values: Any, name: str) -> Any:
    """The columns of a data frame that are coordinates; anything else as it is."""
    columns = getattr(values, "columns", None)
    if columns is None or not hasattr(values, "to_numpy"):
        return values
    names = [str(column) for column in columns]
    places = coordinate_places(names)
    if turned := [name for name in ([names[i] for i in places] or names) if has_angle(name)]:
        remedy = "convert them to lengths, or pass frame.to_numpy()"
        raise ValueError(f"{name}: column {turned[0]!r} holds angles, not lengths: {remedy}")
    if places:
        return values.iloc[:, places] if hasattr(values, "iloc") else values[[names[i] for i in places]]
    if pair := angles(names):
        raise ValueError(f"{name}: columns {' and '.join(pair)} are angles, not lengths: convert them to x, y, z")
    if len(names) > _USUAL:
        remedy = f"pass those alone, or frame.to_numpy() for all {len(names)} dimensions"
        raise ValueError(f"{name}: {len(names)} columns, and no names say which are x, y and z: {remedy}")
    return values


def _from_frame(values: Any, array: NDArray[Any], name: str) -> NDArray[Any]:
    """The numbers of a data frame whose columns may miss some; TypeError for anything else."""
    columns, dtypes = getattr(values, "columns", None), getattr(values, "dtypes", None)
    if columns is None or dtypes is None or not hasattr(values, "to_numpy"):
        raise TypeError(f"{name} have dtype {array.dtype}: expected real numbers")
    kinds = {str(column): dtype for column, dtype in zip(columns, dtypes, strict=True)}
    rest = [column for column, dtype in kinds.items() if getattr(dtype, "kind", "O") in "fiu"]
    if len(rest) < len(kinds):
        remedy = f"pass the others, {', '.join(map(repr, rest))}, alone" if rest else "no column is left"
        faults = [f"{column!r} has dtype {dtype}" for column, dtype in kinds.items() if column not in rest]
        raise TypeError(f"{name}: column {', '.join(faults[:5])}, which is not one of real numbers; {remedy}")
    return np.asarray(values.to_numpy(dtype=float, na_value=np.nan))


Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Words = NDArray[np.uint64]


Array = TypeVar("Array", Floats, Ints, Bools)


def as_number(array: Array) -> Array:
    """The number of an array without axes, as NumPy's and SciPy's functions return one; other arrays as they are."""
    return array[()]

"""Arrays of real numbers from what a user passes: lists, masked arrays, data frames."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from study.text.coordinate_names import angles, coordinate_places

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
    if places := coordinate_places(names):
        return values.iloc[:, places] if hasattr(values, "iloc") else values[[names[i] for i in places]]
    if pair := angles(names):
        raise ValueError(f"{name}: columns {' and '.join(pair)} are angles, not lengths: convert them to x, y, z")
    if len(names) > _USUAL:
        whole = f"or frame.to_numpy() for all {len(names)} dimensions"
        raise ValueError(
            f"{name}: {len(names)} columns, and no names say which are x, y and z: pass those alone, {whole}"
        )
    return values


def _from_frame(values: Any, array: NDArray[Any], name: str) -> NDArray[Any]:
    """The numbers of a data frame whose columns may miss some; TypeError for anything else."""
    columns, dtypes = getattr(values, "columns", None), getattr(values, "dtypes", None)
    if columns is None or dtypes is None or not hasattr(values, "to_numpy"):
        raise TypeError(f"{name} have dtype {array.dtype}: expected real numbers")
    kinds = {str(column): dtype for column, dtype in zip(columns, dtypes, strict=True)}
    wrong = [column for column, dtype in kinds.items() if getattr(dtype, "kind", "O") not in "fiu"]
    if wrong:
        rest = [column for column in kinds if column not in wrong]
        remedy = f"pass the others, {', '.join(map(repr, rest))}, alone" if rest else "no column is left"
        found = ", ".join(f"{column!r} has dtype {kinds[column]}" for column in wrong[:5])
        raise TypeError(f"{name}: column {found}, which is not one of real numbers; {remedy}")
    return np.asarray(values.to_numpy(dtype=float, na_value=np.nan))

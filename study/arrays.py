"""Arrays of real numbers from what a user passes: lists, masked arrays, data frames.

Names of the array types that functions take and return; a docstring gives the shape.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def real_array(values: ArrayLike, name: str) -> NDArray[Any]:
    """Return an array of real numbers, in which masked values are NaN.

    Args:
        values: numbers in any form that NumPy takes, or a data frame.
        name: the argument's name, for the message.

    Raises:
        TypeError: if they are text, truth values, complex numbers or objects. The message names the dtype and, for a
            data frame, the columns.
        ValueError: if they form no array, because rows have different lengths.
    """
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


Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Words = NDArray[np.uint64]

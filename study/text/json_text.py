"""Results as JSON, for other programs."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path


def json_text(data: Mapping[str, object] | Sequence[object]) -> str:
    """A mapping as a JSON object, in the order of its keys; or a list.

    Args:
        data: what JSON has, mappings, lists, tuples, texts, numbers and None; also arrays of NumPy, and paths.

    Returns:
        The text, indented by two spaces, its letters as they are. NaN and infinities, which JSON does not have, are
        null.

    Raises:
        TypeError: if there is anything else in it.
    """
    return json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False)


def _plain(value: object) -> object:
    if hasattr(value, "tolist"):  # an array or a number of NumPy
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value

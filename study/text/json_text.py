"""Results as one JSON object, for other programs."""

import json
import math
from collections.abc import Mapping
from pathlib import Path


def json_text(data: Mapping[str, object]) -> str:
    """A mapping as a JSON object, in the order of its keys.

    Args:
        data: what JSON has: mappings, lists, tuples, texts, numbers and None; also numbers of NumPy and paths.

    Returns:
        The object, indented by two spaces, its letters as they are. NaN and infinities, which JSON does not have, are
        null.

    Raises:
        TypeError: if there is anything else in it.
    """
    return json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False)


def _plain(value: object) -> object:
    if hasattr(value, "item"):  # a number of NumPy
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value

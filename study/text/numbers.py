"""Numbers in tables for a terminal."""

import math


def number(value: float, form: str = ".3g") -> str:
    """A number in a format of Python's; "-" for NaN."""
    return "-" if math.isnan(value) else f"{value:{form}}"

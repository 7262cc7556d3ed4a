"""Numbers in tables for a terminal."""

import math


def number(value: float, form: str = ".3g") -> str:
    """A number in a format of Python's; "-" for NaN."""
    return "-" if math.isnan(value) else f"{value:{form}}"


def with_error(value: float, error: float) -> str:
    """A value to the second digit of its error: 12.345 ± 0.067."""
    if not math.isfinite(value):
        return "-"
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g} ± ?"
    digits = 1 - int(f"{error:.1e}".partition("e")[2])  # of the rounded error: 0.0996 is 0.10
    if not -6 <= digits <= 12:
        return f"{value:.6g} ± {error:.2g}"
    return " ± ".join(f"{round(each, digits) + 0.0:.{max(digits, 0)}f}" for each in (value, error))

"""Numbers in tables for a terminal."""

import math

_BYTES = {"EB": 1e18, "PB": 1e15, "TB": 1e12, "GB": 1e9, "MB": 1e6}
DAY = 86_400.0
YEAR = 365.25 * DAY
_TIMES = {"years": YEAR, "days": DAY, "h": 3600.0, "min": 60.0, "s": 1.0}


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


def size(count: float) -> str:
    """A number of bytes in the largest unit of which there are at least two, from MB: 3.6 TB."""
    return _in_units(count, _BYTES, "MB")


def duration(seconds: float) -> str:
    """A time in the largest unit of which there are at least two, from s: 3.6 years."""
    return _in_units(seconds, _TIMES, "s")


def _in_units(value: float, units: dict[str, float], least: str) -> str:
    unit = next((name for name, factor in units.items() if value >= 2.0 * factor), least)
    return f"{value / units[unit]:,.1f} {unit}"

"""Text of numbers and designs: three digits, powers of ten, true minus signs."""

import math
import re
from collections.abc import Sequence

from study import style
from study.simulation.experiment.conditions import CONDITIONS, SAMPLES, Condition, Distribution, RowValues, Value
from study.simulation.experiment.config import Study

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
JOINED = "\u00a0"  # no-break space
_NUMBER = r"-?\d+\.?\d*(?:e[+-]\d+)?"


def power_of_ten(exponent: int) -> str:
    """10 raised to a whole number."""
    return "10" + str(exponent).translate(_RAISED)


def count(value: int) -> str:
    """Format a whole number with thousands separated, as the figures and commands do."""
    return f"{value:,}".replace("-", "−")


def number(value: float, digits: int = 3, zeros: bool = False) -> str:
    """Format a number to some digits, with a power of ten if it is very large or small; trailing zeros on request."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    mantissa, _, power = f"{value:{'#' * zeros}.{digits}g}".partition("e")
    mantissa = mantissa.rstrip(".").replace("-", "−")
    if not power:
        return mantissa
    ten = power_of_ten(int(power))
    return ten if mantissa == "1" else f"{mantissa}{JOINED}×{JOINED}{ten}"


def timed(value: float) -> str:
    """Format a single measurement without an error: three digits, no power of ten below 10⁶."""
    if 999.5 <= value < 999_500.0:
        return count(int(float(f"{value:.3g}")))
    return number(value, zeros=True)


def exactly(value: float) -> str:
    """Format a number of a config, not rounded."""
    digits = len(f"{value:.11e}".partition("e")[0].rstrip("0").replace(".", "").lstrip("-"))
    if value == int(value) and (abs(value) < 1e6 or abs(value) < 10.0**digits):
        return count(int(value))
    return number(value, 12 if 1e-4 <= abs(value) < 1e6 else digits)


def measured(value: float, error: float) -> str:
    """Format a number with its Monte-Carlo error: two digits of the error, the number to the same place.

    The number has at most six digits; where the error is larger, both have two of their own. "± ∞" says that there
    are too few trials for an error; a number without one was counted.
    """
    if not math.isfinite(value) or math.isnan(error) or error == 0.0:
        return number(value)
    if math.isinf(error):
        return f"{number(value)} ±{JOINED}∞"
    top = math.floor(math.log10(max(abs(value), error)))
    place = math.floor(math.log10(error)) - 1
    place = max(min(place, top), top - 5)
    power = top if top >= 5 or top < -3 else 0  # break a line before the error, if anywhere
    decimals = max(0, power - place)
    scale = 10.0**-power
    shown = f"{value * scale:.{decimals}f}".replace("-", "−")
    beside = f"{error * scale:.{decimals}f}"
    if abs(value) < error or float(beside) == 0.0:  # the two have no digit in common
        return f"{_plain(value, 6 if error < abs(value) else 2)} ±{JOINED}{_plain(error, 2)}"
    both = f"{shown} ±{JOINED}{beside}"
    return f"({both}){JOINED}×{JOINED}{power_of_ten(power)}" if power else both


def _plain(value: float, digits: int) -> str:
    """Format a number to some digits, without a power of ten unless it is very large or small."""
    if value == 0.0:
        return "0"
    if 10.0 ** (digits - 1) <= abs(value) < 1e5:
        return count(int(float(f"{value:.{digits}g}"))) if abs(value) >= 10.0**digits else number(value, digits)
    return number(value, digits, zeros=True)


def estimator(name: str) -> str:
    """Name of an estimator within a sentence; one that would read as an ordinary word stands between backticks."""
    label = style.label(name)
    return f"`{label}`" if label[0].islower() else label


def percent(part: int, whole: int) -> str:
    """Format a share in per cent; only exact 0 and 1 give 0 % and 100 %."""
    if 0 < part < 0.001 * whole:
        return f"<{JOINED}0.1{JOINED}%"
    if 0.999 * whole < part < whole:
        return f">{JOINED}99.9{JOINED}%"
    return f"{number(100.0 * part / whole)}{JOINED}%"


def moment(text: str) -> str:
    """Format a manifest's time without its T."""
    return text.replace("T", " ").replace("+00:00", " UTC")


def readable(text: str) -> str:
    """Rewrite numbers within a program's text (1.2e-05, -3) with powers of ten and true minus signs."""

    def joined(match: re.Match[str]) -> str:
        return measured(float(match[1]), float(match[2])).replace(" ", JOINED)

    text = re.sub(rf"(?<![\w.)\]])({_NUMBER}) ± ({_NUMBER})", joined, text)
    text = re.sub(r"(?<=\d)e([+-]\d+)\b", lambda match: f"{JOINED}×{JOINED}{power_of_ten(int(match[1]))}", text)
    return re.sub(r"(?<![\w.)\]-])-(?=[\d.])", "−", text)


def share(value: float) -> str:
    """Format a share as a reader says it: none, all, or per cent to two digits."""
    if math.isnan(value):
        return number(value)
    if value in {0.0, 1.0}:
        return "all" if value else "none"
    return f"{number(100.0 * value, 3 if value > 0.99 else 2)}{JOINED}%"


def times(value: float) -> str:
    """Format a ratio to two digits, three above 100."""
    return f"{number(value, 2 if value < 100.0 else 3, zeros=bool(0.1 <= value < 10.0))}{JOINED}times"


def power(value: float) -> str:
    """Format an exponent to two decimals."""
    return f"{value:.2f}".replace("-", "−")


class Quantity(float):
    """A number behind a claim, which a sentence formats by the name of a function: share, times or power."""

    def __format__(self, name: str) -> str:
        """The number in words."""
        return {"share": share, "times": times, "power": power}[name](float(self))


def values(finding: str) -> list[Quantity]:
    """The values in a claim's finding, which has a number a line: "words: value ± error", or without an error.

    Raises:
        ValueError: if a line is not so.
    """
    return [Quantity(line.rpartition(": ")[2].partition(" ± ")[0]) for line in finding.splitlines()]


def dimension(study: Study) -> str:
    """Name of the fitted shape in d dimensions."""
    d = study.dimension
    return {2: "circles in the plane", 3: "spheres in space"}.get(d, f"spheres in {d} dimensions")


def condition(which: Condition, row: RowValues) -> str:
    """The value of a condition in a row of a table."""
    value = which.of(row)
    if isinstance(value, str):
        return value
    return count(int(value)) if which.kind is int else number(value, which.digits) + which.mark


def design(study: Study) -> str:
    """Sentence that describes a study's design."""
    made = study.design
    given = [(CONDITIONS[name], entry) for name, entry in made.given().items()]
    values = "; ".join(f"{c.symbol}{JOINED}{_entry(entry, c.mark)}" for c, entry in given)
    if made.one_trial_a_cell:
        return f"{count(made.trials)} trials, each with conditions of its own: {values}"
    cells, most = study.cells(), "up to " if study.precision is not None else ""
    trials = {made.trials_of(int(n)) for n in made.values(SAMPLES) or ()}
    number = count(made.trials) if len(trials) == 1 else f"{count(min(trials))} to {count(max(trials))}"
    if cells == 1:
        return f"one cell of {most}{number} trials: {values}"
    draws = "each with draws of its own" if study.independent() else "all from the same draws"
    return f"{count(cells)} cells of {most}{number} trials, {draws}: {values}"


def _entry(entry: tuple[Value, ...] | Distribution, mark: str) -> str:
    """An axis of a grid, or a law of a random design."""
    if isinstance(entry, tuple):
        return f"={JOINED}{_values(entry, mark)}"
    values = entry.possible()
    if entry.continuous:
        low, high = (exactly(value) + mark for value in values)
        return f"{entry.name} from{JOINED}{low} to{JOINED}{high}"
    return f"={JOINED}{exactly(values[0])}{mark}" if len(values) == 1 else f"one of {_values(values, mark)}"


def _values(values: Sequence[Value], mark: str) -> str:
    if len(values) <= 6:
        return ", ".join(_exactly(v) + mark for v in values)
    first = ", ".join(_nearly(v) + mark for v in values[:3])
    return f"{first}, …, {_nearly(values[-1])}{mark} ({len(values)}{JOINED}values)"


def _exactly(value: Value) -> str:
    return value if isinstance(value, str) else exactly(value)


def _nearly(value: Value) -> str:
    """A value as given if it is whole, else in three digits."""
    return _exactly(value) if isinstance(value, str) or value == int(value) else number(value)

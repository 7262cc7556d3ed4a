"""Operations of a fit by the paper's formulas and statements."""

import math
from collections.abc import Callable


def _gdke(n: int, d: int) -> float:
    """Eqs 7-8 of the paper: 26 N + 45 in three dimensions."""
    return n * (d * d + 6 * d - 1) + d * (d + 1) * (d + 8) / 3.0 + 1.0


PAPER: dict[str, Callable[[int, int], float]] = {
    "gdke": _gdke,
    "ugdk": _gdke,
    "als": lambda n, d: math.nan,  # not in the paper
    "igdk": lambda n, d: 4.0 * _gdke(n, d),  # §8: "about four times slower"
    "lls": lambda n, d: 236.0 * n + 709.0 if d == 3 else math.nan,  # §4.4
    "mle": lambda n, d: 80.0 * _gdke(n, d),  # §10: "about 80 times faster than the MLE"
}
"""FLOPs of a fit of n samples in d dimensions, by estimator; NaN if the paper gives none."""

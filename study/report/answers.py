"""One sentence of answer to each claim, made from the numbers that its verdict was computed from.

The words of a sentence do not depend on the numbers: only its numbers and the verdict change. To answer a new claim,
write an entry in `ANSWERS`; a claim without one is answered by the first of its numbers.
"""

import math
from collections.abc import Callable, Sequence

from study.analysis.claims.claim import Verdict
from study.report import words

Values = Sequence[float]
"""The values behind a claim, in the order of its finding."""

_BEGINNINGS = {Verdict.REPRODUCED: "Yes", Verdict.PARTLY: "In part", Verdict.NOT_REPRODUCED: "No"}


def parts(share: float) -> str:
    """Format a share as a reader says it: none, all, or per cent to two digits."""
    if math.isnan(share):
        return words.number(share)
    if share in {0.0, 1.0}:
        return "all" if share else "none"
    return f"{words.number(100.0 * share, 3 if share > 0.99 else 2)}\u00a0%"


def times(value: float) -> str:
    """Format a ratio to two digits, three above 100."""
    return f"{words.number(value, 2 if value < 100.0 else 3, zeros=bool(0.1 <= value < 10.0))}\u00a0times"


def power(value: float) -> str:
    """Format an exponent to two decimals."""
    return f"{value:.2f}".replace("-", "−")


ANSWERS: dict[str, Callable[[Values], str]] = {
    "one-line": lambda n: (
        f"over the paper's range MLE's median error grows as σ to the power {power(n[0])}; where GDKE's bias "
        f"dominates, GDKE's as σ to the power {power(n[4])}."
    ),
    "ugdk-closest": lambda n: (
        f"UGDK is clearly the closest in {parts(n[0])} of the decades of noise, and another method is clearly closer "
        f"in {parts(n[1])}."
    ),
    "gdke-on-par": lambda n: (
        f"GDKE's median error is up to {times(n[0])} MLE's; at the smallest noise it is {times(n[1])} MLE's."
    ),
    "mle-outliers": lambda n: (
        f"of the trials with noise around the radius, {parts(n[0])} are such outliers; the best of three starts mends "
        f"{parts(n[1])} of them."
    ),
    "lls-outliers-small": lambda n: (
        f"of LLS's fits there, {parts(n[0])} are outliers, and {parts(n[1])} if small singular values are cut."
    ),
    "lls-outliers-place": lambda n: (
        f"{parts(n[1])} of the outliers lie on the sphere if the design matrix is centred, {parts(n[3])} if it is not."
    ),
    "lls-outliers-large": lambda n: (
        f"of LLS's fits there, {parts(n[0])} are outliers or fail in double precision, {parts(n[1])} in single "
        "precision."
    ),
    "gdke-bias-order": lambda n: (
        f"the bias grows as σ to the power {power(n[0])}, {power(n[1])} and {power(n[2])} on three caps."
    ),
    "gdke-bias-stays": lambda n: (
        f"the bias is {times(n[0])} the scatter, {parts(n[1])} of the 95 % ellipses hold the true centre, and at the "
        f"largest number of samples the bias is {times(n[2])} that at the smallest."
    ),
    "ugdk-efficient": lambda n: (
        f"UGDK's variance along the axis is up to {times(n[0])} the bound's; at the smallest noise it is "
        f"{times(n[2])} the bound's."
    ),
    "bound-for-all": lambda n: (
        f"the least root mean square error is {times(n[0])} the bound; where the bias is not significant it is "
        f"{times(n[2])} the bound."
    ),
    "gdke-even-data": lambda n: (
        f"on the whole sphere GDKE errs up to {times(n[0])} as far as an efficient estimator; on the smallest cap its "
        f"error is up to {times(n[-1])} the bound."
    ),
    "ugdk-bias": lambda n: f"UGDK's bias goes as N to the power {power(n[0])}, GDKE's as N to the power {power(n[1])}.",
    "ugdk-error": lambda n: (
        f"at σ = .02 r the median error goes as N to the power {power(n[0])}; where σ ≥ r, as N to the power "
        f"{power(n[2])}."
    ),
    "figure-4-setting": lambda n: (
        f"{parts(n[0])} of the trials have a smaller ρ than the paper's, {parts(n[1])} have ρ < 1, and {parts(n[2])} "
        "of the ellipses hold the true centre."
    ),
    "noise-from-the-points": lambda n: (
        f"ALS's noise variance is {times(n[0])} the true one, and UGDK with a Σ estimated from the points errs up to "
        f"{times(n[1])} as far as with the true Σ."
    ),
    "markers-averaged": lambda n: (
        f"the fit to all markers errs {times(n[0])} as far as the best marker alone, and less than the worst in "
        f"{parts(n[1])} of the trials."
    ),
    "markers-positive-definite": lambda n: (
        f"the sum is positive definite in {parts(n[1])} of the trials, and in {parts(n[0])} at the worst noise."
    ),
    "same-cost": lambda n: (
        f"UGDK takes {times(n[0])} the operations of GDKE, and on this machine {times(n[1])} its time."
    ),
    "incremental-cost": lambda n: (
        f"IGDK takes {times(n[0])} the operations of GDKE, and on this machine {times(n[1])} its time."
    ),
    "speed": lambda n: f"LLS takes {times(n[0])} the operations of GDKE, MLE {times(n[1])}.",
    "power-law": lambda n: (
        f"the median error of UGDK falls as N to the power {power(n[0])}, GDKE's as N to the power {power(n[2])}."
    ),
    "recordings-within-1-cm": lambda n: f"above 200 samples {parts(n[0])} of the spreads are below 1 cm.",
}
"""Sentences by the name of their claim."""


def answer(name: str, verdict: str, finding: str) -> str:
    """Answer a claim in one sentence.

    Args:
        name: the claim's.
        verdict: its verdict.
        finding: the lines of its numbers, as the claims table has them.

    Returns:
        "Yes", "In part" or "No", and the sentence; the verdict itself where it is another.
    """
    begin = _BEGINNINGS.get(Verdict(verdict), verdict) if verdict in set(Verdict) else verdict.capitalize()
    try:
        rest = ANSWERS[name](words.values(finding))
    except (KeyError, IndexError, ValueError):  # a claim of another version, or one whose numbers are fewer
        rest = words.readable(finding.partition("\n")[0])
    return f"{begin}: {rest}"

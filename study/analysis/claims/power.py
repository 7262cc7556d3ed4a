"""The claim of section 9.1 and figure 7 that the error falls as 1/√N, on points whose truth is known."""

import pandas as pd

from study.analysis.claims.claim import Claim, Evidence, Number, Verdict
from study.analysis.claims.shared_measures import failures_last, formed, law, of, within


def _measure_power(evidence: Evidence) -> list[Number]:
    errors = evidence.table("power-law", "errors")
    return [_exponent(errors, "ugdk"), *formed(_exponent(errors, name) for name in ("mle", "gdke"))]


def _exponent(errors: pd.DataFrame, estimator: str) -> Number:
    part = of(errors, estimator)
    at = part["samples"].to_numpy(dtype=float)
    words = f"exponent of N in {estimator.upper()}'s median error, all fits"
    return law(words, at, failures_last(part, part["error"]), at)


def _judge_power(numbers: list[Number]) -> Verdict:
    exponent = numbers[0]
    if within(exponent, -0.5, 0.05):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if exponent.value + 2.0 * exponent.error < -0.25 else Verdict.NOT_REPRODUCED


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="power-law",
        section="9.1",
        statement="The accuracy improves with the number of samples by a power law close to 1/√N.",
        quantity="exponent of N in the median error",
        criterion="Reproduced if UGDK's exponent is within .05 of -½, two standard errors included; partly if it is "
        "below -.25 by two; not reproduced otherwise.",
        reads=("power-law/errors",),
        measure=_measure_power,
        judge=_judge_power,
        figure="fig7_power_law",
        remark="The paper reads it off the spread of fits to motion capture; here the truth is known. GDKE's error "
        "stops at its bias, which a spread over repetitions cannot show.",
    ),
)

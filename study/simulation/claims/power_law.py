"""The claim of section 9.1 and figure 7 that the error falls as 1/√N, tested on points with known truth."""

import numpy as np
import pandas as pd

from study.simulation.claims.claim import Claim, Evidence, Number, Verdict, only_known
from study.simulation.claims.measures import error_over, exponent, rows_of, within


def _measure_power(evidence: Evidence) -> list[Number]:
    errors = evidence.errors("power-law", "error")
    return [_exponent(errors, "ugdk"), *only_known(_exponent(errors, name) for name in ("mle", "gdke"))]


def _exponent(errors: pd.DataFrame, estimator: str) -> Number:
    part = rows_of(errors, estimator)
    at = part["samples"].to_numpy(dtype=float)
    words = f"exponent of N in {estimator.upper()}'s median error, all fits"
    return exponent(words, at, np.asarray(error_over(part, "radius")), at)


def _judge_power(numbers: list[Number]) -> Verdict:
    ugdk = numbers[0]
    if within(ugdk, -0.5, 0.05):
        return Verdict.REPRODUCED
    return Verdict.PARTLY if ugdk.value + 2.0 * ugdk.error < -0.25 else Verdict.NOT_REPRODUCED


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="power-law",
        section="9.1",
        statement="The error falls with the number of samples by a power law close to 1/√N.",
        quantity="exponent of N in the median error",
        criterion="Reproduced if UGDK's exponent and two standard errors on either side are within .05 of -½; partly "
        "if it is below -.25 by two standard errors; not reproduced otherwise. All fits count as computed.",
        answer="the median error of UGDK falls as N to the power {0:power}, GDKE's as N to the power {2:power}.",
        reads=("power-law/errors",),
        measure=_measure_power,
        judge=_judge_power,
        figure="fig7_power_law",
        remark="The paper takes it from the spread of fits to motion capture; here the truth is known. GDKE's error "
        "levels off at its bias, which a spread over repetitions cannot show.",
    ),
)

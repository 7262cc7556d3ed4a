"""Claims of section 9.1 and figure 7: the error falls as 1/√N, on recordings to less than a centimetre."""

import math

import numpy as np
import pandas as pd

from study.analysis.claims.ledger import Claim, Evidence, Number, TableMissing, Verdict
from study.analysis.claims.measured import failures_last, formed, law, of, within
from study.analysis.measures import share

_ENOUGH = 200
_CENTIMETRE = 0.01


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


def _measure_recordings(evidence: Evidence) -> list[Number]:
    """Spreads of joints of recordings; without a table of them, that there are none is the number."""
    try:
        joints = evidence.table("recordings", "joints")
    except TableMissing:
        return [Number("spreads of joints measured on recordings", 0.0, 0.0, 0)]
    many = joints["samples"].to_numpy() > _ENOUGH
    spread = joints["spread"].to_numpy()
    numbers = [Number("spreads of joints measured on recordings", float(len(joints)), 0.0, 0)]
    for words, these in ((f"above {_ENOUGH}", many), (f"up to {_ENOUGH}", ~many)):
        below = share(int(np.sum(spread[these] < _CENTIMETRE)), int(these.sum()))
        numbers.append(Number.of(f"share of spreads below 1 cm, {words} samples", below, int(these.sum())))
    return numbers


def _judge_recordings(numbers: list[Number]) -> Verdict:
    if numbers[0].value == 0.0:
        return Verdict.NOT_TESTABLE
    above, upto = numbers[1:]
    if above.value - 2.0 * above.error <= 0.5:
        return Verdict.NOT_REPRODUCED
    more = above.value - upto.value > 2.0 * math.hypot(above.error, upto.error)
    return Verdict.REPRODUCED if more else Verdict.PARTLY


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
    Claim(
        name="recordings-within-1-cm",
        section="9.1",
        statement="On recordings, most joints are within one centimetre above about 200 samples.",
        quantity="spread of a joint's centre over random parts of a recording, in metres",
        criterion="Not testable here without spreads of joints from recordings. With them: reproduced if, above 200 "
        "samples, more than half are below 1 cm, by two standard errors, and a greater share than up to 200; partly "
        "if only the first; not reproduced otherwise.",
        reads=("recordings/joints",),
        measure=_measure_recordings,
        judge=_judge_recordings,
        remark="No recording is part of this study, and points simulated on spheres say nothing of skin, soft tissue "
        "and joints that are no ball joints.",
    ),
)

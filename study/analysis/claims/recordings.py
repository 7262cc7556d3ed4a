"""The claim of section 9.1 on recordings: above about 200 samples most joints are within a centimetre.

All fits to a joint share the frames of its recording, in every case study of it, and joints of one name in several
recordings are alike. So each joint counts once, by the share of its spreads that are below a centimetre, and every
standard error is over joints.
"""

import numpy as np
import pandas as pd

from study.analysis.claims.claim import Claim, Number, Verdict, only_known
from study.analysis.claims.evidence import Evidence
from study.sphere.types import Floats
from study.statistics.measures import Measure, mean, share

_MANY = 200
"""Samples above which the claim promises a centimetre."""
_CENTIMETRE = 0.01
_FEWEST = 5
"""Least number of joints: all of four are on one side by chance with probability 2⁻⁴ > .05."""


def _measure_recordings(evidence: Evidence) -> list[Number]:
    spreads = evidence.spreads()
    spreads = spreads.assign(sure=spreads["spread"].where(~spreads["doubted"], np.inf))
    many = spreads["samples"] > _MANY
    above, upto = _below(spreads[many], "spread"), _below(spreads[~many], "spread")
    joints, recordings = (above.index.unique(level).size for level in ("joint", "recording"))
    of = f"{joints} joints of {recordings} recording{'s' * (recordings != 1)}"
    gain = _per_joint(above - upto)
    return [
        _share(f"share of {of} with a spread below 1 cm, above {_MANY} samples", above),
        _over_joints(f"that share minus the share up to {_MANY} samples, joint by joint", mean(gain), len(gain)),
        _share("that share with joints that are in doubt counted as farther", _below(spreads[many], "sure")),
        *only_known(
            [
                _share(
                    "that share with the error of the whole recording's fit in place of the spread",
                    _below(spreads[many], "error"),
                ),
                _share("that share with every axis of hinges, as in the paper", _below(spreads[many], "with_axes")),
            ]
        ),
    ]


def _below(spreads: pd.DataFrame, column: str) -> "pd.Series[float]":
    """For each joint in each recording the share of its spreads that are below a centimetre.

    Case studies of one recording with different seeds are pooled, so that their order does not matter.
    """
    below = (spreads[column] < _CENTIMETRE).astype(float)
    return below.groupby([spreads["joint"], spreads["recording"]]).mean()


def _per_joint(values: "pd.Series[float]") -> Floats:
    """Each joint's mean over the recordings that have a value; every recording has the same weight."""
    return np.asarray(values.dropna().groupby("joint").mean(), dtype=float)


def _share(words: str, below: "pd.Series[float]") -> Number:
    joints = _per_joint(below)
    return _over_joints(words, share(float(joints.sum()), len(joints)), len(joints))


def _over_joints(words: str, measure: Measure, joints: int) -> Number:
    enough = joints >= _FEWEST
    return Number.of(words, measure, joints) if enough else Number.unknown(f"{words} (needs {_FEWEST} joints)")


def _judge_recordings(numbers: list[Number]) -> Verdict:
    above, gain, undoubted = numbers[:3]
    if above.value <= 0.5:
        return Verdict.NOT_REPRODUCED
    most = (number.value - 2.0 * number.error > 0.5 for number in (above, undoubted))
    sure = all(most) and gain.value - 2.0 * gain.error > 0.0
    return Verdict.REPRODUCED if sure else Verdict.PARTLY


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="recordings-within-1-cm",
        section="9.1",
        statement="On recordings, most joints are within one centimetre above about 200 samples.",
        quantity="median distance of a joint's centre, fitted to random frames, from the centre by the whole recording",
        criterion="Reproduced if, by two standard errors over joints, more than half of the spreads above 200 samples "
        "are below 1 cm and of joints that are not in doubt, and a larger share than up to 200 samples; not reproduced "
        "if at most half are below 1 cm; partly otherwise.",
        reads=("case-study",),
        measure=_measure_recordings,
        judge=_judge_recordings,
        remark="A spread within one recording is not a distance to the truth: skin that moves with a joint does not "
        "show in it, so a joint counts for the verdict where its own error raises no doubt. Frames near in time are "
        "correlated, so that the fit to the whole recording errs too. The paper accounts for neither. The standard "
        "errors do not account for errors that the joints of one body share, nor for joints that had no sphere.",
    ),
)

"""The claim of section 9.1 on recordings: above about 200 samples most joints are within a centimetre.

All fits to a joint share the frames of its recording, whichever case study of it they are in, and joints of one name
in several recordings are alike. So each joint counts once, by the share of its spreads that are below a centimetre, and
every error is one over joints.
"""

import numpy as np
import pandas as pd

from study.analysis.claims.claim import Claim, Evidence, Number, Verdict
from study.analysis.claims.shared_measures import formed
from study.sphere.types import Floats
from study.statistics.measures import Measure, mean, share

_ENOUGH = 200
_CENTIMETRE = 0.01
_FEWEST = 5
"""Joints: fewer would be all on one side by chance alone more often than once in 20 times, 2⁻⁴ > .05."""


def _measure_recordings(evidence: Evidence) -> list[Number]:
    spreads = evidence.spreads()
    many = spreads["samples"] > _ENOUGH
    above, upto = _below(spreads[many], "spread"), _below(spreads[~many], "spread")
    joints, recordings = (above.index.unique(level).size for level in ("joint", "recording"))
    of = f"{joints} joints of {recordings} recording{'s' * (recordings != 1)}"
    gain = _per_joint(above - upto)
    return [
        _share(f"share of {of} with a spread below 1 cm, above {_ENOUGH} samples", above),
        _over_joints(f"the same less the share up to {_ENOUGH} samples, joint by joint", mean(gain), len(gain)),
        *formed(
            [
                _share("the same with the error of the whole recording's answer", _below(spreads[many], "error")),
                _share("the same with every axis of hinges, as the paper has it", _below(spreads[many], "with_axes")),
            ]
        ),
    ]


def _below(spreads: pd.DataFrame, column: str) -> "pd.Series[float]":
    """For each joint in each recording the share of its spreads that are below a centimetre.

    Case studies of one recording, with other seeds, are pooled: each is as good a look at the same frames, and to take
    the first would let the order in which they are given decide. They make no second recording.
    """
    below = (spreads[column] < _CENTIMETRE).astype(float)
    return below.groupby([spreads["joint"], spreads["recording"]]).mean()


def _per_joint(values: "pd.Series[float]") -> Floats:
    """Each joint's mean over the recordings that have a value; they count alike, however long they are."""
    return np.asarray(values.dropna().groupby("joint").mean(), dtype=float)


def _share(words: str, below: "pd.Series[float]") -> Number:
    joints = _per_joint(below)
    return _over_joints(words, share(float(joints.sum()), len(joints)), len(joints))


def _over_joints(words: str, measure: Measure, joints: int) -> Number:
    enough = joints >= _FEWEST
    return Number.of(words, measure, joints) if enough else Number.unknown(f"{words} (takes {_FEWEST} joints)")


def _judge_recordings(numbers: list[Number]) -> Verdict:
    above, gain = numbers[:2]
    if above.value <= 0.5:
        return Verdict.NOT_REPRODUCED
    sure = above.value - 2.0 * above.error > 0.5 and gain.value - 2.0 * gain.error > 0.0
    return Verdict.REPRODUCED if sure else Verdict.PARTLY


CLAIMS: tuple[Claim, ...] = (
    Claim(
        name="recordings-within-1-cm",
        section="9.1",
        statement="On recordings, most joints are within one centimetre above about 200 samples.",
        quantity="median distance of a joint's centre, fitted to random frames, from that of the whole recording",
        criterion="Reproduced if, by two standard errors over joints, more than half are below 1 cm above 200 samples, "
        "and more than up to 200; not reproduced if it is not more than half; partly otherwise.",
        reads=("case-study",),
        measure=_measure_recordings,
        judge=_judge_recordings,
        remark="A spread within one recording is no distance to the truth: what skin does alike in every frame is in "
        "no subset's. Frames near in time are worth fewer, so that the whole answer errs, too; the paper has neither. "
        "The errors know nothing of what the joints of one body have in common, nor of joints that had no sphere.",
    ),
)

"""The section ``[precision]`` of a config: cells get trials until the Monte-Carlo error of a measure is small enough.

The error is computed at checkpoints: after a first number of trials, after twice as many, and so on up to
`design.trials`, the cap. A cell stops at the first checkpoint at which the error is small enough for every estimator
that the target is for. So the decision depends on the cell's own rows, and on no other cell's.

A rule that stops at a small *estimated* error prefers errors that were estimated too small. With few checkpoints, each
of twice the trials, that costs little: the true standard error is within the target, and the interval of 2 targets on
either side covers the truth in 97 % of cells. The interval of 2 stored errors covers it in 93 %, against 93 to 95 %
after a number of trials that is fixed beforehand (`tests/statistics/test_precision_coverage.py`).
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from study.experiment.config_faults import Fault
from study.experiment.designs.design import Design
from study.experiment.toml_model import Distinct, Frozen
from study.text.nearest import did_you_mean

MEASURES = (
    *("".join(words) for words in product(("relative_", "ratio_"), ("median", "q05", "q95"), ("", "_ok", "_all"))),
    *("far", "far_ok", "far_all", "axis_median", "axis_median_ok", "tail_index", "bias", "rmse"),
)
"""The measures of the summary that have a Monte-Carlo error."""
_SHARES = ("far", "far_ok", "far_all")
"""Measures that are shares of fits."""


def _known(name: str) -> str:
    if name not in MEASURES:
        raise ValueError(f"no measure of the summary; {did_you_mean(name, MEASURES)}")
    return name


class Precision(Frozen):
    """The rule by which a cell has enough trials.

    Attributes:
        measure: the measure of the summary whose Monte-Carlo error decides.
        target: the error that is small enough, in the measure's own unit.
        relative_target: the same as a fraction of the measure; give one of the two.
        estimators: the estimators whose error must be so small; all of the study's, if None.
        first: trials at the first checkpoint. From 100 trials, the error of a quantile is itself known to 30 %.
        seconds: time after which one `study run` starts no new work; the finished tables do not depend on it.
    """

    measure: Annotated[str, AfterValidator(_known)] = "ratio_median_ok"
    target: Annotated[float, Field(gt=0.0)] | None = None
    relative_target: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    estimators: Distinct[str] | None = None
    first: Annotated[int, Field(ge=100)] = 250
    seconds: Annotated[float, Field(gt=0.0)] | None = None

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        given = [name for name in ("target", "relative_target") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "neither"
            raise ValueError(f"give target or relative_target, one of the two (found {found})")
        return self

    def checkpoints(self, cap: int) -> list[int]:
        """Numbers of trials at which a cell is examined, up to the most that it may have."""
        points = [min(self.first, cap)]
        while points[-1] < cap:
            points.append(min(2 * points[-1], cap))
        return points

    def goal(self, value: float) -> float:
        """The largest error that is small enough, for a measure of this value."""
        return self.target if self.target is not None else float(self.relative_target or 0.0) * abs(value)

    def reached(self, value: float, error: float) -> bool:
        """True if the error of a measure is small enough; one that is infinite, or not a number, never is."""
        return math.isfinite(error) and error <= self.goal(value)


def precision_faults(precision: Precision, estimators: Sequence[str], design: Design, keep: str) -> list[Fault]:
    """Find entries of a ``[precision]`` that a study cannot satisfy.

    Args:
        precision: the config's section.
        estimators: the study's.
        design: the study's, whose number of trials is the most that a cell has.
        keep: the study's: errors or summary.
    """
    faults = []
    if precision.relative_target is not None and precision.measure in _SHARES:
        words = f"{precision.measure} is a share, which may be 0, and no error is a fraction of 0: give target instead"
        faults.append(Fault(("precision", "relative_target"), words, precision.relative_target))
    if design.one_trial_a_cell:
        words = 'a random design has one trial in a cell: design.kind = "grid", or leave [precision] out'
        faults.append(Fault(("precision",), words))
    if keep == "summary":
        faults.append(Fault(("precision",), 'needs the errors, which keep = "summary" does not store'))
    if not design.one_trial_a_cell and design.trials < precision.first:
        words = f"design.trials = {design.trials} is the cap, and below the first checkpoint: raise it, or lower first"
        faults.append(Fault(("precision", "first"), words, precision.first))
    unknown = [name for name in precision.estimators or () if name not in estimators]
    if unknown:
        words = f"{', '.join(map(repr, unknown))} not among the study's; {did_you_mean(unknown, estimators)}"
        faults.append(Fault(("precision", "estimators"), words))
    return faults

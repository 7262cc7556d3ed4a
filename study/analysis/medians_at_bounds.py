"""Medians that an efficient estimator would have, beside those measured: at the Cramér-Rao and the attainable bound."""

import math
from typing import NamedTuple

from study.analysis.asymptotics import median_at_bound, median_attainable
from study.experiment.conditions import ANGLE, NOISE_OVER_RADIUS, RowValues, bound_law
from study.experiment.config import Study
from study.sphere.cap_moments import cap_moments


class AtBounds(NamedTuple):
    """Medians of error over √tr CRLB, for Gaussian errors.

    Attributes:
        cramer_rao: at the Cramér-Rao bound, which treats the directions as known.
        attainable: at the attainable bound, which does not; NaN where it cannot be formed.
    """

    cramer_rao: float
    attainable: float


def has_bounds(study: Study) -> bool:
    """True if every cell of a study has both bounds: in a grid, with isotropic Gaussian noise."""
    departs = bound_law([condition.name for condition in study.conditions()]) != ""
    return study.noise_law.isotropic and not departs and not study.design.one_trial_a_cell


def medians_at_bounds(study: Study, row: RowValues) -> AtBounds:
    """Medians of efficient estimators in the cell of a row of the summary."""
    angle, noise = float(ANGLE.of(row)), float(NOISE_OVER_RADIUS.of(row))
    at_bound = median_at_bound(cap_moments(math.radians(angle), study.dimension), study.dimension)
    return AtBounds(at_bound, median_attainable(angle, noise, study.dimension))

"""Faults of a config whose noise is not normal: entries that are for normal noise alone, or without effect."""

from collections.abc import Collection, Mapping

from study.experiment.conditions import DEPARTURES, LAW, OUTLIER_SHARE, OUTLIER_SIZE
from study.experiment.config_faults import Fault


def departure_faults(given: Collection[str], has: Mapping[str, bool]) -> list[Fault]:
    """Find entries that do not go with another law of the noise, or with outliers.

    Args:
        given: names of the conditions that a design gives, without those at their defaults.
        has: for ``posterior`` and ``noise_shape``, true if the config has one.
    """
    named = [condition.name for condition in DEPARTURES if condition.name in given]
    faults = []
    if named and has["posterior"]:
        words = f"its likelihoods are of normal noise without outliers: take {' and '.join(named)} out of the design"
        faults.append(Fault(("posterior",), words))
    if LAW.name in named and has["noise_shape"]:
        faults.append(Fault(("noise_shape",), f"is the covariance of normal noise: take {LAW.name} out of the design"))
    if OUTLIER_SIZE.name in named and OUTLIER_SHARE.name not in named:
        words = f"has no effect without {OUTLIER_SHARE.name}, the probability of an outlier"
        faults.append(Fault(("design", OUTLIER_SIZE.name), words))
    return faults

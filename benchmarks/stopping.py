"""The rule of adaptive runs, tried on laws with known medians; `python benchmarks/stopping.py` stores its coverage.

The stopping rule is run many times on what it judges: error over bound of one centre coordinate, |z| with z standard
normal, as of an efficient estimator in one dimension, whose median is Φ⁻¹(3/4); and |c| with c of Cauchy's law, which
has no mean, as UGDK's error has none, and whose median is 1. Neither truth comes from a simulation. Each law is tried
at 8 targets, so that the first checkpoint is at different distances from them.
"""

import numpy as np
from scipy import stats
from studies import store

from study.fits import Status
from study.simulation.experiment.config import Precision
from study.simulation.statistics import measured

CAP = 16_000
REPEATS = 500
FACTORS = np.geomspace(1.0, 4.0, 8)
LAWS = {"normal": (stats.halfnorm, stats.norm.ppf(0.75)), "cauchy": (stats.halfcauchy, 1.0)}


def _columns(values):
    """Rows of the error table with these errors over bound."""
    one = np.ones(len(values))
    return {"error": values, "error_1": values, "bound": one, "radius": one, "status": np.full(len(values), Status.OK)}


def stop(precision, values):
    """The measure where the rule stops, its error, and the number of trials."""
    for count in precision.checkpoints(len(values)):
        measure = measured(precision.measure, _columns(values[:count]))
        if precision.reached(*measure):
            break
    return *measure, count


def studies(name):
    """Deviations from the truth, errors, targets, factors and trials (5, n) of studies that reached their target."""
    law, truth = LAWS[name]
    rng = np.random.default_rng(20)
    at_first = 0.5 / law.pdf(truth) / np.sqrt(250)  # the median's standard error, asymptotically
    rows = []
    for factor in FACTORS:
        target = at_first / factor
        for values in law.rvs(size=(REPEATS, CAP), random_state=rng):
            value, error, count = stop(Precision(target=target), values)
            assert count < CAP
            rows.append((value - truth, error, target, factor, count))
    return np.array(rows).T


def fixed(name, count, repeats=4000):
    """Share of studies of a fixed number of trials whose truth lies within two of their errors."""
    law, truth = LAWS[name]
    rng = np.random.default_rng(21)
    held = 0
    for values in law.rvs(size=(repeats, count), random_state=rng):
        value, error = measured("ratio_median_ok", _columns(values))
        held += abs(value - truth) <= 2.0 * error
    return held / repeats


def rows():
    """A row per law and quantity: real standard error over target, and shares of studies that hold the truth."""
    for law in LAWS:
        away, error, target, factor, _ = studies(law)
        spread = [float(np.sqrt(np.mean((away / target)[factor == each] ** 2))) for each in FACTORS]
        quantities = {
            "spread": float(np.sqrt(np.mean((away / target) ** 2))),
            "spread_least": min(spread),
            "spread_greatest": max(spread),
            "two_targets": float(np.mean(np.abs(away) <= 2.0 * target)),
            "two_errors": float(np.mean(np.abs(away) <= 2.0 * error)),
        }
        quantities |= {f"fixed_{count}": fixed(law, count) for count in (250, 1000, 4000)}
        yield from ({"law": law, "quantity": name, "value": value} for name, value in quantities.items())


if __name__ == "__main__":
    store("stopping", rows())

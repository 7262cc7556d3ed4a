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


def studies(name):
    """Deviations from the truth and errors (2, 8, n), over the targets, of studies that reached them."""
    law, truth = LAWS[name]
    rng = np.random.default_rng(20)
    targets = 0.5 / law.pdf(truth) / np.sqrt(250) / FACTORS  # the median's standard error at first, asymptotically
    rows = []
    for target in targets:
        precision = Precision(target=target)
        for values in law.rvs(size=(REPEATS, CAP), random_state=rng):
            measures = ((n, measured(precision.measure, _columns(values[:n]))) for n in precision.checkpoints(CAP))
            count, (value, error) = next(row for row in measures if precision.reached(*row[1]) or row[0] == CAP)
            assert count < CAP
            rows.append(((value - truth) / target, error / target))
    return np.moveaxis(np.reshape(rows, (len(targets), REPEATS, 2)), 2, 0)


def fixed(name, count, repeats=4000):
    """Share of studies of a fixed number of trials whose truth lies within two of their errors."""
    law, truth = LAWS[name]
    sets = law.rvs(size=(repeats, count), random_state=np.random.default_rng(21))
    value, error = np.transpose([measured("ratio_median_ok", _columns(values)) for values in sets])
    return float(np.mean(np.abs(value - truth) <= 2.0 * error))


def rows():
    """A row per law and quantity: real standard error over target, and shares of studies that hold the truth."""
    for law in LAWS:
        away, error = studies(law)
        spread = np.sqrt(np.mean(away**2, axis=1))
        quantities = {
            "spread": np.sqrt(np.mean(away**2)),
            "spread_least": spread.min(),
            "spread_greatest": spread.max(),
        }
        quantities |= {"two_targets": np.mean(np.abs(away) <= 2.0), "two_errors": np.mean(np.abs(away) <= 2.0 * error)}
        quantities |= {f"fixed_{count}": fixed(law, count) for count in (250, 1000, 4000)}
        yield from ({"law": law, "quantity": name, "value": float(value)} for name, value in quantities.items())


if __name__ == "__main__":
    store("stopping", rows())

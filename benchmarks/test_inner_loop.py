"""The compiled inner loop beside the naive one: draw, four estimators, errors and bound of the same trials.

The claim: at N = 1000 the compiled loop is at least 12 times as fast. The fastest row is 1.0 in its group.
"""

import math

import naive
import numpy as np
import pytest

from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import Study
from study.simulation.experiment.sampling import units

SIGMA, ANGLE = 0.05, 60.0


def whole_study(samples, trials):
    """A grid of one cell, as one unit."""
    design = {"kind": "grid", "trials": trials, "samples": [samples], "noise": SIGMA, "angle": ANGLE}
    config = Study.model_validate(
        {"name": "bench", "seed": 1, "estimators": ["mle", "lls", "gdke", "ugdk"], "design": design}
    )
    (unit,) = units(config)
    return config, unit


@pytest.mark.parametrize(("samples", "trials"), [(10, 2000), (1000, 200), (100_000, 4)])
@pytest.mark.parametrize("loop", ["compiled", "naive"])
def test_inner_loop(benchmark, loop, samples, trials):
    """Time one loop, and hold that both see the same statistics."""
    benchmark.group = f"inner loop, N = {samples}, per trial"
    words = {"compiled": "compiled, as a run computes it", "naive": "as one would first write it in NumPy"}[loop]
    aim = "≥ 5" if samples == 10 and loop == "naive" else ""
    benchmark.extra_info.update(what=words, items=trials, unit=loop == "compiled", aim=aim)
    if loop == "naive":
        rng = np.random.default_rng(1)
        rows = benchmark(naive.study, rng, trials, samples, math.radians(ANGLE), SIGMA)
        medians = np.median(rows[:, :4] / rows[:, 4:], axis=0)
    else:
        errors = benchmark(compute, *whole_study(samples, trials)).errors
        ratio = errors["error"] / errors["bound"]
        medians = [np.median(ratio[errors["estimator"] == name]) for name in ("mle", "lls", "gdke", "ugdk")]
    assert np.all((np.array(medians) > 0.3) & (np.array(medians) < 200.0))

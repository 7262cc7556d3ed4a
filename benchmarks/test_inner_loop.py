"""The compiled inner loop beside the naive one: draw, four estimators, errors and bound of the same trials.

The claim: at N = 1000 the compiled loop is at least 12 times as fast. The fastest row is 1.0 in its group.
"""

import math

import naive
import numpy as np
import pytest
from studies import FOUR, grid, whole

SIGMA, ANGLE = 0.05, 60.0


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
        errors = benchmark(whole(grid(samples, trials))).errors
        ratio = errors["error"] / errors["bound"]
        medians = [np.median(ratio[errors["estimator"] == name]) for name in FOUR]
    assert np.all((np.array(medians) > 0.3) & (np.array(medians) < 200.0))

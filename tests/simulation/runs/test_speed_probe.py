"""Calibration: seconds between and beyond the measured numbers of samples."""

import math

import numpy as np
import pytest

from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import parse
from study.simulation.experiment.sampling import units
from study.simulation.runs import plan
from study.simulation.runs.plan import Kind, Pace, measure

PACE = Pace(np.array([10.0, 110.0, 1000.0]), np.array([1.0, 2.0, 4.0]), np.array([0.5, 1.5, 2.5]), 0.0)


@pytest.mark.parametrize(
    ("samples", "trials", "count", "seconds"),
    [
        (10, 1, 1, 1.5),  # as measured
        (60, 2, 3, 2 * (1.5 + 3 * 1.0)),  # halfway between two sizes
        (5, 1, 2, 2.0),  # below the first a call costs what it costs
        (4000, 1, 1, 4 * 6.5),  # beyond the last in proportion
    ],
)
def test_seconds(samples, trials, count, seconds):
    """A trial costs its draw and its levels, linear between the sizes; trials of several kinds add up."""
    found = PACE.of({Kind(samples, count, 1): trials, Kind(110, 1, 1): 2})
    assert math.isclose(found, seconds + 2 * 3.5, rel_tol=1e-12)


def test_sizes_are_the_studys(make_text):
    """The study's own numbers of samples are measured, or seven of them, and every one takes time."""
    for samples, expected in (([10, 20, 300], [10, 20, 300]), (list(range(10, 210, 10)), 7)):
        study = parse(make_text({"estimators": ["gdke"]}, samples=samples))
        cells = [cell for unit in units(study) for batch in unit.parts(0) for cell in batch.cells]
        pace = measure(study, cells, 2)
        assert (len(pace.samples) == expected) if isinstance(expected, int) else (list(pace.samples) == expected)
        assert pace.samples[0] == samples[0]
        assert pace.samples[-1] == samples[-1]
        assert np.all(pace.draw > 0.0)
        assert np.all(pace.level > 0.0)


def test_the_first_measurement_does_not_count_alone(make_text, monkeypatch):
    """A first call of ten seconds, which loads compiled code, leaves the pace at the tenth of one of the others."""
    study = parse(make_text({"estimators": ["gdke"]}, samples=[10]))
    cells = [cell for unit in units(study) for batch in unit.parts(0) for cell in batch.cells]
    calls = [0.0]

    def slow_at_first(study, unit):
        calls.append(calls[-1] + (10.0 if len(calls) == 1 else 0.1))
        return compute(study, unit)

    monkeypatch.setattr(plan, "compute", slow_at_first)
    monkeypatch.setattr(plan, "perf_counter", lambda: calls[-1])
    pace = measure(study, cells, 1)
    assert pace.level[0] * study.design.trials_of(10) < 0.11

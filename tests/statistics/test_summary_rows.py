"""Rows of the summary table from errors in memory."""

import pandas as pd

from study.analysis.summary import summary
from study.experiment.compute_unit import compute
from study.experiment.config import Study
from study.experiment.errors import Errors
from study.experiment.units import units
from study.statistics.summary_rows import of_errors

GRID = {"kind": "grid", "trials": 70, "samples": 5, "noise": [0.05, 3.0], "angle": [60, 180], "radius": [1.0, 10.0]}


def test_rows_from_memory_are_rows_from_a_table():
    """From errors in memory, with fits that are not ok, come the rows that `summary` makes of their table."""
    study = Study.model_validate(
        {"name": "test", "seed": 1, "estimators": ["ugdk", "mle"], "keep": "summary", "design": GRID}
    )
    made = [Errors.joined(compute(study, unit).blocks) for unit in units(study)]
    assert len(made) == 2
    for errors in made:
        expected = summary(pd.DataFrame(errors.columns()), by_decade=False)
        rows = pd.DataFrame(of_errors(errors))
        assert (rows["ok"] < rows["planned"]).any()
        pd.testing.assert_frame_equal(rows, expected, check_exact=True)

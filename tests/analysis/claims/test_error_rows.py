"""Rows of error tables: the fits that count as worse than any."""

import math

import pandas as pd

from study.analysis.claims.error_rows import failures_last
from study.estimators import Status


def test_failures_last():
    """Fits that are not ok, or have no number, are worse than any."""
    part = pd.DataFrame({"status": [0, 1, 0], "error": [1.0, 2.0, math.nan]})
    assert list(failures_last(part, part["error"])) == [1.0, math.inf, math.inf]
    assert Status.OK == 0

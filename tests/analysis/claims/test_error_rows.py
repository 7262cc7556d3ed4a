"""Rows of error tables: every fit counts with its error, and one without a number as infinite."""

import math

import pandas as pd

from study.analysis.claims.error_rows import error_over


def test_every_fit_counts():
    """A status leaves no fit out; without a number, or a finite bound, an error is infinite."""
    part = pd.DataFrame(
        {"status": [0, 1, 3, 0], "error": [1.0, 2.0, math.nan, 1.0], "bound": [2.0, 2.0, 2.0, math.inf]}
    )
    assert list(error_over(part, "bound")) == [0.5, 1.0, math.inf, math.inf]

"""The claim of section 9.1 on the power law follows from the stored run."""

import numpy as np
import pandas as pd
import pytest

from study.fits import Status
from study.simulation.claims.claim import Verdict
from study.simulation.claims.recordings import CLAIMS

SAMPLES = [30, 100, 300, 1000, 3000]


@pytest.fixture
def grid(error_rows, scores):
    """Errors ∝ n^e for exponents e of each estimator, with the same spread at each n."""

    def make(**exponents):
        spread = np.exp(0.3 * scores(400))
        rows = [error_rows(name, spread * float(n) ** e, samples=n) for name, e in exponents.items() for n in SAMPLES]
        return pd.concat(rows)

    return make


@pytest.mark.parametrize(
    ("exponent", "verdict"),
    [
        (-0.5, Verdict.REPRODUCED),
        (-0.4, Verdict.PARTLY),
        (-1.0, Verdict.PARTLY),
        (-0.2, Verdict.NOT_REPRODUCED),
        (0.0, Verdict.NOT_REPRODUCED),
    ],
)
def test_power_law(find, grid, exponent, verdict):
    """UGDK's exponent decides; the others are shown."""
    found = find(CLAIMS, "power-law", {"power-law/errors": grid(ugdk=exponent, mle=-0.5, gdke=0.0)})
    assert [n.value for n in found.numbers] == pytest.approx([exponent, -0.5, 0.0], abs=1e-9)
    assert found.numbers[0].trials == 400
    assert found.verdict is verdict


def test_failures_count(find, grid):
    """Fits without a number raise the medians at the largest N; where most have none, the error falls with nothing.

    A status alone changes nothing.
    """
    errors = grid(ugdk=-0.5)
    for share, verdict in ((0.4, Verdict.PARTLY), (0.6, Verdict.NOT_REPRODUCED)):
        failed = (errors["samples"] >= 1000) & (errors["trial"] % 10 < 10 * share)
        table = errors.assign(status=np.where(failed, Status.NOT_POSITIVE_DEFINITE, Status.OK))
        assert find(CLAIMS, "power-law", {"power-law/errors": table}).verdict is Verdict.REPRODUCED
        table = table.assign(error=table["error"].where(~failed))
        found = find(CLAIMS, "power-law", {"power-law/errors": table})
        assert found.numbers[0].value > -0.5
        assert found.verdict is verdict


def test_two_numbers_of_samples_are_no_law(find, grid):
    """A line through two points fits always."""
    errors = grid(ugdk=-0.5)
    found = find(CLAIMS, "power-law", {"power-law/errors": errors[errors["samples"] <= 100]})
    assert found.verdict is Verdict.NOT_EVALUATED

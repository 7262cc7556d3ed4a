"""Claims of section 9.1: the power law follows from the stored run, and recordings wait for a table of them."""

import numpy as np
import pandas as pd
import pytest

from study.analysis.claims.ledger import Verdict
from study.analysis.claims.power import CLAIMS
from study.estimators import Status

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
    """Failures at the largest N raise the medians there; where most fits fail, the error falls with nothing."""
    errors = grid(ugdk=-0.5)
    for share, verdict in ((0.4, Verdict.PARTLY), (0.6, Verdict.NOT_REPRODUCED)):
        failed = (errors["samples"] >= 1000) & (errors["trial"] % 10 < 10 * share)
        table = errors.assign(status=np.where(failed, Status.NOT_POSITIVE_DEFINITE, Status.OK))
        found = find(CLAIMS, "power-law", {"power-law/errors": table})
        assert found.numbers[0].value > -0.5
        assert found.verdict is verdict


def test_two_numbers_of_samples_are_no_law(find, grid):
    """A line through two points fits always."""
    errors = grid(ugdk=-0.5)
    found = find(CLAIMS, "power-law", {"power-law/errors": errors[errors["samples"] <= 100]})
    assert found.verdict is Verdict.NOT_EVALUATED


def test_recordings_are_not_there(find):
    """Without recordings the claim says that it cannot be tested, and that none were measured."""
    found = find(CLAIMS, "recordings-within-1-cm", {})
    assert found.verdict is Verdict.NOT_TESTABLE
    assert [n.value for n in found.numbers] == [0.0]


@pytest.mark.parametrize(
    ("below", "above", "verdict"),
    [(0.05, 0.002, Verdict.REPRODUCED), (0.002, 0.002, Verdict.PARTLY), (0.05, 0.05, Verdict.NOT_REPRODUCED)],
)
def test_recordings(find, below, above, verdict):
    """With a table of joints the verdict is about their spreads up to and above 200 samples."""
    joints = pd.DataFrame({"samples": np.repeat([50, 200, 400, 3000], 20), "spread": np.repeat([below, above], 40)})
    found = find(CLAIMS, "recordings-within-1-cm", {"recordings/joints": joints})
    assert found.verdict is verdict
    assert found.numbers[0].value == 80

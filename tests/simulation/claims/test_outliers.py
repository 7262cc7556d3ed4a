"""Claims on outliers: each verdict follows its table, and turns with it."""

import numpy as np
import pandas as pd
import pytest

from study.fits import Status
from study.simulation.claims.claim import OTHER_CAUSE, Verdict

STARTS = ("mle", "mle_centroid", "mle_mirror", "gdke")
LINEAR = ("lls", "lls_nr", "lls_nr_raw", "lls_single", "gdke")


@pytest.fixture(scope="module")
def starts(error_rows):
    """Trials of noise .001 to 10 r with an error of the bound, and an error of r in the MLE of those about r.

    ``better`` is the residual of the centroid's start there over MLE's, with a tenth of the error.
    """

    def make(outliers=30, better=1.0, trials=400):
        level = np.geomspace(1e-3, 9.9, trials)
        about = np.flatnonzero((level > 0.3) & (level < 3.0))[:outliers]
        parts = []
        for name in STARTS:
            error, residual = 0.01 * level, level**2
            error[about] = 1.0
            if name == "mle_centroid" and better < 1.0:
                error[about], residual[about] = 0.1, better * residual[about]
            if name == "mle_mirror":
                error[level < 0.005] = 1e5
            parts.append(error_rows(name, error, noise=level, bound=0.01 * level, noise_variance=residual))
        return pd.concat(parts, ignore_index=True)

    return make


@pytest.mark.parametrize(
    ("outliers", "better", "verdict"),
    [(30, 0.5, "reproduced"), (30, 1.0, "reproduced, another cause"), (0, 1.0, "not reproduced")],
)
def test_mle(find, starts, outliers, better, verdict):
    """Outliers that a better minimum cures, outliers that it does not, and none."""
    found = find("mle-outliers", {"starts/errors": starts(outliers, better)})
    assert f"{found.verdict}{OTHER_CAUSE * found.other_cause}" == verdict
    within = int(np.sum(np.geomspace(1e-3, 9.9, 400) >= 0.1))
    assert found.numbers[1].value == pytest.approx(outliers / within)
    if outliers:
        assert found.numbers[2].value == (better < 1.0)
        assert found.numbers[3].value == pytest.approx(1.0)


def test_mle_other_solutions_and_runaways(find, starts):
    """Starts that end elsewhere at small noise are counted, and so are answers at infinity that pass for good."""
    level = np.geomspace(1e-3, 9.9, 400)
    table = starts()
    found = find("mle-outliers", {"starts/errors": table})
    assert found.numbers[5].value == pytest.approx(np.mean(level[level < 0.01] < 0.005))
    assert found.numbers[6].value == 0.0
    far = (table["estimator"] == "mle") & (table["trial"] < 8)
    table.loc[far, "error"] = 1e5
    table.loc[far & (table["trial"] < 2), "status"] = int(Status.AT_BOUND)
    found = find("mle-outliers", {"starts/errors": table})
    assert found.numbers[6].value == pytest.approx(6 / 400)


@pytest.fixture(scope="module")
def linear(error_rows):
    """Random trials of 27 decades with an error of the bound in all, but for outliers of given estimators.

    ``outliers(name)`` is (share, from σ/r, to σ/r, error over r): evenly among the trials in that range.
    """

    def make(outliers=lambda name: (0.0, 0.0, 0.0, 0.0), names=LINEAR, trials=2000):
        level = np.geomspace(1e-13, 1e14, trials)
        parts = []
        for name in names:
            share, low, high, size = outliers(name)
            error = 0.01 * level
            inside = np.flatnonzero((level >= low) & (level < high))
            if share > 0.0:
                error[inside[:: round(1 / share)]] = size
            status = np.where(np.isnan(error), int(Status.NOT_FINITE), int(Status.OK))
            parts.append(error_rows(name, error, noise=level, bound=0.01 * level, status=status))
        return pd.concat(parts, ignore_index=True)

    return make


def of(**outliers):
    """Outliers by estimator, as `linear` takes them; none of others."""
    return lambda name: outliers.get(name, (0.0, 0.0, 0.0, 0.0))


SMALL = (0.1, 2e-12, 5e-7, 1.0)


@pytest.mark.parametrize(
    ("outliers", "verdict"),
    [
        (of(lls=SMALL, lls_nr=SMALL, lls_nr_raw=SMALL), Verdict.REPRODUCED),
        (of(lls_nr=SMALL), Verdict.IN_PART),
        (of(lls_nr_raw=SMALL), Verdict.IN_PART),
        (of(lls_nr_raw=(0.1, 2e-12, 1e9, 1e12)), Verdict.NOT_REPRODUCED),
        (of(lls=SMALL), Verdict.NOT_REPRODUCED),
        (of(lls_single=SMALL), Verdict.NOT_REPRODUCED),
        (of(lls=SMALL, lls_nr=SMALL, lls_nr_raw=SMALL, lls_single=SMALL, gdke=SMALL), Verdict.NOT_REPRODUCED),
        (of(lls=(0.1, 1e-13, 9e-13, 1.0)), Verdict.NOT_REPRODUCED),
        (of(), Verdict.NOT_REPRODUCED),
    ],
)
def test_lls_small(find, linear, outliers, verdict):
    """Outliers of both cuts, of one, far above the limit, without a cut, GDKE's too, rounding's, and none."""
    found = find("lls-outliers-small", {"outliers/errors": linear(outliers), "paper/errors": linear()})
    assert found.verdict == verdict
    level = np.geomspace(1e-13, 1e14, 2000)
    inside, asked = (np.sum((level > low) & (level < high)) for low, high in (SMALL[1:3], (1e-12, 1e-6)))
    expected = 0.1 * inside / asked
    shared = outliers("gdke")[0] > 0.0
    for number, name in zip(found.numbers[1:5], ("lls", "lls_nr_raw", "lls_nr", "lls_single"), strict=True):
        if outliers(name) == SMALL:
            assert number.value == pytest.approx(0.0 if shared else expected, rel=0.05)


@pytest.mark.parametrize(
    ("centred", "raw", "verdict"),
    [
        (1.0, 1.0, Verdict.REPRODUCED),
        (1.0, 0.5, Verdict.IN_PART),
        (0.5, 1.0, Verdict.IN_PART),
        (0.5, 0.5, Verdict.NOT_REPRODUCED),
    ],
)
def test_lls_place(find, linear, centred, raw, verdict):
    """The verdict follows from the places of the outliers of both cuts."""
    table = linear(of(lls_nr=(*SMALL[:3], centred), lls_nr_raw=(*SMALL[:3], raw)))
    found = find("lls-outliers-place", {"outliers/errors": table})
    assert found.verdict == verdict
    assert [number.value for number in found.numbers[1:]] == [centred, centred == 1.0, raw, raw == 1.0]


@pytest.mark.parametrize("error", [np.nan, 1e20])
@pytest.mark.parametrize(
    ("names", "low", "verdict"),
    [
        (("lls", "lls_single"), 2e10, Verdict.REPRODUCED),
        (("lls_single",), 2e10, Verdict.IN_PART),
        (("lls_single",), 1.0, Verdict.NOT_REPRODUCED),
        ((), 2e10, Verdict.NOT_REPRODUCED),
    ],
)
def test_lls_large(find, linear, names, low, verdict, error):
    """Failures or outliers above 1e10 r in double precision, in single, in all noise from r on, and none."""
    table = linear(of(**dict.fromkeys(names, (1.0, low, 1e15, error))))
    found = find("lls-outliers-large", {"outliers/errors": table, "paper/errors": linear()})
    assert found.numbers[1].value == pytest.approx(float("lls" in names), abs=0.1)
    assert found.verdict == verdict
    assert found.numbers[4].value == pytest.approx(low if names and np.isnan(error) else np.inf, rel=0.05)

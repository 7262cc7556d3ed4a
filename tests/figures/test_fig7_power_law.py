import dataclasses

import numpy as np
import pandas as pd
import pytest

from study.analysis.summary import summary
from study.figures.inputs import NotApplicable
from study.figures.paper import fig7_power_law


def test_exponents(power_tables):
    """Errors that fall as N^-1/2 have that exponent; those that stop at a bias are said to have none."""
    laws = {tuple(row["estimators"]): row for _, row in fig7_power_law.prepare(power_tables).laws.iterrows()}
    assert set(laws) == {("mle",), ("lls", "gdke"), ("ugdk",)}
    for name in ("mle", "ugdk"):
        law = laws[(name,)]
        assert law["describes"]
        assert abs(law["exponent"] + 0.5) < 1.5 * law["interval"]
        assert law["interval"] < 0.05
    assert not laws[("lls", "gdke")]["describes"]


def test_medians_are_those_of_all_fits(power_tables):
    """Curves are in order of N, with medians that agree with an independent count of the trials."""
    frame = fig7_power_law.prepare(power_tables)
    curve = frame.curves[frame.curves["estimator"] == "mle"]
    assert list(curve["samples"]) == [10, 30, 100, 300, 1000, 3000]
    errors = power_tables.errors
    for _, row in curve.iterrows():
        some = errors[(errors["estimator"] == "mle") & (errors["samples"] == row["samples"])]
        np.testing.assert_allclose(row["median"], np.median(some["error"]))
    np.testing.assert_allclose(frame.bounds["bound"], 0.1 * np.sqrt(3.0 / frame.bounds["samples"]))


def test_failures_count_as_worst(power_tables):
    """Where more than half of the fits have no number there is no median, and the panel says where."""
    errors = power_tables.errors
    bad = (errors["estimator"] == "ugdk") & (errors["samples"] == 10) & (errors["trial"] < 250)
    errors.loc[bad, "error"] = np.nan
    frame = fig7_power_law.prepare(dataclasses.replace(power_tables, summary=summary(errors, False)))
    law = next(row for _, row in frame.laws.iterrows() if row["estimators"] == ["ugdk"])
    assert "$N$ = 10" in law["failed"]
    assert law["describes"]
    texts = [text.get_text() for text in fig7_power_law.draw(frame).axes[0].texts]
    assert any("UGDK: half of the fits" in text for text in texts)


def test_an_estimator_without_any_median(power_tables):
    """One that fails everywhere is named as such, not left out silently."""
    errors = power_tables.errors
    errors.loc[errors["estimator"] == "ugdk", "error"] = np.nan
    frame = fig7_power_law.prepare(dataclasses.replace(power_tables, summary=summary(errors, False)))
    texts = [text.get_text() for text in fig7_power_law.draw(frame).axes[0].texts]
    assert any("without a number at every $N$" in text for text in texts)


@pytest.mark.parametrize(("levels", "panels"), [(1, 1), (2, 2), (4, 4), (9, 4)])
def test_small_multiples_by_noise(power_tables, make_tables, levels, panels):
    """One panel per noise, at most four, the lowest and the highest among them; other axes stay at their first."""
    noises = np.geomspace(0.001, 1.0, levels)
    base = power_tables.errors
    parts = [base.assign(noise=noise, cell=base["cell"] + f"-{i}") for i, noise in enumerate(noises)]
    parts.append(base.assign(angle=90.0, cell=base["cell"] + "-other"))
    frame = fig7_power_law.prepare(make_tables(pd.concat(parts, ignore_index=True), "grid"))
    assert len(frame.limits) == panels
    np.testing.assert_allclose([frame.limits.index.min(), frame.limits.index.max()], [noises.min(), noises.max()])
    assert frame.fixed == "$φ$ = 60°"
    assert len(fig7_power_law.draw(frame).axes) == panels


def test_reasons(power_tables, random_tables):
    """A random design has no curves, and three numbers of samples are no law."""
    with pytest.raises(NotApplicable, match='kind = "grid"'):
        fig7_power_law.prepare(random_tables)
    summary = power_tables.summary
    with pytest.raises(NotApplicable, match="at least 4 numbers of samples"):
        fig7_power_law.prepare(dataclasses.replace(power_tables, summary=summary[summary["samples"] < 300]))

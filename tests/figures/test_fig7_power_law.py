import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from study.estimators import Status
from study.figures import fig7_power_law
from study.figures.expected import gdke_bias, median_at_bound
from study.figures.inputs import NotApplicable
from study.sphere.cap import cap_moments, sample_cap


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
    """Where more than half of the fits failed there is no median, and the panel says where."""
    errors = power_tables.errors
    bad = (errors["estimator"] == "ugdk") & (errors["samples"] == 10) & (errors["trial"] < 250)
    errors.loc[bad, "status"] = int(Status.NOT_POSITIVE_DEFINITE)
    from study.analysis.summary import summary

    frame = fig7_power_law.prepare(dataclasses.replace(power_tables, summary=summary(errors, False)))
    law = next(row for _, row in frame.laws.iterrows() if row["estimators"] == ["ugdk"])
    assert "$N$ = 10" in law["failed"]
    assert law["describes"]
    texts = [text.get_text() for text in fig7_power_law.draw(frame).axes[0].texts]
    assert any("UGDK: most fits" in text for text in texts)


def test_an_estimator_without_any_median(power_tables):
    """One that fails everywhere is named as such, not left out silently."""
    errors = power_tables.errors
    errors.loc[errors["estimator"] == "ugdk", "status"] = int(Status.SINGULAR)
    from study.analysis.summary import summary

    frame = fig7_power_law.prepare(dataclasses.replace(power_tables, summary=summary(errors, False)))
    texts = [text.get_text() for text in fig7_power_law.draw(frame).axes[0].texts]
    assert any("not ok at every $N$" in text for text in texts)


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


@pytest.mark.parametrize("dimension", [2, 3, 5])
@pytest.mark.parametrize("degrees", [20.0, 60.0, 180.0])
def test_cap_moments_agree_with_drawn_directions(dimension, degrees):
    """Quadrature agrees with the mean and variance of a sample of directions."""
    u = sample_cap(np.random.default_rng(4), 200_000, math.radians(degrees), dimension)
    moments = cap_moments(math.radians(degrees), dimension)
    assert abs(u[:, 0].mean() - moments.mean) < 5 * math.sqrt(moments.along / len(u))
    np.testing.assert_allclose(u[:, 0].var(), moments.along, rtol=0.02)
    np.testing.assert_allclose(u[:, 1].var(), moments.across, rtol=0.02)


def test_cap_moments_in_closed_form():
    """Archimedes: on a sphere u₁ is uniform; and the small angle keeps its digits (Kₐ → φ⁴/48)."""
    phi = math.radians(60.0)
    m1, m2 = (1 + math.cos(phi)) / 2, (1 + math.cos(phi) + math.cos(phi) ** 2) / 3
    np.testing.assert_allclose(cap_moments(phi, 3), [m1, m2 - m1**2, (1 - m2) / 2], rtol=1e-12)
    np.testing.assert_allclose(cap_moments(1e-6, 3).along, 1e-24 / 48, rtol=1e-9)


def test_gdke_bias():
    """m₁σ²/(Kₐ + σ²) for isotropic noise; for a covariance the matrix formula, whichever way it is solved."""
    moments = cap_moments(math.radians(60.0), 3)
    np.testing.assert_allclose(gdke_bias(0.02, moments, np.eye(3)), 0.75 * 4e-4 / (1 / 48 + 4e-4))
    shape = np.array([[1.0, 0.3, 0.0], [0.3, 2.0, 0.0], [0.0, 0.0, 0.5]])
    extent = np.diag([moments.along, moments.across, moments.across])
    told = np.linalg.inv(extent + 0.01 * shape) @ (0.01 * shape) @ [moments.mean, 0.0, 0.0]
    np.testing.assert_allclose(gdke_bias(0.1, moments, shape), np.linalg.norm(told))


def test_median_at_bound():
    """On the whole sphere the length is χ₃/√3; on a cap it agrees with drawn Gaussians."""
    np.testing.assert_allclose(
        median_at_bound(cap_moments(math.pi, 3), 3), math.sqrt(stats.chi2.median(3) / 3), rtol=1e-6
    )
    for dimension in (2, 3):
        moments = cap_moments(math.radians(40.0), dimension)
        variance = 1.0 / np.array([moments.along] + [moments.across] * (dimension - 1))
        drawn = np.random.default_rng(5).normal(size=(400_000, dimension)) * np.sqrt(variance / variance.sum())
        np.testing.assert_allclose(
            np.median(np.linalg.norm(drawn, axis=1)), median_at_bound(moments, dimension), rtol=0.01
        )

"""The figure of robustness: the medians that it shows, their order, and the reasons where there is none."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from study.experiment.noise.gaussian import AnisotropicGaussian
from study.figures import fig_robustness
from study.figures.inputs import NotApplicable

LAWS = ["student(3)", "normal", "uniform", "student(2.5)", "laplace"]
SHARES = [0.3, 0.0, 0.1]
TRIALS = 9


@pytest.fixture
def grid(make_rows, make_tables):
    """Tables of two angles, two radii, five laws, three shares and two estimators; some fits have no number."""

    def make(laws=LAWS, shares=SHARES, **more):
        rng, parts = np.random.default_rng(1), []
        for angle in (180.0, 60.0):
            for radius in (1.0, 2.0):
                for law in laws:
                    for share in shares:
                        for name in ("mle", "gdke"):
                            conditions = {"angle": angle, "radius": radius, "law": law, "outlier_share": share} | more
                            status = np.zeros(TRIALS, dtype=int)
                            status[: 6 if name == "gdke" and share == 0.3 else 0] = 1
                            cell = f"{angle}-{radius}-{law}-{share}"
                            error = np.where(status[:, None] == 1, np.nan, rng.normal(size=(TRIALS, 3)))
                            parts.append(make_rows(cell, name, error, status=status, **conditions))
        return make_tables(pd.concat(parts, ignore_index=True), "grid")

    return make


def test_medians(grid):
    """Of the first radius; on the sphere the unit is the median length of a Gaussian, over √tr; no number is far."""
    tables = grid()
    frame = fig_robustness.prepare(tables)
    errors = tables.errors[(tables.errors["radius"] == 1.0) & (tables.errors["angle"] == 180.0)]
    unit = math.sqrt(stats.chi2.median(3) / 3.0)
    for rows, others in ((frame.shares, {"law": "normal"}), (frame.tails, {"share": 0.0})):
        assert len(rows) == 2 * 2 * (len(SHARES) if "law" in others else len(LAWS))
        for row in rows[rows["angle"] == 180.0].itertuples():
            mine = errors[(errors["law"] == row.law) & (errors["outlier_share"] == row.share)]
            mine = mine[mine["estimator"] == row.estimator]
            values = np.sort(np.where(mine["status"] == 0, mine["error"] / mine["bound"], np.inf))
            assert row.ratio == pytest.approx(values[TRIALS // 2] / unit, rel=1e-12)
    assert set(frame.shares[np.isinf(frame.shares["ratio"])]["share"]) == {0.3}


def test_order(grid):
    """Shares ascend; laws stand by their tails, and where both have no kurtosis by their degrees of freedom."""
    frame = fig_robustness.prepare(grid())
    assert list(frame.shares["share"].unique()) == [0.0, 0.1, 0.3]
    assert list(frame.tails["law"].unique()) == ["uniform", "normal", "laplace", "student(3)", "student(2.5)"]


def test_panels(grid):
    """A row per angle; the dashed line is √(1 + p s²/d), with the size that the run has, 10 σ by default."""
    for more, size in (({}, 10.0), ({"outlier_size": 5.0}, 5.0)):
        figure = fig_robustness.draw(fig_robustness.prepare(grid(**more)))
        assert len(figure.axes) == 4
        (dashed,) = [line for line in figure.axes[0].get_lines() if line.get_linestyle() == "--"]
        expected = [math.sqrt(1 + share * size**2 / 3) for share in (0.0, 0.1, 0.3)]
        np.testing.assert_allclose(dashed.get_ydata(), expected, rtol=1e-12)
        assert [text.get_text() for text in figure.axes[2].get_xticklabels()] == ["0 %", "10 %", "30 %"]
        assert figure.axes[3].get_xticklabels()[0].get_text() == "uniform\n−1.2"
        assert f"displaced by {size:g}" in figure.axes[2].get_xlabel()


@pytest.mark.parametrize(
    ("entries", "change", "words"),
    [
        ({}, {"design": "random"}, 'kind = "grid"'),
        ({}, {"noise_law": AnisotropicGaussian(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0)))}, "isotropic"),
        ({"laws": ["laplace", "uniform", "student(3)"]}, {}, "3 values of law in the grid, with normal among them"),
        ({"shares": [0.1, 0.2, 0.3]}, {}, "3 values of outlier_share in the grid, with 0.0 among them"),
    ],
)
def test_reasons(grid, entries, change, words):
    """A run that cannot feed the figure says what it would need."""
    with pytest.raises(NotApplicable, match=words):
        fig_robustness.prepare(dataclasses.replace(grid(**entries), **change))

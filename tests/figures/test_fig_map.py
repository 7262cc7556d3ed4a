import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from study.experiment.noise.gaussian import AnisotropicGaussian
from study.figures import fig_efficiency, fig_map
from study.figures.inputs import NotApplicable
from study.figures.paper import fig2_error

LEVELS = [1e-3, 1e-1, 10.0]
ANGLES = [45.0, 180.0]
COUNTS = [1000, 10]
TRIALS = 5


@pytest.fixture
def grid(make_rows, make_tables):
    """Tables of two radii, sample counts, angles and estimators and three levels, where some fits have no number."""

    def make(levels=LEVELS, angles=ANGLES):
        rng, parts = np.random.default_rng(1), []
        for radius in (2.0, 3.0):
            for count in COUNTS:
                for angle in angles:
                    for level in levels:
                        for name in ("mle", "ugdk"):
                            status = np.zeros(TRIALS, dtype=int)
                            status[: 3 if name == "ugdk" and level == 10.0 else 1] = 1
                            error = np.where(status[:, None] == 1, np.nan, rng.normal(size=(TRIALS, 3)))
                            parts.append(
                                make_rows(
                                    f"{radius}-{count}-{angle}-{level}", name, error,
                                    samples=count, angle=angle, noise=radius * level, radius=radius, status=status,
                                )
                            )  # fmt: skip
        return make_tables(pd.concat(parts, ignore_index=True), "grid")

    return make


def test_noise_beyond_the_shown_range_is_left_out(grid):
    """From 10⁻⁴ to 10²; a run with fewer than two levels there is shown as it is."""
    assert set(fig_map.prepare(grid(levels=[1e-9, 1e-3, 10.0, 1e9])).ratios["level"]) == {1e-3, 10.0}
    assert set(fig_map.prepare(grid(levels=[1e-9, 1e-7])).ratios["level"]) == {1e-9, 1e-7}


def test_medians_of_the_first_radius(grid):
    """Fits without a number count as infinite; on the sphere the unit is the median length of a Gaussian, over √tr."""
    tables = grid()
    ratios = fig_map.prepare(tables).ratios
    assert len(ratios) == 2 * len(COUNTS) * len(ANGLES) * len(LEVELS)
    errors = tables.errors[tables.errors["radius"] == 2.0]
    unit = math.sqrt(stats.chi2.median(3) / 3.0)
    for row in ratios[ratios["angle"] == 180.0].itertuples():
        mine = errors[(errors["estimator"] == row.estimator) & (errors["samples"] == row.samples)]
        mine = mine[(mine["angle"] == 180.0) & np.isclose(mine["noise"], 2.0 * row.level)]
        values = np.sort(np.where(mine["status"] == 0, mine["error"] / mine["bound"], np.inf))
        assert math.isclose(row.ratio, values[TRIALS // 2] / unit, rel_tol=1e-12)
    lost = ratios[np.isinf(ratios["ratio"])]
    assert set(lost["estimator"]) == {"ugdk"}
    assert set(lost["level"]) == {10.0}


def test_a_summary_alone_is_enough(grid):
    """A study that kept no errors has its map; figures of single errors say what they lack."""
    tables = grid()
    alone = dataclasses.replace(tables, rows=None)
    assert fig_map.prepare(alone).ratios.equals(fig_map.prepare(tables).ratios)
    for figure, design in ((fig_efficiency, "grid"), (fig2_error, "random")):
        with pytest.raises(NotApplicable, match='keep = "errors"'):
            figure.prepare(dataclasses.replace(alone, design=design))


def test_a_panel_per_estimator_and_count(grid):
    """Estimators in the order of the config, counts ascending; a cell without an answer is left to the background."""
    figure = fig_map.draw(fig_map.prepare(grid()))
    panels = [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]
    assert len(panels) == 2 * len(COUNTS)
    assert [ax.get_title() for ax in panels[:2]] == ["$N$ = 10", "$N$ = $10^3$"]
    assert [panels[0].get_ylabel().split()[0], panels[2].get_ylabel().split()[0]] == ["MLE", "UGDK"]
    for ax, lost in zip(panels, (0, 0, 2, 2), strict=True):
        (mesh,) = ax.collections
        values = mesh.get_array()
        assert values.shape == (len(ANGLES), len(LEVELS))
        assert np.ma.count_masked(values) == lost


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"design": "random"}, 'kind = "grid"'),
        ({"noise_law": AnisotropicGaussian(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0)))}, "isotropic"),
    ],
)
def test_reasons(grid, change, words):
    """A run that has no map says what it would need."""
    with pytest.raises(NotApplicable, match=words):
        fig_map.prepare(dataclasses.replace(grid(), **change))


@pytest.mark.parametrize(("entries", "words"), [({"levels": [0.1]}, "levels of noise"), ({"angles": [90.0]}, "angles")])
def test_too_small_a_grid(grid, entries, words):
    """One level or one angle makes no map."""
    with pytest.raises(NotApplicable, match=words):
        fig_map.prepare(grid(**entries))

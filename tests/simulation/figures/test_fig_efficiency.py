"""Figures of medians over the bound: efficiency, its map, and robustness; what they show, its order, and reasons."""

import dataclasses
import math
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import study
from study import style
from study.fits.points.cap import cap_moments
from study.simulation.analysis.theory import gdke_leaves, noise_at_kappa, ugdk_leaves
from study.simulation.experiment.noise import gaussian
from study.simulation.figures import fig2_error, fig_efficiency, fig_map, fig_regret, fig_robustness

LEVELS = [1e-3, 1e-2, 0.1, 0.5, 2.0]
NAMES = ["mle", "gdke", "ugdk"]
ANGLES = [180.0, 45.0]
TRIALS = 7
ON_THE_SPHERE = math.sqrt(stats.chi2.median(3) / 3.0)
"""Median length over √tr of a Gaussian at the bound of the whole sphere: figures' unit."""
RANDOM = {"design": "random"}
ANISOTROPIC = {"noise_law": gaussian(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0)), 3)}
LAWS = ["student(3)", "normal", "uniform", "student(2.5)", "laplace"]
SHARES = [0.3, 0.0, 0.1]


@pytest.fixture
def made(make_rows, make_tables):
    """Tables of a grid of seven trials a cell, in which the first fits of some estimators have no number."""

    def make(axes, names, lost=lambda name, cell: 0, change=lambda errors: errors, **columns):
        rng, parts = np.random.default_rng(1), []
        for values in product(*axes.values()):
            cell = dict(zip(axes, values, strict=True)) | {"bound": rng.uniform(0.5, 2.0, TRIALS)} | columns
            level = {"noise": cell["radius"] * cell["level"]} if "level" in cell else {}
            for name in names:
                status = (np.arange(TRIALS) < lost(name, cell)).astype(int)
                error = np.where(status[:, None] == 1, np.nan, rng.normal(size=(TRIALS, 3)))
                parts.append(make_rows(str(values), name, error, **{"status": status} | cell | level))
        return make_tables(change(pd.concat(parts, ignore_index=True).drop(columns="level", errors="ignore")), "grid")

    return make


@pytest.fixture
def small(made):
    """Tables of two angles, five levels of noise and three estimators."""

    def make(names=NAMES, angles=ANGLES, levels=LEVELS, **more):
        return made({"angle": angles, "level": levels}, names, **{"samples": 100, "radius": 2.0} | more)

    return make


@pytest.fixture
def grid(made):
    """Tables of two radii, sample counts, angles and estimators and three levels, where some fits have no number."""

    def make(levels=(1e-3, 1e-1, 10.0), angles=(45.0, 180.0)):
        axes = {"radius": (2.0, 3.0), "samples": [1000, 10], "angle": angles, "level": levels}
        return made(axes, ("mle", "ugdk"), lambda name, cell: 5 if name == "ugdk" and cell["level"] == 10.0 else 1)

    return make


@pytest.fixture
def departing(made):
    """Tables of two angles, two radii, five laws, three shares and two estimators; some fits have no number."""

    def make(laws=LAWS, shares=SHARES, **more):
        axes = {"angle": (180.0, 60.0), "radius": (1.0, 2.0), "law": laws, "outlier_share": shares}
        return made(
            axes, ("mle", "gdke"), lambda name, cell: 4 * (name == "gdke" and cell["outlier_share"] == 0.3), **more
        )

    return make


def median(tables, **cell):
    """Median of error over bound of the fits in a cell, of which those without a number are the worst."""
    chosen = np.all(
        [np.isclose(tables.errors[k], v) if k == "noise" else tables.errors[k] == v for k, v in cell.items()], 0
    )
    mine = tables.errors[chosen]
    assert len(mine) == TRIALS
    return np.median((mine["error"] / mine["bound"]).fillna(np.inf))


def test_medians_of_efficiency(small):
    """They are over that of a Gaussian at the bound: drawn to 1 % on the cap (its error .2 %), known on the sphere.

    Three of seven fits without a number leave the largest of the others, four an infinite median, which is drawn.
    """
    tables = small(lost=lambda name, cell: {"gdke": 3, "ugdk": 4}.get(name, 0) if cell["level"] < 0.2 else 0)
    frame = fig_efficiency.prepare(tables)
    assert len(frame.curves) == len(ANGLES) * len(LEVELS) * len(NAMES)
    c = math.cos(math.radians(45.0))
    variance = np.array([12.0 / (1 - c) ** 2, *[6.0 / ((1 - c) * (2 + c))] * 2])  # theory (3.3)
    drawn = np.random.default_rng(2).normal(size=(400_000, 3)) * np.sqrt(variance / variance.sum())
    units = {180.0: ON_THE_SPHERE, 45.0: np.median(np.linalg.norm(drawn, axis=1))}
    for row in frame.curves.itertuples():
        told = median(tables, angle=row.angle, estimator=row.estimator, noise=2.0 * row.level) / units[row.angle]
        assert row.ratio == pytest.approx(told, rel=1e-6 if row.angle == 180.0 else 0.01)
        assert np.isinf(row.ratio) == (row.estimator == "ugdk" and row.level < 0.2)
    fig_efficiency.draw(frame).draw_without_rendering()
    assert fig_efficiency.prepare(dataclasses.replace(tables, rows=None)).curves.equals(frame.curves)


def test_medians_of_the_map(grid, refused):
    """They are of the first radius; a study that kept its summary alone has its map, and no figure of single errors."""
    tables = grid()
    ratios = fig_map.prepare(tables).ratios
    assert len(ratios) == 2 * 2 * 2 * 3
    for row in ratios[ratios["angle"] == 180.0].itertuples():
        cell = {"radius": 2.0, "estimator": row.estimator, "samples": row.samples, "noise": 2.0 * row.level}
        assert row.ratio == pytest.approx(median(tables, angle=180.0, **cell) / ON_THE_SPHERE, rel=1e-12)
        assert np.isinf(row.ratio) == (row.estimator == "ugdk" and row.level == 10.0)
    alone = dataclasses.replace(tables, rows=None)
    assert fig_map.prepare(alone).ratios.equals(ratios)
    for figure, design in ((fig_regret, "grid"), (fig2_error, "random")):
        refused(figure, alone, 'keep = "errors"', design=design)


def test_medians_of_robustness(departing):
    """They are of the first radius, over those of a Gaussian at the bound."""
    tables = departing()
    frame = fig_robustness.prepare(tables)
    for rows, count in ((frame.shares, len(SHARES)), (frame.tails, len(LAWS))):
        assert len(rows) == 2 * 2 * count
        for row in rows[rows["angle"] == 180.0].itertuples():
            cell = {"radius": 1.0, "law": row.law, "outlier_share": row.share, "estimator": row.estimator}
            assert row.ratio == pytest.approx(median(tables, angle=180.0, **cell) / ON_THE_SPHERE, rel=1e-12)
    assert set(frame.shares[np.isinf(frame.shares["ratio"])]["share"]) == {0.3}


def test_attainable_line(small):
    """On the whole sphere its errors are spherical too: the line is the ratio of the two bounds' roots."""
    line = fig_efficiency.prepare(small(angles=[180.0], levels=[1e-3, 0.05, 0.1, 0.2, 0.3])).attainable
    for level, ratio in zip(line["level"], line["ratio"], strict=True):
        expected = math.sqrt(study.attainable_bound(180.0, level, 3)[0, 0] / (3.0 * level**2))
        assert ratio == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("samples", [100, 10_000])
def test_marks(small, samples):
    """GDKE leaves at s* = r√(Kₐ/N)/m₁, never on the whole sphere; UGDK at σ² = v/2, and fails at κ = 3."""
    marks = fig_efficiency.prepare(small(angles=[20.0, 60.0, 90.0, 180.0], samples=samples)).marks
    for _, row in marks.iterrows():
        moments = cap_moments(math.radians(row["angle"]), 3)
        places = [gdke_leaves(samples, moments), ugdk_leaves(moments), noise_at_kappa(3.0, samples, moments)]
        assert list(row[["gdke", "ugdk", "fails"]]) == places
    if samples == 100:  # s* of theory §3, rounded
        np.testing.assert_allclose(marks["gdke"][:3], [1.8e-3, 1.9e-2, 5.8e-2], rtol=0.03)


def test_other_axes(small, make_tables):
    """Shown are the greatest number of samples, and the first radius and centre."""
    base, errors = small(samples=1000), []
    for ending, columns in {"n": {"samples": 10}, "r": {"radius": 3.0}, "c": {"center": 7.0}}.items():
        other = small(**{"samples": 1000} | columns).errors
        errors.append(other.assign(cell=other["cell"] + ending, error=1e9))
    frame = fig_efficiency.prepare(make_tables(pd.concat([base.errors, *errors], ignore_index=True), "grid"))
    pd.testing.assert_frame_equal(frame.curves, fig_efficiency.prepare(base).curves)
    assert frame.samples == 1000


@pytest.mark.parametrize(
    ("figure", "made_by", "entries", "change", "words"),
    [
        (fig_efficiency, "small", {}, RANDOM, 'kind = "grid"'),
        (fig_efficiency, "small", {}, ANISOTROPIC, "without noise_shape"),
        (fig_efficiency, "small", {"levels": LEVELS[:3]}, {}, "at least 4 levels of noise in the grid, not 3"),
        (fig_map, "grid", {}, RANDOM, 'kind = "grid"'),
        (fig_map, "grid", {}, ANISOTROPIC, "isotropic"),
        (fig_map, "grid", {"levels": [0.1]}, {}, "levels of noise"),
        (fig_map, "grid", {"angles": [90.0]}, {}, "angles"),
        (fig_robustness, "departing", {}, RANDOM, 'kind = "grid"'),
        (fig_robustness, "departing", {}, ANISOTROPIC, "isotropic"),
        (fig_robustness, "departing", {"laws": LAWS[2:]}, {}, "3 values of law in the grid, with normal among them"),
        (
            fig_robustness,
            "departing",
            {"shares": [0.1, 0.2, 0.3]},
            {},
            "3 values of outlier_share .* with 0.0 among them",
        ),
    ],
)
def test_reasons(request, refused, figure, made_by, entries, change, words):
    """A run that cannot feed a figure says what it would need."""
    refused(figure, request.getfixturevalue(made_by)(**entries), words, **change)


def test_efficiency_drawn(small):
    """A panel per angle with a curve per estimator, all medians within its limits, and marks of those shown alone."""
    frame = fig_efficiency.prepare(small())
    figure = fig_efficiency.draw(frame)
    assert len(figure.axes) == 2
    for ax, angle in zip(figure.axes, ANGLES, strict=True):
        low, high = ax.get_ylim()
        for name in NAMES:
            curve = frame.curves[(frame.curves["angle"] == angle) & (frame.curves["estimator"] == name)]
            (line,) = [line for line in ax.lines if line.get_color() == style.color(name) and len(line.get_xdata()) > 2]
            np.testing.assert_allclose(line.get_xydata(), curve[["level", "ratio"]])
            assert curve["ratio"].between(low, high).all()
        marks = {"$σ^2=v/2$", "$κ=3$", "$s^*$"} - {"$s^*$" if angle == 180.0 else ""}
        assert {text.get_text() for text in ax.texts} == marks
        assert f"{angle:g}°" in ax.get_title(loc="left")
    (legend,) = figure.legends
    words = [*map(style.label, NAMES), "attainable bound", "Cramér-Rao bound"]
    assert [text.get_text() for text in legend.get_texts()] == words
    alone = fig_efficiency.draw(fig_efficiency.prepare(small(names=["mle"], angles=[45.0])))
    assert [text.get_text() for text in alone.axes[0].texts] == []


def test_five_curves_at_most(small):
    """The paper's and the default come first, others in the order of the config; the stamp names the rest."""
    names = ["taubin", "pratt", "mle", "gdke", "als", "corrected"]
    frame = fig_efficiency.prepare(small(names=names, angles=[45.0]))
    assert set(frame.curves["estimator"]) == {"gdke", "mle", "als", "corrected", "taubin"}
    assert "not drawn: Pratt" in frame.stamp


@pytest.mark.parametrize(("count", "panels"), [(1, 1), (3, 3), (8, 6)])
def test_panels(small, count, panels):
    """One panel per angle, six at most, and no empty ones."""
    figure = fig_efficiency.draw(fig_efficiency.prepare(small(angles=list(np.linspace(20, 180, count)))))
    assert sum(ax.get_visible() for ax in figure.axes) == panels


def test_noise_beyond_the_shown_range_is_left_out(grid):
    """From 10⁻⁴ to 10²; a run with fewer than two levels there is shown as it is."""
    assert set(fig_map.prepare(grid(levels=[1e-9, 1e-3, 10.0, 1e9])).ratios["level"]) == {1e-3, 10.0}
    assert set(fig_map.prepare(grid(levels=[1e-9, 1e-7])).ratios["level"]) == {1e-9, 1e-7}


def test_a_panel_per_estimator_and_count(grid):
    """Estimators in the order of the config, counts ascending; a cell without an answer is left to the background."""
    figure = fig_map.draw(fig_map.prepare(grid()))
    panels = [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]
    assert [ax.get_title() for ax in panels] == ["$N$ = 10", "$N$ = $10^3$", "", ""]
    assert [ax.get_ylabel().split()[0] for ax in panels[::2]] == ["MLE", "UGDK"]
    values = [mesh.get_array() for ax in panels for mesh in ax.collections]
    assert [(each.shape, np.ma.count_masked(each)) for each in values] == [((2, 3), lost) for lost in (0, 0, 2, 2)]


def test_robustness_drawn(departing):
    """A row per angle; shares ascend, laws stand by their tails, and where both have no kurtosis by their freedom.

    The dashed line is √(1 + p s²/d), with the size that the run has, 10 σ by default.
    """
    for more, size in (({}, 10.0), ({"outlier_size": 5.0}, 5.0)):
        frame = fig_robustness.prepare(departing(**more))
        assert list(frame.tails["law"].unique()) == ["uniform", "normal", "laplace", "student(3)", "student(2.5)"]
        figure = fig_robustness.draw(frame)
        assert len(figure.axes) == 4
        (dashed,) = [line for line in figure.axes[0].get_lines() if line.get_linestyle() == "--"]
        np.testing.assert_allclose(dashed.get_ydata(), np.sqrt(1 + np.array([0.0, 0.1, 0.3]) * size**2 / 3), rtol=1e-12)
        assert [text.get_text() for text in figure.axes[2].get_xticklabels()] == ["0 %", "10 %", "30 %"]
        assert figure.axes[3].get_xticklabels()[0].get_text() == "uniform\n−1.2"
        assert f"displaced by {size:g}" in figure.axes[2].get_xlabel()

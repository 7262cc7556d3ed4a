"""The figure of robustness: the medians that it shows, their order, and the reasons where there is none."""

import dataclasses
import math
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import study
from study import style
from study.fits.cap import cap_moments
from study.simulation.analysis.theory import gdke_leaves, noise_at_kappa, ugdk_leaves
from study.simulation.experiment.noise import gaussian
from study.simulation.figures import fig2_error, fig_efficiency, fig_map, fig_robustness

LEVELS = [1e-3, 1e-2, 0.1, 0.5, 2.0]
NAMES = ["mle", "gdke", "ugdk"]
ANGLES = [180.0, 45.0]
TRIALS = 7
ANISOTROPIC = gaussian(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0)), 3)


@pytest.fixture
def made(make_rows, make_tables):
    """Tables of a grid with so many trials in each cell, in which the first fits of some estimators have no number."""

    def make(axes, names, trials, lost=lambda name, cell: 0, change=lambda errors: errors, **columns):
        rng, parts = np.random.default_rng(1), []
        for values in product(*axes.values()):
            cell = dict(zip(axes, values, strict=True)) | {"bound": rng.uniform(0.5, 2.0, trials)} | columns
            level = {"noise": cell["radius"] * cell["level"]} if "level" in cell else {}
            for name in names:
                status = (np.arange(trials) < lost(name, cell)).astype(int)
                error = np.where(status[:, None] == 1, np.nan, rng.normal(size=(trials, 3)))
                parts.append(make_rows(str(values), name, error, **{"status": status} | cell | level))
        return make_tables(change(pd.concat(parts, ignore_index=True).drop(columns="level", errors="ignore")), "grid")

    return make


@pytest.fixture
def small(made):
    """Tables of two angles, five levels of noise and three estimators, of seven trials each."""

    def make(names=NAMES, angles=ANGLES, levels=LEVELS, **more):
        return made({"angle": angles, "level": levels}, names, TRIALS, **{"samples": 100, "radius": 2.0} | more)

    return make


def unit(angle):
    """Median length over √tr of a Gaussian at the bound: in closed form on the sphere, else of drawn Gaussians."""
    if angle == 180.0:
        return math.sqrt(stats.chi2.median(3) / 3.0)
    c = math.cos(math.radians(angle))
    variance = np.array([12.0 / (1 - c) ** 2, *[6.0 / ((1 - c) * (2 + c))] * 2])  # theory (3.3)
    drawn = np.random.default_rng(2).normal(size=(400_000, 3)) * np.sqrt(variance / variance.sum())
    return float(np.median(np.linalg.norm(drawn, axis=1)))


def test_medians(small):
    """Each is the median of error over bound, over that of a Gaussian at the bound (drawn: to 1 %, its error 0.2 %)."""
    tables = small()
    curves = fig_efficiency.prepare(tables).curves
    assert len(curves) == len(ANGLES) * len(LEVELS) * len(NAMES)
    units = {angle: unit(angle) for angle in ANGLES}
    for _, row in curves.iterrows():
        errors = tables.errors
        some = errors[(errors["angle"] == row["angle"]) & (errors["estimator"] == row["estimator"])]
        some = some[np.isclose(some["noise"], 2.0 * row["level"])]
        assert len(some) == row["trials"] == TRIALS
        told = sorted(some["error"] / some["bound"])[3] / units[row["angle"]]
        assert row["ratio"] == pytest.approx(told, rel=1e-6 if row["angle"] == 180.0 else 0.01)


def test_an_efficient_estimator_is_at_one(make_rows, make_tables):
    """Gaussian errors at the bound have ratio 1 within 4.5 Monte-Carlo errors (5 levels: 3 in 10⁵)."""
    rng = np.random.default_rng(3)
    sphere = {"angle": 180.0, "bound": math.sqrt(3.0)}
    parts = [make_rows(f"c{level}", "mle", rng.normal(size=(4000, 3)), noise=level, **sphere) for level in LEVELS]
    curves = fig_efficiency.prepare(make_tables(pd.concat(parts, ignore_index=True), "grid")).curves
    assert np.all(np.abs(curves["ratio"] - 1.0) < 4.5 * curves["error"])
    assert np.all(curves["error"] < 0.02)


def test_attainable_line(small):
    """On the whole sphere its errors are spherical too: the line is the ratio of the two bounds' roots."""
    line = fig_efficiency.prepare(small(angles=[180.0], levels=[1e-3, 0.05, 0.1, 0.2, 0.3])).attainable
    for level, ratio in zip(line["level"], line["ratio"], strict=True):
        expected = math.sqrt(study.attainable_bound(180.0, level, 3)[0, 0] / (3.0 * level**2))
        assert ratio == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("missing", "finite"), [(3, True), (4, False)])
def test_fits_without_a_number_count_as_worst(small, missing, finite):
    """Three of seven NaN: the median is the largest of the four others; four of seven: it is infinite, and drawn."""

    def spoil(errors):
        errors.loc[(errors["estimator"] == "ugdk") & (errors["trial"] < missing), ["error", "error_1"]] = np.nan
        return errors

    tables = small(angles=[180.0], change=spoil)
    frame = fig_efficiency.prepare(tables)
    ratios = frame.curves.loc[frame.curves["estimator"] == "ugdk", "ratio"]
    if finite:
        mine = tables.errors[tables.errors["estimator"] == "ugdk"]
        told = (mine["error"] / mine["bound"]).groupby(mine["noise"]).max().to_numpy() / unit(180.0)
        np.testing.assert_allclose(ratios, told, rtol=1e-6)
    else:
        assert np.all(np.isinf(ratios))
    fig_efficiency.draw(frame).draw_without_rendering()


def test_statuses_do_not_matter(small):
    """A fit that is not ok counts with the error it has."""
    tables = small()
    failed = small(status=1)
    pd.testing.assert_frame_equal(fig_efficiency.prepare(tables).curves, fig_efficiency.prepare(failed).curves)


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
    base = small(samples=1000)
    others = [
        small(change=lambda e, ending=ending: e.assign(cell=e["cell"] + ending), **{"samples": 1000} | columns)
        for ending, columns in {"n": {"samples": 10}, "r": {"radius": 3.0}, "c": {"center": 7.0}}.items()
    ]
    spoiled = [tables.errors.assign(error=1e9) for tables in others]
    frame = fig_efficiency.prepare(make_tables(pd.concat([base.errors, *spoiled], ignore_index=True), "grid"))
    pd.testing.assert_frame_equal(frame.curves, fig_efficiency.prepare(base).curves)
    assert frame.samples == 1000


def test_reasons(small, refused):
    """Each thing that is missing is told in a sentence that names the remedy."""
    tables = small()
    refused(fig_efficiency, tables, 'kind = "grid"', design="random")
    refused(fig_efficiency, tables, "without noise_shape", noise_law=ANISOTROPIC)
    refused(fig_efficiency, small(levels=LEVELS[:3]), "at least 4 levels of noise in the grid, not 3")


def test_drawn(small):
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
            assert low < curve["ratio"].min()
            assert curve["ratio"].max() < high
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


LEVELS_FIG_MAP = [1e-3, 1e-1, 10.0]

ANGLES_FIG_MAP = [45.0, 180.0]

COUNTS = [1000, 10]

TRIALS_FIG_MAP = 5


@pytest.fixture
def grid(made):
    """Tables of two radii, sample counts, angles and estimators and three levels, where some fits have no number."""

    def make(levels=LEVELS_FIG_MAP, angles=ANGLES_FIG_MAP):
        axes = {"radius": (2.0, 3.0), "samples": COUNTS, "angle": angles, "level": levels}
        lost = lambda name, cell: 3 if name == "ugdk" and cell["level"] == 10.0 else 1  # noqa: E731
        return made(axes, ("mle", "ugdk"), TRIALS_FIG_MAP, lost)

    return make


def test_noise_beyond_the_shown_range_is_left_out(grid):
    """From 10⁻⁴ to 10²; a run with fewer than two levels there is shown as it is."""
    assert set(fig_map.prepare(grid(levels=[1e-9, 1e-3, 10.0, 1e9])).ratios["level"]) == {1e-3, 10.0}
    assert set(fig_map.prepare(grid(levels=[1e-9, 1e-7])).ratios["level"]) == {1e-9, 1e-7}


def test_medians_of_the_first_radius(grid):
    """Fits without a number count as infinite; on the sphere the unit is the median length of a Gaussian, over √tr."""
    tables = grid()
    ratios = fig_map.prepare(tables).ratios
    assert len(ratios) == 2 * len(COUNTS) * len(ANGLES_FIG_MAP) * len(LEVELS_FIG_MAP)
    errors = tables.errors[tables.errors["radius"] == 2.0]
    unit = math.sqrt(stats.chi2.median(3) / 3.0)
    for row in ratios[ratios["angle"] == 180.0].itertuples():
        mine = errors[(errors["estimator"] == row.estimator) & (errors["samples"] == row.samples)]
        mine = mine[(mine["angle"] == 180.0) & np.isclose(mine["noise"], 2.0 * row.level)]
        values = np.sort(np.where(mine["status"] == 0, mine["error"] / mine["bound"], np.inf))
        assert math.isclose(row.ratio, values[TRIALS_FIG_MAP // 2] / unit, rel_tol=1e-12)
    lost = ratios[np.isinf(ratios["ratio"])]
    assert set(lost["estimator"]) == {"ugdk"}
    assert set(lost["level"]) == {10.0}


def test_a_summary_alone_is_enough(grid, refused):
    """A study that kept no errors has its map; figures of single errors say what they lack."""
    tables = grid()
    alone = dataclasses.replace(tables, rows=None)
    assert fig_map.prepare(alone).ratios.equals(fig_map.prepare(tables).ratios)
    for figure, design in ((fig_efficiency, "grid"), (fig2_error, "random")):
        refused(figure, alone, 'keep = "errors"', design=design)


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
        assert values.shape == (len(ANGLES_FIG_MAP), len(LEVELS_FIG_MAP))
        assert np.ma.count_masked(values) == lost


@pytest.mark.parametrize(
    ("entries", "change", "words"),
    [
        ({}, {"design": "random"}, 'kind = "grid"'),
        ({}, {"noise_law": ANISOTROPIC}, "isotropic"),
        ({"levels": [0.1]}, {}, "levels of noise"),
        ({"angles": [90.0]}, {}, "angles"),
    ],
)
def test_reasons_fig_map(grid, refused, entries, change, words):
    """A run that has no map says what it would need; one level or one angle makes none."""
    refused(fig_map, grid(**entries), words, **change)


LAWS = ["student(3)", "normal", "uniform", "student(2.5)", "laplace"]

SHARES = [0.3, 0.0, 0.1]

TRIALS_FIG_ROBUSTNESS = 9


@pytest.fixture
def grid_of_fig_robustness(made):
    """Tables of two angles, two radii, five laws, three shares and two estimators; some fits have no number."""

    def make(laws=LAWS, shares=SHARES, **more):
        axes = {"angle": (180.0, 60.0), "radius": (1.0, 2.0), "law": laws, "outlier_share": shares}
        lost = lambda name, cell: 6 if name == "gdke" and cell["outlier_share"] == 0.3 else 0  # noqa: E731
        return made(axes, ("mle", "gdke"), TRIALS_FIG_ROBUSTNESS, lost, **more)

    return make


def test_medians_fig_robustness(grid_of_fig_robustness):
    """Of the first radius; on the sphere the unit is the median length of a Gaussian, over √tr; no number is far."""
    tables = grid_of_fig_robustness()
    frame = fig_robustness.prepare(tables)
    errors = tables.errors[(tables.errors["radius"] == 1.0) & (tables.errors["angle"] == 180.0)]
    unit = math.sqrt(stats.chi2.median(3) / 3.0)
    for rows, others in ((frame.shares, {"law": "normal"}), (frame.tails, {"share": 0.0})):
        assert len(rows) == 2 * 2 * (len(SHARES) if "law" in others else len(LAWS))
        for row in rows[rows["angle"] == 180.0].itertuples():
            mine = errors[(errors["law"] == row.law) & (errors["outlier_share"] == row.share)]
            mine = mine[mine["estimator"] == row.estimator]
            values = np.sort(np.where(mine["status"] == 0, mine["error"] / mine["bound"], np.inf))
            assert row.ratio == pytest.approx(values[TRIALS_FIG_ROBUSTNESS // 2] / unit, rel=1e-12)
    assert set(frame.shares[np.isinf(frame.shares["ratio"])]["share"]) == {0.3}


def test_order(grid_of_fig_robustness):
    """Shares ascend; laws stand by their tails, and where both have no kurtosis by their degrees of freedom."""
    frame = fig_robustness.prepare(grid_of_fig_robustness())
    assert list(frame.shares["share"].unique()) == [0.0, 0.1, 0.3]
    assert list(frame.tails["law"].unique()) == ["uniform", "normal", "laplace", "student(3)", "student(2.5)"]


def test_panels_fig_robustness(grid_of_fig_robustness):
    """A row per angle; the dashed line is √(1 + p s²/d), with the size that the run has, 10 σ by default."""
    for more, size in (({}, 10.0), ({"outlier_size": 5.0}, 5.0)):
        figure = fig_robustness.draw(fig_robustness.prepare(grid_of_fig_robustness(**more)))
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
        ({}, {"noise_law": ANISOTROPIC}, "isotropic"),
        ({"laws": ["laplace", "uniform", "student(3)"]}, {}, "3 values of law in the grid, with normal among them"),
        ({"shares": [0.1, 0.2, 0.3]}, {}, "3 values of outlier_share in the grid, with 0.0 among them"),
    ],
)
def test_reasons_fig_robustness(grid_of_fig_robustness, refused, entries, change, words):
    """A run that cannot feed the figure says what it would need."""
    refused(fig_robustness, grid_of_fig_robustness(**entries), words, **change)

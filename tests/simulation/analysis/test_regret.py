"""Regret: ratios to the best in a cell, their geometric means, and errors of these.

Expectations from theory on a cap, against closed forms, drawn Gaussians and each other.

Stored points are put together again as they were drawn.
"""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import study
from study.files import RunError
from study.fits import Status, fit, mgdk
from study.fits.cap import cap_moments
from study.simulation.analysis import regret

DESIGN = """
name = "grid"
seed = 3
dimension = 2
estimators = ["gdke", "als"]
[design]
kind = "grid"
trials = 20
samples = [10, 20]
noise = 0.1
angle = [90, 180]
"""


def table(**cells):
    """An error table of cells, each with its samples and lists of errors by estimator."""
    rows = []
    for cell, (samples, errors) in cells.items():
        for estimator, values in errors.items():
            rows += [(cell, samples, trial, estimator, value) for trial, value in enumerate(values)]
    return pd.DataFrame(rows, columns=["cell", "samples", "trial", "estimator", "error"])


def test_ratios_and_geometric_means():
    """Two cells with constant errors have these ratios and these means, whatever is left out."""
    errors = table(a=(10, {"x": [1.0] * 20, "y": [2.0] * 20}), b=(99, {"x": [8.0] * 20, "y": [1.0] * 20}))
    cells = regret.by_cell(errors, ["x", "y"])
    assert list(cells["median"]) == [1.0, 2.0, 8.0, 1.0]
    assert list(cells["q95"]) == [1.0, 2.0, 8.0, 1.0]
    means = regret.regret(cells).set_index(["samples", "estimator"])
    assert means.loc[(0, "x"), "median"] == pytest.approx(math.sqrt(8.0))
    assert means.loc[(0, "y"), "q95"] == pytest.approx(math.sqrt(2.0))
    assert means.loc[(99, "x"), "median"] == pytest.approx(8.0)
    assert means.loc[(0, "x"), "median_worst"] == 8.0
    assert means["median_error"].abs().max() < 1e-12
    assert list(means["cells"]) == [2, 2, 1, 1, 1, 1]


def test_fits_without_a_number_count_as_worse_than_any():
    """Lost fits beyond the median do not change it, and those at the 95 % quantile make it infinite."""
    errors = table(a=(10, {"x": [1.0] * 17 + [np.nan] * 3, "y": [3.0] * 20}))
    cells = regret.by_cell(errors, ["x", "y"]).set_index("estimator")
    assert cells.loc["y", "median"] == 3.0
    assert cells.loc["y", "q95"] == 1.0
    assert cells.loc["x", "q95"] == np.inf
    whole = table(a=(10, {"x": [1.0] * 20, "y": [2.0] * 20}), b=(10, {"x": [np.nan] * 20, "y": [1.0] * 20}))
    means = regret.regret(regret.by_cell(whole, ["x", "y"])).set_index(["samples", "estimator"])
    assert list(means.loc[(0, "x"), ["median", "median_error", "median_worst"]]) == [np.inf] * 3
    assert means.loc[(0, "y"), "median"] == pytest.approx(math.sqrt(2.0))


def test_standard_error_is_that_of_repetitions():
    """The jackknife's error is the scatter of the mean regret over repetitions, within 40 %.

    The scatter of 50 has an error of 10 %, the median jackknife of 10 groups one of some 5 % and a bias of order 10 %.
    """
    rng, found = np.random.default_rng(1), []
    for _ in range(50):
        noisy = rng.exponential(size=(4, 2, 200))
        cells = {f"c{i}": (10, {"x": one, "y": 2.0 * two}) for i, (one, two) in enumerate(noisy)}
        means = regret.regret(regret.by_cell(table(**cells), ["x", "y"])).set_index(["samples", "estimator"])
        found.append((means.loc[(0, "y"), "median"], means.loc[(0, "y"), "median_error"]))
    values, errors = np.transpose(found)
    assert np.median(errors) == pytest.approx(values.std(ddof=1), rel=0.4)


def test_one_trial_is_too_few():
    """A cell of one trial has no Monte-Carlo error, and the message says where."""
    with pytest.raises(RunError, match="cell a: 1 trials; regret needs at least 2"):
        regret.by_cell(table(a=(10, {"x": [1.0], "y": [1.0]})), ["x", "y"])


def test_regret_of_a_run(make_run):
    """The command's table has a line per estimator, and ratios that the error table confirms."""
    run = make_run(DESIGN)
    cells = regret.of_run(run)
    errors = run.table("errors")
    medians = errors.groupby(["cell", "estimator"], observed=True)["error"].quantile(0.5, interpolation="lower")
    medians = medians.unstack()
    expected = (medians["als"] / medians.min(axis=1)).to_dict()
    mine = cells[cells["estimator"] == "als"]
    assert dict(zip(mine["cell"], mine["median"], strict=True)) == pytest.approx(expected)
    lines = list(regret.printed(run, regret.regret(cells)))
    assert {line.split()[0] for line in lines[3:]} == {"gdke", "als"}
    assert "N = 10" in lines[2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('["gdke", "als"]', '["als"]'), "regret compares estimators"),
        (("[design]", 'keep = "summary"\n[design]'), "regret needs every error"),
    ],
)
def test_runs_that_have_none(make_run, change, message):
    """A run of one estimator, or without its error table, is refused in one line."""
    with pytest.raises(RunError, match=message):
        regret.of_run(make_run(DESIGN.replace(*change)))


def test_gdke_bias():
    """m₁σ²/(Kₐ + σ²) for isotropic noise; for a covariance the matrix formula, whichever way it is solved."""
    moments = cap_moments(math.radians(60.0), 3)
    np.testing.assert_allclose(regret.gdke_bias(0.02, moments, np.eye(3)), 0.75 * 4e-4 / (1 / 48 + 4e-4))
    shape = np.array([[1.0, 0.3, 0.0], [0.3, 2.0, 0.0], [0.0, 0.0, 0.5]])
    extent = np.diag([moments.along, moments.across, moments.across])
    told = np.linalg.inv(extent + 0.01 * shape) @ (0.01 * shape) @ [moments.mean, 0.0, 0.0]
    np.testing.assert_allclose(regret.gdke_bias(0.1, moments, shape), np.linalg.norm(told))


def test_median_at_bound():
    """On the whole sphere the length is χ₃/√3; on a cap it agrees with drawn Gaussians."""
    whole = math.sqrt(stats.chi2.median(3) / 3)
    np.testing.assert_allclose(regret.median_at_bound(cap_moments(math.pi, 3), 3), whole, rtol=1e-6)
    for dimension in (2, 3):
        moments = cap_moments(math.radians(40.0), dimension)
        variance = 1.0 / np.array([moments.along] + [moments.across] * (dimension - 1))
        drawn = np.random.default_rng(5).normal(size=(400_000, dimension)) * np.sqrt(variance / variance.sum())
        median = np.median(np.linalg.norm(drawn, axis=1))
        np.testing.assert_allclose(median, regret.median_at_bound(moments, dimension), rtol=0.01)


@pytest.mark.parametrize("noise", [1e-320, 1e-200, 1e-65, 1e-3, 1e155, 1e308])
@pytest.mark.parametrize("angle", [1e-300, 1e-100, 1e-10, 45.0, 180.0])
def test_medians_at_the_ends_of_float64(angle, noise):
    """Whatever a config may ask for, a median is a number or NaN; with next to no noise it is that of the bound."""
    at_bound = regret.median_at_bound(cap_moments(math.radians(angle), 3), 3)
    found = regret.median_attainable(angle, noise, 3)
    assert math.isnan(at_bound) == (angle < 1e-90)
    assert math.isnan(found) == (angle < 1e-90 or noise > 1e3 * math.radians(angle))
    if noise < 1e-6 * math.radians(angle):
        np.testing.assert_equal(found, at_bound)


@pytest.mark.parametrize("degrees", [20.0, 60.0])
def test_gdke_leaves_where_bias_meets_scatter(degrees):
    """At s* the bias of many samples is the bound's standard deviation along the axis, σ/√(N Kₐ)."""
    moments = cap_moments(math.radians(degrees), 3)
    noise = regret.gdke_leaves(10**8, moments)
    scatter = noise / math.sqrt(10**8 * moments.along)
    assert regret.gdke_bias(noise, moments, np.eye(3)) == pytest.approx(scatter, rel=1e-4)


def test_gdke_never_leaves_on_the_whole_sphere():
    """GDKE has no bias there; the mean of the directions is zero up to rounding."""
    for dimension in (2, 3, 4):
        assert regret.gdke_leaves(10**6, cap_moments(math.pi, dimension)) == math.inf


def test_where_ugdk_leaves_and_fails():
    """With v = Kₐ = (1 - cos φ)²/12: σ² = v/2; κ = (v/σ²)√(N/2), and the noise of a κ has it."""
    along = (1.0 - math.cos(0.7)) ** 2 / 12.0
    moments = cap_moments(0.7, 3)
    assert regret.ugdk_leaves(moments) ** 2 == pytest.approx(along / 2.0, rel=1e-12)
    assert regret.kappa(0.05, 1000, moments) == pytest.approx(along / 0.05**2 * math.sqrt(500.0), rel=1e-12)
    assert regret.kappa(regret.noise_at_kappa(3.0, 1000, moments), 1000, moments) == pytest.approx(3.0, rel=1e-12)


def test_ugdk_variance():
    """1 + 7.5 σ²/r² on the whole sphere, where Kₐ = ⅓ and m₁ = 0; 1 + 96 σ²/(r²φ⁴) on small caps, Kₐ → φ⁴/48."""
    assert regret.ugdk_variance(0.1, cap_moments(math.pi, 3), 3) == pytest.approx(1.0 + 0.01 * 7.5, rel=1e-12)
    assert regret.ugdk_variance(1e-4, cap_moments(0.01, 3), 3) == pytest.approx(1.0 + 96.0, rel=1e-3)


@pytest.mark.parametrize("degrees", [5.0, 60.0, 180.0])
def test_bound_shares(degrees):
    """They are as 12/(1 - cos φ)² to 6/[(1 - cos φ)(2 + cos φ)] (theory 3.3), and whole."""
    c = math.cos(math.radians(degrees))
    along, across = regret.bound_shares(cap_moments(math.radians(degrees), 3), 3)
    assert along + 2.0 * across == pytest.approx(1.0, rel=1e-12)
    assert along / across == pytest.approx(12.0 / (1 - c) ** 2 / (6.0 / ((1 - c) * (2 + c))), rel=1e-9)


@pytest.mark.parametrize(("dimension", "degrees", "noise"), [(3, 45.0, 0.3), (3, 180.0, 0.2), (2, 45.0, 0.1)])
def test_median_attainable(dimension, degrees, noise):
    """The median is that of drawn Gaussians with the attainable covariance, over the Cramér-Rao bound's root trace."""
    moments = cap_moments(math.radians(degrees), dimension)
    bound = study.attainable_bound(degrees, noise, dimension)[:-1, :-1]
    drawn = np.random.default_rng(5).normal(size=(400_000, dimension)) * np.sqrt(np.diag(bound))
    unit = noise * math.sqrt(1.0 / moments.along + (dimension - 1) / moments.across)
    expected = np.median(np.linalg.norm(drawn, axis=1)) / unit
    np.testing.assert_allclose(regret.median_attainable(degrees, noise, dimension), expected, rtol=0.01)


def test_median_attainable_without_noise_and_without_hope():
    """Little noise leaves the Cramér-Rao bound; noise that hides the cap leaves no number."""
    moments = cap_moments(math.radians(45.0), 3)
    np.testing.assert_allclose(regret.median_attainable(45.0, 1e-5, 3), regret.median_at_bound(moments, 3), rtol=1e-6)
    assert math.isnan(regret.median_attainable(0.01, 1.0, 3))


@pytest.fixture
def tables():
    """Errors and points of cells (noise, radius), shuffled, with a centre that is not the origin."""

    def make(cells, samples=5, trials=(3, 3, 3, 3)):
        rng = np.random.default_rng(1)
        errors, points, truth = [], [], {}
        for k, ((noise, radius), count) in enumerate(zip(cells, trials, strict=False)):
            x = rng.standard_normal((count, samples, 2))
            truth[noise, radius] = x
            base = {"cell": f"c{k}", "trial": np.repeat(np.arange(count), samples)}
            base |= {"sample": np.tile(np.arange(samples), count), "radius": radius}
            axes = {"x_1": x[..., 0].ravel() + 2.0, "x_2": x[..., 1].ravel() - 1.0, "center_1": 2.0, "center_2": -1.0}
            points.append(pd.DataFrame(base | axes))
            conditions = {"noise": noise, "radius": radius, "samples": samples, "angle": 60.0, "center": 5**0.5}
            errors.append(pd.DataFrame({"cell": [f"c{k}"] * count} | conditions))
        shuffled = pd.concat(points).sample(frac=1.0, random_state=2)
        return pd.concat(errors).astype({"cell": "category"}), shuffled.astype({"cell": "category"}), truth

    return make


def test_joints(tables):
    """A joint per noise, ascending, its markers by ascending radius, points in the order of trial and sample."""
    errors, points, truth = tables([(0.2, 2.0), (0.1, 0.5), (0.2, 1.0), (0.1, 3.0)])
    found = list(regret.joint_markers(errors, points))
    assert [joint.sigma for joint in found] == [0.1, 0.2]
    assert [list(joint.radii) for joint in found] == [[0.5, 3.0], [1.0, 2.0]]
    for joint in found:
        for radius, marker in zip(joint.radii, joint.markers, strict=True):
            np.testing.assert_allclose(marker, truth[joint.sigma, radius], atol=1e-14)


def test_one_radius_is_no_joint(tables):
    """Noises with one marker alone are passed over."""
    errors, points, _ = tables([(0.1, 1.0), (0.2, 1.0), (0.2, 2.0)])
    assert [joint.sigma for joint in regret.joint_markers(errors, points)] == [0.2]


def test_markers_with_fewer_trials_bound_the_others(tables):
    """All markers of a joint have as many trials as the one with the fewest."""
    errors, points, _ = tables([(0.1, 1.0), (0.1, 2.0)], trials=(4, 2))
    (joint,) = regret.joint_markers(errors, points)
    assert [len(marker) for marker in joint.markers] == [2, 2]


def test_a_cell_without_points(tables):
    """A cell of which no points are stored has no sets."""
    _, points, _ = tables([(0.1, 1.0)])
    assert regret.point_sets(points, "other").size == 0


@pytest.mark.parametrize("noise", [0.01, 0.1, 0.6])
@pytest.mark.parametrize("weighted", [False, True])
def test_fits_are_those_of_the_library(on_cap, noise, weighted):
    """Centres, radii and statuses of `study.mgdk`, trial by trial, noise that hides two markers of three included."""
    rng = np.random.default_rng(4)
    markers = [on_cap(rng, n, 60.0, 3, noise, radius, sets=20)[0] for n, radius in ((40, 0.1), (60, 0.5), (50, 2.0))]
    found = regret.fit_joints(markers, noise, weighted)
    each = [mgdk(sets, noise=noise, weighted=weighted) for sets in zip(*markers, strict=True)]
    np.testing.assert_allclose(found.center, [f.center for f in each], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.definite, [f.status == Status.OK for f in each])
    radii = np.sqrt(np.where(found.squares >= 0.0, found.squares, np.nan))
    np.testing.assert_allclose(radii.T, [f.radii for f in each], rtol=1e-7)


@pytest.mark.parametrize("noise", [0.05, 0.4])
def test_one_marker_is_fitted_by_ugdk(on_cap, noise):
    """Eq. 22 of one marker is eqs 15 to 21, and errors are those of UGDK, whatever it says of them."""
    points, _ = on_cap(np.random.default_rng(5), 50, 50.0, 3, noise, 1.0, sets=40)
    found, expected = regret.fit_joints([points], noise), fit(points, "ugdk", noise=noise)
    np.testing.assert_allclose(found.center, expected.center, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.definite, expected.own_status == Status.OK)
    np.testing.assert_allclose(found.distances(), np.linalg.norm(expected.center, axis=1), rtol=1e-9)

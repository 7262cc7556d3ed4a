"""Tests of paper figures."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Circle
from scipy import stats

import study
from study.fits import Status, mgdk
from study.fits.points.cap import sample_cap
from study.simulation.figures import fig2_error, fig3_5_ellipses, fig6_mgdk, fig7_power_law
from study.simulation.statistics import quantile
from tests.summaries import summary

GDKE, UGDK, METHODS = FIGURES = [*fig3_5_ellipses.FIGURES.values()]


def test_spread_of_gaussian_errors(circle_tables):
    """Median and robust standard deviation are those of the Gaussian that the errors were drawn from, in radii."""
    data = fig3_5_ellipses.choose(circle_tables, ["gdke"])
    error = 4.0 / np.sqrt(3000)  # four standard errors, of quantiles that have at most 1.6 of a mean's
    for name, bias in (("gdke", 0.5), ("ugdk", 0.0)):
        spread = data.spreads[name]
        np.testing.assert_allclose(spread.sd, [0.1, 0.025], rtol=1.6 * error)
        np.testing.assert_allclose(spread.bias[0], bias, atol=1.6 * error * 0.1)
        np.testing.assert_allclose(spread.bias[1], 0.0, atol=1.6 * error * 0.025)


def test_coverage_of_gaussian_errors(circle_tables):
    """An unbiased Gaussian's 95 % ellipses hold the truth in 95 % of the trials; GDKE's, five sd off, hardly ever."""
    data = fig3_5_ellipses.choose(circle_tables, ["gdke"])
    assert abs(data.spreads["ugdk"].covered - 2850) < 4 * np.sqrt(3000 * 0.95 * 0.05) + 30
    assert data.spreads["gdke"].covered < 60  # P(N(5, 1) < 2.45) = 0.5 %, with room


def test_fits_without_a_number_are_left_out_of_the_spread_and_not_covered(circle_tables):
    """They move nothing, and no ellipse of theirs holds the truth; a status alone changes nothing."""
    before = fig3_5_ellipses.choose(circle_tables, ["gdke"]).spreads["ugdk"]
    errors = circle_tables.errors
    wild = errors.index[errors["estimator"] == "ugdk"][10:1010]
    errors.loc[wild, "status"] = Status.NOT_POSITIVE_DEFINITE
    assert fig3_5_ellipses.choose(circle_tables, ["gdke"]).spreads["ugdk"] == before
    errors.loc[wild, ["error_1", "error_2", "error"]] = np.nan
    after = fig3_5_ellipses.choose(circle_tables, ["gdke"]).spreads["ugdk"]
    assert after.known == 2000
    assert after.covered < before.covered - 900
    np.testing.assert_allclose(after.sd, before.sd, rtol=0.15)


def test_all_figures_show_the_same_kept_trial(circle_tables):
    """Of the trials with points, the one nearest to the paper's ρ; nearer ones without points do not count."""
    chosen = [figure.prepare(circle_tables).data for figure in FIGURES]
    assert {data.trial for data in chosen} == {3}
    assert {data.condition for data in chosen} == {0.55}


def test_positions_are_in_radii_from_the_true_centre(circle_tables):
    """Points lie on the unit circle about the origin, and a fit is where its error vector says."""
    data = fig3_5_ellipses.choose(circle_tables, ["gdke"])
    np.testing.assert_allclose(np.hypot(data.points["x"], data.points["y"]), 1.0)
    row = circle_tables.errors.query("estimator == 'mle' and trial == 3").iloc[0]
    circle = data.fits["mle"]
    np.testing.assert_allclose([circle.x, circle.y, circle.radius], [row["error_1"] / 2, row["error_2"] / 2, 1.0])


def test_distance_of_the_truth_in_standard_deviations(circle_tables):
    """The number under figure 3 is the Mahalanobis distance of the estimate's error."""
    frame = GDKE.prepare(circle_tables)
    row = circle_tables.errors.query("estimator == 'gdke' and trial == 3").iloc[0]
    told = np.hypot(row["error_1"] / 2 / frame.spread.sd[0], row["error_2"] / 2 / frame.spread.sd[1])
    np.testing.assert_allclose(frame.distance, told)


def test_drawn_ellipses_have_the_size_of_the_spread(circle_tables):
    """Axes of the patches are 2 √χ²₂ sd, centred on the estimate."""
    frame = UGDK.prepare(circle_tables)
    patches = UGDK.draw(frame).axes[1].patches
    assert len(patches) == 2
    fit = frame.data.fits["ugdk"]
    for patch, level in zip(patches, (0.68, 0.95), strict=True):
        size = 2.0 * np.sqrt(stats.chi2.ppf(level, 2)) * np.array(frame.spread.sd)
        np.testing.assert_allclose([patch.width, patch.height], size)
        np.testing.assert_allclose(patch.center, [fit.x, fit.y])


def test_figures_3_and_4_share_a_window_that_holds_both_ellipses(circle_tables):
    """So that their sizes can be compared."""
    one, other = GDKE.prepare(circle_tables), UGDK.prepare(circle_tables)
    assert one.window == other.window
    left, right, bottom, top = one.window
    for frame in (one, other):
        fit = frame.data.fits[frame.estimator]
        wide, tall = fig3_5_ellipses.reach(0.95) * np.array(frame.spread.sd)
        assert left < fit.x - wide
        assert fit.x + wide < right
        assert bottom < fit.y - tall
        assert fit.y + tall < top


def test_fits_that_coincide_are_named_together(circle_tables):
    """LLS is GDKE: one circle, and the words say so."""
    frame = METHODS.prepare(circle_tables)
    assert frame.same == {"mle": [], "ugdk": [], "gdke": ["lls"]}
    along = [circle.x for circle in frame.circles.values()]
    assert along == sorted(along)
    texts = [text.get_text() for text in METHODS.draw(frame).axes[1].texts]
    assert any(text.startswith("GDKE") and "the same: LLS" in text for text in texts)


@pytest.mark.parametrize("figure", FIGURES)
def test_reasons(circle_tables, power_tables, figure, refused):
    """Each thing that is missing is told in a sentence that names the remedy."""
    refused(figure, power_tables, "dimension = 2 in the config, not 3")
    refused(figure, circle_tables, 'kind = "grid"', design="random")
    refused(figure, circle_tables, "keep_points", points=None)
    errors = circle_tables.errors
    both = {"rows": errors, "summary": circle_tables.summary}
    without = {name: table[table["estimator"] != "ugdk"] for name, table in both.items()}
    refused(figure, circle_tables, "estimator ugdk", **without)
    refused(figure, circle_tables, "at least 50 trials", rows=errors[errors["trial"] < 20])
    failed = errors.assign(status=int(Status.SINGULAR))
    refused(figure, circle_tables, "no ok fit", rows=failed)


def test_slope_agrees_with_scipy_on_scattered_errors(random_tables):
    """The slope and its interval are Theil and Sen's in decades, of the trials in which each estimator has a number."""
    rng = np.random.default_rng(0)
    errors = random_tables.errors
    errors["error"] *= 10.0 ** rng.normal(size=len(errors))
    errors.loc[errors.index[::7], "status"] = Status.NOT_POSITIVE_DEFINITE
    errors.loc[(errors["estimator"] == "ugdk") & (errors["trial"] % 3 == 0), "error"] = np.nan
    frame = fig2_error.prepare(random_tables)
    some = errors[(errors["estimator"] == "gdke") & (errors["trial"] % 3 != 0)]
    told = stats.theilslopes(np.log10(some["error"] / some["radius"]), np.log10(some["noise"] / some["radius"]), 0.95)
    row = frame.panels.set_index("estimator").loc["gdke"]
    np.testing.assert_allclose(row[["slope", "slope_low", "slope_high"]].astype(float), [told[0], told[2], told[3]])


def test_every_fit_is_counted_once(random_tables):
    """Fits beyond ten times their bound are counted whatever their status; rings are those that are ok."""
    errors = random_tables.errors
    first = errors.index[errors["estimator"] == "ugdk"]
    errors.loc[first[:5], "error"] = 11.0 * errors.loc[first[:5], "bound"]
    errors.loc[first[5:8], "error"] = 9.0 * errors.loc[first[5:8], "bound"]
    errors.loc[first[3:10], "status"] = Status.SINGULAR
    frame = fig2_error.prepare(random_tables)
    row = frame.panels.set_index("estimator").loc["ugdk"]
    assert (row["far"], row["not_ok"], row["planned"]) == (5, 7, 400)
    kinds = frame.dots[frame.dots["estimator"] == "ugdk"]["kind"].value_counts()
    assert (kinds["far"], kinds["not ok"], kinds["ok"]) == (3, 7, 390)


def test_what_is_off_the_scale_is_counted(random_tables):
    """Wild, vanishing and missing errors do not set the limits, and are not dropped silently."""
    errors = random_tables.errors
    first = errors.index[errors["estimator"] == "ugdk"]
    errors.loc[first[0], "error"] = 1e300
    errors.loc[first[1], "error"] = 0.0
    errors.loc[first[2], "error"] = np.nan
    frame = fig2_error.prepare(random_tables)
    assert frame.error_limits[1] < 20
    off = frame.panels.set_index("estimator")["off_scale"]
    assert off["ugdk"] == 3
    assert off["mle"] == 0
    figure = fig2_error.draw(frame)
    texts = [text for ax in figure.axes for text in ax.texts]
    assert "3 off the scale" in "\n".join(text.get_text() for text in texts)
    figure.draw_without_rendering()
    tops = [text.get_window_extent().y1 for text in texts if text.get_weight() == "bold"]
    assert len(tops) == len(frame.panels)
    np.testing.assert_allclose(tops, tops[0], atol=1.0)  # in pixels: names stand in one line, whatever is below them


def test_reasons_fig2_error(power_tables, random_tables, refused):
    """A grid has too few levels of noise for a cloud, and a single noise has no slope."""
    refused(fig2_error, power_tables, "random design")
    random_tables.errors["noise"] = 1.0
    refused(fig2_error, random_tables, "decade")


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_draws_any_number_of_estimators(random_tables, make_tables, count):
    """Two panels each, none more."""
    one = random_tables.errors[random_tables.errors["estimator"] == "mle"]
    errors = pd.concat([one.assign(estimator=f"own_{i}") for i in range(count)], ignore_index=True)
    figure = fig2_error.draw(fig2_error.prepare(make_tables(errors, "random")))
    assert len(figure.axes) == 2 * count


def test_medians_by_decade(random_tables):
    """A decade's point is the median of noise and bound, once per trial; below, that of errors over bounds."""
    errors, frame = random_tables.errors, fig2_error.prepare(random_tables)
    np.testing.assert_allclose(frame.dots["ratio"], errors["error"] / errors["bound"], rtol=1e-12)
    one = errors[errors["estimator"] == "mle"].assign(noise=lambda rows: rows["noise"] / rows["radius"])
    some = one.query("1e3 <= noise < 1e4")
    (row,) = frame.bound.query("1e3 <= noise < 1e4").to_dict("records")
    assert row["trials"] == len(some)
    np.testing.assert_allclose([row["noise"], row["bound"]], np.median(some["noise"]) * np.array([1.0, 0.5]))
    (row,) = frame.medians.query("estimator == 'mle' and 1e3 <= noise < 1e4").to_dict("records")
    assert (row["trials"], row["ratio"]) == (len(some), np.median(some["error"] / some["bound"]))


def test_survives_an_estimator_that_always_fails(random_tables):
    """Without a number there is no slope, and the panel says so."""
    errors = random_tables.errors
    errors.loc[errors["estimator"] == "ugdk", "status"] = Status.SINGULAR
    errors.loc[errors["estimator"] == "ugdk", "error"] = np.nan
    frame = fig2_error.prepare(random_tables)
    assert np.isnan(frame.panels.set_index("estimator").loc["ugdk", "slope"])
    texts = [text.get_text() for text in fig2_error.draw(frame).axes[3].texts]
    assert any("too few fits" in text and "400 of 400 not ok" in text for text in texts)


CENTER = np.array([3.0, -4.0])

RADII = {"inner": 1.2, "outer": 2.0}

TRIALS, N, NOISE = 61, 40, 0.05


@pytest.fixture
def markers(make_rows, make_tables, kept_points):
    """Tables of a run with two markers, points in an order of their own, and those of the inner and the outer one."""

    def make(cells, seed=1):
        rng = np.random.default_rng(seed)
        errors, tables, sets = [], [], []
        for cell, radius, columns in cells:
            points = CENTER + radius * sample_cap(rng, TRIALS * N, np.radians(50.0), 2).reshape(TRIALS, N, 2)
            points += columns.get("noise", NOISE) * rng.normal(size=points.shape)
            rows = kept_points(cell, points, radius, CENTER).sample(frac=1.0, random_state=1)
            conditions = {"noise": NOISE, "samples": N, "angle": 50.0} | columns
            errors.append(make_rows(cell, "als", rng.normal(size=(TRIALS, 2)), radius=radius, center=5.0, **conditions))
            tables.append(rows)
            sets.append(points)
        return make_tables(pd.concat(errors, ignore_index=True), "grid", pd.concat(tables, ignore_index=True)), sets

    return make


@pytest.fixture
def two(markers):
    return markers([(name, radius, {}) for name, radius in RADII.items()])


def distances(inner, outer):
    """Errors of the outer marker alone, the inner one and both, one set after the other."""
    joint = [mgdk(pair).center for pair in zip(inner, outer, strict=True)]
    centers = np.array([study.fit(outer, "als").center, study.fit(inner, "als").center, joint])
    return np.linalg.norm(centers - CENTER, axis=2)


def test_medians(two):
    """The medians are those of fits made one by one, and their errors those of the quantile."""
    tables, (inner, outer) = two
    frame = fig6_mgdk.prepare(tables)
    expected = distances(inner, outer)
    np.testing.assert_allclose(frame.distances, expected, rtol=1e-9)
    np.testing.assert_allclose([median.value for median in frame.medians], np.median(expected, axis=1), rtol=1e-9)
    np.testing.assert_allclose([m.error for m in frame.medians], [quantile(row, 0.5).error for row in expected])


def test_the_joint_fit_is_better_by_as_much_as_theory_says(markers):
    """Little noise: each alone is at the same bound, which has no radius in it, and both together have half of it.

    The ratio of medians is 1/√2 within 4.5 Monte-Carlo errors (7 in 10⁶; more seldom, as the fits are correlated).
    """
    tables, _ = markers([("a", 1.2, {"noise": 1e-3}), ("b", 2.0, {"noise": 1e-3})])
    outer, inner, joint = fig6_mgdk.prepare(tables).medians
    for alone in (outer, inner):
        error = np.hypot(joint.error, alone.error / np.sqrt(2))
        assert abs(joint.value - alone.value / np.sqrt(2)) < 4.5 * error
        assert error < 0.25 * joint.value


def test_the_data_set_is_typical(two):
    """It is the trial whose worst ratio to a median is least, and its points and circles are that trial's."""
    tables, (inner, outer) = two
    frame = fig6_mgdk.prepare(tables)
    errors = distances(inner, outer)
    ratio = errors / np.median(errors, axis=1)[:, None]
    trial = int(np.argmin(np.maximum(ratio, 1.0 / ratio).max(axis=0)))
    np.testing.assert_allclose(frame.points[0], outer[trial] - CENTER)
    np.testing.assert_allclose(frame.points[1], inner[trial] - CENTER)
    joint = mgdk([inner[trial], outer[trial]])
    np.testing.assert_allclose(frame.centers[2], joint.center - CENTER, atol=1e-9)
    np.testing.assert_allclose(frame.radii[2], joint.radii[::-1])
    np.testing.assert_allclose(frame.radii[:2], [study.fit(each[trial], "als").radius for each in (outer, inner)])
    assert frame.true_radii == (2.0, 1.2)
    assert f"trial {trial} of {TRIALS}" in frame.stamp


def test_other_axes_stay_at_their_first_value(markers, two):
    """Cells of another noise, angle, centre or number of samples do not mix in."""
    cells = [(name, radius, {}) for name, radius in RADII.items()]
    changes = list(enumerate(({"noise": 0.3}, {"angle": 90.0}, {"samples": 99})))
    more = [(f"{name}-{k}", radius, change) for name, radius, _ in cells for k, change in changes]
    tables, _ = markers([*cells, *more])
    np.testing.assert_array_equal(fig6_mgdk.prepare(tables).distances, fig6_mgdk.prepare(two[0]).distances)
    assert "$σ$ = 0.05" in fig6_mgdk.prepare(tables).caption


def test_a_fit_without_a_number_counts_as_worst(two):
    """A set on a line has no centre: its error is infinite, the medians are of all trials, and it is drawn."""
    tables, _ = two
    points = tables.points
    flat = (points["trial"] == 5) & (points["cell"] == "inner")
    points.loc[flat, "x_1"] = points.loc[flat, "x_2"] = points.loc[flat, "sample"].astype(float)
    frame = fig6_mgdk.prepare(tables)
    assert np.isinf(frame.distances[1]).sum() == 1
    assert frame.medians[1].value == np.median(frame.distances[1])
    fig6_mgdk.draw(frame).draw_without_rendering()


def test_a_method_without_an_answer_chooses_no_trial():
    """Where most errors of a method are infinite, the trial is that which is typical of the others."""
    distances = np.array([[1.0, 2.0, 4.0], [np.inf, np.inf, 1.0], [1.0, 2.1, 4.0]])
    assert fig6_mgdk._typical(distances) == 1


def test_reasons_fig6_mgdk(two, markers, power_tables, circle_tables, refused):
    """Each thing that is missing is told in a sentence that names the remedy."""
    tables, _ = two
    replace = dataclasses.replace
    refused(fig6_mgdk, power_tables, "dimension = 2")
    refused(fig6_mgdk, tables, "a grid of two radii", design="random")
    refused(fig6_mgdk, tables, "set keep_points", points=None)
    refused(fig6_mgdk, circle_tables, "two markers: two radii")
    relative, _ = markers([("a", 1.2, {"noise": 0.06}), ("b", 2.0, {"noise": 0.1})])
    refused(fig6_mgdk, relative, "same noise: noise in the config, not noise_over_radius")
    few = replace(tables, points=tables.points[tables.points["trial"] < 19])
    refused(fig6_mgdk, few, "at least 20 trials with points kept, not 19")


def test_shared_draws_are_refused(two, refused):
    """Markers with the same directions and the same noise, c + r u + σ z, have nothing to add to each other."""
    tables, (inner, _) = two
    points = tables.points
    rng = np.random.default_rng(1)
    directions = sample_cap(rng, TRIALS * N, np.radians(50.0), 2)  # as the fixture drew them for the inner marker
    noise = inner.reshape(-1, 2) - CENTER - 1.2 * directions
    assert noise.std() == pytest.approx(NOISE, rel=0.1)
    shared = points[points["cell"] == "inner"].sort_values(["trial", "sample"]).assign(cell="outer", radius=2.0)
    shared[["x_1", "x_2"]] = CENTER + 2.0 * directions + noise
    both = pd.concat([points[points["cell"] == "inner"], shared], ignore_index=True)
    refused(fig6_mgdk, tables, 'draws = "independent"', points=both)


def test_drawn_circles(two):
    """Outer red, inner blue, joint green twice, each where its fit is, in lines of their own; the truth is faint."""
    frame = fig6_mgdk.prepare(two[0])
    figure = fig6_mgdk.draw(frame)
    whole, zoom = figure.axes
    circles = [patch for patch in whole.patches if isinstance(patch, Circle)]
    fitted = [c for c in circles if to_hex(c.get_edgecolor()) in fig6_mgdk._COLORS]
    found = [(to_hex(c.get_edgecolor()), *c.center, c.radius) for c in fitted]
    both = frame.radii[2]
    told = [(fig6_mgdk.OUTER, *frame.centers[0], frame.radii[0]), (fig6_mgdk.INNER, *frame.centers[1], frame.radii[1])]
    told += [(fig6_mgdk.JOINT, *frame.centers[2], radius) for radius in both]
    assert found == told
    assert len({str(c.get_linestyle()) for c in fitted}) == 3
    assert sorted(c.radius for c in circles if c not in fitted) == [1.2, 2.0]
    for line, distance in zip(zoom.lines, frame.distances, strict=False):
        np.testing.assert_array_equal(line.get_xdata(), np.sort(distance))
    words = "\n".join(text.get_text() for text in zoom.get_legend().get_texts())
    assert all(f"{median.value:.3f} ± {median.error:.3f}" in words for median in frame.medians)


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


def test_reasons_fig7_power_law(power_tables, random_tables, refused):
    """A random design has no curves, and three numbers of samples are no law."""
    refused(fig7_power_law, random_tables, 'kind = "grid"')
    summary = power_tables.summary
    refused(fig7_power_law, power_tables, "at least 4 numbers of samples", summary=summary[summary["samples"] < 300])

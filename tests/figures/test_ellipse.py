import dataclasses

import numpy as np
import pytest
from scipy import stats

from study.estimators import Status
from study.figures.inputs import NotApplicable
from study.figures.paper import arc_data, fig3_gdke_ellipse, fig4_ugdk_ellipse, fig5_methods

FIGURES = [fig3_gdke_ellipse, fig4_ugdk_ellipse, fig5_methods]


def test_reach_is_the_chi_square_quantile():
    """The ellipse's reach is √χ²₂."""
    for level in (0.5, 0.68, 0.95):
        np.testing.assert_allclose(arc_data.reach(level) ** 2, stats.chi2.ppf(level, 2))


def test_spread_of_gaussian_errors(circle_tables):
    """Median and robust standard deviation are those of the Gaussian that the errors were drawn from, in radii."""
    data = arc_data.choose(circle_tables, ["gdke"])
    error = 4.0 / np.sqrt(3000)  # four standard errors, of quantiles that have at most 1.6 of a mean's
    for name, bias in (("gdke", 0.5), ("ugdk", 0.0)):
        spread = data.spreads[name]
        np.testing.assert_allclose(spread.sd, [0.1, 0.025], rtol=1.6 * error)
        np.testing.assert_allclose(spread.bias[0], bias, atol=1.6 * error * 0.1)
        np.testing.assert_allclose(spread.bias[1], 0.0, atol=1.6 * error * 0.025)


def test_coverage_of_gaussian_errors(circle_tables):
    """An unbiased Gaussian's 95 % ellipses hold the truth in 95 % of the trials; GDKE's, five sd off, hardly ever."""
    data = arc_data.choose(circle_tables, ["gdke"])
    assert abs(data.spreads["ugdk"].covered - 2850) < 4 * np.sqrt(3000 * 0.95 * 0.05) + 30
    assert data.spreads["gdke"].covered < 60  # P(N(5, 1) < 2.45) = 0.5 %, with room


def test_fits_without_a_number_are_left_out_of_the_spread_and_not_covered(circle_tables):
    """They move nothing, and no ellipse of theirs holds the truth; a status alone changes nothing."""
    before = arc_data.choose(circle_tables, ["gdke"]).spreads["ugdk"]
    errors = circle_tables.errors
    wild = errors.index[errors["estimator"] == "ugdk"][10:1010]
    errors.loc[wild, "status"] = Status.NOT_POSITIVE_DEFINITE
    assert arc_data.choose(circle_tables, ["gdke"]).spreads["ugdk"] == before
    errors.loc[wild, ["error_1", "error_2", "error"]] = np.nan
    after = arc_data.choose(circle_tables, ["gdke"]).spreads["ugdk"]
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
    data = arc_data.choose(circle_tables, ["gdke"])
    np.testing.assert_allclose(np.hypot(data.points["x"], data.points["y"]), 1.0)
    row = circle_tables.errors.query("estimator == 'mle' and trial == 3").iloc[0]
    circle = data.fits["mle"]
    np.testing.assert_allclose([circle.x, circle.y, circle.radius], [row["error_1"] / 2, row["error_2"] / 2, 1.0])


def test_distance_of_the_truth_in_standard_deviations(circle_tables):
    """The number under figure 3 is the Mahalanobis distance of the estimate's error."""
    frame = fig3_gdke_ellipse.prepare(circle_tables)
    row = circle_tables.errors.query("estimator == 'gdke' and trial == 3").iloc[0]
    told = np.hypot(row["error_1"] / 2 / frame.spread.sd[0], row["error_2"] / 2 / frame.spread.sd[1])
    np.testing.assert_allclose(frame.distance, told)


def test_drawn_ellipses_have_the_size_of_the_spread(circle_tables):
    """Axes of the patches are 2 √χ²₂ sd, centred on the estimate."""
    frame = fig4_ugdk_ellipse.prepare(circle_tables)
    patches = fig4_ugdk_ellipse.draw(frame).axes[1].patches
    assert len(patches) == 2
    fit = frame.data.fits["ugdk"]
    for patch, level in zip(patches, (0.68, 0.95), strict=True):
        size = 2.0 * np.sqrt(stats.chi2.ppf(level, 2)) * np.array(frame.spread.sd)
        np.testing.assert_allclose([patch.width, patch.height], size)
        np.testing.assert_allclose(patch.center, [fit.x, fit.y])


def test_figures_3_and_4_share_a_window_that_holds_both_ellipses(circle_tables):
    """So that their sizes can be compared."""
    one, other = fig3_gdke_ellipse.prepare(circle_tables), fig4_ugdk_ellipse.prepare(circle_tables)
    assert one.window == other.window
    left, right, bottom, top = one.window
    for frame in (one, other):
        fit = frame.data.fits[frame.estimator]
        wide, tall = arc_data.reach(0.95) * np.array(frame.spread.sd)
        assert left < fit.x - wide
        assert fit.x + wide < right
        assert bottom < fit.y - tall
        assert fit.y + tall < top


def test_fits_that_coincide_are_named_together(circle_tables):
    """LLS is GDKE: one circle, and the words say so."""
    frame = fig5_methods.prepare(circle_tables)
    assert {one.estimator: one.same for one in frame.shown} == {"mle": [], "ugdk": [], "gdke": ["lls"]}
    assert [one.circle.x for one in frame.shown] == sorted(one.circle.x for one in frame.shown)
    texts = [text.get_text() for text in fig5_methods.draw(frame).axes[1].texts]
    assert any(text.startswith("GDKE") and "the same: LLS" in text for text in texts)


@pytest.mark.parametrize("figure", FIGURES)
def test_reasons(circle_tables, power_tables, figure):
    """Each thing that is missing is told in a sentence that names the remedy."""
    with pytest.raises(NotApplicable, match="dimension = 2 in the config, not 3"):
        figure.prepare(power_tables)
    with pytest.raises(NotApplicable, match='kind = "grid"'):
        figure.prepare(dataclasses.replace(circle_tables, design="random"))
    with pytest.raises(NotApplicable, match="keep_points"):
        figure.prepare(dataclasses.replace(circle_tables, points=None))
    errors = circle_tables.errors
    both = {"rows": errors, "summary": circle_tables.summary}
    without = {name: table[table["estimator"] != "ugdk"] for name, table in both.items()}
    with pytest.raises(NotApplicable, match="estimator ugdk"):
        figure.prepare(dataclasses.replace(circle_tables, **without))
    with pytest.raises(NotApplicable, match="at least 50 trials"):
        figure.prepare(dataclasses.replace(circle_tables, rows=errors[errors["trial"] < 20]))
    failed = errors.assign(status=int(Status.SINGULAR))
    with pytest.raises(NotApplicable, match="no ok fit"):
        figure.prepare(dataclasses.replace(circle_tables, rows=failed))

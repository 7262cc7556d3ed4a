import numpy as np
import pytest
from scipy import stats

from study.estimators import Status
from study.figures.inputs import NotApplicable
from study.figures.paper import fig2_error


def test_slope_of_an_exact_power_law(random_tables):
    """Errors exactly proportional to the noise have slope 1, and everything is over the radius."""
    frame = fig2_error.prepare(random_tables)
    np.testing.assert_allclose(frame.panels[["slope", "slope_low", "slope_high"]], 1.0, rtol=1e-9)
    np.testing.assert_allclose(frame.dots["error"] / frame.dots["noise"], 0.125)
    assert list(frame.panels["estimator"]) == ["mle", "lls", "gdke", "ugdk"]


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
    assert "3 off the scale" in "\n".join(text.get_text() for ax in fig2_error.draw(frame).axes for text in ax.texts)


def test_running_median_of_the_bound(random_tables):
    """Each decade's point is the median of noise and bound of the trials in it, once per trial."""
    frame = fig2_error.prepare(random_tables)
    one = random_tables.errors[random_tables.errors["estimator"] == "mle"]
    noise = (one["noise"] / one["radius"]).to_numpy()
    inside = (noise >= 1e3) & (noise < 1e4)
    row = frame.bound[(frame.bound["noise"] >= 1e3) & (frame.bound["noise"] < 1e4)].iloc[0]
    assert row["trials"] == inside.sum()
    np.testing.assert_allclose(row["noise"], np.median(noise[inside]))
    np.testing.assert_allclose(row["bound"], np.median(0.5 * noise[inside]))


def test_needs_a_random_design(power_tables):
    """A grid has too few levels of noise for a cloud."""
    with pytest.raises(NotApplicable, match="random design"):
        fig2_error.prepare(power_tables)


def test_needs_a_range_of_noise(random_tables):
    """A single noise has no slope."""
    random_tables.errors["noise"] = 1.0
    with pytest.raises(NotApplicable, match="decade"):
        fig2_error.prepare(random_tables)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_draws_any_number_of_estimators(random_tables, make_tables, count):
    """Two panels each, none more."""
    import pandas as pd

    one = random_tables.errors[random_tables.errors["estimator"] == "mle"]
    errors = pd.concat([one.assign(estimator=f"own_{i}") for i in range(count)], ignore_index=True)
    figure = fig2_error.draw(fig2_error.prepare(make_tables(errors, "random")))
    assert len(figure.axes) == 2 * count


def test_errors_over_their_own_bounds(random_tables):
    """The lower panels have every fit's error over its bound, and the median in each decade of noise."""
    errors = random_tables.errors
    frame = fig2_error.prepare(random_tables)
    np.testing.assert_allclose(frame.dots["ratio"], errors["error"] / errors["bound"], rtol=1e-12)
    mine = frame.medians[frame.medians["estimator"] == "mle"]
    one = errors[errors["estimator"] == "mle"]
    relative = one["noise"] / one["radius"]
    row = mine.iloc[len(mine) // 2]
    power = np.floor(np.log10(row["noise"]))
    chosen = (relative >= 10.0**power) & (relative < 10.0 ** (power + 1))
    assert row["trials"] == chosen.sum()
    assert row["ratio"] == np.median((one["error"] / one["bound"])[chosen])


def test_survives_an_estimator_that_always_fails(random_tables):
    """Without a number there is no slope, and the panel says so."""
    errors = random_tables.errors
    errors.loc[errors["estimator"] == "ugdk", "status"] = Status.SINGULAR
    errors.loc[errors["estimator"] == "ugdk", "error"] = np.nan
    frame = fig2_error.prepare(random_tables)
    assert np.isnan(frame.panels.set_index("estimator").loc["ugdk", "slope"])
    texts = [text.get_text() for text in fig2_error.draw(frame).axes[3].texts]
    assert any("too few fits" in text and "400 of 400 not ok" in text for text in texts)

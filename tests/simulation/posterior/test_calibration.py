"""Monte-Carlo errors mean what they say: over many repetitions they match the scatter of what they belong to.

Standard deviations over 2000 repetitions are known to 1.6 % (normal) to 2 %, so 10 % is passed by chance in fewer
than 1 of 10⁵ cases, and 15 % still less.

Ranks and coverage, from tables whose answers are known.
"""

import math
import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from study.fits import Status
from study.simulation.experiment.config import ChainStatus
from study.simulation.posterior import run
from study.simulation.posterior.run import FLAT, KEYS, LEVELS, by_cell, coverage, trials, uniformity
from study.simulation.statistics import UNKNOWN, mean, quantile, root_mean_square, share

REPEATS, SIZE = 2000, 1000

LAWS = {"normal": stats.norm, "cauchy": stats.cauchy}


@pytest.fixture(scope="module", params=list(LAWS))
def repeated(request):
    """A law, and 2000 samples of 1000 of it."""
    return LAWS[request.param], LAWS[request.param].rvs(size=(REPEATS, SIZE), random_state=17)


@pytest.mark.parametrize(("p", "tolerance"), [(0.5, 0.10), (0.05, 0.15), (0.95, 0.15)])
def test_quantile_errors_match_the_scatter(repeated, p, tolerance):
    """The error of a quantile is, on average, that quantile's standard deviation, which is theory's √(p(1-p)/n)/f(x_p).

    The true quantile lies within one error in 68 % of repetitions and within two in 95 %, to 5 points.
    """
    law, data = repeated
    value, error = np.transpose([quantile(row, p) for row in data])
    assert error.mean() == pytest.approx(value.std(), rel=tolerance)
    assert value.std() == pytest.approx(math.sqrt(p * (1 - p) / SIZE) / law.pdf(law.ppf(p)), rel=tolerance)
    pull = np.abs(value - law.ppf(p)) / error
    assert np.mean(pull < 1) == pytest.approx(0.683, abs=0.05)
    assert np.mean(pull < 2) == pytest.approx(0.954, abs=0.05)


@pytest.mark.parametrize("p", [0.02, 0.3, 0.5])
def test_share_errors_match_the_scatter(p):
    """The error of a share is the standard deviation of the share, within 10 %."""
    counts = stats.binom(400, p).rvs(size=REPEATS, random_state=3)
    value, error = np.transpose([share(int(count), 400) for count in counts])
    assert value.mean() == pytest.approx(p, abs=4.5 * math.sqrt(p * (1 - p) / 400 / REPEATS))
    assert error.mean() == pytest.approx(value.std(), rel=0.15 if p < 0.1 else 0.1)


@pytest.mark.parametrize("measure", [mean, root_mean_square])
def test_moment_errors_match_the_scatter(measure):
    """Errors of mean and root mean square match their scatter within 10 %, where moments exist."""
    data = stats.norm(1.0, 2.0).rvs(size=(REPEATS, SIZE), random_state=11)
    value, error = np.transpose([measure(row) for row in data])
    assert error.mean() == pytest.approx(value.std(), rel=0.1)
    truth = 1.0 if measure is mean else math.sqrt(5.0)
    assert value.mean() == pytest.approx(truth, abs=4.5 * value.std() / math.sqrt(REPEATS) + 1e-3)


def test_shares_and_moments_of_nothing():
    """None or all of n has an error of the order 1/n, not 0; none of none is unknown.

    Samples without a spread to estimate have no mean and no root mean square.
    """
    for count in (0, 100):
        found = share(count, 100)
        assert found.value == count / 100
        assert 0.005 < found.error < 0.03
    assert all(math.isnan(v) for v in share(0, 0))
    for values in (np.array([]), np.array([1.0])):
        assert all(math.isnan(v) for measure in (mean, root_mean_square) for v in measure(values))
    assert math.isnan(root_mean_square(np.zeros(5)).value) == math.isnan(UNKNOWN.value)


RANKS = ["rank_1", "rank_2", "rank_radius"]


@pytest.mark.parametrize("stored", [False, True])
def test_a_row_per_chain_and_method(rng, chains, beside, as_stored, stored):
    """Chains and fits stand in one table with the flatness of their trial, and whether they are ok."""
    posterior = chains(rng, 9, noises=("known", "unknown"))
    posterior["flatness"] = np.linspace(0.001, 0.1, len(posterior))
    posterior.loc[3, "status"] = int(ChainStatus.AT_PRIOR)
    answers = beside(rng, posterior).sample(frac=1.0, random_state=1)
    answers.loc[5, "status"] = int(Status.NOT_CONVERGED)
    found = trials(*((as_stored(posterior), as_stored(answers)) if stored else (posterior, answers)))
    assert found["method"].value_counts().to_dict() == {"posterior": 18, "mle": 18, "gdke": 18}
    mine = found[found["method"] == "posterior"]
    for name in ("level", "flatness", *RANKS, "rank_noise"):
        np.testing.assert_array_equal(mine[name], posterior[name])
    assert list(mine["ok"]) == [i != 3 for i in range(18)]
    columns = ["level", *RANKS, "flatness"]
    for name in ("mle", "gdke"):
        told = answers[answers["estimator"] == name].merge(posterior[[*KEYS, "flatness"]], on=KEYS)
        some = found[found["method"] == name]
        both = (frame[columns].sort_values("level", ignore_index=True) for frame in (some, told))
        pd.testing.assert_frame_equal(*both)
        assert some["rank_noise"].isna().all()
        assert (~some["ok"]).sum() == (name == "mle")


@pytest.mark.parametrize("order", [("geometric", "whole_sphere"), ("whole_sphere", "geometric")])
def test_estimators_are_not_counted_twice(rng, chains, beside, order):
    """A fit stands beside the chain of each likelihood, and is one fit."""
    posterior = chains(rng, 12, likelihoods=order, noises=("known", "unknown"))
    found = trials(posterior, beside(rng, posterior))
    counts = found.groupby(["method", "noise_is"]).size()
    of_methods = {"posterior": 24, "mle": 12, "gdke": 12}.items()
    assert counts.to_dict() == {(name, noise): n for name, n in of_methods for noise in ("known", "unknown")}
    table = coverage(found)
    assert set(table[table["method"] == "mle"]["trials"]) == {12}
    assert len(table[table["method"] == "mle"]) == 2 * len(LEVELS)
    assert len(table[table["method"] == "posterior"]) == 4 * len(LEVELS)


@pytest.mark.parametrize(("inside", "count"), [(0, 7), (7, 7), (5, 7), (61, 100), (950, 1000), (1, 1)])
def test_intervals_are_clopper_and_pearsons(rng, chains, beside, inside, count):
    """The share, its exact interval from quantiles of the beta law, and the exact test, by their definitions."""
    posterior = chains(rng, count)
    posterior["level"] = np.where(np.arange(count) < inside, 0.3, 0.99)
    table = coverage(trials(posterior, beside(rng, posterior)))
    for _, row in table[table["method"] == "posterior"].iterrows():
        assert (row["trials"], row["failed"]) == (count, 0)
        assert row["share"] == inside / count
        low = stats.beta.ppf(0.025, inside, count - inside + 1) if inside else 0.0
        high = stats.beta.ppf(0.975, inside + 1, count - inside) if inside < count else 1.0
        assert row["low"] == pytest.approx(low, rel=1e-9)
        assert row["high"] == pytest.approx(high, rel=1e-9)
        chances = stats.binom.pmf(np.arange(count + 1), count, row["level"])
        assert row["p"] == pytest.approx(min(chances[chances <= chances[inside] * (1 + 1e-7)].sum(), 1.0), rel=1e-9)


def test_those_that_failed_are_outside(rng, chains, beside):
    """A chain or a fit that is not ok, or has no level, does not hold the truth, whatever its level is."""
    posterior = chains(rng, 50, level=0.1)
    posterior.loc[:9, "status"] = [int(s) for s in (ChainStatus.NOT_CONVERGED, ChainStatus.AT_PRIOR)] * 5
    posterior.loc[10:13, "level"] = np.nan
    answers = beside(rng, posterior, names=("mle",), level=0.1)
    answers.loc[:4, "status"] = int(Status.AT_BOUND)
    table = coverage(trials(posterior, answers)).set_index(["method", "level"])
    for level in LEVELS:
        row = table.loc[("posterior", level)]
        assert (row["trials"], row["failed"], row["share"]) == (50, 10, 36 / 50)
        row = table.loc[("mle", level)]
        assert (row["trials"], row["failed"], row["share"]) == (50, 5, 45 / 50)


def test_coverage_of_what_is_calibrated(rng, chains, beside):
    """Of 1000 uniform levels the test is passed at 1 in 10⁴ for each of 4 methods and levels; of squares it is not."""
    posterior = chains(rng, 1000)
    answers = beside(rng, posterior, names=("mle", "gdke"))
    gdke = answers["estimator"] == "gdke"
    answers.loc[gdke, "level"] = np.sqrt(answers.loc[gdke, "level"])
    table = coverage(trials(posterior, answers)).set_index(["method", "level"])
    for method in ("posterior", "mle"):
        for level in LEVELS:
            row = table.loc[(method, level)]
            assert row["p"] > 1e-4
            assert abs(row["share"] - level) < 4.0 * np.sqrt(level * (1.0 - level) / 1000)
    exact = posterior.assign(level=(np.arange(1000) + 0.5) / 1000.0)  # a set holds the truth if its level is below
    whole = coverage(trials(exact, answers)).query("method == 'posterior'")
    assert dict(zip(whole["level"], whole["share"], strict=True)) == pytest.approx({0.68: 0.68, 0.95: 0.95})
    assert table.loc[("gdke", 0.68), "p"] < 1e-9
    assert table.loc[("gdke", 0.68), "high"] < 0.68


def test_uniform_ranks_pass_and_shifted_ones_fail(rng, chains, beside):
    """At a false-alarm rate of 10⁻⁴ for each of seven; ranks shifted by 0.1 of 1000, or pulled to the middle, fail.

    Distance and p are those of SciPy's test of Kolmogorov and Smirnov.
    """
    posterior = chains(rng, 1000, noises=("known", "unknown"))
    unknown = posterior["noise_is"] == "unknown"
    posterior.loc[unknown, "rank_1"] = np.clip(posterior.loc[unknown, "rank_1"] + 0.1, 0.0, 1.0)
    posterior.loc[unknown, "rank_2"] = 0.25 + 0.5 * posterior.loc[unknown, "rank_2"]
    found = trials(posterior, beside(rng, posterior, names=("mle",)))
    table = uniformity(found).set_index(["noise_is", "method", "parameter"])
    assert len(table) == 3 + 4 + 3 + 3  # σ has a rank where it has a posterior
    wrong = [("unknown", "posterior", "1"), ("unknown", "posterior", "2")]
    for key, row in table.iterrows():
        assert row["trials"] == 1000
        assert (row["p"] < 1e-4) == (key in wrong), key
    ranks = posterior.loc[~unknown, "rank_1"]
    told, expected = table.loc["known", "posterior", "1"], stats.kstest(ranks, "uniform")
    assert list(told[["distance", "p", "mean"]]) == [expected.statistic, expected.pvalue, ranks.mean()]
    assert table.loc[wrong[0], "mean"] == pytest.approx(0.595, abs=0.05)
    assert table.loc[wrong[1], "mean"] == pytest.approx(0.5, abs=0.03)  # which a mean does not show


def test_ranks_of_those_that_failed_do_not_count(rng, chains, beside):
    """A chain that is not ok has no say on uniformity, and neither has a rank that is no number; one alone neither."""
    posterior = chains(rng, 30)
    posterior.loc[:9, "status"] = int(ChainStatus.NOT_CONVERGED)
    posterior.loc[:9, RANKS] = 0.0
    posterior.loc[10:14, "rank_1"] = np.nan
    posterior.loc[10:28, "rank_2"] = np.nan
    table = uniformity(trials(posterior, beside(rng, posterior))).query("method == 'posterior'").set_index("parameter")
    assert table["trials"].to_dict() == {"1": 15, "radius": 20}
    assert (table["p"] > 1e-3).all()


@pytest.fixture
def cells(rng, chains, beside):
    """Chains of two cells and their answers, with what `by_cell` compares: shifts, deviations, bounds and times."""
    posterior = pd.concat([chains(rng, 5, noises=("known", "unknown"), cell=cell) for cell in "ba"], ignore_index=True)
    posterior = posterior.assign(samples=100, noise=0.1, angle=60.0, radius=2.0, tau=rng.random(20))
    answers = beside(rng, posterior)
    for ending in ("1", "2", "radius"):
        posterior[f"sd_{ending}"], posterior[f"bound_{ending}"] = rng.random((2, 20)) + 0.5
        answers[f"away_{ending}"] = rng.normal(size=40)
    return posterior, answers


def test_cell_by_cell(rng, cells):
    """Largest shift of the MLE, least and most of sd over bound, longest τ, of the chains that are ok."""
    posterior, answers = cells
    posterior.loc[[0, 7, 8], "status"] = int(ChainStatus.NOT_CONVERGED)
    found = by_cell(posterior, answers.sample(frac=1.0, random_state=1))
    keys = [[cell, noise] for cell in "ba" for noise in ("known", "unknown")]
    assert found[["cell", "noise_is"]].to_numpy().tolist() == keys
    for row in found.itertuples():
        mine = posterior[(posterior["cell"] == row.cell) & (posterior["noise_is"] == row.noise_is)]
        ok = mine[mine["status"] == 0]
        assert (row.chains, row.ok) == (5, len(ok))
        assert (row.samples, row.noise, row.angle, row.radius, row.flatness) == (100, 0.1, 60.0, 2.0, 0.001)
        mle = answers[answers["estimator"] == "mle"].merge(ok[KEYS], on=KEYS)
        ratios = [ok[f"sd_{e}"] / ok[f"bound_{e}"] for e in ("1", "2", "radius")]
        assert row.shift == mle[["away_1", "away_2", "away_radius"]].abs().max(axis=None)
        assert row.least == pytest.approx(np.min(ratios), rel=1e-12)
        assert row.most == pytest.approx(np.max(ratios), rel=1e-12)
        assert row.tau == ok["tau"].max()


def test_cells_without_an_mle_or_a_chain_that_is_ok(rng, cells):
    """A value that the chains do not determine is NaN."""
    posterior, answers = cells
    without = by_cell(posterior, answers[answers["estimator"] != "mle"])
    assert without["shift"].isna().all()
    assert without[["least", "most", "tau"]].notna().all(axis=None)
    none = by_cell(posterior.assign(status=int(ChainStatus.NO_START)), answers)
    assert (none["ok"] == 0).all()
    assert none[["shift", "least", "most", "tau"]].isna().all(axis=None)


def test_what_is_printed(rng, chains, beside):
    """A line per method with coverage and uniformity of chains that are not too flat, and the number of these."""
    posterior = chains(rng, 60)
    posterior.loc[40:, "flatness"] = FLAT
    posterior.loc[40:, "level"] = 0.999
    answers = beside(rng, posterior, names=("mle",))
    found = trials(posterior, answers)
    first, head, *lines, note = run.printed_calibration(found)
    assert first.startswith("calibration of 40 chains")
    assert "σ²/v < 0.02" in first
    table, tests = coverage(found[found["flatness"] < FLAT]), uniformity(found[found["flatness"] < FLAT])
    names = list(dict.fromkeys(tests["parameter"]))
    sets = ["68% set", "95% set", *(f"p of {name}" for name in names)]
    assert re.split(r" {2,}", head) == ["likelihood", "noise", "method", *sets]
    assert "Kolmogorov" in note
    assert len(lines) == 2
    for line, method in zip(lines, ("posterior", "mle"), strict=True):
        assert line.split()[:3] == ["geometric", "known", method]
        for row in table[table["method"] == method].itertuples():
            assert f"{row.share:.1%} ({row.low:.1%} … {row.high:.1%})" in line
        p = tests[tests["method"] == method].set_index("parameter")["p"]
        assert re.split(r" {2,}", line)[5:] == [f"{p[name]:.2g}" if name in p else "-" for name in names]
    assert list(run.printed_calibration(found[found["flatness"] >= FLAT])) == []

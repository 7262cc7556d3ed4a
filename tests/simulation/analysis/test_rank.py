"""Rankings: marks of those that cannot be told from the best, their level, copies, failures, and the command."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import study
from study.files import RunError
from study.simulation.analysis import losses, rank
from tests.configs import config

DESIGN = config({"dimension": 2, "estimators": ["gdke", "als", "mle"]}, trials=30, samples=[10, 20], angle=[90, 180])


def table(*cells):
    """An error table of cells, each a dictionary of estimators with their errors."""
    rows = [
        (f"c{number}", trial, estimator, value)
        for number, cell in enumerate(cells)
        for estimator, values in cell.items()
        for trial, value in enumerate(values)
    ]
    return pd.DataFrame(rows, columns=["cell", "trial", "estimator", "error"])


def compared(errors, names, name=""):
    """The mechanism of an error table."""
    return rank.compared(losses.Losses(name, names, [errors]))


def of_run(run, by="center"):
    """The mechanism of a run."""
    return rank.compared(losses.of_run(run, by))


def logs(distances):
    """Log losses of one cell's errors (k, trials)."""
    return rank.log_losses(np.asarray(distances), np.arange(np.shape(distances)[1]), rank.signs("test"))


def log_of(loss, errors):
    """The log of a loss of errors (…, trials)."""
    return np.log(np.median(errors, axis=-1) if loss == "median" else np.sqrt(np.mean(errors**2, axis=-1)))


def marks_by_a_loop(loss, cells, draws, rng):
    """The marks by swapping the errors of each pair outright, and the critical values and spreads behind them."""
    k, marks, spreads = cells.shape[1], [], np.zeros(cells.shape[1:2] * 2)
    values = log_of(loss, cells).mean(axis=0)
    swaps = rng.random((draws, cells.shape[2])) < 0.5
    for i in range(k):
        others = [j for j in range(k) if j != i]
        found = np.zeros((draws, k))
        for b, swap in enumerate(swaps):
            for j in others:
                mine, other = np.where(swap, cells[:, j], cells[:, i]), np.where(swap, cells[:, i], cells[:, j])
                found[b, j] = (log_of(loss, mine) - log_of(loss, other)).mean()
        spreads[i] = found.std(axis=0)
        critical = np.quantile((found[:, others] / spreads[i][others]).max(axis=1), 0.95)
        marks.append(all(values[i] - values[j] <= critical * spreads[i][j] for j in others))
    return marks, spreads


@pytest.mark.parametrize("seed", [5, 6])
@pytest.mark.parametrize("loss", rank.LOSSES)
def test_marks_are_those_of_a_loop(loss, seed):
    """Over three cells of four estimators, swapping errors one draw at a time gives the same marks and spreads.

    The ratios are 1, 1.02, 1.2 and 1.6. Spreads agree within 12 %, of medians, which are linearised, within 30 %.
    """
    rng = np.random.default_rng(seed)
    shared = rng.standard_normal((3, 1, 150))
    cells = np.abs(shared + 0.7 * rng.standard_normal((3, 4, 150))) * np.array([1.0, 1.02, 1.2, 1.6])[:, None]
    expected, spreads = marks_by_a_loop(loss, cells, 600, rng)
    names = list("abcd")
    found = compared(table(*(dict(zip(names, cell, strict=True)) for cell in cells)), names)
    assert list(rank.may_be_best(found.logs[loss])) == expected
    assert expected[2:] == [False, False]
    mine = np.sqrt(np.mean(found.logs[loss].swapped ** 2, axis=0))
    rest = ~np.eye(4, dtype=bool)
    np.testing.assert_allclose(mine[rest], spreads[rest], rtol=0.3 if loss == "median" else 0.12)


def test_two_estimators_are_those_of_a_permutation_test():
    """Of two estimators the worse loses its mark where scipy's paired permutation test has a chance below 5 %."""
    rng, compared = np.random.default_rng(2), 0
    for _ in range(40):
        pair = rng.exponential(size=(2, 60)) * np.array([[1.0], [rng.uniform(1.0, 1.6)]])

        def difference(one, two, axis):
            return log_of("rms", one) - log_of("rms", two)

        order = pair[np.argsort(log_of("rms", pair))[::-1]]
        test = stats.permutation_test(
            order,
            difference,
            permutation_type="samples",
            n_resamples=2000,
            alternative="greater",
            rng=1,
            vectorized=True,
        )
        if abs(test.pvalue - 0.05) > 0.03:  # 4 errors of either's draws
            compared += 1
            assert rank.may_be_best(logs(order)["rms"])[0] == (test.pvalue > 0.05)
    assert compared > 25


def test_a_copy_is_never_ranked_apart():
    """Of 100 tables, an exact copy of an estimator has its row in each, whatever its place and its failures."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        cells = []
        names = list(rng.permutation(["a", "b", "copy", "d", "e"]))
        for _ in range(2):
            errors = np.abs(rng.standard_t(2, (5, 40))) * rng.uniform(1.0, 1.3, (5, 1))
            errors[rng.random((5, 40)) < 0.02 * (seed % 3)] = np.nan
            cell = dict(zip(["a", "b", "copy", "d", "e"], errors, strict=True))
            cells.append(cell | {"copy": cell["b"]})
        ranking = rank.ranked([compared(table(*cells), names, "run")]).set_index("estimator")
        pd.testing.assert_series_equal(ranking.loc["b"], ranking.loc["copy"], check_names=False, check_exact=True)
        places = sorted(ranking.index.get_indexer(["b", "copy"]))
        assert (places[1] - places[0] == 1) or not np.isfinite(ranking.loc["b", "median"])


def test_rounding_does_not_rank_apart():
    """Of 100 tables, an estimator that differs by 10⁻¹² has the marks and the draws of its twin."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        errors = 0.001 * np.abs(rng.standard_normal((6, 40))) * rng.uniform(1.0, 1.4, (6, 1))
        errors[5] = errors[1] * (1.0 + 1e-12 * rng.standard_normal(40))
        for one in logs(errors).values():
            marks = rank.may_be_best(one)
            assert marks[5] == marks[1], seed
            assert np.abs(one.swapped[:, 1, 5]).max() < 1e-9, seed


@pytest.mark.parametrize("loss", rank.LOSSES)
@pytest.mark.parametrize("law", [stats.halfnorm, stats.t(3)])
def test_the_level_holds_among_equals(law, loss):
    """Of 250 tables of four equal estimators, a given one loses its mark in 5 % at most, but for chance.

    A rate of 5 % passes the limit once in 20,000.
    """
    rng = np.random.default_rng(3)
    lost = sum(not rank.may_be_best(logs(np.abs(law.rvs(size=(4, 80), random_state=rng)))[loss])[0] for _ in range(250))
    assert 1 <= lost <= stats.binom.isf(5e-5, 250, 0.05)  # one that never tells anything apart has no level


def test_a_worse_estimator_is_told_from_the_best():
    """Errors that are half as large again lose both marks in 200 trials, in nine of ten tables; the best keeps its."""
    rng, told = np.random.default_rng(4), []
    for _ in range(50):
        errors = np.abs(rng.standard_normal((3, 200))) * np.array([[1.0], [1.0], [1.5]])
        marks = [rank.may_be_best(one) for one in logs(errors).values()]
        told.append([not mark[2] for mark in marks])
    assert np.mean(told, axis=0).min() >= 0.9


def test_ratios_and_their_errors():
    """Ratios are geometric means over the cells; the error is the scatter over repetitions, within 30 %."""
    ones = {"x": [1.0] * 20, "y": [2.0] * 20}
    ranking = rank.ranked([compared(table(ones, {"x": [8.0] * 20, "y": [1.0] * 20}), ["x", "y"], "run")])
    assert list(ranking["estimator"]) == ["y", "x"]
    np.testing.assert_allclose(ranking[["median", "rms"]], [[1.0, 1.0], [2.0, 2.0]])
    assert list(ranking["median_alone"]) == [1, 1]
    rng, found = np.random.default_rng(6), []
    for _ in range(60):
        cells = [dict(zip("xy", np.abs(rng.standard_normal((2, 200)) * [[1.0], [3.0]]), strict=True)) for _ in range(3)]
        row = rank.ranked([compared(table(*cells), ["x", "y"], "run")]).iloc[1]
        found.append([row["median"], row["median_error"], row["rms"], row["rms_error"]])
    for value, error in np.transpose(found).reshape(2, 2, 60):
        assert np.median(error) == pytest.approx(value.std(ddof=1), rel=0.3)


def test_fits_without_a_number():
    """They are infinitely far: one leaves the median and takes the root mean square. A cell without any is left out."""
    rng = np.random.default_rng(7)
    x, y = np.abs(rng.standard_normal((2, 50)))
    lost = {"x": [np.nan] * 50, "y": [np.inf] * 50}
    ranking = rank.ranked([compared(table({"x": [np.nan, *x[1:]], "y": y}, lost), ["x", "y"], "run")])
    ranking = ranking.set_index("estimator")
    assert np.isfinite(ranking["median"]).all()
    assert ranking.loc["x", "rms"] == np.inf
    assert not ranking.loc["x", "rms_best"]
    assert ranking.loc["y", "rms_best"]
    assert ranking["failures"].to_dict() == {"x": 0.51, "y": 0.5}
    nothing = rank.ranked([compared(table(lost), ["x", "y"], "run")])
    assert nothing[["median_best", "rms_best"]].all(axis=None)
    with pytest.raises(RunError, match="cell c0: 9 trials; a ranking needs at least 10"):
        compared(table({"x": [1.0] * 9, "y": [2.0] * 9}), ["x", "y"])


def test_all_runs_together():
    """Over all runs each counts the same, with the estimators that all have; a run may be given once."""
    rng = np.random.default_rng(8)
    one = {"a": np.full(40, 1.0), "b": np.full(40, 2.0), "c": rng.random(40)}
    two = {"b": np.full(40, 1.0), "a": np.full(40, 8.0)}
    runs = [compared(table(one, one, one), list("abc"), "one"), compared(table(two), list("ba"), "two")]
    ranking = rank.ranked(runs)
    whole = ranking[ranking["run"] == rank.ALL].set_index("estimator")
    assert whole["median"].to_dict() == pytest.approx({"b": 1.0, "a": 2.0})  # √(2 · 1) and √(1 · 8)
    assert set(whole["cells"]) == {4}
    with pytest.raises(RunError, match="one: given twice"):
        rank.ranked([runs[0], runs[0]])
    other = compared(table({"z": np.full(10, 1.0), "b": np.full(10, 2.0)}), ["z", "b"])
    assert rank.ALL not in set(rank.ranked([runs[0], other])["run"])


@pytest.mark.parametrize(("apart", "radius"), [(0.3, 0.9), (1.2, 0.5), (0.2, 1.5), (2.5, 1.0), (0.1, 0.5), (0.0, 1.0)])
def test_the_index_of_two_discs(apart, radius):
    """One less the Jaccard index is that of a count of points on a grid."""
    x, y = np.meshgrid(*[np.linspace(-2.0, 4.0, 2401)] * 2)
    one, two = np.hypot(x, y) <= 1.0, np.hypot(x - apart, y) <= radius
    expected = 1.0 - (one & two).sum() / (one | two).sum()
    assert losses.disc_loss(np.array(apart), np.array(radius), np.array(1.0)) == pytest.approx(expected, abs=3e-3)


def test_discs_without_a_radius():
    """A fit without a radius has no disc."""
    lost = losses.disc_loss(np.array([0.1, np.nan, 0.1]), np.array([np.nan, 1.0, -1.0]), np.ones(3))
    assert np.isinf(lost).all()


def test_rankings_of_a_run(make_run):
    """The losses are those of the error table, of each kind; seconds are those of the timings."""
    run = make_run(DESIGN.replace("[design]", 'measures = ["jaccard"]\n[design]'))
    errors, timings = run.table("errors"), run.table("timings")
    away = {"center": errors["error"], "radius": errors["radius_error"].abs()}
    away["jaccard_index"] = errors["jaccard_index"]  # a number of a measure, which is ranked as it is
    for by, values in away.items():
        ranking = rank.ranked([of_run(run, by)]).set_index("estimator")
        square = (values**2).groupby([errors["cell"], errors["estimator"]], observed=True).mean().unstack()
        means = np.exp(0.5 * np.log(square).mean())
        assert ranking["rms"].to_dict() == pytest.approx((means / means.min()).to_dict())
    of_mle = timings[timings["step"] == "mle"]
    assert ranking.loc["mle", "seconds"] == pytest.approx(np.median(of_mle["seconds"] / of_mle["fits"]))
    discs = rank.ranked([of_run(run, "disc")])
    assert discs["median"].min() == 1.0
    with pytest.raises(RunError, match="dimension = 3: discs are of circles"):
        of_run(make_run(config({"estimators": ["gdke", "als"]}, trials=10)), "disc")


def test_the_command(tmp_path, well, call_here):
    """The command prints a ranking for each run and over all, and stores it; Python has the same."""
    for seed in (1, 2):
        (tmp_path / f"s{seed}.toml").write_text(DESIGN.replace("seed = 1", f"seed = {seed}"))
        study.run(tmp_path / f"s{seed}.toml", folder=tmp_path / f"r{seed}")
    said = well(tmp_path, "rank", "r1", "r2", "--by", "radius", "--table", "ranking.csv").splitlines()
    assert said[0].startswith("error of the radius")
    assert [line.split(":")[0] for line in said if "cells, " in line][-1] == "all"
    stored = pd.read_csv(tmp_path / "ranking.csv")
    mine = study.read_run(tmp_path / "r1").rank("radius")
    pd.testing.assert_frame_equal(stored.iloc[:3], mine, check_exact=False, check_dtype=False)
    code, _, complained = call_here(tmp_path, "rank", "r1", "--by", "x")
    assert code == 2
    assert "--by x: must be center, radius, disc for r1" in complained


def test_a_negative_measure_is_no_loss(make_run, monkeypatch):
    """It is refused with the number and the cell, not ranked by a logarithm of nothing."""
    run = make_run(DESIGN.replace("[design]", 'measures = ["jaccard"]\n[design]'))
    of_part = losses.Grouped.cells

    def cells(self, columns, only=None):
        for part in of_part(self, columns):
            values = part["jaccard_index"] - 2.0
            values.iloc[3] = np.nan  # a fit without a number is no reason
            yield part.assign(jaccard_index=values)

    monkeypatch.setattr(losses.Grouped, "cells", cells)
    with pytest.raises(RunError, match=r"jaccard_index = -[12]\.?\d* in cell \w+: losses are 0 or more"):
        of_run(run, "jaccard_index")


def test_who_is_not_in_every_run():
    """Estimators that the ranking over all runs leaves out are named below it."""
    one, two = ({name: np.arange(1.0, 21.0) for name in names} for names in ("abc", "abd"))
    runs = [compared(table(of), list(of), name) for of, name in ((one, "one"), (two, "two"))]
    *_, last = rank.printed(rank.ranked(runs), "center", 0.95)
    assert last == "not in every run: c, d"

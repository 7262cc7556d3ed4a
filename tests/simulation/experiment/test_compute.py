"""One unit of work: rows that compare each fit with its truth, and an estimator that raises.

Points of a cell: x = c + r u + σ z, the same u and z for every σ, r and c of a group.
"""

import math
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

import study
from study.fits import Estimator
from study.fits.points.samples import blank
from study.simulation.experiment import compute as module
from study.simulation.experiment.compute import Result, compute, draw
from study.simulation.experiment.config import parse
from study.simulation.experiment.designs import Batch
from study.simulation.experiment.replay import all_trials
from study.simulation.runs import runner
from tests.configs import config, uniform

ANSWER = (3.0, -4.0, 12.0, 0.5, 0.25)


@pytest.fixture
def fixed(monkeypatch):
    """An estimator whose answer is the same whatever the points are."""

    def estimator(samples):
        b, d, _ = samples.shape
        fit = blank(b, d)
        fit.center[:] = ANSWER[:d]
        fit.radius[:] = 7.0
        fit.noise_variance[:] = 0.5
        fit.status[:] = study.Status.NOT_CONVERGED
        fit.condition[:] = 0.75
        fit.iterations[:] = 42
        return fit

    monkeypatch.setitem(study.ESTIMATORS, "fixed", Estimator(estimator, "a test"))


@pytest.mark.usefixtures("fixed")
@pytest.mark.parametrize("d", [2, 3, 5])
def test_error_is_estimate_minus_truth(make_study, rows, d):
    """Components are estimated minus true, the error is their norm, and the radius error has the same sign rule.

    A sphere of radius 10 is fitted in units of 10, in which the answer comes too.
    """
    found = rows(make_study({"estimators": ["fixed"], "dimension": d}, radius=[2, 10], center=[0, 6]))
    for i in range(len(found["trial"])):
        center, unit = found["center"][i] / math.sqrt(d), {2.0: 1.0, 10.0: 10.0}[found["radius"][i]]
        vector = [unit * ANSWER[k] - center for k in range(d)]
        assert [found[f"error_{k + 1}"][i] for k in range(d)] == pytest.approx(vector, rel=1e-11)
        assert found["error"][i] == pytest.approx(math.hypot(*vector), rel=1e-11)
        assert found["radius_error"][i] == 7.0 * unit - found["radius"][i]
        assert found["noise_variance"][i] == 0.5 * unit**2
    assert set(found["radius_error"]) == {5.0, 60.0}
    stored = {"status": study.Status.NOT_CONVERGED, "condition": 0.75, "iterations": 42}  # as it came
    assert all(set(found[name]) == {value} for name, value in stored.items())


def test_cells_a_power_of_ten_apart_are_one_level(make_study, rows):
    """Radii of 1 and 10 with noise of .1 and 1: the errors of the larger are ten times those of the smaller, exactly.

    A study of the larger sphere alone gives the same bytes, so both are right.
    """
    both = rows(make_study(noise=[0.1, 1.0], radius=[1.0, 10.0]))
    small = (both["radius"] == 1.0) & (both["noise"] == 0.1)
    large = (both["radius"] == 10.0) & (both["noise"] == 1.0)
    for name in ("error_1", "error", "radius_error"):
        np.testing.assert_allclose(both[name][large], 10.0 * both[name][small], rtol=4e-16)
    alone = rows(make_study(noise=[1.0], radius=[10.0]))
    for name in ("cell", "trial", "estimator", "error_1", "error", "radius_error", "noise_variance", "status"):
        np.testing.assert_array_equal(both[name][large], alone[name])


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("shaped", [False, True])
def test_bounds_are_of_the_realised_directions(make_study, d, shaped):
    """The bound of each trial is √tr CRLB of the directions that were drawn for it; so is the radius'."""
    shape = np.diag(np.arange(1.0, d + 1)).tolist() if shaped else None
    made = make_study({"dimension": d, "noise_shape": shape}, noise=[0.1, 3.0], trials=4)
    unit = next(made.units())
    u = draw(made, next(unit.parts(0))).directions.swapaxes(1, 2).copy()
    u[:, :, 0] = 1.0 - u[:, :, 0]
    found = compute(made, unit).errors
    for sigma in (0.1, 3.0):
        crlb = study.crlb(u, sigma**2 * (np.eye(d) if shape is None else np.array(shape)))
        here = found["noise"] == sigma
        np.testing.assert_allclose(found["bound"][here], np.sqrt(np.einsum("bii->b", crlb[:, :d, :d])), rtol=1e-10)
        np.testing.assert_allclose(found["radius_bound"][here], np.sqrt(crlb[:, d, d]), rtol=1e-10)


def test_an_estimator_that_takes_no_covariance(make_study):
    """It says so in a run, too."""
    shape = [[2.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]
    made = make_study({"estimators": ["hinge"], "noise_shape": shape}, trials=3, samples=30, noise=0.05)
    result = compute(made, next(made.units()))
    assert set(result.errors["status"]) == {study.Status.FAILED}
    assert all(message.startswith("ValueError: ") for message in result.failures["message"])


@pytest.mark.parametrize("keep", [0, 1, 3, 99])
def test_first_trials_points_are_kept(make_study, keep, monkeypatch):
    """The points of the first trials of each cell are stored, as many as the config says, across blocks."""
    monkeypatch.setattr("study.simulation.experiment.designs.BLOCK_TRIALS", 2)
    made = make_study({"keep_points": keep}, trials=5, noise=[0.1, 0.2])
    result = compute(made, next(made.units()))
    kept = min(keep, 5)
    if not keep:
        assert result.points == {}
        return
    seen = set(zip(result.points["cell"], result.points["trial"], result.points["sample"], strict=True))
    names = set(result.errors["cell"])
    assert seen == {(name, t, k) for name in names for t in range(kept) for k in range(10)}
    assert len(result.points["cell"]) == len(seen)


def test_timings_account_for_every_fit(make_study):
    """Every step of every estimator is timed, for as many data sets as there are."""
    made = make_study({"estimators": ["ugdk", "lls"]}, trials=7, samples=[10, 20], noise=[0.1, 0.2])
    for unit in made.units():
        result: Result = compute(made, unit)
        fits = dict(zip(result.timings["step"], result.timings["fits"], strict=True))
        assert fits == {"draw": 7, "bound": 7, "points": 14, "moments": 14, "ugdk": 14, "lls": 14}
        assert np.all(result.timings["seconds"] >= 0.0)


@pytest.mark.parametrize(("d", "samples"), [(2, 10), (3, 7), (3, 9000), (5, 30)])
def test_levels_do_not_depend_on_what_is_fitted_beside_them(make_study, rows, d, samples):
    """Levels fitted side by side, from points formed in a cache, have the bytes of levels fitted one at a time.

    Levels are fitted one at a time if an estimator needs points in memory, or if points are stored.
    """
    names, design = ["mle", "lls", "gdke", "ugdk"], {"samples": samples, "noise": [1e-6, 0.02, 0.3, 5.0], "trials": 3}
    together = rows(make_study({"estimators": names, "dimension": d}, **design))
    others = [
        rows(make_study({"estimators": [*names, "igdk"], "dimension": d}, **design)),
        rows(make_study({"estimators": names, "dimension": d, "keep_points": 1}, **design)),
        rows(make_study({"estimators": names, "dimension": d}, **design | {"noise": [0.02]})),
    ]
    keys = lambda found: zip(found["cell"], found["estimator"], found["trial"], strict=True)  # noqa: E731
    order = {key: i for i, key in enumerate(keys(together))}
    for other in others:
        place = np.array([order.get(key, -1) for key in keys(other)])
        shared = place >= 0
        assert shared.sum() >= 12
        for name, values in together.items():
            np.testing.assert_array_equal(other[name][shared], values[place[shared]])


def one_by_one(made):
    """Rows of a study of plain cells, from draws and fits of one trial at a time, with the points."""
    for trial in all_trials(made):
        cell, samples = trial.cell, trial.level
        bound = cell.noise * np.sqrt(np.diag(trial.unit_bound)[:-1].sum())
        for name in made.estimators:
            fit = study.ESTIMATORS[name](samples)
            numbers = *(fit.center[0] - cell.level.center) * cell.scale, fit.noise_variance[0] * cell.scale**2
            yield cell.name, trial.trial, name, *numbers, bound, fit.status[0], samples.x[0]


@pytest.mark.parametrize(
    "design",
    [
        {"kind": "random", "samples": 40},
        {"kind": "random", "samples": {"law": "choice", "values": [10, 300]}, "noise": uniform(0, 1)},
        {"kind": "random", "samples": 40, "law": "laplace"},
        {"kind": "grid", "samples": [40, 5000], "angle": [20, 180]},
    ],
    ids=["equal sizes", "sizes", "a law", "grid"],
)
def test_trials_that_are_computed_together_are_those_computed_alone(make_study, rows, design):
    """Trials of their own size, σ, angle, radius and centre have the bytes of a draw and a fit of each alone."""
    own = {"radius": uniform(1, 9), "center": uniform(0, 2), "angle": uniform(1, 180)}
    design = (own if design["kind"] == "random" else {}) | {"trials": 60} | design
    made = make_study({"estimators": ["mle", "lls", "gdke", "ugdk"], "keep_points": 60}, **design)
    expected = list(one_by_one(made))
    order = {row[:3]: place for place, row in enumerate(expected)}
    results = [compute(made, unit) for unit in made.units()]
    assert sum(len(result.errors["trial"]) for result in results) == len(expected)
    for result in results:
        found, points = result.errors, pd.DataFrame(result.points)
        names = ["error_1", "error_2", "error_3", "noise_variance", "bound", "status"]
        keys = zip(found["cell"], found["trial"], found["estimator"], strict=True)
        for key, *numbers in zip(keys, *(found[name] for name in names), strict=True):
            np.testing.assert_array_equal(numbers, expected[order[key]][3:-1])
        for (cell, trial), part in points.groupby(["cell", "trial"]):
            x = expected[order[cell, trial, "mle"]][-1]
            np.testing.assert_array_equal(part[["x_1", "x_2", "x_3"]].to_numpy().T, x)


@pytest.mark.parametrize("route", ["points", "moments"])
def test_no_estimators_leave_no_rows(make_study, route):
    """A unit without estimators gives timings and points alone, as for a run that has lost those tables."""
    made = make_study({"estimators": ["gdke"], "route": route}, noise=[0.1, 0.2])
    alone = made.model_copy(update={"estimators": ()})
    result = compute(alone, next(made.units()))
    assert result.errors == {}
    assert {"draw", "bound", "moments"} <= set(result.timings["step"])


@pytest.fixture
def sometimes(monkeypatch):
    """An estimator that is lls, but raises on batches with points of a first coordinate above 1.2."""

    def estimator(samples):
        if samples.x[:, 0].max() > 1.2:
            raise ZeroDivisionError("my own mistake")
        return study.ESTIMATORS["lls"](samples)

    monkeypatch.setitem(study.ESTIMATORS, "sometimes", Estimator(estimator, "a test"))


@pytest.mark.usefixtures("sometimes")
def test_an_exception_is_a_status_of_its_trial(make_study):
    """The trials on which an estimator raises are named; other trials and other estimators are not affected."""
    made = make_study({"estimators": ["lls", "sometimes"], "keep_points": 40}, trials=40, noise=[0.1, 0.2])
    result = compute(made, next(made.units()))
    found, failures, points = result.errors, result.failures, result.points
    mine, lls = found["estimator"] == "sometimes", found["estimator"] == "lls"
    failed = found["status"][mine] == study.Status.FAILED
    pairs = list(zip(found["cell"][mine], found["trial"][mine], strict=True))
    large = {(c, t) for c, t, x in zip(points["cell"], points["trial"], points["x_1"], strict=True) if x > 1.2}
    assert 5 < len(large) < 75
    assert {pair for pair, bad in zip(pairs, failed, strict=True) if bad} == large
    for name in ("error", "radius_error", "status"):
        np.testing.assert_array_equal(found[name][mine][~failed], found[name][lls][~failed])
        assert name == "status" or np.isnan(found[name][mine][failed]).all()
    np.testing.assert_array_equal(found["bound"][mine], found["bound"][lls])
    assert not np.any(found["status"][lls] == study.Status.FAILED)
    assert set(zip(failures["cell"], failures["trial"], strict=True)) == large
    assert set(failures["estimator"]) == {"sometimes"}
    assert set(failures["message"]) == {"ZeroDivisionError: my own mistake"}
    assert set(failures["cause"]) == {"exception"}
    assert list(failures["name"]) == [f"{c}/{t}" for c, t in zip(failures["cell"], failures["trial"], strict=True)]


@pytest.mark.usefixtures("sometimes")
def test_failures_do_not_depend_on_batches(make_study):
    """The same trials fail, with the same numbers beside them, whatever is computed together."""
    made = make_study({"estimators": ["sometimes"]}, trials=12, noise=0.2)
    unit = next(made.units())
    whole = compute(made, unit).errors
    for first, last in ((0, 5), (5, 6), (6, 12)):
        for name, column in compute(made, Batch(unit.group, first, last)).errors.items():
            np.testing.assert_array_equal(column, whole[name][first:last])


@pytest.mark.usefixtures("sometimes")
def test_failures_of_trials_with_cells_of_their_own(make_study):
    """Where every trial has a cell of its own, the fits that failed are named by it."""
    made = make_study({"estimators": ["sometimes"]}, kind="random", trials=25, noise=uniform(0, 1))
    result = compute(made, next(made.units()))
    failed = result.errors["status"] == study.Status.FAILED
    assert 2 < failed.sum() < 23
    for name in ("cell", "trial"):
        np.testing.assert_array_equal(result.failures[name], result.errors[name][failed])


@pytest.mark.parametrize("wrong", ["center", "radius", "status"])
def test_answers_of_another_shape_are_failures(make_study, monkeypatch, wrong):
    """An estimator that gives fewer answers than it was given sets fails on all of them, not silently."""

    def short(samples):
        fit = study.ESTIMATORS["lls"](samples)
        return fit._replace(**{wrong: getattr(fit, wrong)[:0]})

    monkeypatch.setitem(study.ESTIMATORS, "short", Estimator(short, "a test"))
    made = make_study({"estimators": ["short"]}, trials=3)
    result = compute(made, next(made.units()))
    assert set(result.errors["status"]) == {study.Status.FAILED}
    assert all(f"ValueError: {wrong} has shape (0," in message for message in result.failures["message"])


def test_a_long_message_is_cut(make_study, monkeypatch):
    """A message has at most 500 characters."""

    def talkative(samples):
        raise RuntimeError("x" * 10_000)

    monkeypatch.setitem(study.ESTIMATORS, "talkative", Estimator(talkative, "a test"))
    made = make_study({"estimators": ["talkative"]}, trials=1)
    assert [len(m) for m in compute(made, next(made.units())).failures["message"]] == [500]


LEVELS = {"noise": [0.5, 2.0, 8.0], "radius": [1, 3], "center": [0, 4]}


def first_batch(study):
    """The first batch of a study."""
    return next(next(study.units()).parts(0))


@pytest.mark.parametrize("d", [2, 3, 5])
def test_points_are_centre_plus_direction_plus_noise(make_study, d):
    """Placed points are c + r u + σ z of the draws, in exact arithmetic, to three roundings, for every level."""
    study = make_study({"dimension": d}, **LEVELS)
    batch = first_batch(study)
    draws = draw(study, batch)
    assert len(batch.cells) == 12
    for cell in batch.cells:
        level, points = cell.level, draws.place(cell.level).x
        r, s = Fraction(level.radius), Fraction(level.noise)
        for (t, i, k), point in np.ndenumerate(points):
            u, z, c = map(Fraction, (draws.directions[t, i, k], draws.unit_noise[t, i, k], level.center[i]))
            terms = (c, r * ((1 - u) if i == 0 else u), s * z)
            assert abs(Fraction(point) - sum(terms)) <= 3 * 2.0**-53 * float(sum(map(abs, terms)))


SHAPES = {
    "isotropic": None,
    "correlated": [[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]],
    "flat": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1e-6]],
}


@pytest.mark.parametrize("shape", list(SHAPES))
def test_noise_has_its_covariance(make_study, shape):
    """Sample mean and covariance of 10⁵ noise vectors are 0 and the shape.

    Nine normal statistics within 5 standard errors: a false alarm has probability 6e-6.
    """
    study = make_study({"noise_shape": SHAPES[shape]}, samples=100_000, trials=1)
    draws = draw(study, first_batch(study))
    expected = np.eye(3) if SHAPES[shape] is None else np.array(SHAPES[shape])
    np.testing.assert_array_equal(draws.law.covariance(1.0), expected)
    z = draws.unit_noise[0]
    variance = np.diag(expected)
    assert np.all(np.abs(z.mean(axis=1)) < 5 * np.sqrt(variance / z.shape[1]))
    error = np.sqrt((np.outer(variance, variance) + expected**2) / z.shape[1])
    assert np.all(np.abs(z @ z.T / z.shape[1] - expected) < 5 * error)


def test_times_are_without_the_compiler(monkeypatch, tmp_path):
    """An estimator waits for a compiler at its first call in a process, and takes a second a call from then on.

    The time of each unit is that of its calls; the clock is the test's.
    """
    now, calls = [0.0], []

    def waits(samples):
        now[0] += 1.0 if calls else 1000.0
        calls.append(samples.shape[0])
        return study.ESTIMATORS["lls"](samples)

    monkeypatch.setitem(study.ESTIMATORS, "waits", Estimator(waits, "a test"))
    monkeypatch.setattr(module, "perf_counter", lambda: now[0])
    text = config({"estimators": ["lls", "waits"]}, trials=20, samples=[6, 40], noise=[0.05, 0.5], draws="independent")
    timings = runner.run(parse(text), text, tmp_path / "run", 1).table("timings").astype({"step": str})
    assert timings.groupby("step")["seconds"].sum().loc[["lls", "waits"]].tolist() == [0.0, len(calls) - 1.0]
    assert calls[0] == 1
    assert sum(calls[1:]) == 20 * 4

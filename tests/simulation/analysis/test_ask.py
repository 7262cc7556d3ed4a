"""Answers without a run: the formulas beside others of them, the range, and the table beside what a study gives."""

import json
import math
from dataclasses import replace

import ask as maker
import numpy as np
import pytest
import scipy

import study
from study.simulation.analysis.ask import LEVEL, TABLE, Emulator, Process, correlation, efficient, features
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch
from study.simulation.statistics import measured

CONDITIONS = np.exp(np.random.default_rng(1).uniform(np.log([8, 0.003, 8]), np.log([2000, 0.8, 180]), (40, 3)))
"""Conditions anywhere in the table's range."""


@pytest.fixture(scope="module")
def emulator():
    return Emulator.load()


@pytest.fixture
def small():
    """A process of forty made-up values."""
    places, rng = features(CONDITIONS), np.random.default_rng(2)
    values, noise = np.sin(places[:, 0]) + places[:, 3], rng.uniform(1e-4, 1e-3, 40)
    return Process(np.linspace(2.0, 6.0, 9), 1.7, 1e-4, places, values, noise, 1.3)


def simulated(seed, trials, samples, noise, angle, estimators):
    """Medians of a study of one cell, and their errors: a pair for each estimator."""
    design = {"kind": "grid", "trials": trials, "samples": samples, "noise_over_radius": noise, "angle": angle}
    study = Study.model_validate({"name": "one", "seed": seed, "estimators": estimators, "design": design})
    errors = compute(study, Batch(next(study.groups()), 0, trials)).errors
    chosen = [errors["estimator"] == name for name in estimators]
    used = ("error", "error_1", "bound", "status")
    return [measured("ratio_median", {name: errors[name][mine] for name in used}) for mine in chosen]


def test_correlation_is_matern():
    """The closed form for ν = 5/2 equals the general one with the modified Bessel function."""
    one = np.random.default_rng(3).standard_normal((5, 4))
    other = one + np.geomspace(1e-3, 1e1, 5)[:, None]
    distance = math.sqrt(5.0) * np.linalg.norm(one[:, None] - other, axis=2)
    general = 2.0**-1.5 / math.gamma(2.5) * distance**2.5 * scipy.special.kv(2.5, distance)
    np.testing.assert_allclose(correlation(one, other), general, rtol=1e-10)


def test_prediction_is_the_conditional_law(small):
    """Mean and variance are those of a joint normal law, given its other coordinates."""
    new = features(CONDITIONS[:6] * [1.1, 0.9, 0.95])
    everywhere = np.concatenate([new, small.places]) / small.lengths
    joint = small.variance * correlation(everywhere, everywhere)
    joint[6:, 6:] += np.diag(small.noise + small.roughness)
    joint[range(6), range(6)] += small.roughness
    precision = np.linalg.inv(joint)  # its block of the new coordinates is the inverse of their covariance
    covariance = np.linalg.inv(precision[:6, :6])
    mean = small.values.mean()
    expected = mean - covariance @ precision[:6, 6:] @ (small.values - mean)
    value, half = small.predict(new)
    np.testing.assert_allclose(value, expected, rtol=1e-6)
    np.testing.assert_allclose(half, 1.3 * np.sqrt(np.diag(covariance)), rtol=1e-6)


def test_cells_left_out(small):
    """The formula for a cell that is left out gives what the process without it predicts."""
    deviation, variance = maker.left_out(small)
    for cell in (0, 17, 39):
        others = np.arange(40) != cell
        arrays = {name: getattr(small, name)[others] for name in ("places", "values", "noise")}
        rest = replace(small, **arrays)
        near = correlation(small.places[cell : cell + 1] / small.lengths, rest.places / small.lengths)
        root = np.linalg.solve(rest.root, small.variance * near[0])
        mean = small.values.mean()  # of all values, as the whole process has it
        known = small.variance * near[0] @ np.linalg.solve(rest.root @ rest.root.T, rest.values - mean)
        assert deviation[cell] == pytest.approx(small.values[cell] - mean - known, rel=1e-6, abs=1e-9)
        expected = small.variance + small.roughness - root @ root + small.noise[cell]
        assert variance[cell] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--samples", "7", "samples 7: the table reaches from 8 to 2000"),
        ("--samples", "2001", "samples 2001: the table reaches from 8 to 2000"),
        ("--noise-over-radius", "0.0029", "noise_over_radius 0.0029: the table reaches from 0.003 to 0.8"),
        ("--noise-over-radius", "NaN", "noise_over_radius nan: the table reaches from 0.003 to 0.8"),
        ("--angle", "7.9", "angle 7.9: the table reaches from 8 to 180"),
        ("--angle", "181", "angle 181: the table reaches from 8 to 180"),
        ("--dimension", "2", "dimension 2: the table is of spheres in 3"),
    ],
)
def test_beyond_the_table(emulator, option, value, words):
    """Conditions that the table does not reach are refused, with what it reaches."""
    asked = {"--samples": 50, "--noise-over-radius": 0.1, "--angle": 40, "--dimension": 3} | {option: json.loads(value)}
    with pytest.raises(ValueError, match=words):
        emulator.ask(tuple(asked.values())[:3], asked["--dimension"])


def test_the_ends_of_the_range(emulator):
    """At its corners the table answers, with intervals that are no points and not endless."""
    for samples, noise, angle in np.stack(np.meshgrid([8, 2000], [0.003, 0.8], [8.0, 180.0]), -1).reshape(-1, 3):
        for answer in emulator.ask((samples, noise, angle)):
            assert 0.0 < answer.low < answer.ratio_median < answer.high < 2.0 * answer.low


def test_nearest_cells_are_enough(emulator):
    """In places drawn at random they predict what all cells do, far within the interval."""
    process = emulator.processes["mle"]
    drawn = np.exp(np.random.default_rng(4).uniform(np.log([8, 0.003, 8]), np.log([2000, 0.8, 180]), (20, 3)))
    whole, half = process.predict(features(drawn))
    for place, value, size in zip(features(drawn), whole, half, strict=True):
        (near,), (reach,) = process.near(place).predict(place[None])
        assert abs(near - value) < 0.1 * size
        assert size <= reach < 1.05 * size


def test_in_python():
    """`study.ask` predicts what the command does."""
    assert study.ask(50, 0.1, 40)[0] == Emulator.load().ask((50, 0.1, 40))[0]
    with pytest.raises(ValueError, match=r"^samples = 10{39}…: must be below 1\.8e308$"):
        study.ask(10**400, 0.1, 40)
    with pytest.raises(TypeError, match=r"^angle = 'wide': give one number$"):
        study.ask(50, 0.1, "wide")


def test_little_noise_on_half_a_sphere(emulator):
    """There the errors of consistent estimators are normal at the bound: theory's median, within their intervals."""
    answers = {answer.estimator: answer for answer in emulator.ask((1500, 0.003, 90.0))}
    for name in ("corrected", "als", "mle", "hyper"):
        assert answers[name].ratio_median == pytest.approx(efficient(90.0), rel=0.02)


def test_table_is_of_studies(emulator):
    """A cell of the table has the numbers of a study with its seed; they are stored in single precision."""
    origin, names = emulator.origin, list(emulator.processes)
    table = np.exp([process.values for process in emulator.processes.values()])
    places = next(iter(emulator.processes.values())).places
    cell = int(np.argmin(places[:, 0]))
    samples, noise, angle = (float(value) for value in emulator.conditions[cell])
    found = simulated(origin["seed"], origin["trials"], int(samples), noise, angle, names)
    np.testing.assert_allclose(table[:, cell], [measure.value for measure in found], rtol=1e-6)


def test_origin(emulator):
    """The table says where it is from, and is small."""
    assert set(emulator.origin) == {"version", "seed", "trials", "cells", "even"}
    assert {len(process.values) for process in emulator.processes.values()} == {emulator.origin["cells"]}
    assert TABLE.stat().st_size < 300_000


def test_factors_hold_the_even_cells(emulator):
    """With its factor each process has the stated share of the even cells within their intervals, left out."""
    even = emulator.origin["even"]
    for process in emulator.processes.values():
        inside = np.mean(maker.scores(process)[:even] <= process.factor * (1.0 + 1e-4))
        assert LEVEL <= inside < LEVEL + 0.01


def test_fresh_cells(emulator):
    """Studies of other seeds give what is predicted of them.

    Each deviation is judged by three times its interval and the study's own error. In none of the 200 cells of
    `benchmarks/ask.py check` does an estimator lie farther, so a cell fails with a probability below 1.5 % (at 95 %
    confidence), and one of the four here with one below 6 %. The seeds are fixed.
    """
    names = list(emulator.processes)
    rng = np.random.default_rng(9)
    for u in rng.random((4, 3)):
        n, noise, angle = np.exp(np.log([8, 0.003, 8]) + u * np.log([50, 0.8 / 0.003, 180 / 8]))
        answers = {answer.estimator: answer for answer in emulator.ask((round(n), noise, angle))}
        for name, measure in zip(names, simulated(8, 10_000, round(n), noise, angle, names), strict=True):
            answer = answers[name]
            half = 0.5 * math.log(answer.high / answer.low)
            deviation = abs(math.log(answer.ratio_median / measure.value))
            assert deviation <= 3.0 * math.hypot(half, 2.0 * measure.error / measure.value), (name, n, noise, angle)

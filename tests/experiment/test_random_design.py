"""Conditions that trials of a random design draw: they follow the laws, and nothing else moves them."""

import math
from collections import Counter

import numpy as np
import pytest
from scipy import stats

from study.experiment.units import groups, units

TRIALS = 3000
ALARM = 1e-5
LAWS = {
    "samples": {"law": "log_uniform", "low": 4, "high": 1_000_000},
    "noise": {"law": "log_uniform", "low": 1e-13, "high": 1e14},
    "angle": {"law": "uniform", "low": 0, "high": 180},
    "radius": {"law": "uniform", "low": 0, "high": 37},
    "center": {"law": "uniform", "low": 0, "high": 2},
}


@pytest.fixture(scope="module")
def cells(make_study):
    """Cells of a random design with the paper's laws; keyword arguments replace some."""

    def make(top=None, **changes):
        study = make_study(top, **{"kind": "random", "trials": TRIALS, **LAWS, **changes})
        return [cell for unit in units(study) for batch in unit.batches for cell in batch.cells]

    return make


@pytest.fixture(scope="module")
def drawn(cells):
    """Cells of the paper's laws."""
    return cells()


@pytest.mark.parametrize(
    ("quantity", "law"),
    [
        ("noise", stats.loguniform(1e-13, 1e14)),
        ("angle", stats.uniform(0, 180)),
        ("radius", stats.uniform(0, 37)),
        ("distance", stats.uniform(0, 2)),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_values_follow_their_law(drawn, quantity, law):
    """Kolmogorov and Smirnov find no difference; a false alarm has probability 1e-5."""
    values = [getattr(cell, quantity) for cell in drawn]
    assert stats.kstest(values, law.cdf).pvalue > ALARM
    assert min(values) > law.ppf(0) * (1 - 1e-11)
    assert max(values) <= law.ppf(1)


def test_samples_follow_their_law(drawn):
    """N is the rounded log-uniform number; Kolmogorov's bound is conservative for a discrete law (1e-5)."""
    values = np.array([cell.samples for cell in drawn])
    steps = np.unique(values)
    empirical = np.searchsorted(np.sort(values), steps, side="right") / TRIALS
    distance = np.abs(empirical - stats.loguniform(4, 1e6).cdf(steps + 0.5)).max()
    assert distance < stats.kstwobign.isf(ALARM) / math.sqrt(TRIALS)


def test_samples_are_whole_numbers_within_the_ends(cells):
    """N drawn uniformly from 4 to 6 is 4, 5 or 6, with weights ¼, ½, ¼ (χ², false alarm 1e-5)."""
    values = [cell.samples for cell in cells(samples={"law": "uniform", "low": 4, "high": 6})]
    assert all(type(value) is int for value in values)
    counts = Counter(values)
    assert set(counts) == {4, 5, 6}
    expected = np.array([0.25, 0.5, 0.25]) * TRIALS
    assert stats.chisquare([counts[4], counts[5], counts[6]], expected).pvalue > ALARM


def test_choice_is_even(cells):
    """A choice of three values takes each in a third of the trials (χ², false alarm 1e-5)."""
    counts = Counter(cell.angle for cell in cells(angle={"law": "choice", "values": [30, 90, 180]}))
    assert set(counts) == {30.0, 90.0, 180.0}
    assert stats.chisquare(list(counts.values())).pvalue > ALARM


@pytest.mark.parametrize("d", [2, 3])
def test_centres_lie_in_every_direction(cells, d):
    """Centres point uniformly: each component is uniform in 3-D (Archimedes), the angle in 2-D (1e-5 each)."""
    centers = np.array([cell.center for cell in cells({"dimension": d})])
    unit = centers / np.linalg.norm(centers, axis=1, keepdims=True)
    angle = np.arctan2(unit[:, 1], unit[:, 0]) / (2 * np.pi) + 0.5
    rows = [angle] if d == 2 else [0.5 * (column + 1) for column in unit.T]
    assert all(stats.kstest(row, "uniform").pvalue > ALARM for row in rows)


def test_quantities_are_independent(drawn):
    """Ranks of any two quantities are uncorrelated (5 standard errors for each of 10 pairs: 6e-6)."""
    table = [[c.samples, c.noise, c.angle, c.radius, c.distance] for c in drawn]
    correlation = stats.spearmanr(np.array(table)).statistic
    off = correlation[np.triu_indices(5, 1)]
    assert np.abs(off).max() < 5 / math.sqrt(TRIALS)


@pytest.mark.parametrize("changed", list(LAWS))
def test_a_law_moves_its_own_quantity_alone(cells, drawn, changed):
    """Another law for one quantity leaves every other quantity of every trial as it was."""
    again = cells(**{changed: {"law": "uniform", "low": 5, "high": 9}})
    for quantity in LAWS:
        same = [getattr(c, quantity) for c in again] == [getattr(c, quantity) for c in drawn]
        assert same == (quantity != changed)


@pytest.mark.parametrize("trials", [1, 1024, 1025, 4000])
def test_the_number_of_trials_moves_nothing(cells, drawn, trials):
    """Fewer or more trials are the beginning or the continuation of the same."""
    again = cells(trials=trials)
    shared = min(trials, TRIALS)
    assert again[:shared] == drawn[:shared]


def test_one_trial_alone(make_study, drawn):
    """A trial's condition is found from its number, without those before it."""
    study = make_study(kind="random", trials=TRIALS, **LAWS)
    (group,) = groups(study)
    assert [group.cell(i) for i in (2999, 7, 1024)] == [drawn[i] for i in (2999, 7, 1024)]


def test_relative_noise_is_times_the_radius(cells):
    """noise_over_radius is drawn for itself and multiplied by the trial's radius."""
    law = {"law": "log_uniform", "low": 1e-3, "high": 10.0}
    found = cells(noise=None, noise_over_radius=law)
    ratio = np.array([cell.noise / cell.radius for cell in found])
    assert stats.kstest(ratio, stats.loguniform(1e-3, 10.0).cdf).pvalue > ALARM


def test_constants_are_taken_to_the_last_bit(cells):
    """A number is used as it is written, as in a grid."""
    value = 0.12345678901234567
    found = cells(trials=3, samples=10, noise=value, radius=value, angle=value)
    assert {(c.noise, c.radius, c.angle) for c in found} == {(value, value, value)}


def test_equal_conditions_have_equal_names(cells, make_study):
    """A centre at the origin is one condition, however its heading fell, and the same as in a grid."""
    plain = {"samples": 10, "noise": 0.1, "angle": 90.0, "radius": 1.0, "center": 0.0}
    grid = make_study(**plain)
    names = {cell.name for unit in units(grid) for batch in unit.batches for cell in batch.cells}
    assert {cell.name for cell in cells(trials=20, **plain)} == names

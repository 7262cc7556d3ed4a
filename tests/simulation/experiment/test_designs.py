"""From a study to cells, batches and units: every trial of every cell once, in an order that the config alone fixes.

Conditions that trials of a random design draw: they follow the laws, and nothing else moves them.
"""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from study.fits.points.cap import sample_cap
from study.simulation.experiment import designs
from study.simulation.experiment.designs import Cell, block_trials
from tests.configs import log_uniform, uniform

AXES = {"samples": [4, 50], "noise": [0.1, 0.2, 0.3], "angle": [20, 90], "radius": [1, 2], "center": [0, 1, 5]}

STUDIES = {
    "shared": {"trials": 1500, **AXES},
    "independent": {"trials": 1500, **AXES, "draws": "independent"},
    "one trial": {"trials": 1, **AXES},
    "one trial more than a block": {"trials": 1001, "noise": [0.1, 0.2]},
    "relative": {"trials": 7, **AXES, "noise": None, "noise_over_radius": [0.1, 0.2]},
    "by kappa": {"trials": 7, **AXES, "noise": None, "kappa": [0.3, 3, 30], "most_noise": 1.0},
    "random": {"kind": "random", "trials": 77, "samples": log_uniform(4, 1e4), "radius": uniform(0, 37)},
}


@pytest.fixture(params=list(STUDIES))
def some_study(request, make_study):
    """A study of each kind of design."""
    return make_study(**STUDIES[request.param])


def served(work):
    """Cells and trials of units, in order."""
    for unit in work:
        for batch in unit.parts(0):
            for cell in batch.cells:
                assert (cell.samples, cell.angle) == (batch.cells[0].samples, batch.cells[0].angle)
                for trial in range(batch.first, batch.last):
                    yield cell.name, trial


def test_every_trial_of_every_cell_once(some_study, monkeypatch):
    """Units cover each cell and trial exactly once, as many as were counted, in the same order each time.

    No two batches draw from the same stream.
    """
    monkeypatch.setattr(designs, "_SAMPLES_PER_UNIT", 60_000)
    assert list(some_study.units()) == list(some_study.units())
    names = Counter(name for unit in some_study.units() for batch in unit.parts(0) for name, _, _ in batch.blocks())
    assert set(names.values()) == {1}
    found = Counter(served(some_study.units()))
    assert set(found.values()) == {1}
    trials = range(some_study.design.trials)
    if some_study.design.kind == "random":
        assert sorted(trial for _, trial in found) == list(trials)
        assert some_study.cells() == len(trials)
    else:
        names = {name for name, _ in found}
        assert len(names) == some_study.cells()
        assert set(found) == {(name, trial) for name in names for trial in trials}


def test_order_of_a_grid(make_study):
    """Cells come by samples, then angle, then noise, radius and centre, each in the order of the config."""
    work = make_study(samples=[50, 4], noise=[0.2, 0.1], angle=[90, 20], radius=[2, 1], center=[1, 0]).units()
    cells = [cell for unit in work for batch in unit.parts(0) for cell in batch.cells]
    assert {cell.center for cell in cells} == {(0.0,) * 3, (1.0 / math.sqrt(3.0),) * 3}  # on the main diagonal
    keys = [(-c.samples, -c.angle, -c.noise, -c.radius, -c.distance) for c in cells]
    assert keys == sorted(keys)
    assert len(set(keys)) == 32


CELL = Cell(10, 0.1, 90.0, 1.0, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "change",
    [
        {"samples": 11},
        {"noise": math.nextafter(0.1, 1)},
        {"angle": 90.00000000000001},
        {"radius": 2.0},
        {"center": (0.0, 0.0, 1.0)},
        {"center": (0.0, 0.0)},
        {"noise": 90.0, "angle": 0.1},
    ],
    ids=str,
)
def test_a_name_stands_for_the_whole_condition(change):
    """Equal conditions have equal names; a change in any value, to the last bit, gives another."""
    assert replace(CELL).name == CELL.name
    assert replace(CELL, **change).name != CELL.name


def test_names_do_not_depend_on_the_grid(make_study):
    """A condition has the same name whatever else its grid holds, and whatever the kind of design."""

    def names(**entries):
        return {c.name for unit in make_study(**entries).units() for b in unit.parts(0) for c in b.cells}

    alone = names(samples=4, noise=0.1, angle=20, radius=2, center=5)
    assert len(alone) == 1
    assert alone <= names(**AXES) == names(**AXES, draws="independent")


@pytest.mark.parametrize("samples", [4, 33, 1000, 32_768, 10**6, 10**9])
def test_block_size_depends_on_samples_alone(make_study, samples):
    """Blocks of a number of samples are cut at the same trials in every grid."""
    size = block_trials(samples)
    assert 1 <= size <= 1000
    assert size == 1 or size * samples <= 2**15
    for entries in ({"trials": 3000}, {"trials": 2999, "noise": [1, 2], "angle": [5, 7]}, {"draws": "independent"}):
        trials = entries.get("trials", 2)
        for unit in make_study(samples=[samples], **entries).units():
            for batch in unit.parts(0):
                assert batch.first % size == 0
                assert batch.trials == min(size, trials - batch.first)
                assert batch.blocks()[0][0][-1] == batch.first // size


TRIALS = 3000
ALARM = 1e-5
LAWS = {"samples": log_uniform(4, 1_000_000), "noise": log_uniform(1e-13, 1e14), "angle": uniform(0, 180)}
LAWS |= {"radius": uniform(0, 37), "center": uniform(0, 2)}


@pytest.fixture(scope="module")
def cells(make_study):
    """Cells of a random design with the paper's laws; keyword arguments replace some."""

    def make(top=None, **changes):
        study = make_study(top, **{"kind": "random", "trials": TRIALS, **LAWS, **changes})
        return [cell for unit in study.units() for batch in unit.parts(0) for cell in batch.cells]

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


@pytest.mark.parametrize(
    ("name", "law", "weights"),
    [
        ("samples", uniform(4, 6), {4: 0.25, 5: 0.5, 6: 0.25}),
        ("angle", {"law": "choice", "values": [30, 90, 180]}, dict.fromkeys((30.0, 90.0, 180.0), 1 / 3)),
    ],
)
def test_values_that_are_counted(cells, name, law, weights):
    """N drawn uniformly from 4 to 6 is 4, 5 or 6, with weights ¼, ½, ¼; a choice of three is even (χ², alarm 1e-5)."""
    values = [getattr(cell, name) for cell in cells(**{name: law})]
    assert {type(value) for value in values} == {type(next(iter(weights)))}
    counts = Counter(values)
    assert set(counts) == set(weights)
    assert stats.chisquare([counts[v] for v in weights], np.array(list(weights.values())) * TRIALS).pvalue > ALARM


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
    again = cells(**{changed: uniform(5, 9)})
    for quantity in LAWS:
        same = [getattr(c, quantity) for c in again] == [getattr(c, quantity) for c in drawn]
        assert same == (quantity != changed)


@pytest.mark.parametrize("trials", [1, 1024, 1025, 4000])
def test_the_number_of_trials_moves_nothing(cells, drawn, trials):
    """Fewer or more trials are the beginning or the continuation of the same."""
    again = cells(trials=trials)
    shared = min(trials, TRIALS)
    assert again[:shared] == drawn[:shared]


def test_relative_noise_is_times_the_radius_random_design(cells):
    """noise_over_radius is drawn for itself and multiplied by the trial's radius."""
    found = cells(noise=None, noise_over_radius=log_uniform(1e-3, 10.0))
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
    names = {cell.name for unit in grid.units() for batch in unit.parts(0) for cell in batch.cells}
    assert {cell.name for cell in cells(trials=20, **plain)} == names


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("angle", [5.0, 70.0, 150.0, 180.0])
def test_noise_by_kappa(make_study, angle, dimension):
    """The noise is σ² = (v/κ)√(N/2) in radii, v the least eigenvalue of the covariance of directions.

    That is of 10⁵ directions, to 4.5 of its standard errors (6e-3 each); false alarms 7e-6.
    """
    directions = sample_cap(np.random.default_rng(2), 100_000, math.radians(angle), dimension)
    least = np.linalg.eigvalsh(np.cov(directions.T))[0]
    top = {"dimension": dimension}
    study = make_study(top, samples=[50], noise=None, kappa=[2, 50], angle=angle, radius=[1, 3])
    for cell in next(study.groups()).cells:
        kappa = least / (cell.noise / cell.radius) ** 2 * math.sqrt(50 / 2)
        assert kappa == pytest.approx(cell.values["kappa"], rel=4.5 * 0.006)


def test_most_noise_leaves_cells_out(make_study):
    """Cells of larger noise are in no group, and the others have the names and streams that they have without it."""
    entries = {"samples": [10, 1000], "noise": None, "kappa": [1, 100], "angle": [5, 180], "trials": 3}
    every, some = make_study(**entries), make_study(**entries, most_noise=0.9)
    cells = {cell.name: cell.noise for group in every.groups() for cell in group.cells}
    kept = {cell.name for group in some.groups() for cell in group.cells}
    assert kept == {name for name, noise in cells.items() if noise <= 0.9}
    assert (every.cells(), some.cells()) == (8, len(kept))
    assert 4 <= some.cells() < 8
    streams = {cell.name: group.stream for group in every.groups() for cell in group.cells}
    assert all(streams[cell.name] == group.stream for group in some.groups() for cell in group.cells)

"""Points of a cell: x = c + r u + σ z, the same u and z for every σ, r and c of a group."""

from itertools import combinations

import numpy as np
import pytest

from study.experiment.compute_unit import compute
from study.experiment.sampling import draw
from study.experiment.units import units

EPS = np.finfo(float).eps
LEVELS = {"noise": [0.5, 2.0, 8.0], "radius": [1, 3], "center": [0, 4]}


def first_batch(study):
    """The first batch of a study."""
    return next(units(study)).batches[0]


def unit_vectors(draws):
    """Directions (b, d, n), with the height put back to u₁."""
    u = draws.directions.copy()
    u[:, 0] = 1.0 - u[:, 0]
    return u


@pytest.mark.parametrize("d", [2, 3, 5])
def test_points_are_centre_plus_direction_plus_noise(make_study, d):
    """Placed points are c + r u + σ z of the draws, to rounding, for every level of a group."""
    study = make_study({"dimension": d}, **LEVELS)
    batch = first_batch(study)
    draws = draw(study, [batch])
    u = unit_vectors(draws)
    assert len(batch.cells) == 12
    for cell in batch.cells:
        center = np.array(cell.center)[:, None]
        size = np.abs(center) + cell.radius + cell.noise * np.abs(draws.unit_noise)
        error = draws.place(cell.level).x - (center + cell.radius * u + cell.noise * draws.unit_noise)
        assert np.all(np.abs(error) <= 4 * EPS * size)


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("angle", [1e-4, 20, 90, 180])
def test_directions_are_unit_vectors_within_the_cap(make_study, d, angle):
    """Directions have length 1, within the confinement angle of the first axis, and reach there (false alarm 1e-6)."""
    study = make_study({"dimension": d}, samples=1000, angle=angle)
    directions = draw(study, [first_batch(study)]).directions
    height, across = directions[:, 0], np.sum(directions[:, 1:] ** 2, axis=1)
    np.testing.assert_allclose(across, height * (2 - height), rtol=1e-12, atol=1e-15)
    limit = 2 * np.sin(np.radians(angle) / 2) ** 2
    near = 0.9 if (d, angle) == (5, 180) else 0.99  # few points are near a pole in five dimensions
    assert near * limit < height.max() <= limit * (1 + 4 * EPS)


def stored_points(study):
    """Points (cell, trial, n, d) as a run stores them, and their cells."""
    batch = first_batch(study)
    cells = [cell for unit in units(study) for batch in unit.batches for cell in batch.cells]
    columns = [compute(study, unit).points for unit in units(study)]
    d = study.dimension
    x = np.concatenate([np.stack([part[f"x_{i + 1}"] for i in range(d)], axis=-1) for part in columns])
    return x.reshape(len(cells), study.design.trials, batch.samples, d), cells


@pytest.mark.parametrize("d", [2, 3, 5])
def test_levels_of_a_group_share_their_draws(make_study, d):
    """From the points of three cells follow u and z, and with them the points of all others."""
    study = make_study({"dimension": d, "keep_points": 9}, trials=3, **LEVELS)
    x, cells = stored_points(study)
    at = {(c.noise, c.radius, round(c.distance)): (x[i], c) for i, c in enumerate(cells)}
    (p, low), (q, high), (wide, _) = at[0.5, 1, 0], at[8.0, 1, 0], at[0.5, 3, 0]
    z = (q - p) / (high.noise - low.noise)
    u = (wide - p) / 2.0
    np.testing.assert_allclose(np.linalg.norm(u, axis=-1), 1.0, rtol=1e-13)
    for points, cell in at.values():
        expected = np.array(cell.center) + cell.radius * u + cell.noise * z
        np.testing.assert_allclose(points, expected, rtol=0, atol=1e-13)


def test_cells_with_independent_draws_share_nothing(make_study):
    """With independent draws, no two cells have a common direction or normal."""
    study = make_study({"keep_points": 9}, trials=3, draws="independent", **LEVELS)
    batches = [batch for unit in units(study) for batch in unit.batches]
    assert len(batches) == 12
    drawn = [draw(study, [batch]) for batch in batches]
    for left, right in combinations(drawn, 2):
        assert not np.intersect1d(left.unit_noise, right.unit_noise).size
        assert not np.intersect1d(left.directions[:, 0], right.directions[:, 0]).size


@pytest.mark.parametrize(
    "change", [{"top": {"seed": 2}}, {"angle": 91}, {"samples": 11}, {"top": {"dimension": 4}}], ids=str
)
def test_groups_share_nothing(make_study, change):
    """Another seed, angle, number of samples or dimension is another draw."""
    one, other = make_study(), make_study(**change)
    left, right = draw(one, [first_batch(one)]), draw(other, [first_batch(other)])
    assert not np.intersect1d(left.unit_noise, right.unit_noise).size


def test_first_trials_do_not_depend_on_how_many_follow(make_study):
    """A longer study begins with the draws of a shorter one, bit for bit, also with a noise shape."""
    shape = [[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]]
    short, long = (make_study({"noise_shape": shape}, trials=trials) for trials in (1, 500))
    left, right = draw(short, [first_batch(short)]), draw(long, [first_batch(long)])
    np.testing.assert_array_equal(left.unit_noise, right.unit_noise[:1])
    np.testing.assert_array_equal(left.directions, right.directions[:1])


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
    draws = draw(study, [first_batch(study)])
    expected = np.eye(3) if SHAPES[shape] is None else np.array(SHAPES[shape])
    np.testing.assert_array_equal(draws.law.covariance(1.0), expected)
    z = draws.unit_noise[0]
    variance = np.diag(expected)
    assert np.all(np.abs(z.mean(axis=1)) < 5 * np.sqrt(variance / z.shape[1]))
    error = np.sqrt((np.outer(variance, variance) + expected**2) / z.shape[1])
    assert np.all(np.abs(z @ z.T / z.shape[1] - expected) < 5 * error)


def test_noise_does_not_follow_the_direction(make_study):
    """Noise and direction of a sample are uncorrelated in every pair of components (9 pairs, 5 errors: 5e-6)."""
    study = make_study(samples=100_000, trials=1, angle=180)
    draws = draw(study, [first_batch(study)])
    correlation = np.corrcoef(np.vstack([unit_vectors(draws)[0], draws.unit_noise[0]]))[:3, 3:]
    assert np.abs(correlation).max() < 5 / np.sqrt(100_000)

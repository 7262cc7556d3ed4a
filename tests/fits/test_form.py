"""The minimum-zone sphere, beside a search through all sets of d + 2 points; forms that move fits."""

import itertools

import numpy as np
import pytest
from scipy.special import sph_harm_y

import study


def brute_force(x):
    """Narrowest zone that any d + 2 points define, by each choice of sides.

    With the signs s, |x - c|² = (r + s t)² for two points, subtracted, is linear in c and r t.
    """
    n, d = x.shape
    best = (np.inf, None)
    for chosen in map(list, itertools.combinations(range(n), d + 2)):
        for sides in itertools.product([-1.0, 1.0], repeat=d + 1):
            signs = np.array([1.0, *sides])
            if abs(signs.sum()) == d + 2:
                continue
            part = x[chosen]
            squares = (part**2).sum(axis=1)
            system = np.column_stack([2.0 * (part[1:] - part[0]), 2.0 * (signs[1:] - signs[0])])
            center = np.linalg.solve(system, squares[1:] - squares[0])[:d]
            distance = np.linalg.norm(x - center, axis=1)
            width = np.ptp(distance)
            if width <= np.ptp(distance[chosen]) + 1e-11 and width < best[0]:
                best = (width, [*center, 0.5 * (distance.min() + distance.max())])
    return best


@pytest.mark.parametrize(("d", "n", "angle", "noise"), [(2, 9, 180, 0.05), (2, 8, 90, 0.02), (3, 8, 180, 0.02)])
def test_brute_force(rng, on_cap, d, n, angle, noise):
    """The zone is the narrowest of those that d + 2 points define, to 1e-9 r."""
    for _ in range(5):
        points = on_cap(rng, n, angle, d, noise, center=rng.standard_normal(d))[0]
        zone = study.minimum_zone(points)
        width, sphere = brute_force(points)
        assert zone.optimal
        assert zone.width == pytest.approx(width, abs=1e-9)
        np.testing.assert_allclose([*zone.center, zone.radius], sphere, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("d", "n", "angle"),
    [(2, 40, 60), (3, 30, 180), (3, 400, 60), (3, 20_000, 90), pytest.param(4, 100, 120, marks=pytest.mark.slow)],
)
def test_no_neighbour_is_narrower(rng, on_cap, d, n, angle):
    """No small change of the centre narrows the zone, d + 2 points touch it, and least squares has a wider one."""
    points = on_cap(rng, n, angle, d, 0.01)[0]
    zone = study.minimum_zone(points)

    def width(center):
        return np.ptp(np.linalg.norm(points - center, axis=1))

    distance = np.linalg.norm(points - zone.center, axis=1)
    assert zone.optimal
    assert zone.width == pytest.approx(width(zone.center), abs=1e-13)
    assert (np.abs(np.abs(distance - zone.radius) - zone.width / 2) < 1e-11).sum() == d + 2
    for size in (1e-1, 1e-3, 1e-6):
        for direction in rng.standard_normal((100 if n < 1000 else 5, d)):
            assert width(zone.center + size * direction / np.linalg.norm(direction)) > zone.width
    assert zone.width < np.ptp(study.fit(points, "mle").residuals)


def test_motion_and_unit(rng, on_cap, random_rotation):
    """A moved set in another unit has the moved zone; sets of a batch do not affect each other."""
    points = on_cap(rng, 25, 100, noise=0.02, sets=3)[0]
    rotation, shift = random_rotation(rng, 3), rng.standard_normal(3)
    one, two = study.minimum_zone(points), study.minimum_zone(1e3 * (points @ rotation.T + shift))
    np.testing.assert_allclose(two.center, 1e3 * (one.center @ rotation.T + shift), rtol=0, atol=1e-8)
    np.testing.assert_allclose(two.width, 1e3 * one.width, rtol=1e-9)
    assert one.optimal.all()
    np.testing.assert_array_equal(study.minimum_zone(points[1]).center, one.center[1])


def test_points_without_a_zone(rng, on_cap):
    """Exact points have a zone as wide as rounding; a line has none."""
    exact = study.minimum_zone(on_cap(rng, 20, 90)[0])
    assert exact.width < 1e-14
    np.testing.assert_allclose(exact.center, 0.0, atol=1e-12)
    line = study.minimum_zone(np.outer(np.arange(6.0), [1.0, 2.0, 3.0]))
    assert np.isnan(line.center).all()
    assert not line.optimal


def real_harmonics(u, degree):
    """Real harmonics (2l + 1, n) of a degree, of mean square 1 over the sphere, from SciPy's complex ones."""
    polar, turn = np.arccos(np.clip(u[:, 2], -1.0, 1.0)), np.arctan2(u[:, 1], u[:, 0])
    rows = []
    for order in range(degree + 1):
        value = np.sqrt(4.0 * np.pi) * sph_harm_y(degree, order, polar, turn)
        rows += [value.real] if order == 0 else [np.sqrt(2.0) * value.real, np.sqrt(2.0) * value.imag]
    return np.array(rows)


@pytest.mark.parametrize(
    "known", [{}, {"radius": 2.0}, {"radius": (2.0, 0.02)}, {"noise": np.linspace(0.01, 0.05, 90)}]
)
@pytest.mark.parametrize("angle", [40.0, 120.0])
def test_a_form_of_the_stated_size_moves_a_number_by_its_error(rng, on_cap, angle, known):
    """Of points that each harmonic deforms a little, refits by `mle` move so; the worst mixture moves each by its ±."""
    u = on_cap(rng, 90, angle, noise=0.0)[0]
    points = 2.0 * u + 0.02 * rng.standard_normal(u.shape)
    fit = study.fit(points, "mle", **known)
    away = points - fit.center
    e = away / np.linalg.norm(away, axis=1)[:, None]
    for row, degree in enumerate((2, 3)):
        moves = []
        for f in real_harmonics(e, degree):
            ends = [study.fit(points + side * f[:, None] * e, "mle", **known) for side in (-1e-4, 1e-4)]
            moves.append(np.append(ends[1].center - ends[0].center, ends[1].radius - ends[0].radius) / 2e-4)
        worst = np.linalg.norm(moves, axis=0)
        expected = np.divide(fit.standard_errors, worst * fit.sigma, out=np.full(4, np.inf), where=worst > 1e-9)
        expected[3] = np.inf if np.ndim(known.get("radius", ())) == 0 and "radius" in known else expected[3]
        np.testing.assert_allclose(fit.sensitivity()[row], expected, rtol=0.1)


def test_sensitivity_of_a_batch_and_of_circles(rng, on_cap):
    """Each set has its own, in every unit; an outlier that is left out does not count; an ellipse on a whole circle.

    On a whole circle a form of degree 2 moves neither centre nor radius: the points' own unevenness is left.
    """
    points = on_cap(rng, 40, 60.0, noise=0.02, sets=3)[0]
    fits = study.fit(points)
    assert fits.sensitivity().shape == (3, 2, 4)
    np.testing.assert_allclose(study.fit(100.0 * points[1] - 7.0).sensitivity(), fits.sensitivity()[1], rtol=1e-6)
    far = points[0].copy()
    far[3] *= 3.0
    kept, rest = study.fit(far, "robust"), study.fit(np.delete(far, 3, axis=0), "robust")
    assert list(np.flatnonzero(kept.outliers)) == [3]
    np.testing.assert_allclose(kept.sensitivity() / kept.allowance, rest.sensitivity() / rest.allowance, rtol=1e-3)
    turn = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn)]) + 1e-6 * rng.standard_normal((36, 2))
    assert (study.fit(circle).sensitivity() > 100.0).all()

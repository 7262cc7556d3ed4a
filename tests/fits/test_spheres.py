"""Several spheres in one cloud: their truth, clutter, fewer than asked for, and shapes that are none."""

from pathlib import Path

import numpy as np
import pytest

import study
from study import Status
from study.fits.spheres import fit_spheres, printed

BALLS = [([0, 0, 0], 10, 400, 180), ([40, 0, 0], 10, 300, 90), ([0, 50, 10], 15, 500, 60)]
"""Centre, radius, number of points and half-angle of the cap that they lie on."""
SIGMA = 0.05


def balls(rng, on_cap, kinds=BALLS, d=3):
    """Noisy points of spheres whose caps have random axes (n, d), and the number of each point's sphere (n,)."""
    clouds = []
    for center, radius, n, angle in kinds:
        turn = np.linalg.qr(rng.standard_normal((d, d)))[0]
        clouds.append(on_cap(rng, n, angle, d)[0] @ turn * radius + center + SIGMA * rng.standard_normal((n, d)))
    return np.concatenate(clouds), np.repeat(np.arange(len(kinds)), [kind[2] for kind in kinds])


def matched(spheres, kinds=BALLS):
    """Place of the sphere that is nearest to each true one."""
    away = np.linalg.norm(spheres.center[:, None] - np.array([kind[0] for kind in kinds], float), axis=2)
    return away.argmin(axis=0)


@pytest.mark.parametrize("clutter", [0, 800, 8000])
def test_spheres_among_clutter(rng, on_cap, clutter):
    """Centres and radii are within four standard errors of the truth, and points have the right labels.

    Of 12 normal numbers one is beyond 4 once in 1300 seeds. Points of the clutter that lie by chance within some
    standard deviations of a sphere cannot be told from its own; that is one in a hundred.
    """
    points, truth = balls(rng, on_cap)
    more = rng.uniform([-60, -20, -30], [80, 80, 40], (clutter, 3))
    order = rng.permutation(len(points) + clutter)
    spheres = study.fit_spheres(np.concatenate([points, more])[order], 3)
    assert spheres.ok.all()
    assert len(spheres) == 3
    place = matched(spheres)
    assert sorted(place) == [0, 1, 2]
    for (center, radius, *_), fit in zip(BALLS, [spheres.fits[k] for k in place], strict=True):
        pulls = (np.append(fit.center, fit.radius) - [*center, radius]) / fit.standard_errors
        assert np.abs(pulls).max() < 4.0
    labels = np.empty(len(order), dtype=int)
    labels[order] = spheres.labels
    assert (labels[: len(points)] == place[truth]).mean() > 0.98
    assert (labels[len(points) :] >= 0).sum() <= 0.01 * clutter
    np.testing.assert_array_equal(spheres.count, np.bincount(spheres.labels[spheres.labels >= 0]))
    assert spheres.left + spheres.count.sum() == len(order)


def test_radii_within_limits(rng, on_cap):
    """Balls of another radius are left alone, whatever their number of points; limits that are none are refused."""
    points, truth = balls(rng, on_cap)
    spheres = fit_spheres(points, 3, radius=(12.0, 18.0))
    assert list(spheres.ok) == [True]
    assert spheres.radius == pytest.approx([15.0], abs=0.1)
    assert np.mean(truth[spheres.labels == 0] == 2) > 0.99
    small = fit_spheres(points, 3, radius=(8.0, 12.0))
    assert sorted(small.center[small.ok][:, 0].round()) == [0.0, 40.0]
    for limits in ((18.0, 12.0), (-1.0, 5.0)):
        with pytest.raises(ValueError, match=r"give the least and the greatest, such as \(24, 26\)"):
            fit_spheres(points, 1, radius=limits)


def test_fewer_than_asked_for(rng, on_cap):
    """More spheres than there are are not made up; the same points give the same answer again."""
    points = np.concatenate([balls(rng, on_cap)[0], rng.uniform(-60, 80, (2000, 3))])
    spheres, again = study.fit_spheres(points, 8), study.fit_spheres(points, 8)
    assert spheres.ok.sum() == 3
    np.testing.assert_array_equal(spheres.labels, again.labels)
    lines = list(printed(spheres, ["x", "y", "z"], 8))
    assert f"{len(spheres)} of 8 spheres were found" in lines
    assert lines[-1] == f"{spheres.left} of {len(points)} points belong to no sphere"


def shapes(rng, n=900):
    """Clouds of other shapes, of the size of the balls, with the same noise."""
    angle, unit = rng.uniform(0, 2 * np.pi, n), rng.standard_normal((n, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    cube, height = rng.uniform(-10, 10, (n, 3)), 10 * np.sqrt(rng.random(n))
    cube[np.arange(n), rng.integers(3, size=n)] = rng.choice([-10.0, 10.0], n)
    clouds = {
        "clutter": rng.uniform(-60, 80, (n, 3)),
        "plane": np.column_stack([rng.uniform(-60, 80, (n, 2)), np.zeros(n)]),
        "cube": cube,
        "rod": np.column_stack([5 * np.cos(angle), 5 * np.sin(angle), rng.uniform(-40, 40, n)]),
        "cone": np.column_stack([np.cos(angle) * height, np.sin(angle) * height, 2 * height]),
        "filled ball": 10 * unit * np.cbrt(rng.random((n, 1))),
        "cloud": 10 * rng.standard_normal((n, 3)),
        "ellipsoid": unit * [10, 9, 8],
    }
    return {name: cloud + SIGMA * rng.standard_normal(cloud.shape) for name, cloud in clouds.items()}


@pytest.mark.parametrize("name", list(shapes(np.random.default_rng(0), 9)))
@pytest.mark.parametrize("ball", [False, True])
def test_what_is_no_sphere_is_not_ok(rng, on_cap, name, ball):
    """Of other shapes no part is an ok sphere, with a ball beside them or not; the ball is found, and ok."""
    points = shapes(rng)[name]
    if ball:
        points = np.concatenate([points, balls(rng, on_cap, [([150, 0, 0], 10, 300, 120)])[0]])
    spheres = study.fit_spheres(points, 2)
    assert spheres.ok.sum() == ball
    if ball:
        np.testing.assert_allclose(spheres.center[0], [150, 0, 0], atol=0.05)
        assert spheres.status[0] == Status.OK


def test_balls_on_a_table(rng, on_cap):
    """A plane that touches two balls takes nothing from them."""
    kinds = [([0, 0, 10], 10, 400, 180), ([40, 0, 10], 10, 300, 180)]
    table = np.column_stack([rng.uniform(-60, 80, (1500, 2)), SIGMA * rng.standard_normal(1500)])
    spheres = study.fit_spheres(np.concatenate([balls(rng, on_cap, kinds)[0], table]), 2)
    assert spheres.ok.all()
    np.testing.assert_allclose(spheres.center[matched(spheres, kinds)], [kind[0] for kind in kinds], atol=0.05)


def test_a_scan_in_lines(rng):
    """Rays of a regular grid hit a ball before a wall: their lines are circles, and on no sphere but one.

    A scanner's noise is along its rays, and so less at the ball's rim, which its status may say.
    """
    turn, tilt = np.meshgrid(np.linspace(-0.3, 0.3, 90), np.linspace(-0.3, 0.3, 90))
    rays = np.stack([np.sin(turn) * np.cos(tilt), np.sin(tilt), np.cos(turn) * np.cos(tilt)], axis=-1).reshape(-1, 3)
    center, radius = np.array([20.0, 10.0, 400.0]), 60.0
    along = rays @ center
    reach = along**2 - center @ center + radius**2
    distance = np.where(reach > 0.0, along - np.sqrt(np.maximum(reach, 0.0)), 500.0 / rays[:, 2])
    points = np.round(rays * (distance + 0.05 * rng.standard_normal(len(rays)))[:, None], 2)
    spheres = study.fit_spheres(points, 4)
    near = np.linalg.norm(spheres.center - center, axis=1).argmin()
    np.testing.assert_allclose(spheres.center[near], center, atol=0.1)
    assert not np.delete(spheres.ok, near).any()


def test_circles_exact_points_and_gaps(rng, on_cap):
    """Circles in the plane, of points without noise, in any unit; missing points belong to none."""
    kinds = [([0, 0], 1, 60, 180), ([5, 0], 2, 60, 90)]
    points = np.concatenate([on_cap(rng, n, angle, 2)[0] * radius + center for center, radius, n, angle in kinds])
    points = np.concatenate([points, rng.uniform(-2, 8, (40, 2)), np.full((3, 2), np.nan)])
    for unit in (1.0, 1e-6, 1e6):
        spheres = study.fit_spheres(unit * points, 2)
        assert spheres.ok.all()
        place = matched(spheres, [(unit * np.array(kind[0]), *kind[1:]) for kind in kinds])
        np.testing.assert_allclose(spheres.radius[place], [unit, 2 * unit], rtol=1e-9)
        assert (spheres.labels[-3:] == -1).all()


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (np.zeros((4, 3)), {}, r"points have shape \(4, 3\)"),
        (np.zeros((2, 9, 3)), {}, r"points have shape \(2, 9, 3\)"),
        (np.eye(9, 3), {"count": 0}, "count = 0: give the number"),
        (np.eye(9, 3), {"estimator": "corected"}, "corrected"),
    ],
)
def test_wrong_arguments(points, options, message):
    """What cannot be used is named, with what can."""
    with pytest.raises(ValueError, match=message):
        fit_spheres(points, **{"count": 2} | options)


def test_points_that_are_one():
    """Equal points, and nothing but missing ones, have no sphere."""
    for points in (np.ones((20, 3)), np.full((20, 3), np.nan)):
        spheres = study.fit_spheres(points, 2)
        assert len(spheres) == 0
        assert spheres.left == 20
        assert spheres.to_frame().empty


@pytest.mark.parametrize("number", [105, 106])
def test_a_scan_and_its_stand(number):
    """On a raw laser scan the ball is the one of 50 mm; nothing of its stand, and no few points of lines, is ok."""
    name = f"shared/data/nist/SPH{number}.xyz"
    path = next((folder / name for folder in Path(__file__).parents if (folder / name).is_file()), None)
    if path is None:
        pytest.skip(f"{name} is not there: a laser scan that is not in the repository")
    spheres = study.fit_spheres(np.loadtxt(path)[:, :3], 2)
    ball = int(np.abs(spheres.radius - 0.05).argmin())
    assert abs(spheres.radius[ball] - 0.05) < 0.0002
    assert spheres.count[ball] > 4000
    assert not np.delete(spheres.ok, ball).any()


def test_no_sphere_is_larger_than_the_cloud():
    """A shallow bowl of radius 40 in a cloud 14 wide is found by its points, and not ok; one of radius 7.5 is."""
    rng = np.random.default_rng(51)
    flat = rng.uniform(-5.0, 5.0, (1500, 2))
    for radius, ok in ((40.0, False), (7.5, True)):
        bowl = np.column_stack([flat, radius - np.sqrt(radius**2 - (flat**2).sum(axis=1))])
        bowl = bowl[np.isfinite(bowl).all(axis=1)] + 0.002 * rng.normal(size=(1500, 3))
        found = study.fit_spheres(bowl, 1)
        assert found.radius[0] == pytest.approx(radius, rel=0.02)
        assert found.ok.tolist() == [ok]


@pytest.mark.parametrize("seed", [3, 8, 13, 33])
def test_points_that_a_refused_sphere_took_are_looked_at(seed):
    """A cylinder of 600 points has no ok sphere; one touched it where a refused sphere had taken the points around."""
    rng = np.random.default_rng([7, seed])
    angle = rng.uniform(0, 2 * np.pi, 600)
    cylinder = np.column_stack([np.cos(angle), np.sin(angle), rng.uniform(-2, 2, 600)])
    assert not study.fit_spheres(cylinder + rng.normal(0, 0.01, (600, 3)), 1).ok.any()

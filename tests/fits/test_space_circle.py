"""Circles in space: their truth, the coverage of their intervals, and shapes that are none."""

import json

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import binom

import study
from study import Status

CENTER, RADIUS = np.array([10.0, -4.0, 7.0]), 3.2


def circles(seed, sets, n, arc, noise, shape=lambda t: 0.0 * t):
    """Points (sets, n, 3) of arcs in degrees, with noise in radii and a height over the plane, and the axis."""
    rng = np.random.default_rng(seed)
    turned = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    t = np.radians(arc) * (rng.random((sets, n)) - 0.5)
    points = RADIUS * np.stack([np.cos(t), np.sin(t), shape(t)], axis=2)
    return (points + noise * RADIUS * rng.standard_normal(points.shape)) @ turned.T + CENTER, turned[:, 2]


def test_the_geometric_circle():
    """Under little noise it is the circle that SciPy finds for the least squares of distances, but for the bias σ²/2r.

    That is 5e-7 here; the rest is its square.
    """
    (points,), axis = circles(1, 1, 40, 150.0, 1e-3)
    fit = study.fit_circle(points)

    def away(v):
        normal = np.array([np.cos(v[4]) * np.cos(v[5]), np.sin(v[4]) * np.cos(v[5]), np.sin(v[5])])
        height = (points - v[:3]) @ normal
        inside = np.linalg.norm(points - v[:3] - height[:, None] * normal, axis=1) - v[3]
        return np.concatenate([height, inside])

    start = [*CENTER, RADIUS, np.arctan2(axis[1], axis[0]), np.arcsin(axis[2])]
    best = least_squares(away, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    np.testing.assert_allclose([*fit.center, fit.radius], best[:4], rtol=0, atol=1e-5)
    assert abs(fit.axis @ axis) > 1.0 - 1e-5
    assert fit.ok


@pytest.mark.parametrize(
    ("arc", "n", "noise"),
    [(360, 6, 0.005), (360, 30, 0.1), (180, 12, 0.02), (180, 80, 0.05), (90, 30, 0.005), (60, 40, 0.005)],
)
def test_intervals_of_ok_circles_cover(part_of, arc, n, noise):
    """Of the ok circles' 95 % intervals .94 or more cover, of radius, centre and axis; fewer in 1e-4 of seeds.

    Half of the errors are within .69 of the stated ones (.674 for the normal law, more for Student's), to 3.8 errors of
    this median.
    """
    sets = part_of(400)
    points, axis = circles(61 + n, sets, n, arc, noise)
    fit = study.fit_circle(points, assume="circle" if n < 10 else None)
    ends, center, angle = fit.interval("radius"), fit.interval("center"), fit.interval("axis")[:, 1]
    held = np.column_stack([(ends[:, 0] <= RADIUS) & (ends[:, 1] >= RADIUS), np.zeros((len(ends), 4), dtype=bool)])
    held[:, 1:4] = (center[..., 0] <= CENTER) & (center[..., 1] >= CENTER)
    held[:, 4] = np.arccos(np.minimum(np.abs(fit.axis @ axis), 1.0)) <= angle
    assert fit.ok.mean() > 0.85
    assert (held[fit.ok].sum(axis=0) >= binom.ppf(1e-4, fit.ok.sum(), 0.94)).all(), held[fit.ok].mean(axis=0)
    errors = fit.standard_errors[fit.ok]
    scatter = np.column_stack([fit.center - CENTER, fit.radius - RADIUS])[fit.ok]
    assert np.median(np.abs(scatter) / errors, axis=0) == pytest.approx(np.full(4, 0.69), abs=3.0 / np.sqrt(sets))


@pytest.mark.parametrize(
    "shape",
    [lambda t: 0.03 * t, lambda t: 0.03 * np.cos(2 * t), lambda t: 0.03 * np.sin(3 * t)],
    ids=["helix", "saddle", "wave"],
)
def test_what_leaves_the_plane(shape):
    """A helix and warped rings by 3 σ are misfits, by the test out of the plane."""
    points, _ = circles(5, 20, 80, 360.0, 0.01, shape)
    fit = study.fit_circle(points)
    assert (fit.status == Status.MISFIT).all()
    assert (fit.tests["out of plane"] < 1e-4).all()


def test_other_shapes(rng, on_cap):
    """An ellipse is a misfit; of spheres, caps and lines none is ok."""
    ring, _ = circles(6, 20, 80, 360.0, 0.0)
    squeezed = (ring - CENTER) * [1.0, 0.9, 0.95] + 0.02 * rng.standard_normal(ring.shape)
    assert (study.fit_circle(squeezed).status == Status.MISFIT).all()
    for angle in (180.0, 60.0):
        assert not study.fit_circle(on_cap(rng, 60, angle, noise=0.01, sets=20)[0]).ok.any()
    line = np.outer(np.arange(20.0), [1.0, 2.0, 3.0])
    assert study.fit_circle(line).status == Status.SINGULAR
    assert study.fit_circle(np.full((7, 3), np.nan)).status == Status.TOO_FEW_POINTS


def test_an_arc_that_noise_hides():
    """On an arc of 30° with noise above its height no circle is ok, and most are weakly identified."""
    fit = study.fit_circle(circles(7, 100, 40, 30.0, 0.05)[0])
    assert fit.ok.sum() <= 1
    assert (fit.status == Status.WEAKLY_IDENTIFIED).mean() > 0.8


def test_missing_points_units_and_a_far_point():
    """Missing points are left out; another unit gives the circle in it; a point far from the plane is named."""
    (points,), _ = circles(8, 1, 40, 200.0, 0.01)
    fit = study.fit_circle(points)
    missing = np.insert(points, 5, np.nan, axis=0)
    other = study.fit_circle(missing)
    np.testing.assert_allclose(other.center, fit.center, rtol=1e-12)
    np.testing.assert_allclose(other.interval("center"), fit.interval("center"), rtol=1e-6)
    small = study.fit_circle(1e-3 * points)
    np.testing.assert_allclose(small.interval("radius"), 1e-3 * fit.interval("radius"), rtol=1e-6)
    points[7] += 1.0 * fit.axis
    far = study.fit_circle(points)
    assert far.status == Status.OUTLIERS
    assert far.outliers.nonzero()[0].tolist() == [7]


def test_bad_input():
    """A message says which shape is expected."""
    with pytest.raises(ValueError, match=r"points have shape \(9, 2\): expected \(…, n, 3\) with n ≥ 6"):
        study.fit_circle(np.ones((9, 2)))
    with pytest.raises(ValueError, match="assume = 'sphere': only 'circle' can be assumed"):
        study.fit_circle(np.ones((9, 3)), assume="sphere")


@pytest.mark.parametrize("size", [1e160, 1e300])
def test_points_whose_squares_are_beyond_all_numbers(rng, size):
    """They are not finite, which is said without a warning."""
    assert study.fit_circle(size * rng.standard_normal((40, 3))).status == Status.NOT_FINITE


def test_the_command(tmp_path, well, call_here):
    """`study fit --circle` prints centre, radius and axis, or JSON, and its exit code is 0 if the circle is ok."""
    (points,), axis = circles(9, 1, 60, 250.0, 0.01)
    np.savetxt(tmp_path / "ring.xyz", points)
    printed = well(tmp_path, "fit", "--circle", "ring.xyz", "--plot", "ring.png")
    assert "axis (" in printed
    assert (tmp_path / "ring.png").is_file()
    (row,) = json.loads(well(tmp_path, "fit", "--circle", "ring.xyz", "--json"))
    assert row["radius"] == pytest.approx(float(study.fit_circle(points).radius))
    assert abs(np.dot(row["axis"], axis)) > 0.9999
    assert row["tests"]["shape"] == "passed"
    line = np.outer(np.arange(20.0), [1.0, 2.0, 3.0])
    np.savetxt(tmp_path / "line.xyz", line)
    assert call_here(tmp_path, "fit", "--circle", "line.xyz")[0] == 3
    assert "--circle goes with" in call_here(tmp_path, "fit", "--circle", "ring.xyz", "--noise", "0.1")[2]

"""Input that no fit can use: a TypeError names the dtype or the columns, a ValueError the value and the remedy.

Missing samples: the answer is the same as without the rows with a NaN or a mask, whatever their number and place.

Data that determine no sphere: a status and NaN, no exception, no warning, and no effect on other sets.
"""

from functools import partial

import numpy as np
import pandas as pd
import pytest

import study
from study import Status
from study.fits.loops.jit import CHUNK

POINTS = np.random.default_rng(4).standard_normal((8, 3))

UNIT = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)

CALLS = {
    "fit": study.fit,
    "mgdk": lambda points: study.mgdk([POINTS, points]),
    "crlb": lambda points: study.crlb(points, 0.1),
    "Incremental": lambda points: study.Incremental(3).update(points),
    "minimum_zone": study.minimum_zone,
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_what_is_no_array_of_numbers(call):
    """Text, complex numbers, truth values and objects are no coordinates; rows of different lengths form no array."""
    for kind in (str, complex, bool, object):
        with pytest.raises(TypeError, match=f"dtype {np.dtype(kind).name[:3]}|dtype <U"):
            call(POINTS.astype(kind))
    with pytest.raises(ValueError, match=r"(points|directions) form no array: give rows equally many numbers"):
        call([*POINTS.tolist(), [1.0, 2.0]])


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_frames_with_text(call):
    """Columns beside x, y and z may hold anything; of others, those that are not numbers are named."""
    frame = pd.DataFrame(UNIT, columns=list("xyz")).assign(name="a", good=True)
    call(frame)
    with pytest.raises(TypeError, match=r"'name' .*'good' has dtype bool.*pass the others, 'w', alone"):
        call(frame[["x", "name", "good"]].rename(columns={"x": "w"}))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("size", [1e308, np.finfo(float).max])
def test_points_as_large_as_numbers_go(d, size):
    """They are not finite when squared, which is said without a warning, whatever is known of their noise."""
    corners = np.array([[i >> k & 1 for k in range(d)] for i in range(2**d)]) * 2.0 - 1.0
    for points in (size * corners, np.concatenate([corners, size * corners])):
        for known in ({}, {"ordered": True}, {"radius": 1.0}, {"noise": 1.0}, {"noise": np.ones(len(points))}):
            assert study.fit(points, **known).status == Status.NOT_FINITE
        assert (study.fit(np.stack([points, points])).status == Status.NOT_FINITE).all()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("n", [12, 60])
def test_some_points_as_large_as_numbers_go(rng, on_cap, d, n):
    """Beside points of a sphere they make no warning; they are outliers of `robust`, and no other fit is ok."""
    points, _ = on_cap(rng, n, angle=180.0, d=d, noise=0.01)
    points[::10] = np.where(rng.random(points[::10].shape) < 0.5, 1.0, -1.0) * np.finfo(float).max
    spread = np.linspace(0.01, 0.02, n)
    for name, entry in study.ESTIMATORS.items():
        known = [{"noise": 0.01 if entry.needs else None}]
        known += [{"radius": 1.0}, {"noise": spread}, {"noise": np.einsum("n,ij->nij", spread**2, np.eye(d))}]
        for one in known if name == "corrected" else known[:1]:
            fit = study.fit(points, name, **one)
            shown = fit.outliers, fit.goodness, fit.standard_errors, fit.interval("center"), fit.to_dict()
            assert name == "robust" or not fit.ok, (name, shown)
    found = study.fit(points, "robust")
    assert found.outliers.nonzero()[0].tolist() == list(range(0, n, 10))
    assert found.status == Status.NOT_FINITE or float(found.radius) == pytest.approx(1.0, abs=0.05)
    assert np.isnan(study.minimum_zone(points).radius)
    assert (study.fit_spheres(points, 1).labels[::10] == -1).all()


@pytest.mark.parametrize("shape", [(), (3,), (5, 1), (4, 5, 1), (3, 3), (0, 3), (2, 2), (7, 4, 4)])
def test_wrong_shapes(shape):
    """Points of another shape than (…, n, d) with n > d ≥ 2 raise an error that shows the shape; so do directions."""
    calls = {name: partial(study.fit, estimator=name, noise=0.1) for name in study.ESTIMATORS}
    calls["minimum_zone"] = study.minimum_zone
    if shape in [(), (3,), (5, 1)]:
        calls["crlb"] = partial(study.crlb, noise=0.1)
    for name, call in calls.items():
        with pytest.raises(ValueError, match=r"(points|directions) have shape") as caught:
            call(np.zeros(shape))
        assert str(shape) in str(caught.value), name


@pytest.mark.parametrize(
    ("noise", "failure", "says"),
    [
        *((value, ValueError, "positive") for value in (-0.1, 0.0, np.nan)),
        (np.inf, ValueError, "finite"),
        (1e-200, ValueError, "square"),
        (1e200, ValueError, "square"),
        ([0.1, 0.1, 0.1], ValueError, r"\(3,\)"),
        (np.eye(2), ValueError, r"\(2, 2\)"),
        (np.eye(3)[None], ValueError, r"\(1, 3, 3\)"),
        (np.diag([1.0, 1.0, -1.0]), ValueError, "positive definite"),
        (np.diag([1.0, 1.0, 0.0]), ValueError, "positive definite"),
        (np.ones((3, 3)), ValueError, "positive definite"),
        ([[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], ValueError, "symmetric"),
        (np.diag([1.0, np.nan, 1.0]), ValueError, "finite"),
        *((value, TypeError, "noise has dtype") for value in (True, "0.1", 0.1 + 0j, np.array(True))),
    ],
)
def test_wrong_noise(noise, failure, says):
    """Noise that is neither a standard deviation nor a covariance raises an error that says why."""
    growing = study.Incremental(3)
    growing.update(POINTS)
    calls = [lambda name=name: study.fit(POINTS, name, noise) for name in study.ESTIMATORS]
    calls += [lambda: study.crlb(UNIT, noise), lambda: study.mgdk([POINTS], noise)]
    for call in [*calls, lambda: growing.fit(study.ESTIMATORS["ugdk"], noise)]:
        with pytest.raises(failure, match="noise") as caught:
            call()
        caught.match(says)


@pytest.mark.parametrize(
    ("name", "failure", "says"),
    [
        *((name, ValueError, ", ".join(study.ESTIMATORS)) for name in ("sphere", "", "MLE")),
        (3, TypeError, "estimator = 3: expected a name"),
        ("ugdk", ValueError, "noise="),
    ],
)
def test_wrong_estimators(name, failure, says):
    """An unknown name raises an error that lists the known ones; one that needs the noise says how to pass it."""
    with pytest.raises(failure, match=says):
        study.fit(np.eye(4, 3), name)


def test_directions_of_another_length():
    """Vectors that are not of unit length are refused, with the place and the length; rounding is allowed."""
    with pytest.raises(ValueError, match=r"directions\[3\] has length 2: .*divide"):
        study.crlb(UNIT * np.where(np.arange(8) == 3, 2.0, 1.0)[:, None], 0.1)
    with pytest.raises(ValueError, match=r"directions\[1, 0\] has length 0"):
        study.crlb(np.stack([UNIT, 0 * UNIT]), 0.1)
    with pytest.raises(ValueError, match=r"length inf"):
        study.crlb(np.where(UNIT[0, 0] == UNIT, np.inf, UNIT), 0.1)
    bound = study.crlb(UNIT.astype(np.float32), 0.1)
    np.testing.assert_allclose(bound, study.crlb(UNIT, 0.1), rtol=1e-4)


@pytest.mark.parametrize("level", [0, 1, 2, 95, -0.1, np.nan])
def test_levels(level):
    """A coverage lies between 0 and 1."""
    fit = study.fit(POINTS)
    for call in (fit.ellipsoid, lambda level: fit.interval("radius", level)):
        with pytest.raises(ValueError, match=r"between 0 and 1, (such as|for example) 0\.95"):
            call(level)


@pytest.mark.parametrize("make", [np.asarray, np.asfortranarray, lambda a: a[:, ::-1]])
def test_a_fit_owns_its_points(make):
    """Errors and residuals do not change when the caller reuses the array; with copy=False they are refused."""
    points = make(POINTS.copy())
    expected = study.fit(points).standard_errors
    fit, view = study.fit(points), study.fit(points, copy=False)
    points[:] = 0.0
    np.testing.assert_array_equal(fit.standard_errors, expected)
    np.testing.assert_array_equal(view.samples.x, 0.0)
    for what in ("status", "standard_errors", "residuals", "outliers", "count"):
        with pytest.raises(ValueError, match="points have changed since they were fitted"):
            getattr(view, what)
    points = make(POINTS.copy())
    known = study.fit(points, copy=False)
    assert known.status == Status.WEAKLY_IDENTIFIED  # which computes intervals of 95 % and the test of fit
    points[0] += 0.1
    for name in ("interval", "goodness", "allowance", "count"):
        with pytest.raises(ValueError, match="points have changed since they were fitted"):
            known.interval("radius", 0.9) if name == "interval" else getattr(known, name)
    joint = study.mgdk([buffer := POINTS.copy()])
    buffer[:] = np.nan
    assert np.isfinite(joint.residuals[0]).all()
    assert fit.estimates.status == Status.OK


def test_large_arrays_are_lent():
    """A large batch is not copied; a changed set, a part of the batch too, is refused, and an unchanged one is not."""
    points = np.random.default_rng(1).standard_normal((2000, 20, 3))
    points *= (1.0 + 0.01 * points[..., :1]) / np.linalg.norm(points, axis=-1, keepdims=True)
    fit, copied = study.fit(points), study.fit(points, copy=True)
    assert np.shares_memory(fit.samples.x, points)
    assert not np.shares_memory(copied.samples.x, points)
    np.testing.assert_allclose(fit.residuals, copied.residuals, rtol=0, atol=1e-14)  # layouts round differently
    first, last, both = fit[0], fit[-1], fit[[0, -1]]
    points[-1, 3, 1] += 1e-9
    np.testing.assert_allclose(first.standard_errors, copied[0].standard_errors, rtol=1e-9)
    np.testing.assert_allclose(both.standard_errors, copied[[0, -1]].standard_errors, rtol=1e-9)  # indexing copied them
    for part in (last, fit, fit[-1]):
        with pytest.raises(ValueError, match="points have changed"):
            _ = part.standard_errors
    points[5, 2] = np.nan
    with_missing = study.fit(points)
    points[5, 2] = 0.0
    assert with_missing.count[5] == 19


HOLES = [0, 1, 0, 7, 7, 30, 33, 36, 37, 40, 12, 0]
"""Number of missing samples in each of the sets below; a sphere needs 4."""


@pytest.fixture(scope="module", params=[40, CHUNK + 44])
def holed(on_cap, request):
    """Twelve sets of so many samples with rows missing, each row by one, two or three of its coordinates."""
    points = on_cap(np.random.default_rng(31), request.param, 120.0, noise=0.02, radius=2.0, center=1.0, sets=12)[0]
    rng = np.random.default_rng(32)
    for sample, holes in zip(points, HOLES, strict=True):
        for row in rng.choice(request.param, holes, replace=False):
            sample[row, rng.choice(3, rng.integers(1, 4), replace=False)] = np.nan
    return points


def assert_same(one, two, what=slice(None)):
    """Assert that fits have the same answers to the last bit."""
    for name, own, other in zip(study.Estimates._fields, one.estimates, two.estimates, strict=True):
        np.testing.assert_array_equal(own, other[what], err_msg=name)


def assert_lost(fit, status):
    """Assert that a fit has this status and no numbers that could be taken for an answer."""
    assert np.all(fit.estimates.status == status)
    assert np.all(np.isin(fit.status, status))
    for name in ("center", "radius"):
        assert np.isnan(getattr(fit, name)).all(), name
    assert np.isnan(fit.estimates.noise_variance).all()
    assert not np.any(fit.estimates.condition < 1.0)
    assert not np.isfinite(fit.standard_errors).any()


def test_a_mixed_batch(holed, estimator):
    """Each set of a batch has the answer of its own remaining samples to the last bit, errors to rounding."""
    noise = 0.02**2 * np.diag([1.0, 2.0, 0.5]) if holed.shape[1] == 40 else 0.02
    if estimator in ("hinge", "corrected_01", "corrected_02", "corrected_12") and np.ndim(noise) == 2:
        with pytest.raises(ValueError, match=r"noise=σ|takes no covariance"):
            study.fit(holed, estimator, noise)
        return
    fit, n = study.fit(holed, estimator, noise), holed.shape[1]
    np.testing.assert_array_equal(fit.count, n - np.array(HOLES))
    for t, points in enumerate(holed):
        if n - HOLES[t] < 4:
            assert_lost(fit[t], Status.TOO_FEW_POINTS)
            assert np.isnan(fit.residual_rms[t])
            continue
        alone = study.fit(points[~np.isnan(points).any(axis=1)], estimator, noise)
        if estimator == "corrected" and np.ndim(noise) == 2:  # which weighs each point, with sums over all rows
            np.testing.assert_allclose([*alone.center, alone.radius], [*fit[t].center, fit[t].radius], rtol=1e-13)
        else:
            assert_same(alone, fit, t)
        for name in ("count", "residual_rms", "covariance", "standard_errors"):
            got, expected = getattr(fit, name)[t], getattr(alone, name)
            np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12, err_msg=name)


def test_other_ways_to_say_that_samples_are_missing(holed, estimator):
    """What stands beside or below a hole has no effect, infinities too; more axes, and a single set, neither."""
    holes = np.isnan(holed)
    fit = study.fit(holed, estimator, 0.02)
    values = np.array([1e6, np.inf, -np.inf] * 4)[:, None, None]
    beside = np.where(holes.any(axis=2, keepdims=True) & ~holes, values, holed)
    for points in (beside, np.ma.MaskedArray(np.where(holes, 1e3, holed), holes)):
        other = study.fit(points, estimator, 0.02)
        assert_same(fit, other)
        np.testing.assert_array_equal(other.count, fit.count)
        np.testing.assert_allclose(other.residual_rms, fit.residual_rms, rtol=1e-12)
        np.testing.assert_allclose(other.covariance, fit.covariance, rtol=1e-12)
    assert_same(study.fit(holed.reshape(3, 2, 2, -1, 3), estimator, 0.02)[2, 1, 0], fit, 10)
    assert_same(study.fit(holed[10], estimator, 0.02), fit, 10)


@pytest.mark.parametrize("d", [2, 3, pytest.param(5, marks=pytest.mark.plain)])
def test_too_few_left(rng, on_cap, estimator, d):
    """With no sample left, or d where d + 1 are needed, the answer is TOO_FEW_POINTS and NaN, alone and in a batch."""
    points = on_cap(rng, 9, 120.0, d, 0.02)[0]
    for left in (d, 1, 0):
        points[left:, 0] = np.nan
        for sets in (points, points[None], np.stack([points] * 3)):
            fit = study.fit(sets, estimator, 0.02)
            assert_lost(fit, Status.TOO_FEW_POINTS)
            np.testing.assert_array_equal(fit.count, left)
            assert np.isnan(fit.residual_rms).all()


@pytest.mark.parametrize("as_mask", [False, True])
def test_missing_points_of_other_functions(rng, on_cap, as_mask):
    """`mgdk`, `crlb` and `minimum_zone` leave out points that are masked or NaN, whatever lies below the mask."""

    def without(points, rows):
        mask, wrong = np.zeros_like(points, dtype=bool), points.copy()
        mask[rows], wrong[rows] = True, 70.0 if as_mask else np.nan
        return np.ma.MaskedArray(wrong, mask) if as_mask else wrong

    first, second = (on_cap(rng, 30, 100.0, noise=0.01, radius=r)[0] for r in (1.0, 2.0))
    rest = np.delete(second, [3, 7], axis=0)
    fit = study.mgdk([first, without(second, [3, 7])])
    np.testing.assert_array_equal(fit.center, study.mgdk([first, rest]).center)
    np.testing.assert_array_equal(fit.count, [30, 28])
    assert np.isnan(fit.residuals[1][[3, 7]]).all()
    zone, other = study.minimum_zone(without(second, [3, 7])), study.minimum_zone(rest)
    np.testing.assert_array_equal([*zone.center, zone.radius], [*other.center, other.radius])
    bound = study.crlb(without(UNIT, [2]), 0.1)
    np.testing.assert_allclose(bound, study.crlb(np.delete(UNIT, 2, axis=0), 0.1), rtol=1e-12)
    assert np.isposinf(study.crlb(np.full((5, 3), np.nan), 0.1)).all()


def test_frames_with_missing_numbers():
    """A frame's own missing values are missing samples."""
    frame = pd.DataFrame(POINTS, columns=list("xyz")).convert_dtypes()
    frame.loc[2, "y"] = pd.NA
    fit = study.fit(frame)
    assert fit.count == 7
    np.testing.assert_array_equal(fit.center, study.fit(np.delete(POINTS, 2, axis=0)).center)


FLAWED = ("lls_nr", "lls_nr_raw", "lls_single")


@pytest.fixture(scope="module", params=[name for name in study.ESTIMATORS if name not in FLAWED])
def careful(request):
    """Each estimator but those that reproduce a flaw: a cut gives the least norm, single precision has little range."""
    return request.param


@pytest.mark.parametrize("n", [6, 30, CHUNK + 44])
def test_not_finite(rng, on_cap, estimator, n):
    """One infinite coordinate, wherever it stands, beside a missing row or not, loses its own set and no other."""
    points = on_cap(rng, n, noise=0.01, sets=9)[0]
    clean = study.fit(points, estimator, noise=0.01)
    bad = [0, 2, 5, 7]
    points[bad, [0, n // 2, n - 1, n - 1], [0, 1, 2, 0]] = [np.inf, -np.inf, -np.inf, np.inf]
    points[5, 0, 1] = np.nan
    fit = study.fit(points, estimator, noise=0.01)
    assert_lost(fit[bad], Status.NOT_FINITE)
    assert fit.count[5] == n - 1
    for name in ("center", "radius", "noise_variance", "status"):
        one, two = (np.delete(getattr(f.estimates, name), bad, axis=0) for f in (fit, clean))
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-12, err_msg=name)


def test_too_large_or_small(rng, on_cap, estimator):
    """Coordinates whose squares come near the ends of float64 are refused by the status of infinite ones."""
    points = on_cap(rng, 20, noise=0.01)[0]
    for scale in (1e-300, 1e-150, 1e150, 1e200, 1e300):
        assert_lost(study.fit(scale * points, estimator, noise=0.01), Status.NOT_FINITE)


def test_units_are_free(rng, on_cap, careful):
    """Any unit gives the same sphere, and the same standard errors."""
    points = on_cap(rng, 100, noise=0.01)[0]
    one = study.fit(points, careful, noise=0.01)
    for scale in (1e-125, 1e-60, 1e-30, 1e30, 1e60, 1e125):
        fit = study.fit(scale * points, careful, noise=0.01 * scale)
        assert fit.ok
        np.testing.assert_allclose(fit.center / scale, one.center, rtol=0, atol=1e-12)
        assert fit.radius / scale == pytest.approx(float(one.radius), rel=1e-12)
        assert fit.estimates.noise_variance / scale**2 == pytest.approx(float(one.estimates.noise_variance), rel=1e-9)
        np.testing.assert_allclose(fit.standard_errors / scale, one.standard_errors, rtol=1e-9)
        np.testing.assert_allclose(fit.residuals / scale, one.residuals, rtol=0, atol=1e-11)


def test_points_and_lines(careful):
    """Points that are all the same, or on a line, determine nothing, not even a circle in a plane."""
    places = [np.full((3, 8, 3), value) for value in (0.0, 1.0, 0.1, -123.456)]
    for points in [*places, *(np.outer(np.arange(9.0), np.arange(1, d + 1)) + 0.3 for d in (2, 3))]:
        assert_lost(study.fit(points, careful, noise=0.01), Status.SINGULAR)


@pytest.mark.parametrize("n", [4, 20, 1000])
@pytest.mark.parametrize("offset", [0.0, 10.0])
def test_planes(rng, random_rotation, careful, offset, n):
    """Points of a plane are recognised in any orientation and place, in spite of rounding; many are on a circle."""
    sets = 100 if n < 20 else 20
    turn = rng.uniform(0, 2 * np.pi, (sets, n))
    points = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=2)
    for t in range(3, sets):  # the first three stay in planes of two coordinates
        points[t] = points[t] @ random_rotation(rng, 3)
    points[:2] = points[:2][..., [2, 0, 1]]
    points += offset * rng.standard_normal((sets, 1, 3))
    fit = study.fit(points, careful, noise=1e-3)
    if careful == "hinge":
        assert np.all(fit.estimates.status == Status.HINGE)
        assert np.isfinite(fit.center).all()
    else:
        assert np.all(fit.estimates.status == Status.SINGULAR)
        assert np.isnan(fit.center).all()
    if n >= 20:
        assert np.all(fit.status == Status.HINGE)
        np.testing.assert_allclose(fit.circle.radius, 1.0, rtol=1e-9)
    assert careful == "hinge" or (np.isnan(fit.sigma).all() and not np.any(fit.estimates.condition < 1.0))


def test_likely_slips():
    """Coordinates in rows, and a word where there must be a truth value, are answered with the remedy."""
    with pytest.raises(ValueError, match=r"\(3, 8\).*points are rows: swap the last two axes"):
        study.fit(POINTS.T)
    with pytest.raises(TypeError, match=r"ordered = 'no': expected True or False"):
        study.fit(POINTS, ordered="no")


def test_equal_noises_of_unknown_scale(rng, on_cap):
    """They are no knowledge: errors, outliers and tests are those of the plain fit; a square of zero is refused."""
    points = on_cap(rng, 60, 180.0, noise=0.01)[0]
    points[7] *= 1.3
    plain = study.fit(points)
    for noise in (np.full(60, 0.1), [0.1] * 60, np.full((60, 3), 0.1), np.ma.MaskedArray(np.full(60, 0.1))):
        fit = study.fit(points, noise=noise, scale="estimated")
        np.testing.assert_array_equal(fit.outliers.nonzero()[0], [7])
        np.testing.assert_array_equal(fit.standard_errors, plain.standard_errors)
        assert fit.to_dict()["status"] == plain.to_dict()["status"] == "outliers"
    assert study.fit(points, noise=np.full(60, np.nan)).status == Status.TOO_FEW_POINTS
    with pytest.raises(ValueError, match=r"noise\[0\] = 1e-300: .* and so must its square"):
        study.fit(points, noise=np.full(60, 1e-300))


def test_equal_noises_in_some_sets_of_a_batch(rng):
    """They have the answers that they have alone, whatever the noises of the sets beside them."""
    u = rng.normal(size=(16, 12, 2))
    points = 2.0 * u / np.linalg.norm(u, axis=2, keepdims=True) + 0.05 * rng.normal(size=u.shape)
    points[:8, 4] *= 1.4
    noise = np.where(np.arange(16)[:, None] % 2 == 0, 0.1, rng.choice([0.1, 0.2], size=(16, 12)))
    batch = study.fit(points, noise=noise, scale="estimated")
    alone = study.fit(points[::2], noise=noise[::2], scale="estimated")
    assert alone.outliers[:4, 4].any()
    for name in ("standard_errors", "outliers", "status", "allowance"):
        np.testing.assert_array_equal(getattr(batch, name)[::2], getattr(alone, name))
    np.testing.assert_array_equal(batch.goodness.answers[:, ::2], alone.goodness.answers)


def test_columns_of_angles():
    """A coordinate in degrees is no length."""
    with pytest.raises(ValueError, match=r"column 'x \(deg\)' holds angles, not lengths"):
        study.fit(pd.DataFrame(POINTS, columns=["x (deg)", "y", "z"]))


@pytest.mark.parametrize("call", [study.read_recording, study.run, study.read_run, study.draw_skeleton])
@pytest.mark.parametrize("value", [None, 3, b"x"])
def test_no_path(call, value):
    """What is no path is named."""
    with pytest.raises(TypeError, match=r"= .*: expected the name of a file or folder"):
        call(value)


def test_plans_beyond_all_numbers():
    """Squares and integers that are too large are answered by the argument."""
    with pytest.raises(ValueError, match=r"error = 1e-300: needs inf points"):
        study.plan_fit(0.1, 25, 1e-300, angle=60)
    with pytest.raises(ValueError, match=r"noise = 1000.*: must be below 1\.8e308"):
        study.plan_fit(10**400, 25, 0.1, angle=60)
    with pytest.raises(ValueError, match=r"points = 10{39}: plan with at least 15"):
        study.plan_fit(0.1, 25, 0.1, points=10**400)
    for call in (partial(study.plan_fit, 0.1, 25, 0.1, points=20), study.attainable_bound):
        with pytest.raises(ValueError, match=r"^dimension = 10{39}: a bound is known for 1,000 at most$"):
            call(dimension=10**400)


@pytest.mark.parametrize("call", [study.find_joints, study.find_gait])
@pytest.mark.parametrize("value", [None, 3, b"x", [None]])
def test_no_recording(call, value):
    """What is no recording is named, alone and among several."""
    with pytest.raises(TypeError, match=r"recording = .*: expected the name of a file or folder"):
        call(value)

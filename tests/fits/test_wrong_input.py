"""Input that no fit can use: a TypeError names the dtype or the columns, a ValueError the value and the remedy.

Data that determine no sphere: a status and NaN, no exception, no warning, and no effect on other sets.
"""

import numpy as np
import pandas as pd
import pytest

import study
from study import Status

POINTS = np.random.default_rng(4).standard_normal((8, 3))

UNIT = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)

CALLS = {
    "fit": study.fit,
    "mgdk": lambda points: study.mgdk([POINTS, points]),
    "crlb": lambda points: study.crlb(points, 0.1),
    "Incremental": lambda points: study.Incremental(3).update(points),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
@pytest.mark.parametrize("kind", [str, complex, bool, object])
def test_dtypes(call, kind):
    """Text, complex numbers, truth values and objects are no coordinates."""
    with pytest.raises(TypeError, match=f"dtype {np.dtype(kind).name[:3]}|dtype <U"):
        call(POINTS.astype(kind))


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_rows_of_different_lengths(call):
    """They form no array, and the message says what would."""
    with pytest.raises(ValueError, match=r"(points|directions) form no array: give rows equally many numbers"):
        call([*POINTS.tolist(), [1.0, 2.0]])


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_frames_with_text(call):
    """Columns beside x, y and z may hold anything; of others, those that are not numbers are named."""
    frame = pd.DataFrame(UNIT, columns=list("xyz")).assign(name="a", good=True)
    call(frame)
    with pytest.raises(TypeError, match=r"'name' .*'good' has dtype bool.*pass the others, 'w', alone"):
        call(frame[["x", "name", "good"]].rename(columns={"x": "w"}))
    call(frame[list("xyz")])


def test_frames_with_missing_numbers():
    """A frame's own missing values are missing samples."""
    frame = pd.DataFrame(POINTS, columns=list("xyz")).convert_dtypes()
    frame.loc[2, "y"] = pd.NA
    fit = study.fit(frame)
    assert fit.count == 7
    np.testing.assert_array_equal(fit.center, study.fit(np.delete(POINTS, 2, axis=0)).center)


@pytest.mark.parametrize("noise", [True, "0.1", 0.1 + 0j, np.array(True)])
def test_noise(noise):
    """A truth value is no standard deviation, nor is text."""
    growing = study.Incremental(3)
    growing.update(POINTS)
    calls = [lambda: study.fit(POINTS, "als", noise), lambda: study.mgdk([POINTS], noise)]
    calls.append(lambda: growing.fit(study.ESTIMATORS["ugdk"], noise))
    for call in [*calls, lambda: study.crlb(UNIT, noise)]:
        with pytest.raises(TypeError, match="noise has dtype"):
            call()


@pytest.mark.parametrize("as_mask", [False, True])
def test_missing_points_of_markers(rng, on_cap, as_mask):
    """`mgdk` leaves out points that are masked or NaN, whatever lies below the mask."""
    first, second = (on_cap(rng, 30, 100.0, noise=0.01, radius=r)[0] for r in (1.0, 2.0))
    rest = np.delete(second, [3, 7], axis=0)
    wrong = second.copy()
    wrong[[3, 7]] = 70.0 if as_mask else np.nan
    mask = np.zeros_like(wrong, dtype=bool)
    mask[[3, 7]] = True
    fit = study.mgdk([first, np.ma.MaskedArray(wrong, mask) if as_mask else wrong])
    np.testing.assert_array_equal(fit.center, study.mgdk([first, rest]).center)
    np.testing.assert_array_equal(fit.count, [30, 28])
    assert np.isnan(fit.residuals[1][[3, 7]]).all()


@pytest.mark.parametrize("as_mask", [False, True])
def test_missing_directions(as_mask):
    """`crlb` leaves out directions that are masked or NaN; without any the bound is infinite."""
    wrong = UNIT.copy()
    wrong[2] = 70.0 if as_mask else np.nan
    mask = np.zeros_like(wrong, dtype=bool)
    mask[2] = True
    bound = study.crlb(np.ma.MaskedArray(wrong, mask) if as_mask else wrong, 0.1)
    np.testing.assert_allclose(bound, study.crlb(np.delete(UNIT, 2, axis=0), 0.1), rtol=1e-12)
    assert np.isposinf(study.crlb(np.full((5, 3), np.nan), 0.1)).all()


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


@pytest.mark.parametrize("level", [0, 1, 2, -0.1, np.nan])
def test_levels(level):
    """A coverage lies between 0 and 1."""
    with pytest.raises(ValueError, match="between 0 and 1"):
        study.fit(POINTS).ellipsoid(level)


@pytest.mark.parametrize("k", [0, -1, np.nan, np.inf])
def test_coverage_factors(k):
    """A coverage factor is positive and finite."""
    with pytest.raises(ValueError, match="coverage factor"):
        study.fit(POINTS).expanded_uncertainty(k)


@pytest.mark.parametrize("make", [np.asarray, np.asfortranarray, lambda a: a[:, ::-1]])
def test_a_fit_owns_its_points(make):
    """Errors and residuals do not change when the caller reuses the array; with copy=False they are refused."""
    points = make(POINTS.copy())
    expected = study.fit(points).standard_errors
    fit, view = study.fit(points), study.fit(points, copy=False)
    points[:] = 0.0
    np.testing.assert_array_equal(fit.standard_errors, expected)
    np.testing.assert_array_equal(view.samples.x, 0.0)
    for what in ("status", "standard_errors", "residuals", "outliers", "copies"):
        with pytest.raises(ValueError, match="points have changed since they were fitted"):
            getattr(view, what)
    joint = study.mgdk([buffer := POINTS.copy()])
    buffer[:] = np.nan
    assert np.isfinite(joint.residuals[0]).all()
    assert fit.own_status == Status.OK


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


FLAWED = ("lls_nr", "lls_nr_raw", "lls_single")


@pytest.fixture(scope="module", params=[name for name in study.ESTIMATORS if name not in FLAWED])
def careful(request):
    """Each estimator but those that reproduce a flaw: a cut gives the least norm, single precision has little range."""
    return request.param


def assert_lost(fit, status, names):
    """Assert that the fit has this status and no numbers that could be taken for an answer."""
    assert names == [status.name] * len(names)
    assert np.isnan(fit.center).all()
    assert np.isnan(fit.radius).all()


def assert_plane(fit, estimator, names):
    """Assert that a plane is recognised; `hinge` alone then has an answer, in the plane."""
    if estimator == "hinge":
        assert names == ["HINGE"] * len(names)
        assert np.isfinite(fit.center).all()
    else:
        assert_lost(fit, Status.SINGULAR, names)


def assert_others(fit, clean, bad):
    """Assert that all but the bad sets have the answers of the clean batch."""
    for name in ("center", "radius", "noise_variance", "own_status"):
        one, two = (np.delete(getattr(f, name), bad, axis=0) for f in (fit, clean))
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("value", [np.inf, -np.inf])
@pytest.mark.parametrize("n", [6, 30, 700])
def test_not_finite(rng, on_cap, estimator, status_of, value, n):
    """One infinite coordinate, wherever it stands, loses its own set and no other."""
    points = on_cap(rng, n, noise=0.01, sets=9)[0]
    clean = study.fit(points, estimator, noise=0.01)
    places = [(0, 0, 0), (2, n // 2, 1), (5, n - 1, 2), (7, n - 1, 0)]
    for place in places:
        points[place] = value
    fit = study.fit(points, estimator, noise=0.01)
    bad = [place[0] for place in places]
    assert [status_of(fit)[t] for t in bad] == ["NOT_FINITE"] * 4
    assert np.isnan(fit.center[bad]).all()
    assert np.isnan(fit.radius[bad]).all()
    assert_others(fit, clean, bad)


@pytest.mark.parametrize("n", [12, 700])
def test_missing_samples(rng, on_cap, estimator, n):
    """A row with a NaN is a missing sample: the fit is that of the rest, and other sets are not affected."""
    points = on_cap(rng, n, noise=0.01, sets=6)[0]
    clean = study.fit(points, estimator, noise=0.01)
    points[1, 3, 0] = points[1, n - 1, 2] = points[4, 0, 1] = np.nan
    fit = study.fit(points, estimator, noise=0.01)
    np.testing.assert_array_equal(fit.count, [n, n - 2, n, n, n - 1, n])
    for t in (1, 4):
        rest = study.fit(points[t][~np.isnan(points[t]).any(axis=1)], estimator, noise=0.01)
        np.testing.assert_allclose(fit.center[t], rest.center, rtol=0, atol=1e-12)
        assert fit.radius[t] == pytest.approx(float(rest.radius), abs=1e-12)
        assert fit.own_status[t] == rest.own_status
    assert_others(fit, clean, [1, 4])


def test_too_few_left(rng, on_cap, estimator, status_of):
    """With fewer than d + 1 samples left the status is TOO_FEW_POINTS."""
    points = on_cap(rng, 6, noise=0.01, sets=3)[0]
    points[0, :3, 1] = np.nan
    points[2] = np.nan
    fit = study.fit(points, estimator, noise=0.01)
    assert [status_of(fit)[t] for t in (0, 2)] == ["TOO_FEW_POINTS"] * 2
    assert np.isnan(fit.center[[0, 2]]).all()


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e150, 1e200, 1e300])
def test_too_large_or_small(rng, on_cap, estimator, status_of, scale):
    """Coordinates whose squares come near the ends of float64 are refused by the status of infinite ones."""
    fit = study.fit(scale * on_cap(rng, 20, noise=0.01)[0], estimator, noise=0.01)
    assert_lost(fit, Status.NOT_FINITE, status_of(fit))


@pytest.mark.parametrize("scale", [1e-125, 1e-60, 1e-30, 1e30, 1e60, 1e125])
def test_units_are_free(rng, on_cap, careful, status_of, scale):
    """Any unit gives the same sphere, and the same standard errors."""
    points = on_cap(rng, 100, noise=0.01)[0]
    one = study.fit(points, careful, noise=0.01)
    fit = study.fit(scale * points, careful, noise=0.01 * scale)
    assert status_of(fit) == ["OK"]
    np.testing.assert_allclose(fit.center / scale, one.center, rtol=0, atol=1e-12)
    assert fit.radius / scale == pytest.approx(float(one.radius), rel=1e-12)
    assert fit.noise_variance / scale**2 == pytest.approx(float(one.noise_variance), rel=1e-9)
    np.testing.assert_allclose(fit.standard_errors / scale, one.standard_errors, rtol=1e-9)
    np.testing.assert_allclose(fit.residuals / scale, one.residuals, rtol=0, atol=1e-11)


@pytest.mark.parametrize("point", [0.0, 1.0, 0.1, -123.456])
def test_identical_points(careful, status_of, point):
    """Points that are all the same determine nothing."""
    fit = study.fit(np.full((3, 8, 3), point), careful, noise=0.01)
    assert_lost(fit, Status.SINGULAR, status_of(fit))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_coordinate_plane(rng, on_cap, careful, status_of, axis):
    """Points with one coordinate in common lie in a plane."""
    points = on_cap(rng, 12, noise=0.1, sets=5)[0]
    points[:, :, axis] = 0.7
    fit = study.fit(points, careful, noise=0.01)
    assert_plane(fit, careful, status_of(fit))


@pytest.mark.parametrize("n", [4, 20, 1000])
@pytest.mark.parametrize("offset", [0.0, 10.0])
def test_any_plane(rng, random_rotation, careful, status_of, offset, n):
    """Points of a plane are recognised in any orientation and place, in spite of rounding; many are on a circle."""
    sets = []
    for _ in range(100):
        angle = rng.uniform(0, 2 * np.pi, n)
        flat = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
        sets.append(flat @ random_rotation(rng, 3) + offset * rng.standard_normal(3))
    fit = study.fit(np.array(sets), careful, noise=1e-3)
    assert_plane(fit, careful, [Status(int(own)).name for own in fit.own_status])
    if n >= 20:
        assert status_of(fit) == ["HINGE"] * 100
        np.testing.assert_allclose(fit.circle.radius, 1.0, rtol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_line(careful, status_of, d):
    """Points of a line determine nothing, not even a circle in a plane."""
    fit = study.fit(np.outer(np.arange(9.0), np.arange(1, d + 1)) + 0.3, careful, noise=0.01)
    assert_lost(fit, Status.SINGULAR, status_of(fit))


def test_lost_sets_have_no_noise_and_no_condition(rng, random_rotation, careful):
    """A set without a sphere has no noise estimate and no condition below 1."""
    points = np.zeros((40, 9, 3))
    for t in range(2, 40):
        points[t] = rng.standard_normal((9, 3)) * [1, 1, 0] @ random_rotation(rng, 3)
    points[1, 4, 1] = np.inf
    fit = study.fit(points, careful, noise=0.01)
    lost = np.isin(fit.own_status, [Status.SINGULAR, Status.NOT_FINITE])
    assert np.all(lost) or careful == "hinge"
    assert careful == "ugdk" or np.isnan(fit.noise_variance[lost]).all()
    assert not np.any(fit.condition[lost] < 1.0)

"""Input that no fit can use: a TypeError names the dtype or the columns, a ValueError the value and the remedy."""

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

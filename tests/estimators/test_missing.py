"""Missing samples: the answer is the same as without the rows with a NaN, whatever their number and place."""

import numpy as np
import pytest

import study
from study import Status

FIELDS = ["own_status" if name == "status" else name for name in study.Estimates._fields]
REPORTS = ["count", "residual_rms", "covariance", "standard_errors"]
HOLES = [0, 1, 0, 7, 7, 30, 33, 36, 37, 40, 12, 0]
"""Number of missing samples, of 40, in each of the sets below; a sphere needs 4."""


@pytest.fixture(scope="module")
def full(on_cap):
    """Twelve sets of 40 samples without holes."""
    return on_cap(np.random.default_rng(31), 40, 120.0, noise=0.02, radius=2.0, center=1.0, sets=12)[0]


@pytest.fixture(scope="module")
def holed(full):
    """The sets with these numbers of rows missing, each row by one, two or three of its coordinates."""
    rng, points = np.random.default_rng(32), full.copy()
    for t, holes in enumerate(HOLES):
        for row in rng.choice(40, holes, replace=False):
            points[t, row, rng.choice(3, rng.integers(1, 4), replace=False)] = np.nan
    return points


def rest(points):
    """The samples that are not missing."""
    return points[~np.isnan(points).any(axis=1)]


@pytest.mark.parametrize("noise", [0.02, 0.02**2 * np.diag([1.0, 2.0, 0.5])])
def test_a_mixed_batch(holed, estimator, noise):
    """Each set of a batch has the answer of its own remaining samples to the last bit, errors to rounding."""
    if estimator == "hinge" and np.ndim(noise) == 2:
        with pytest.raises(ValueError, match="noise=σ"):
            study.fit(holed, estimator, noise)
        return
    fit = study.fit(holed, estimator, noise)
    np.testing.assert_array_equal(fit.count, 40 - np.array(HOLES))
    for t, points in enumerate(holed):
        if 40 - HOLES[t] < 4:
            assert fit.own_status[t] == Status.TOO_FEW_POINTS
            for name in ("center", "radius", "noise_variance", "condition", "residual_rms"):
                assert np.isnan(getattr(fit, name)[t]).all(), name
            assert not np.isfinite(fit.standard_errors[t]).any()
            continue
        alone = study.fit(rest(points), estimator, noise)
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(fit, name)[t], getattr(alone, name), err_msg=name)
        for name in REPORTS:
            got, expected = getattr(fit, name)[t], getattr(alone, name)
            np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12, err_msg=name)


def test_whole_sets_are_not_affected(full, holed, estimator):
    """Sets without holes have, to the last bit, the answer that they have in a batch without holes."""
    fit = study.fit(holed, estimator, 0.02)
    whole = np.flatnonzero(np.array(HOLES) == 0)
    clean = study.fit(full[whole], estimator, 0.02)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(fit, name)[whole], getattr(clean, name), err_msg=name)


def test_values_beside_a_hole_do_not_matter(holed, estimator):
    """The other coordinates of a missing row have no effect, infinite ones included."""
    changed = holed.copy()
    for value, t in [(1e6, 3), (np.inf, 4), (-np.inf, 5)]:
        rows = np.isnan(changed[t]).any(axis=1)
        changed[t][rows] = np.where(np.isnan(changed[t][rows]), np.nan, value)
    one, two = study.fit(holed, estimator, 0.02), study.fit(changed, estimator, 0.02)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
    np.testing.assert_allclose(one.residual_rms, two.residual_rms, rtol=1e-12)
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-12)


def test_leading_axes(holed, estimator):
    """A batch with more axes, and a single set, treat missing samples in the same way."""
    flat, deep = study.fit(holed, estimator, 0.02), study.fit(holed.reshape(3, 2, 2, 40, 3), estimator, 0.02)
    for name in FIELDS:
        field = getattr(flat, name)
        np.testing.assert_array_equal(getattr(deep, name), field.reshape(3, 2, 2, *field.shape[1:]), err_msg=name)
    np.testing.assert_array_equal(deep.count, flat.count.reshape(3, 2, 2))
    single = study.fit(holed[10], estimator, 0.02)
    np.testing.assert_array_equal(single.center, flat.center[10])
    assert single.count == 28


@pytest.mark.parametrize("left", [0, 1, 3])
@pytest.mark.parametrize("d", [2, 3, 5])
def test_too_few_left(rng, on_cap, estimator, d, left):
    """With no sample left, or d where d + 1 are needed, the answer is TOO_FEW_POINTS and NaN, alone and in a batch."""
    points = on_cap(rng, 9, 120.0, d, 0.02)[0]
    points[min(left, d) :, 0] = np.nan
    for sets in (points, points[None], np.stack([points] * 3)):
        fit = study.fit(sets, estimator, 0.02)
        assert np.all(fit.own_status == Status.TOO_FEW_POINTS)
        np.testing.assert_array_equal(fit.count, min(left, d))
        for name in ("center", "radius", "noise_variance", "residual_rms"):
            assert np.isnan(getattr(fit, name)).all(), name
        assert not np.isfinite(fit.standard_errors).any()


def test_infinite_is_not_missing(full, estimator):
    """A row with an infinite coordinate and no NaN is not missing: its set is NOT_FINITE, with holes or without."""
    points = full[:4].copy()
    points[0, 5, 1], points[1, 5, 1], points[1, 9, 0] = np.inf, -np.inf, np.nan
    fit = study.fit(points, estimator, 0.02)
    assert [Status(int(s)) for s in fit.own_status[:2]] == [Status.NOT_FINITE] * 2
    np.testing.assert_array_equal(fit.count, [40, 39, 40, 40])
    assert np.isnan(fit.center[:2]).all()
    assert np.isfinite(fit.center[2:]).all()
    assert np.all(fit.own_status[2:] == Status.OK)


def test_masked_arrays(holed, estimator):
    """Masked values are missing, whatever value lies below the mask."""
    mask = np.isnan(holed)
    masked = np.ma.MaskedArray(np.where(mask, 1e3, holed), mask)
    one, two = study.fit(holed, estimator, 0.02), study.fit(masked, estimator, 0.02)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
    np.testing.assert_array_equal(one.count, two.count)

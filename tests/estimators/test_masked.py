"""Masked arrays: a masked sample is missing."""

import numpy as np
import pytest

import study
from study.sphere.cap import sample_cap


@pytest.mark.parametrize("estimator", ["als", "mle"])
def test_masked_samples_are_missing(estimator):
    """A masked row is left out like a row with a NaN."""
    rng = np.random.default_rng(8)
    points = sample_cap(rng, 40, 2.0) + 0.01 * rng.standard_normal((40, 3))
    mask = np.zeros((40, 3), dtype=bool)
    mask[::4, 1] = True
    masked = study.fit(np.ma.MaskedArray(points, mask), estimator)
    rest = study.fit(points[~mask.any(axis=1)], estimator)
    np.testing.assert_array_equal(masked.center, rest.center)
    assert masked.count == 30


def test_minimum_zone(on_cap):
    """A masked row does not count, and what is no number is refused."""
    points = on_cap(np.random.default_rng(9), 20, 180.0, noise=0.01)[0]
    mask = np.zeros((20, 3), dtype=bool)
    points[3], mask[3] = 50.0, True
    zone, rest = study.minimum_zone(np.ma.MaskedArray(points, mask)), study.minimum_zone(np.delete(points, 3, axis=0))
    np.testing.assert_array_equal([*zone.center, zone.radius], [*rest.center, rest.radius])
    with pytest.raises(TypeError, match="points have dtype complex128"):
        study.minimum_zone(points * 1j)

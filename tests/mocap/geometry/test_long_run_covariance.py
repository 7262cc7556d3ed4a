import numpy as np
import pytest
from scipy.signal import lfilter

from study.mocap.geometry.long_run_covariance import autocorrelation_time, long_run_covariance


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_autocorrelation_time_of_an_autoregression(rng, phi):
    """For x' = φx + ε it is (1 + φ)/(1 - φ), to 10 % with 2·10⁵ frames (its error τ√(2·5τ/n) is 3 % at worst)."""
    series = lfilter([1.0], [1.0, -phi], rng.standard_normal((3, 200_000)), axis=1)
    np.testing.assert_allclose(autocorrelation_time(series), (1 + phi) / (1 - phi), rtol=0.1)


def test_short_and_empty_series():
    """Series of one frame, or of zeros, have an autocorrelation time of 1."""
    np.testing.assert_array_equal(autocorrelation_time(np.ones((2, 1))), 1.0)
    np.testing.assert_array_equal(autocorrelation_time(np.zeros((2, 50))), 1.0)


def test_covariance_of_a_sum_over_correlated_frames(rng):
    """It is the covariance over many independent pairs of correlated series, of unequal size and memory.

    300 sums fix a variance to 8 %, the estimate has about 10 %; 50 % is four of both together: 1 in 10⁴.
    """
    mix = np.array([[1.0, 0.0], [30.0, 40.0]])

    def draw(count):
        noise = rng.standard_normal((count, 2, 4000))
        series = np.stack([lfilter([1.0], [1.0, -0.9], noise[:, 0], axis=1), noise[:, 1]], axis=1)
        return np.einsum("ij,njt->nit", mix, series)

    sums = draw(300).sum(axis=2)
    wanted = np.cov(sums.T)
    one = draw(1)[0]
    found, independent = long_run_covariance(one - one.mean(axis=1)[:, None])
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    assert np.abs((found - wanted) / scale).max() < 0.5
    np.testing.assert_allclose(independent, (one - one.mean(axis=1)[:, None]) @ one.T, rtol=1e-10)
    assert found[0, 0] > 10 * independent[0, 0]

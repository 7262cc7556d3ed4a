"""What several tests share: a seeded generator, point sets on spherical caps, and a statistical assertion.

Factories are session fixtures that return functions, so that hypothesis tests can use them too.
"""

import numpy as np
import pytest

import study
from study.sphere.cap import sample_cap


@pytest.fixture
def rng():
    """A generator with a fixed seed, fresh for each test."""
    return np.random.default_rng(20090901)


@pytest.fixture(scope="session")
def on_cap():
    """Make noisy points on a cap: (n, d), or (sets, n, d); the directions come along."""

    def make(rng, n, angle=180.0, d=3, noise=0.0, radius=1.0, center=0.0, sets=None, axis=None):
        shape = (n, d) if sets is None else (sets, n, d)
        directions = sample_cap(rng, n * (sets or 1), np.radians(angle), d, axis).reshape(shape)
        root = noise * np.eye(d) if np.ndim(noise) == 0 else np.linalg.cholesky(noise)
        points = np.asarray(center) + radius * directions + rng.standard_normal(shape) @ root.T
        return points, directions

    return make


@pytest.fixture(scope="session")
def cap_moments():
    """First moment m and covariance K of directions uniform on a cap about e₁, from theory §0 and (3.2)-(3.3)."""

    def compute(angle, d):
        phi = np.radians(angle)
        if d == 2:
            m1, m2 = np.sin(phi) / phi, 0.5 + np.sin(2 * phi) / (4 * phi)
        elif d == 3:
            m1, m2 = (1 + np.cos(phi)) / 2, (1 + np.cos(phi) + np.cos(phi) ** 2) / 3
        else:
            raise NotImplementedError(d)
        mean = np.zeros(d)
        mean[0] = m1
        return mean, np.diag([m2 - m1**2] + [(1 - m2) / (d - 1)] * (d - 1))

    return compute


@pytest.fixture(scope="session")
def random_rotation():
    """An orthogonal matrix uniform over the group, reflections included."""

    def make(rng, d):
        q, r = np.linalg.qr(rng.standard_normal((d, d)))
        return q * np.sign(np.diag(r))

    return make


@pytest.fixture(scope="session")
def assert_mean():
    """Assert that a sample (trials, …) has the expected mean, to k standard errors in every component.

    A normal deviate passes 4.5 in 7 of 10⁶ cases; the trials are thousands, so means are normal.
    """

    def check(sample, expected, k=4.5):
        error = sample.std(axis=0, ddof=1) / np.sqrt(len(sample))
        pull = (sample.mean(axis=0) - expected) / error
        assert np.all(np.abs(pull) < k), f"{pull} standard errors from the expected mean"

    return check


@pytest.fixture(scope="session", params=list(study.ESTIMATORS))
def estimator(request):
    """Each registered estimator by name."""
    return request.param


@pytest.fixture(scope="session")
def status_of():
    """Names of the statuses of a fit, for messages that can be read."""

    def names(fit):
        return [study.Status(int(value)).name for value in np.ravel(fit.status)]

    return names

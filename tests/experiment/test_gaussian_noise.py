"""Every Gaussian law: its draws have its covariance, estimators get it in the right form, and its bound holds."""

import inspect

import numpy as np
import pytest

import study
from study.experiment.noise import gaussian as noise
from study.experiment.noise.gaussian import AnisotropicGaussian, IsotropicGaussian, gaussian

SHAPE = ((1.63, 0.41, 0.38), (0.41, 0.78, 0.48), (0.38, 0.48, 0.59))
LAWS = {
    "isotropic in the plane": IsotropicGaussian(2),
    "isotropic in space": IsotropicGaussian(3),
    "unequal": AnisotropicGaussian(((4.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.25))),
    "correlated": AnisotropicGaussian(SHAPE),
}


@pytest.fixture(params=list(LAWS))
def law(request):
    """Each law by name."""
    return LAWS[request.param]


@pytest.fixture
def directions(law, rng):
    """Directions of a few trials as draws have them (b, d, n), with the height 1 - u₁ in place of u₁."""
    u = rng.standard_normal((3, len(law.covariance(1.0)), 20))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    u[:, 0] = 1.0 - u[:, 0]
    return u


def test_every_law_is_tested():
    """A class of the module with the methods of a law is among those above."""
    methods = [name for name in vars(noise.NoiseLaw) if not name.startswith("_")]
    classes = [each for _, each in inspect.getmembers(noise, inspect.isclass) if each is not noise.NoiseLaw]
    assert {type(law) for law in LAWS.values()} == {c for c in classes if all(hasattr(c, name) for name in methods)}


def test_draws_have_the_stated_covariance(law, rng):
    """Mean and covariance of 10⁵ draws are 0 and the covariance at σ = 1.

    At most nine covariances and three means within 5 standard errors: a false alarm has probability 7e-6 for a law.
    """
    expected = law.covariance(1.0)
    d, n = len(expected), 100_000
    z = law.unit_noise(rng.standard_normal((1, d, n)))[0]
    products = z[:, None] * z[None]
    error = products.std(axis=2) / np.sqrt(n)
    assert np.all(np.abs(products.mean(axis=2) - expected) < 5.0 * error)
    assert np.all(np.abs(z.mean(axis=1)) < 5.0 * np.sqrt(np.diag(expected) / n))


def test_the_covariance_is_that_of_sigma(law):
    """It is proportional to σ², symmetric and positive definite; if isotropic, σ² I."""
    covariance = law.covariance(0.3)
    np.testing.assert_allclose(covariance, 0.09 * law.covariance(1.0), rtol=1e-14)
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    if law.isotropic:
        np.testing.assert_allclose(covariance, 0.09 * np.eye(len(covariance)), rtol=1e-14)


def test_estimators_get_sigma_or_the_covariance(law):
    """An isotropic law is given as σ, any other as its covariance: the form that `study.fit` takes."""
    given = law.given(0.3)
    if law.isotropic:
        assert given == 0.3
    else:
        np.testing.assert_array_equal(given, law.covariance(0.3))


def test_the_bound_is_that_of_the_library(law, directions):
    """The bound at σ = 1 is the library's Cramér-Rao bound of the same directions and covariance."""
    u = directions.swapaxes(1, 2).copy()
    u[:, :, 0] = 1.0 - u[:, :, 0]
    expected = study.crlb(u, law.covariance(1.0))
    size = np.sqrt(np.einsum("bii,bjj->bij", expected, expected))
    assert np.all(np.abs(law.unit_bound(directions) - expected) < 1e-10 * size)


def test_a_shape_of_the_identity_is_isotropic():
    """The law of no shape and of the identity is the same; any other shape has a law of its own."""
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    assert gaussian(None, 3) == gaussian(unit, 3) == IsotropicGaussian(3)
    assert gaussian(SHAPE, 3) == AnisotropicGaussian(SHAPE)

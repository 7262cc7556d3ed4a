"""The bound of a batch at σ = 1: study.crlb of the realised directions, and exact where the cap is tiny."""

import mpmath
import numpy as np
import pytest

import study
from study.simulation.experiment.sampling import draw, units


def shape_of(d):
    """A covariance with correlations in d dimensions."""
    return [[(i + 1.0) if i == j else 0.3 for j in range(d)] for i in range(d)]


@pytest.fixture(params=[False, True], ids=["isotropic", "shaped"])
def draws_at(request, make_study):
    """Draw a few trials at an angle, with isotropic noise or a noise shape."""

    def make(d, angle, samples=20):
        shape = shape_of(d) if request.param else None
        made = make_study({"dimension": d, "noise_shape": shape}, angle=angle, samples=samples, trials=3)
        return draw(made, next(next(units(made)).parts(0)))

    return make


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("angle", [30, 90, 180])
def test_bound_is_crlb_of_the_realised_directions(draws_at, d, angle):
    """At ordinary angles the bound, every entry of it, is that of the library's own function."""
    draws = draws_at(d, angle)
    u = draws.directions.swapaxes(1, 2).copy()
    u[:, :, 0] = 1.0 - u[:, :, 0]
    expected = study.crlb(u, draws.law.covariance(1.0))
    size = np.sqrt(np.einsum("bii,bjj->bij", expected, expected))
    assert np.all(np.abs(draws.unit_bound() - expected) < 1e-10 * size)


def exact_variances(directions, shape):
    """Diagonal of the inverse of J = Σ w wᵀ/(uᵀΣu), w = (u, 1), in sixty digits (theory 3.1)."""
    d, n = directions.shape
    with mpmath.workdps(60):
        information = mpmath.zeros(d + 1)
        covariance = mpmath.matrix(shape.tolist())
        for k in range(n):
            u = mpmath.matrix([mpmath.mpf(float(v)) for v in directions[:, k]])
            u[0] = 1 - u[0]
            w = mpmath.matrix([*u, 1])
            information += w * w.T / (u.T * covariance * u)[0]
        inverse = information**-1
        return np.array([float(inverse[i, i]) for i in range(d + 1)])


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("angle", [1e-4, 1e-2, 1.0, 60.0])
def test_bound_is_exact_at_tiny_angles(draws_at, d, angle):
    """Variances of centre and radius agree with sixty-digit arithmetic to 1e-8, down to 1e-4 degrees."""
    draws = draws_at(d, angle)
    bound = draws.unit_bound()
    for trial in range(3):
        expected = exact_variances(draws.directions[trial], draws.law.covariance(1.0))
        np.testing.assert_allclose(np.diag(bound[trial]), expected, rtol=1e-8)


def test_bound_falls_with_the_number_of_samples(draws_at):
    """Ten times the samples, a tenth of the variance, within the scatter of the directions."""
    few, many = (np.median(draws_at(3, 60, n).unit_bound()[:, 0, 0]) for n in (1000, 10_000))
    assert few / many == pytest.approx(10.0, rel=0.3)

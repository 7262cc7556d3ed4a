"""Other people's sphere fits, each as a function of one set of points (n, d) that returns its centre."""

import importlib.util
import random
import warnings
from operator import attrgetter

import naive
import numpy as np
import pytest
from scipy import optimize


def scikit_guess():
    """Its 0.0.2 asks NumPy for ``float_``, which NumPy 2 calls ``float64``, and for what has moved."""
    vars(np).setdefault("float_", np.float64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        fit = importlib.import_module("skg").nsphere_fit
    return lambda x: fit(x)[1]


def named(module, path, center):
    """A maker of a fit from the path of a function in a module, and what takes the centre from its answer."""

    def make():
        fit = attrgetter(path)(importlib.import_module(module))
        return lambda x: center(fit(x))

    return make


def scikit_image(sigma):
    """Circles only; a point within three σ is an inlier."""
    from skimage.measure import CircleModel, ransac

    return lambda x, seed=0: ransac(x, CircleModel, 3, 3.0 * sigma, max_trials=200, rng=seed)[0].center


def pyransac3d(sigma):
    """Spheres only; a point within three σ is an inlier. It draws from Python's own generator."""
    from pyransac3d import Sphere

    def fit(x, seed=0):
        random.seed(seed)
        return np.asarray(Sphere().fit(x, thresh=3.0 * sigma, maxIteration=1000)[0])

    return fit


CLOSED = {
    "scikit-guess": ("skg", scikit_guess),
    "scikit-spatial": ("skspatial", named("skspatial.objects", "Sphere.best_fit", lambda answer: answer.point)),
    "trimesh": ("trimesh", named("trimesh.nsphere", "fit_nsphere", lambda answer: answer[0])),
    "compas": ("compas", named("compas.geometry", "bestfit_sphere_numpy", lambda answer: answer[0])),
}
CIRCLES = {"circle-fit": ("circle_fit", named("circle_fit", "taubinSVD", lambda answer: answer[:2]))}
ROBUST = {"scikit-image": ("skimage", scikit_image, 2), "pyransac3d": ("pyransac3d", pyransac3d, 3)}


def fit_of(name, table, *arguments):
    """A peer's fit; the benchmark is skipped where it is not installed."""
    module, make, *_ = table[name]
    if not importlib.util.find_spec(module):
        pytest.skip(f"{name} is not installed")
    return make(*arguments)


def one_by_one(fit, sets):
    """Fit each set in a loop."""
    for x in sets:
        fit(x)


def half_sphere(rng, shape, noise):
    """Noisy points on half a sphere about the origin."""
    u = rng.standard_normal(shape)
    u[..., 0] = np.abs(u[..., 0])
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    return u + noise * rng.standard_normal(u.shape)


def levenberg_marquardt(x):
    """Scipy's least squares with an analytic Jacobian, from the algebraic answer."""
    centre, radius = naive.lls(x)

    def residuals(p):
        return np.sqrt(((x - p[:3]) ** 2).sum(axis=1)) - p[3]

    def jacobian(p):
        y = p[:3] - x
        return np.hstack([y / np.sqrt((y**2).sum(axis=1))[:, None], -np.ones((len(x), 1))])

    return optimize.least_squares(residuals, np.append(centre, radius), jac=jacobian, method="lm").x[:3]


def orthogonal_distance(x):
    """scipy.odr of the implicit sphere, which SciPy has deprecated."""
    centre, radius = naive.lls(x)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        from scipy import odr

        model = odr.Model(lambda p, v: ((v - p[:3, None]) ** 2).sum(axis=0) - p[3] ** 2, implicit=True)
        return odr.ODR(odr.Data(x.T, 1), model, beta0=np.append(centre, radius)).run().beta[:3]

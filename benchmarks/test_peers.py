"""What a user would pick instead, on the same points: time per fit.

The aims: ten thousand fits of 100 points through `study.fit` 60 times as fast as the fastest closed form in a loop,
MLE 50 times as fast as scipy's Levenberg-Marquardt, and one fit no slower than the fastest peer. A peer that is not
installed is skipped by name.
"""

import importlib
from functools import partial
from operator import attrgetter

import naive
import numpy as np
import pytest
from scipy import optimize
from studies import caps

import study

SETS, FEW = 10_000, 100
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # scikit-guess, and SciPy's odr
vars(np).setdefault("float_", np.float64)  # the name that scikit-guess 0.0.2 asks for


def peer(path, center):
    """A package's function by its path, as a function of points (n, d) that returns the centre."""
    module, _, name = path.partition(":")
    fit = attrgetter(name)(pytest.importorskip(module, reason=f"{module} is not installed"))
    return lambda x, *more, **options: center(fit(x, *more, **options))


def levenberg_marquardt():
    """Scipy's least squares with an analytic Jacobian, from the algebraic answer."""

    def residuals(p, x):
        return np.sqrt(((x - p[:3]) ** 2).sum(axis=1)) - p[3]

    def jacobian(p, x):
        y = p[:3] - x
        return np.hstack([y / np.sqrt((y**2).sum(axis=1))[:, None], -np.ones((len(x), 1))])

    solve = partial(optimize.least_squares, residuals, jac=jacobian, method="lm")
    return lambda x: solve(np.hstack(naive.lls(x)), args=(x,)).x[:3]


def orthogonal_distance():
    """scipy.odr of the implicit sphere, which SciPy has deprecated."""
    odr = importlib.import_module("scipy.odr")
    model = odr.Model(lambda p, v: ((v - p[:3, None]) ** 2).sum(axis=0) - p[3] ** 2, implicit=True)
    return lambda x: odr.ODR(odr.Data(x.T, 1), model, beta0=np.hstack(naive.lls(x))).run().beta[:3]


CLOSED = {
    "scikit-guess": partial(peer, "skg:nsphere_fit", lambda answer: answer[1]),
    "scikit-spatial": partial(peer, "skspatial.objects:Sphere.best_fit", lambda answer: answer.point),
    "trimesh": partial(peer, "trimesh.nsphere:fit_nsphere", lambda answer: answer[0]),
    "compas": partial(peer, "compas.geometry:bestfit_sphere_numpy", lambda answer: answer[0]),
}
"""Makers of the same algebraic fit, by the names of the packages."""
CIRCLE = partial(peer, "circle_fit:taubinSVD", lambda answer: answer[:2])
OURS = "study.fit, ten thousand at once"
GROUPS = {
    "closed form, 3-D, N = 100, per fit": {
        f"{OURS}, gdke": "gdke",
        **{f"{name}, in a loop": (fit, FEW, 1e-6, "≥ 60 (the fastest)") for name, fit in CLOSED.items()},
    },
    "maximum likelihood, 3-D, N = 100, per fit": {
        f"{OURS}, mle": "mle",
        f"{OURS}, corrected": "corrected",  # without the bias of the maximum
        "scipy least_squares, Levenberg-Marquardt, in a loop": (levenberg_marquardt, FEW, 1e-4, "≥ 50"),
        "scipy.odr, in a loop": (orthogonal_distance, 10, 1e-4, ""),
    },
    "Taubin, 2-D, N = 100, per fit": {
        f"{OURS}, taubin": "taubin",
        "circle-fit taubinSVD, in a loop": (CIRCLE, FEW, 1e-8, ""),
    },
}
"""Rows of each group, ours first: an estimator, or a peer's maker, sets, tolerance of its centre, and the aim."""


def one_by_one(fit, sets):
    """Fit each set in a loop."""
    return [fit(x) for x in sets]


@pytest.fixture(scope="module")
def points():
    """Sets (10 000, 100, 3) on half a sphere about (1, 2, 3), with noise of 5 % of the radius."""
    return np.array([1.0, 2.0, 3.0]) + caps(np.random.default_rng(1), SETS, 100, 90.0, 0.05)


@pytest.mark.parametrize(("group", "what"), [(group, what) for group, rows in GROUPS.items() for what in rows])
def test_many_fits(timed, points, group, what):
    """Ours of all sets at once, and a peer's one by one, which agrees on the centre."""
    unit, points = next(iter(GROUPS[group].values())), np.ascontiguousarray(points[..., : 2 if "2-D" in group else 3])
    row = GROUPS[group][what]
    if isinstance(row, str):
        timed(group, what, study.fit, points, row, items=SETS, unit=row == unit, aim="" if row == unit else "≤ 1.5")
        return
    make, few, tolerance, aim = row
    fit = make()
    np.testing.assert_allclose(fit(points[0]), study.fit(points[0], unit).center, atol=tolerance)
    timed(group, what, one_by_one, fit, points[:few], items=few, aim=aim, rounds=10 if few == FEW else 5)


@pytest.mark.parametrize("name", ['study.fit(points, "gdke")', *CLOSED])
def test_one_fit(timed, points, name):
    """A single set of 100 points, the call included."""
    ours = name not in CLOSED
    fit = partial(study.fit, estimator="gdke") if ours else CLOSED[name]()
    unit = {"unit": True} if ours else {"aim": "≥ 1", "rounds": 10}
    timed("one fit, 3-D, N = 100", name, one_by_one, fit, points[:FEW], items=FEW, **unit)

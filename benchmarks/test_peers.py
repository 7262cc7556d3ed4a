"""What a user would pick instead, on the same points. A peer that is not installed is skipped by name.

The aims: ten thousand fits of 100 points through `study.fit` 60 times as fast as the fastest closed form in a loop,
MLE 50 times as fast as scipy's Levenberg-Marquardt, and one fit no slower than the fastest peer. Times are per fit;
those of peers are of as many sets as take a moment.
"""

from functools import partial

import numpy as np
import peers
import pytest

import study

SETS, SAMPLES, FEW = 10_000, 100, 100
OURS = "study.fit, ten thousand at once"


@pytest.fixture(scope="module")
def points():
    """Sets (10 000, 100, 3) on half a sphere about (1, 2, 3), with noise of 5 % of the radius."""
    return np.array([1.0, 2.0, 3.0]) + peers.half_sphere(np.random.default_rng(1), (SETS, SAMPLES, 3), 0.05)


@pytest.mark.parametrize("name", ["study", *peers.CLOSED])
def test_closed_forms(timed, points, name):
    """The same algebraic fit everywhere: all agree on the centre."""
    group = "closed form, 3-D, N = 100, per fit"
    if name == "study":
        timed(group, f"{OURS}, gdke", study.fit, points, "gdke", items=SETS, unit=True)
        return
    fit = peers.fit_of(name, peers.CLOSED)
    np.testing.assert_allclose(fit(points[0]), study.fit(points[0], "gdke").center, atol=1e-6)
    what, aim = f"{name}, in a loop", "≥ 60 (the fastest)"
    timed(group, what, peers.one_by_one, fit, points[:FEW], items=FEW, aim=aim, rounds=10)


@pytest.mark.parametrize("name", ["study", *peers.CLOSED])
def test_one_fit(timed, points, name):
    """A single set of 100 points, the call included."""
    group = "one fit, 3-D, N = 100"
    if name == "study":
        ours = partial(study.fit, estimator="gdke")
        timed(group, 'study.fit(points, "gdke")', peers.one_by_one, ours, points[:FEW], items=FEW, unit=True)
        return
    fit = peers.fit_of(name, peers.CLOSED)
    timed(group, name, peers.one_by_one, fit, points[:FEW], items=FEW, aim="≥ 1", rounds=10)


@pytest.mark.parametrize("name", ["study", "corrected", "levenberg_marquardt", "orthogonal_distance"])
def test_geometric_fits(timed, points, name):
    """The maximum-likelihood sphere, by whoever iterates."""
    group = "maximum likelihood, 3-D, N = 100, per fit"
    if name == "study":
        timed(group, f"{OURS}, mle", study.fit, points, "mle", items=SETS, unit=True)
        return
    if name == "corrected":  # without the bias of the maximum
        timed(group, f"{OURS}, corrected", study.fit, points, "corrected", items=SETS, aim="≤ 1.5")
        return
    fit, words, aim, few = {
        "levenberg_marquardt": (peers.levenberg_marquardt, "scipy least_squares, Levenberg-Marquardt", "≥ 50", FEW),
        "orthogonal_distance": (peers.orthogonal_distance, "scipy.odr", "", 10),
    }[name]
    np.testing.assert_allclose(fit(points[0]), study.fit(points[0], "mle").center, atol=1e-4)
    timed(group, f"{words}, in a loop", peers.one_by_one, fit, points[:few], items=few, aim=aim, rounds=5)


@pytest.mark.parametrize("name", ["study", *peers.CIRCLES])
def test_circles(timed, points, name):
    """Taubin's circle."""
    group, flat = "Taubin, 2-D, N = 100, per fit", np.ascontiguousarray(points[..., :2])
    if name == "study":
        timed(group, f"{OURS}, taubin", study.fit, flat, "taubin", items=SETS, unit=True)
        return
    fit = peers.fit_of(name, peers.CIRCLES)
    np.testing.assert_allclose(fit(flat[0]), study.fit(flat[0], "taubin").center, atol=1e-8)
    timed(group, f"{name} taubinSVD, in a loop", peers.one_by_one, fit, flat[:FEW], items=FEW, rounds=10)

"""Options of fits: each is used, so that the answer differs, or refused in words; none is ignored in silence."""

import numpy as np
import pytest

import study

NOISE = 0.02
VARIED = NOISE * np.linspace(0.7, 1.3, 50)
OPTIONS = {
    "noise": {"noise": 0.03},
    "covariance": {"noise": np.diag([1e-4, 4e-4, 9e-4])},
    "noise of each": {"noise": VARIED},
    "scale": {"noise": VARIED, "scale": "estimated"},
    "radius": {"radius": 1.01},
    "uncertain radius": {"radius": (1.01, 0.005)},
    "radius and noise": {"radius": 1.01, "noise": 0.03},
    "radius and covariance": {"radius": 1.01, "noise": np.diag([1e-4, 4e-4, 9e-4])},
    "ordered": {"ordered": True},
    "assume": {"assume": "sphere"},
    "law": {"law": "radial"},
}
LESS = {
    "scale": {"noise": VARIED},
    "radius and noise": {"radius": 1.01},
    "radius and covariance": {"radius": 1.01},
}
"""Options beside which the last one must make a difference."""


@pytest.fixture(scope="module")
def path():
    """Points along a path on a half sphere: the noise of neighbours is alike."""
    rng, turn = np.random.default_rng(4701), np.linspace(0.0, 12.0, 50)
    height = np.linspace(0.1, 0.95, 50)
    across = np.sqrt(1.0 - height**2)
    noise = rng.standard_normal((50, 3))
    for i in range(1, 50):
        noise[i] = 0.9 * noise[i - 1] + np.sqrt(0.19) * noise[i]
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), height]) + NOISE * noise


def everything(fit):
    """All that a fit answers with, in one row."""
    numbers = [fit.center, fit.radius, fit.sigma, fit.standard_errors, fit.interval("center"), fit.interval("radius")]
    return np.concatenate([np.ravel(part) for part in [*numbers, fit.status, fit.goodness.answers]])


def answer(points, name, options):
    """The answer of an estimator, or its refusal."""
    own = {"noise": NOISE} if study.ESTIMATORS[name].needs == "noise" else {}
    try:
        return everything(study.fit(points, name, **own | options))
    except ValueError as error:
        return str(error)


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("name", study.ESTIMATORS)
def test_used_or_refused(path, name, option):
    """The answer differs from that without the option, or a message names the estimator and those that take it."""
    without, found = answer(path, name, LESS.get(option, {})), answer(path, name, OPTIONS[option])
    if isinstance(found, str):
        assert f"'{name}'" in found or "pass noise=σ" in found
        assert "corrected" in found or "als finds" in found or "exact one" in found or "pass noise=σ" in found
    else:
        assert not isinstance(without, str)
        assert not np.array_equal(found, without, equal_nan=True)


def test_enough_take_each_option(path):
    """`corrected`, the default, takes every option; `robust` the noise of all points and an exact radius."""
    for option, options in OPTIONS.items():
        assert not isinstance(answer(path, "corrected", options), str), option
    for option in ("noise", "radius", "radius and noise", "ordered", "assume"):
        assert not isinstance(answer(path, "robust", OPTIONS[option]), str), option


@pytest.mark.parametrize("name", [name for name, entry in study.ESTIMATORS.items() if entry.moments_suffice])
def test_growing_fits(path, name):
    """A fit of moments uses the noise, or says that it finds it in the points."""
    growing = study.Incremental(3)
    growing.update(path)
    entry = study.ESTIMATORS[name]
    if name not in ("ugdk", "hinge"):
        with pytest.raises(ValueError, match=r"noise = 0\.03: this estimator finds it in the points; leave it out"):
            growing.fit(entry, 0.03)
        assert growing.fit(entry, assume="sphere").status != growing.fit(entry).status
        return
    one, two = growing.fit(entry, 0.02), growing.fit(entry, 0.03)
    assert one.sigma != two.sigma


@pytest.mark.parametrize("option", [{"noise": 0.03}, {"weighted": False}, {"ordered": True}, {"assume": "sphere"}])
def test_several_markers(path, option):
    """Each option of `mgdk` is used."""
    answers = []
    for options in ({}, option):
        fit = study.mgdk([path, 2.0 * path[::-1]], **options)
        tests = [goodness.answers for goodness in fit.goodness]
        parts = (fit.center, fit.covariance, fit.interval("center"), fit.status, *tests)
        answers.append(np.concatenate([np.ravel(part) for part in parts]))
    assert not np.array_equal(*answers)


def test_several_spheres_take_no_noise(path):
    """`fit_spheres` has no noise to give, and an estimator that needs one is refused."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'noise'"):
        study.fit_spheres(path, 1, noise=0.02)
    with pytest.raises(ValueError, match="pass noise=σ or a covariance, or use als"):
        study.fit_spheres(path, 1, estimator="ugdk")


@pytest.mark.parametrize("name", ["corrected", "robust"])
def test_a_noise_for_all_is_that_of_each(rng, on_cap, name):
    """The intervals are those of points that each have that noise, to the search's precision; half of it is refused.

    Of 40 points the residuals are twice the half by χ² in all sets but less than one in a million. Sets in which a
    point is an outlier, by chance one in a hundred, are left out.
    """
    points = on_cap(rng, 40, 70.0, noise=0.02, radius=2.0, center=1.0, sets=60)[0]
    fit, each = study.fit(points, name, 0.02), study.fit(points, noise=np.full(40, 0.02))
    kept = ~fit.outliers.any(axis=1)
    assert kept.sum() > 50
    for of in ("radius", "center"):
        np.testing.assert_allclose(fit.interval(of)[kept], each.interval(of)[kept], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(fit.sigma, np.full(60, 0.02))
    np.testing.assert_array_equal(fit.center, study.fit(points, name).center)
    assert fit.noise_scale[kept] == pytest.approx(np.ones(kept.sum()), rel=0.5)
    assert not study.fit(points, name, 0.01).ok[kept].any()
    assert study.fit(points, name, 0.02).ok.mean() > 0.85


def test_copies_count_once_in_intervals(on_cap):
    """Also where the noise, or the radius, is known: rows that repeat earlier ones change no end."""
    points = on_cap(np.random.default_rng(7), 40, 70.0, noise=0.02, radius=2.0)[0]
    for known in ({"noise": 0.02}, {"radius": 2.0}, {"noise": np.full(40, 0.02)}):
        twice = known if np.ndim(known.get("noise", 0.0)) == 0 else {"noise": np.full(60, 0.02)}
        one, two = study.fit(points, **known), study.fit(np.vstack([points, points[:20]]), **twice)
        np.testing.assert_allclose(one.interval("center"), two.interval("center"), rtol=0, atol=1e-6)

"""The status of a fit by the interval of its radius, and that interval as a fit gives it."""

import numpy as np
import pytest

import study
from study import Samples, Status
from study.estimators.intervals import interval, intervals


@pytest.fixture(scope="module")
def weak(on_cap):
    """Forty sets of 40 points on a cap of 5°, whose curvature is of the size of the noise's effect on it."""
    return on_cap(np.random.default_rng(41), 40, 5.0, noise=0.0025, sets=40)[0]


def test_one_rule_for_all_estimators(weak):
    """A fit that did not fail is ok where the interval is bounded and the noise below .35 radii, else weak."""
    found = intervals(Samples(weak.swapaxes(1, 2)))
    assert 5 <= found.identified.sum() <= 38
    for name in ("mle", "als", "gdke", "taubin"):
        fit = study.fit(weak, name)
        ruled = np.isin(fit.own_status, [Status.OK, Status.INSIGNIFICANT])
        np.testing.assert_array_equal((fit.status == Status.WEAKLY_IDENTIFIED), ruled & ~found.identified)
        np.testing.assert_array_equal(fit.status[~ruled], fit.own_status[~ruled])
        insignificant = fit.status == Status.INSIGNIFICANT
        inside = (found.radius[:, 0] <= fit.radius) & (fit.radius <= found.radius[:, 1])
        assert not inside[insignificant].any()
        assert (fit.own_status[insignificant] == Status.INSIGNIFICANT).all()
        assert found.identified[fit.ok].all()
    assert study.fit(weak, "mle").ok.any()
    assert "weakly identified" in repr(study.fit(weak, "mle"))


def test_failures_stay(on_cap):
    """Points in a plane, or with something infinite, have the status that says so."""
    points = on_cap(np.random.default_rng(42), 9, 90.0, noise=0.01, sets=3)[0]
    points[0, :, 2] = 0.0
    points[1, 3, 1] = np.inf
    fit = study.fit(points)
    np.testing.assert_array_equal(fit.status, [Status.SINGULAR, Status.NOT_FINITE, Status.OK])


def test_intervals_of_a_fit(on_cap):
    """A fit's intervals are those of its points, in the shape of the batch, whatever the estimator."""
    points = on_cap(np.random.default_rng(43), 30, 60.0, noise=0.02, radius=3.0, center=2.0, sets=6)[0]
    points[4, :3, 0] = np.nan
    fit = study.fit(points.reshape(2, 3, 30, 3), "mle")
    flat = intervals(Samples(points.swapaxes(1, 2)), 0.9)
    np.testing.assert_array_equal(fit.interval("radius", 0.9), flat.radius.reshape(2, 3, 2))
    np.testing.assert_array_equal(fit.interval("center", 0.9), flat.center.reshape(2, 3, 3, 2))
    one = fit[1, 2]
    assert one.interval("radius").shape == (2,)
    assert one.interval("center").shape == (3, 2)
    assert one.interval("radius")[0] < one.radius < one.interval("radius")[1]
    with pytest.raises(ValueError, match="'radius' or of the 'center'"):
        fit.interval("diameter")


@pytest.mark.parametrize("estimator", ["corrected", "robust"])
def test_copies_count_once(on_cap, estimator):
    """Copies narrow no interval, and four points remain four however often they are repeated: they bound no radius."""
    points = on_cap(np.random.default_rng(44), 30, 60.0, noise=0.02)[0]
    alone, often = (study.fit(x, estimator) for x in (points, np.repeat(points, 20, axis=0)))
    for of in ("radius", "center"):
        np.testing.assert_array_equal(often.interval(of), alone.interval(of))
    assert often.ok
    four = study.fit(np.repeat(points[:4], 20, axis=0), estimator)
    assert four.status == Status.WEAKLY_IDENTIFIED
    np.testing.assert_array_equal(four.interval("radius"), [0.0, np.inf])


def test_nothing_is_computed_unasked(monkeypatch, on_cap):
    """A fit whose status and interval are never read computes no interval."""
    points = on_cap(np.random.default_rng(44), 30, 60.0, noise=0.02)[0]
    monkeypatch.setattr(interval, "_compute", None)
    fit = study.fit(points)
    assert np.isfinite(fit.standard_errors).all()
    assert fit.own_status == Status.OK
    with pytest.raises(TypeError):
        _ = fit.status

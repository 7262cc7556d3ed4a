"""Plans of measurements: their errors are those of fits to simulated points, and the messages."""

import numpy as np
import pytest

import study


@pytest.mark.parametrize(
    ("angle", "noise", "error", "of"),
    [(60.0, 1.0, 0.5, "center"), (180.0, 10.0, 2.0, "center"), (30.0, 0.2, 0.3, "radius")],
)
def test_fits_have_the_error_that_is_planned(rng, on_cap, angle, noise, error, of):
    """400 fits to as many points as are planned scatter by the error: 4 % for chance, 4.5 of these."""
    plan = study.plan_fit(noise, 50.0, error, angle=angle, of=of)
    points = on_cap(rng, plan.points, angle, noise=noise, radius=50.0, sets=400)[0]
    fit = study.fit(points)
    found = np.std(fit.center[:, 0] if of == "center" else fit.radius)
    assert found == pytest.approx(error, rel=0.2)
    assert (plan.center_error if of == "center" else plan.radius_error) == pytest.approx(error, rel=0.01)
    assert np.std(fit.center[:, 1]) == pytest.approx(plan.across_error, rel=0.2)


def test_the_three_plans_agree():
    """The cap for N points, the points for that cap, and the error of both are one plan."""
    first = study.plan_fit(0.1, 50.0, 0.02, angle=70.0)
    second = study.plan_fit(0.1, 50.0, 0.02, points=first.points)
    third = study.plan_fit(0.1, 50.0, angle=70.0, points=first.points)
    assert second.angle == pytest.approx(70.0, rel=1e-3)
    assert third.center_error == pytest.approx(0.02, rel=1e-3)
    bound = study.attainable_bound(70.0, 0.1 / 50.0)
    assert first.points == np.ceil(bound[0, 0] * (50.0 / 0.02) ** 2)
    assert study.plan_fit(0.1, 50.0, 100.0, angle=70.0).points == 10  # as many as intervals need


@pytest.mark.parametrize(
    ("arguments", "failure", "words"),
    [
        ({}, ValueError, "a plan needs two of error=, angle= and points=; it finds the third"),
        ({"error": 0.1, "angle": 30.0, "points": 50}, ValueError, "a plan needs two of"),
        ({"error": -0.1, "angle": 30.0}, ValueError, "error = -0.1: must be positive and finite"),
        ({"error": [0.1], "angle": 30.0}, TypeError, r"error has shape \(1,\): give one number"),
        ({"error": 0.1, "angle": 300.0}, ValueError, "angle = 300.0: give the half-angle of the cap"),
        ({"error": 0.1, "points": 5}, ValueError, "points = 5: plan with at least 10"),
        (
            {"error": 0.001, "points": 50},
            ValueError,
            "even a whole sphere has an error 24.5 times that; give more points",
        ),
        ({"error": 1e-15, "angle": 1.0}, ValueError, r"error = 1e-15: needs .* points; give a larger error or angle"),
        (
            {"error": 0.1, "angle": 30.0, "of": "diameter"},
            ValueError,
            "of = 'diameter': plan the error of the 'center'",
        ),
    ],
)
def test_bad_input(arguments, failure, words):
    """A message names the value and the remedy."""
    with pytest.raises(failure, match=words):
        study.plan_fit(0.1, 50.0, **arguments)

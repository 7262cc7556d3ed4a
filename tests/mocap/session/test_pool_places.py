"""Pooled places against the weighted mean written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from study.mocap.joints.estimates import JointStatus
from study.mocap.markersets.marker_set import Joint
from study.mocap.session.pool_places import TrialPlace, pool_places
from study.mocap.skeleton.calibration import JointPlace

NONE = np.full(3, np.nan)
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def part(trial, place, errors, status=JointStatus.OK, axis=NONE):
    """A trial's place; the child's axes are turned by 90° and 1 m away."""
    at = np.asarray(place, dtype=float)
    return TrialPlace(
        trial,
        JointPlace(
            joint=Joint(name="hip", parent="pelvis", child="thigh"),
            status=status,
            reason=status.text,
            in_parent=at,
            in_child=TURN.T @ at + 1.0,
            covariance=np.diag(np.square(errors)),
            axis_in_parent=np.asarray(axis, dtype=float),
            axis_in_child=NONE,
            mean_rotation=TURN,
        ),
    )


def test_weighted_mean():
    """Each coordinate is weighted by its own error: 1 : 4 and 4 : 1; the child's place is the same point."""
    found = pool_places(
        [part("a", (0, 0, 0), (0.001, 0.002, 0.001)), part("b", (0.005, 0.005, 0), (0.002, 0.001, 0.001))]
    )
    np.testing.assert_allclose(found.place.in_parent, [0.001, 0.004, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.place.in_child, TURN.T @ found.place.in_parent + 1.0, atol=1e-12)
    np.testing.assert_allclose(found.place.covariance, np.diag([0.8e-6, 0.8e-6, 0.5e-6]), atol=1e-15)
    assert set(found.place.trials) == {"a", "b"}


def test_a_hinge_counts_across_its_axis_only():
    """A trial that moved a ball about one axis alone says nothing along that."""
    ball = part("ball", (0, 0, 0), (0.002, 0.002, 0.002))
    hinge = part("hinge", (0.004, 0.004, 0.5), (0.002, 0.002, 0.0), JointStatus.HINGE, (0, 0, 1))
    found = pool_places([hinge, ball])
    np.testing.assert_allclose(found.place.in_parent, [0.002, 0.002, 0.0], atol=1e-12)
    assert found.place.status == JointStatus.OK
    assert found.place.trials == ("ball", "hinge")


def test_two_hinges_keep_the_place_along_the_axis():
    one = part("one", (0, 0, 0.1), (0.001, 0.001, 0.0), JointStatus.HINGE, (0, 0, 1))
    two = part("two", (0.004, 0, 0.3), (0.002, 0.002, 0.0), JointStatus.HINGE, (0, 0, 1))
    found = pool_places([two, one])
    np.testing.assert_allclose(found.place.in_parent, [0.0008, 0.0, 0.1], atol=1e-12)
    assert found.place.status == JointStatus.HINGE


def test_trials_that_are_not_reliable_do_not_count():
    good = part("good", (0, 0, 0), (0.002,) * 3)
    found = pool_places([part("bad", (0.05, 0, 0), (0.001,) * 3, JointStatus.UNSURE), good])
    np.testing.assert_array_equal(found.place.in_parent, np.zeros(3))
    assert found.place.trials == ("good",)


def test_none_is_reliable():
    """The best of them is taken, with its own status."""
    parts = [
        part("a", (0.05, 0, 0), (0.03,) * 3, JointStatus.UNSURE),
        part("b", (0.01, 0, 0), (0.02,) * 3, JointStatus.UNSURE),
        part("c", NONE, (0.001,) * 3, JointStatus.STILL),
    ]
    found = pool_places(parts)
    assert (found.place.trials, found.place.status) == (("b",), JointStatus.UNSURE)


def test_reliable_trials_that_contradict_each_other():
    """The best one's place stays, and its covariance covers the other; a word says so."""
    found = pool_places([part("a", (0, 0, 0), (0.002,) * 3), part("b", (0.03, 0, 0), (0.003,) * 3)])
    assert found.place.status == JointStatus.DISAGREE
    assert found.place.reason == "b puts it 30 mm from where a does: beyond what the errors explain"
    np.testing.assert_array_equal(found.place.in_parent, np.zeros(3))
    assert found.place.standard_error == pytest.approx(np.hypot(0.03, 0.002))
    near = pool_places([part("a", (0, 0, 0), (0.002,) * 3), part("b", (0.009, 0, 0), (0.003,) * 3)])
    assert near.place.status == JointStatus.OK  # below a centimetre


def test_axes_that_contradict_each_other():
    one = part("one", (0, 0, 0), (0.001, 0.001, 0.0), JointStatus.HINGE, (0, 0, 1))
    tilted = replace(one.place, axis_in_parent=np.array([0.0, np.sin(0.5), np.cos(0.5)]))
    found = pool_places([one, TrialPlace("two", tilted)])
    assert found.place.status == JointStatus.DISAGREE
    assert "its axis turned by 29°" in found.place.reason

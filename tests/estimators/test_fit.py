"""The public call `study.fit`: shapes, batches, wrong input, and the fields of its answer."""

import pickle
from typing import get_type_hints

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

import study
from study import Estimates, Status
from study.estimators.estimates import blank


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("lead", [(), (1,), (4,), (2, 3), (0,), (2, 0)])
def test_shapes(rng, on_cap, estimator, lead, d):
    """The answer has the leading axes of the points; an empty batch has an empty answer."""
    points = on_cap(rng, 20, d=d, noise=0.01, sets=max(int(np.prod(lead)), 1))[0][: int(np.prod(lead))]
    fit = study.fit(points.reshape(*lead, 20, d), estimator, noise=0.01)
    assert fit.center.shape == (*lead, d)
    for name in Estimates._fields:
        assert getattr(fit.estimates, name).shape == ((*lead, d) if name == "center" else lead), name
    assert np.all(fit.own_status == Status.OK)
    np.testing.assert_allclose(fit.radius, 1.0, atol=0.1)
    np.testing.assert_array_equal(fit.count, 20)


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("n", [6, 17, 512, 1300])
def test_batched_equals_looped(rng, on_cap, estimator, n, d):
    """A set's answer is the same to the last bit alone and in a batch."""
    points = on_cap(rng, n, 90.0, d, noise=0.01, sets=6)[0]
    together = study.fit(points, estimator, noise=0.01)
    for t in range(6):
        alone = study.fit(points[t], estimator, noise=0.01)
        for name, one, whole in zip(Estimates._fields, alone.estimates, together.estimates, strict=True):
            np.testing.assert_array_equal(one, whole[t], err_msg=name)


@pytest.mark.parametrize("kind", ["int64", "int16", "uint8", "float32", ">f8", "list", "frame"])
def test_kinds_of_points(estimator, kind):
    """Integers, short and foreign floats, lists and data frames are points too."""
    exact = np.array([[9, 5, 5], [1, 5, 5], [5, 9, 5], [5, 1, 5], [5, 5, 9], [5, 5, 1]])
    points = {"list": exact.tolist(), "frame": pd.DataFrame(exact)}.get(kind)
    fit = study.fit(exact.astype(kind) if points is None else points, estimator, noise=1e-9)
    np.testing.assert_allclose(fit.center, 5.0, atol=1e-12)
    assert fit.radius == pytest.approx(4.0, abs=1e-12)


def test_points_are_left_alone(rng, on_cap, estimator):
    """The caller's array is not written to, and may be read-only or any view."""
    points = on_cap(rng, 30, noise=0.01)[0]
    kept = points.copy()
    points.flags.writeable = False
    fit = study.fit(points, estimator, noise=0.01)
    np.testing.assert_array_equal(points, kept)
    view = study.fit(np.repeat(points, 2, axis=0)[::2], estimator, noise=0.01)
    np.testing.assert_allclose(view.center, fit.center, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", [(), (3,), (5, 1), (4, 5, 1), (3, 3), (0, 3), (2, 2), (7, 4, 4)])
def test_wrong_shapes(estimator, shape):
    """Points of another shape than (…, n, d) with n > d ≥ 2 raise an error that shows the shape."""
    with pytest.raises(ValueError, match="points have shape") as caught:
        study.fit(np.zeros(shape), estimator, noise=0.1)
    assert str(shape) in str(caught.value)


@pytest.mark.parametrize("kind", [str, complex, bool, object])
def test_wrong_types(kind):
    """Text, complex numbers, truth values and objects raise a TypeError that names the dtype."""
    points = np.arange(18).reshape(6, 3).astype(kind)
    with pytest.raises(TypeError, match="dtype"):
        study.fit(points, "gdke")


@pytest.mark.parametrize("name", ["sphere", "", "MLE"])
def test_unknown_estimator(name):
    """An unknown name raises an error that lists the known ones."""
    with pytest.raises(ValueError, match="known") as caught:
        study.fit(np.eye(4, 3), name)
    assert all(known in str(caught.value) for known in study.ESTIMATORS)


def test_an_estimator_that_is_no_name():
    """Anything but a name is a type error that says so."""
    with pytest.raises(TypeError, match="estimator = 3: expected a name"):
        study.fit(np.eye(4, 3), 3)


def test_ugdk_without_noise():
    """The estimator that needs the noise raises an error that says how to pass it."""
    with pytest.raises(ValueError, match="noise="):
        study.fit(np.eye(4, 3), "ugdk")


@pytest.mark.parametrize(
    ("noise", "says"),
    [
        (-0.1, "positive"),
        (0.0, "positive"),
        (np.nan, "positive"),
        (np.inf, "finite"),
        ([0.1, 0.1, 0.1], r"\(3,\)"),
        (np.eye(2), r"\(2, 2\)"),
        (np.eye(3)[None], r"\(1, 3, 3\)"),
        (np.diag([1.0, 1.0, -1.0]), "positive definite"),
        (np.ones((3, 3)), "positive definite"),
        ([[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "symmetric"),
        (np.diag([1.0, np.nan, 1.0]), "finite"),
    ],
)
def test_wrong_noise(rng, on_cap, estimator, noise, says):
    """Noise that is neither a standard deviation nor a covariance raises an error that says why."""
    with pytest.raises(ValueError, match="noise") as caught:
        study.fit(on_cap(rng, 10)[0], estimator, noise=noise)
    caught.match(says)


@pytest.mark.parametrize("noise", [1e-200, 1e200])
def test_extreme_noise(rng, on_cap, estimator, noise):
    """A noise whose variance is out of the range of float64 raises an error too."""
    with pytest.raises(ValueError, match="noise"):
        study.fit(on_cap(rng, 10)[0], estimator, noise=noise)


@pytest.mark.parametrize("name", Estimates._fields)
def test_fit_is_frozen(rng, on_cap, name):
    """An array of a fit cannot be replaced by accident."""
    fit = study.fit(on_cap(rng, 10)[0])
    with pytest.raises(AttributeError):
        setattr(fit, name, None)


def test_blank_fit_has_the_declared_types():
    """The arrays that an estimator fills in have the types that the fields of `Estimates` declare, all NaN or zero."""
    declared = get_type_hints(Estimates)
    assert list(declared) == list(Estimates._fields)
    for name, array in zip(Estimates._fields, blank(4, 3), strict=True):
        assert declared[name] == NDArray[array.dtype.type], name
        assert np.isnan(array).all() if array.dtype == float else not array.any()


def test_fit_survives_pickling(rng, on_cap):
    """A fit that was sent to another process has the same arrays and still holds its points."""
    fit = study.fit(on_cap(rng, 10, noise=0.01)[0])
    again = pickle.loads(pickle.dumps(fit))
    for one, two in zip(again.estimates, fit.estimates, strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(again.covariance, fit.covariance)
    assert again.count == 10


def test_statuses_carry_text():
    """Every status has a text of its own, survives storage as an integer, and ok is 0."""
    assert Status.OK == 0
    assert len({status.text for status in Status}) == len(Status)
    assert all(status.text and Status(int(status)) is status for status in Status)

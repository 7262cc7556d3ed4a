"""A `Fit` as an answer: residuals and what metrologists form of them, batches, tables, words and pictures.

The public call `study.fit`: shapes, batches, wrong input, and the fields of its answer.

Missing samples: the answer is the same as without the rows with a NaN, whatever their number and place.

Masked arrays: a masked sample is missing.
"""

import json
import pickle
import re
from typing import get_type_hints

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

import study
from study import Estimates, Fit, Status
from study.fits.cap import sample_cap
from study.fits.registry import fit_samples
from study.fits.samples import blank


@pytest.fixture
def points(rng, on_cap):
    """Six sets of 25 points, in two rows of three, some of them missing, and one set without a sphere."""
    points = on_cap(rng, 25, 100.0, noise=0.05, radius=2.0, center=1.0, sets=6)[0].reshape(2, 3, 25, 3)
    points[0, 1, 4:9, 2] = np.nan
    points[1, 2] = 1.0
    return points


def test_by_definition(points):
    """Residuals are distances from the sphere; form error, deviation, diameter and σ are formed as defined."""
    fit = study.fit(points)
    distance = np.linalg.norm(points - fit.center[..., None, :], axis=-1)
    np.testing.assert_allclose(fit.residuals, distance - fit.radius[..., None], rtol=0, atol=1e-13)
    assert np.isnan(fit.residuals[0, 1, 4:9]).all()
    assert np.isnan(fit.residuals[1, 2]).all()
    good = fit.ok
    np.testing.assert_array_equal(good, [[True, True, True], [True, True, False]])
    held = fit.residuals[good]
    np.testing.assert_allclose(fit.form_error[good], np.nanmax(held, axis=1) - np.nanmin(held, axis=1))
    np.testing.assert_allclose(fit.largest_deviation[good], np.nanmax(np.abs(held), axis=1))
    np.testing.assert_allclose(fit.residual_rms[good], np.sqrt(np.nanmean(held**2, axis=1)))
    assert np.isnan(fit.form_error[1, 2])
    assert np.isnan(fit.largest_deviation[1, 2])
    np.testing.assert_array_equal(fit.diameter[good], 2.0 * fit.radius[good])
    np.testing.assert_array_equal(fit.sigma[good] ** 2, np.sqrt(fit.noise_variance[good]) ** 2)


def test_uncertainties(points):
    """Correlation and expanded uncertainty follow from the covariance."""
    fit = study.fit(points[0])
    np.testing.assert_array_equal(fit.expanded_uncertainty(), 2.0 * fit.standard_errors)
    np.testing.assert_array_equal(fit.expanded_uncertainty(3), 3.0 * fit.standard_errors)
    for covariance, correlation in zip(fit.covariance, fit.correlation, strict=True):
        root = np.diag(1.0 / np.sqrt(np.diag(covariance)))
        np.testing.assert_allclose(correlation, root @ covariance @ root, rtol=1e-12)


@pytest.mark.parametrize(
    "index", [0, -1, (1, 2), slice(None, None, -1), np.array([1, 0, 1]), ..., None, (slice(None), [True, False, True])]
)
def test_indexing(points, index):
    """A part of a batch is the fit of that part of the points."""
    part, alone = study.fit(points)[index], study.fit(points[index])
    assert part.shape == alone.shape
    for name in ("center", "radius", "status", "residuals", "covariance", "count", "ok"):
        one, two = getattr(part, name), getattr(alone, name)
        assert one.shape == two.shape, name
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-15, err_msg=name)


def test_masks_lengths_and_loops(points):
    """A mask selects fits; a batch has a length and can be looped over; a single fit has neither."""
    fit = study.fit(points)
    assert fit[fit.ok].shape == (5,)
    assert len(fit) == 2
    assert [len(row) for row in fit] == [3, 3]
    np.testing.assert_array_equal([[one.radius for one in row] for row in fit], fit.radius)
    single = fit[0, 0]
    assert single.shape == ()
    for act in (len, iter, bool, lambda each: each[0]):
        with pytest.raises(TypeError, match="fit"):
            act(single)


def test_frame(points):
    """A row per fit, in the order of the batch, indexed by its axes."""
    fit = study.fit(points)
    table = fit.to_frame()
    assert list(table.index) == [(i, j) for i in range(2) for j in range(3)]
    np.testing.assert_array_equal(table[["center_1", "center_2", "center_3"]], fit.center.reshape(6, 3))
    np.testing.assert_array_equal(table["radius_error"], fit.standard_errors[..., 3].ravel())
    np.testing.assert_array_equal(table["samples"], [25, 20, 25, 25, 25, 25])
    assert list(table["status"]) == [Status(int(s)).text for s in fit.status.ravel()]
    assert len(fit[0, 0].to_frame()) == 1


def test_words(points):
    """The text of a fit has its numbers with their errors and its status; that of a batch counts the statuses."""
    fit = study.fit(points)
    assert repr(fit) == "Fit(corrected: 6 fits of shape (2, 3), 5 ok, 1 singular)"
    error = fit.standard_errors[0, 0, 3]
    said = repr(fit[0, 0])
    assert said.startswith("Fit(corrected: center (")
    assert said.endswith(", 25 points, ok)")
    value, _, uncertainty = said.partition("radius ")[2].partition(",")[0].partition(" ± ")
    assert float(value) == pytest.approx(float(fit.radius[0, 0]), abs=0.6 * 10.0 ** np.floor(np.log10(error) - 1))
    assert float(uncertainty) == pytest.approx(float(error), rel=0.05)
    assert repr(fit[1, 2]).endswith("singular)")
    page = study.fit(np.concatenate([points.reshape(6, 25, 3)] * 3))._repr_html_()
    assert page.count("<tr>") == 11
    assert "the first 10 are shown" in page
    assert "<td>singular</td>" in page


@pytest.mark.parametrize("d", [2, 3])
def test_picture(rng, on_cap, d):
    """Points, centre and circle or sphere are drawn, and a residual per point."""
    points = on_cap(rng, 30, 100.0, d, noise=0.02)[0]
    fit = study.fit(points)
    figure = fit.plot()
    figure.draw_without_rendering()
    left, right = figure.axes
    drawn = np.array(left.lines[0].get_data_3d() if d == 3 else left.lines[0].get_data())
    np.testing.assert_array_equal(drawn, points.T)
    np.testing.assert_array_equal(right.lines[1].get_ydata(), fit.residuals)


def test_pictures_that_cannot_be(rng, points):
    """A batch, and more than three dimensions, are refused with the remedy."""
    with pytest.raises(ValueError, match=r"fit\[0\]\.plot"):
        study.fit(points).plot()
    with pytest.raises(ValueError, match="4 dimensions"):
        study.fit(rng.standard_normal((20, 4))).plot()


def test_an_estimators_own_covariance(points, monkeypatch):
    """An estimator that states the covariance of its answers is taken at its word, missing samples left out."""

    def rule(samples, estimates):
        assert not np.isnan(samples.x).any()
        return samples.x.shape[2] * estimates.radius[:, None, None] * np.eye(4)

    entry = study.ESTIMATORS["gdke"]
    monkeypatch.setitem(study.ESTIMATORS, "own", study.Estimator(entry.function, covariance=rule))
    fit = study.fit(points, "own")
    expected = fit.count[..., None, None] * fit.radius[..., None, None] * np.eye(4)
    np.testing.assert_array_equal(fit.covariance[fit.ok], expected[fit.ok])
    assert fit.estimator == "own"
    np.testing.assert_array_equal(fit[0].covariance, fit.covariance[0])
    too_few = study.fit(np.where(np.arange(25)[:, None] < 3, points[0, 0], np.nan), "own")
    assert np.isnan(too_few.covariance).all()


def test_distances_from_the_sphere(points):
    """Signed distances of any points, by NumPy's norm; a batch takes its own points, common ones, or one point."""
    fit, one = study.fit(points), study.fit(points[0, 0])
    np.testing.assert_allclose(fit.distance(points), fit.residuals, rtol=0, atol=1e-12)
    others = np.random.default_rng(3).normal(0.0, 9.0, (7, 3))
    expected = np.linalg.norm(others - fit.center[..., None, :], axis=-1) - fit.radius[..., None]
    np.testing.assert_allclose(fit.distance(others), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fit.distance(others[0]), expected[..., 0], rtol=0, atol=1e-12)
    assert one.distance(one.center) == -one.radius
    assert np.isnan(one.distance([[np.nan, 0, 0], [1, 2, 3]])).tolist() == [True, False]
    assert one.distance(np.zeros((4, 5, 3))).shape == (4, 5)
    with pytest.raises(ValueError, match=r"shape \(7, 2\): the fit needs 3 coordinates"):
        one.distance(others[:, :2])
    with pytest.raises(ValueError, match="leading axes must match"):
        fit.distance(np.zeros((99, 7, 3)))
    with pytest.raises(TypeError, match="points have dtype"):
        one.distance([["a", "b", "c"]])


def test_intervals_by_name(points):
    """The diameter's interval is twice the radius's; each coordinate's is its row of the centre's."""
    for fit in (study.fit(points), study.fit(points[0, 0])):
        np.testing.assert_array_equal(fit.interval("diameter", 0.9), 2.0 * fit.interval("radius", 0.9))
        for i, letter in enumerate("xyz"):
            for name in (letter, f"center_{i + 1}"):
                np.testing.assert_array_equal(fit.interval(name), fit.interval("center")[..., i, :])
    with pytest.raises(ValueError, match=r"of = 'w': .*'radius', 'diameter', 'center', 'x', 'y', 'z'"):
        fit.interval("w")
    four = study.fit(np.random.default_rng(1).standard_normal((30, 4)))
    assert four.interval("center_4").shape == (2,)
    with pytest.raises(ValueError, match="'center_4'"):
        four.interval("x")


def test_numbers_as_plain_python(points):
    """A dictionary that JSON takes as it is, with the library's numbers; a batch is refused with the remedy."""
    fit = study.fit(points[0, 0])
    plain = fit.to_dict()
    again = json.loads(json.dumps(plain, allow_nan=bool(np.isnan(fit.condition))))
    assert list(again) == list(plain)
    assert plain["center"] == fit.center.tolist()
    assert plain["diameter_error"] == 2.0 * fit.standard_errors[-1]
    assert plain["radius_interval"] == fit.interval("radius").tolist()
    assert (plain["status_text"], plain["ok"]) == (fit.status_text, bool(fit.ok))
    assert {type(value) for value in plain.values()} <= {str, bool, int, float, list, dict, type(None)}
    with pytest.raises(ValueError, match="take one, or to_frame"):
        study.fit(points).to_dict()


def test_statuses_in_words(points):
    """A text for one fit, an array of texts for a batch."""
    flat = np.column_stack([np.arange(9.0), np.arange(9.0) ** 2, np.zeros(9)])
    assert study.fit(flat).status_text == study.Status.SINGULAR.text
    words = study.fit(np.stack([flat, points[0, 0, :9]]), "als").status_text
    assert (words.shape, words[0]) == ((2,), study.Status.SINGULAR.text)


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("sigma", "give noise="),
        ("sigmas", "give noise="),
        ("weights", "give noise=, the standard deviation of each point"),
        ("estimators", "did you mean 'estimator'"),
        ("ransac", "known are points, estimator, noise, radius, scale, copy, ordered"),
    ],
)
def test_arguments_of_other_libraries(points, argument, words):
    """They are answered with what there is, in one line."""
    with pytest.raises(TypeError, match=re.escape(words)) as caught:
        study.fit(points, **{argument: 1.0})
    assert str(caught.value).startswith(f"study.fit takes no {argument}=: ")
    assert "\n" not in str(caught.value)


def test_fits_without_points():
    """An answer that does not hold its points still has numbers and words, and says what it lacks."""
    fit = Fit(blank(2, 3))
    assert "2 fits" in repr(fit)
    assert "center (" in repr(fit[0])
    assert len(fit.to_frame()) == 2
    with pytest.raises(ValueError, match=r"study\.fit"):
        _ = fit.residuals


def test_without_batch(points):
    """A named estimator fits a batch of samples."""
    fit = study.fit(points[0, [0, 2]])
    assert fit_samples(fit.samples, "als").shape == (2,)


def test_joint_answer(rng, on_cap):
    """The answer of several markers has residuals per marker, a row per marker, and words."""
    markers = [on_cap(rng, 30 + i, 100.0, noise=0.02, radius=1.0 + i, center=3.0)[0] for i in range(2)]
    joint = study.mgdk(markers)
    assert joint.ok
    assert joint.sigma == pytest.approx(np.sqrt(joint.noise_variance))
    for points, radius, residuals in zip(markers, joint.radii, joint.residuals, strict=True):
        expected = np.linalg.norm(points - joint.center, axis=1) - radius
        np.testing.assert_allclose(residuals, expected, rtol=0, atol=1e-14)
    table = joint.to_frame()
    np.testing.assert_array_equal(table["radius"], joint.radii)
    np.testing.assert_array_equal(table["error_2"], np.sqrt(joint.covariance[1, 1]))
    assert list(table["samples"]) == [30, 31]
    assert repr(joint).startswith(f"JointFit(center ({joint.center[0]:.4f} ± ")
    assert repr(joint).endswith("61 points, ok)")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(joint)).center, joint.center)
    assert "singular" in repr(study.mgdk([np.ones((9, 3))]))


def test_names_are_offered():
    """Completion offers the public names before they are imported."""
    assert set(study.__all__) <= set(dir(study))
    assert "import_module" not in dir(study)


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


FIELDS = ["own_status" if name == "status" else name for name in study.Estimates._fields]

REPORTS = ["count", "residual_rms", "covariance", "standard_errors"]

HOLES = [0, 1, 0, 7, 7, 30, 33, 36, 37, 40, 12, 0]
"""Number of missing samples, of 40, in each of the sets below; a sphere needs 4."""


@pytest.fixture(scope="module")
def full(on_cap):
    """Twelve sets of 40 samples without holes."""
    return on_cap(np.random.default_rng(31), 40, 120.0, noise=0.02, radius=2.0, center=1.0, sets=12)[0]


@pytest.fixture(scope="module")
def holed(full):
    """The sets with these numbers of rows missing, each row by one, two or three of its coordinates."""
    rng, points = np.random.default_rng(32), full.copy()
    for t, holes in enumerate(HOLES):
        for row in rng.choice(40, holes, replace=False):
            points[t, row, rng.choice(3, rng.integers(1, 4), replace=False)] = np.nan
    return points


def rest(points):
    """The samples that are not missing."""
    return points[~np.isnan(points).any(axis=1)]


@pytest.mark.parametrize("noise", [0.02, 0.02**2 * np.diag([1.0, 2.0, 0.5])])
def test_a_mixed_batch(holed, estimator, noise):
    """Each set of a batch has the answer of its own remaining samples to the last bit, errors to rounding."""
    if estimator == "hinge" and np.ndim(noise) == 2:
        with pytest.raises(ValueError, match="noise=σ"):
            study.fit(holed, estimator, noise)
        return
    fit = study.fit(holed, estimator, noise)
    np.testing.assert_array_equal(fit.count, 40 - np.array(HOLES))
    for t, points in enumerate(holed):
        if 40 - HOLES[t] < 4:
            assert fit.own_status[t] == Status.TOO_FEW_POINTS
            for name in ("center", "radius", "noise_variance", "condition", "residual_rms"):
                assert np.isnan(getattr(fit, name)[t]).all(), name
            assert not np.isfinite(fit.standard_errors[t]).any()
            continue
        alone = study.fit(rest(points), estimator, noise)
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(fit, name)[t], getattr(alone, name), err_msg=name)
        for name in REPORTS:
            got, expected = getattr(fit, name)[t], getattr(alone, name)
            np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12, err_msg=name)


def test_whole_sets_are_not_affected(full, holed, estimator):
    """Sets without holes have, to the last bit, the answer that they have in a batch without holes."""
    fit = study.fit(holed, estimator, 0.02)
    whole = np.flatnonzero(np.array(HOLES) == 0)
    clean = study.fit(full[whole], estimator, 0.02)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(fit, name)[whole], getattr(clean, name), err_msg=name)


def test_values_beside_a_hole_do_not_matter(holed, estimator):
    """The other coordinates of a missing row have no effect, infinite ones included."""
    changed = holed.copy()
    for value, t in [(1e6, 3), (np.inf, 4), (-np.inf, 5)]:
        rows = np.isnan(changed[t]).any(axis=1)
        changed[t][rows] = np.where(np.isnan(changed[t][rows]), np.nan, value)
    one, two = study.fit(holed, estimator, 0.02), study.fit(changed, estimator, 0.02)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
    np.testing.assert_allclose(one.residual_rms, two.residual_rms, rtol=1e-12)
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-12)


def test_leading_axes(holed, estimator):
    """A batch with more axes, and a single set, treat missing samples in the same way."""
    flat, deep = study.fit(holed, estimator, 0.02), study.fit(holed.reshape(3, 2, 2, 40, 3), estimator, 0.02)
    for name in FIELDS:
        field = getattr(flat, name)
        np.testing.assert_array_equal(getattr(deep, name), field.reshape(3, 2, 2, *field.shape[1:]), err_msg=name)
    np.testing.assert_array_equal(deep.count, flat.count.reshape(3, 2, 2))
    single = study.fit(holed[10], estimator, 0.02)
    np.testing.assert_array_equal(single.center, flat.center[10])
    assert single.count == 28


@pytest.mark.parametrize("left", [0, 1, 3])
@pytest.mark.parametrize("d", [2, 3, 5])
def test_too_few_left(rng, on_cap, estimator, d, left):
    """With no sample left, or d where d + 1 are needed, the answer is TOO_FEW_POINTS and NaN, alone and in a batch."""
    points = on_cap(rng, 9, 120.0, d, 0.02)[0]
    points[min(left, d) :, 0] = np.nan
    for sets in (points, points[None], np.stack([points] * 3)):
        fit = study.fit(sets, estimator, 0.02)
        assert np.all(fit.own_status == Status.TOO_FEW_POINTS)
        np.testing.assert_array_equal(fit.count, min(left, d))
        for name in ("center", "radius", "noise_variance", "residual_rms"):
            assert np.isnan(getattr(fit, name)).all(), name
        assert not np.isfinite(fit.standard_errors).any()


def test_infinite_is_not_missing(full, estimator):
    """A row with an infinite coordinate and no NaN is not missing: its set is NOT_FINITE, with holes or without."""
    points = full[:4].copy()
    points[0, 5, 1], points[1, 5, 1], points[1, 9, 0] = np.inf, -np.inf, np.nan
    fit = study.fit(points, estimator, 0.02)
    assert [Status(int(s)) for s in fit.own_status[:2]] == [Status.NOT_FINITE] * 2
    np.testing.assert_array_equal(fit.count, [40, 39, 40, 40])
    assert np.isnan(fit.center[:2]).all()
    assert np.isfinite(fit.center[2:]).all()
    assert np.all(fit.own_status[2:] == Status.OK)


def test_masked_arrays(holed, estimator):
    """Masked values are missing, whatever value lies below the mask."""
    mask = np.isnan(holed)
    masked = np.ma.MaskedArray(np.where(mask, 1e3, holed), mask)
    one, two = study.fit(holed, estimator, 0.02), study.fit(masked, estimator, 0.02)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
    np.testing.assert_array_equal(one.count, two.count)


@pytest.mark.parametrize("estimator", ["als", "mle"])
def test_masked_samples_are_missing(estimator):
    """A masked row is left out like a row with a NaN."""
    rng = np.random.default_rng(8)
    points = sample_cap(rng, 40, 2.0) + 0.01 * rng.standard_normal((40, 3))
    mask = np.zeros((40, 3), dtype=bool)
    mask[::4, 1] = True
    masked = study.fit(np.ma.MaskedArray(points, mask), estimator)
    rest = study.fit(points[~mask.any(axis=1)], estimator)
    np.testing.assert_array_equal(masked.center, rest.center)
    assert masked.count == 30


def test_minimum_zone(on_cap):
    """A masked row does not count, and what is no number is refused."""
    points = on_cap(np.random.default_rng(9), 20, 180.0, noise=0.01)[0]
    mask = np.zeros((20, 3), dtype=bool)
    points[3], mask[3] = 50.0, True
    zone, rest = study.minimum_zone(np.ma.MaskedArray(points, mask)), study.minimum_zone(np.delete(points, 3, axis=0))
    np.testing.assert_array_equal([*zone.center, zone.radius], [*rest.center, rest.radius])
    with pytest.raises(TypeError, match="points have dtype complex128"):
        study.minimum_zone(points * 1j)

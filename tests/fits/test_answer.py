"""A `Fit` as an answer: residuals and what metrologists form of them, batches, tables, words and pictures.

The public call `study.fit`: shapes, batches, and the fields of its answer. What it refuses is in `test_wrong_input`.
"""

import itertools
import json
import pickle
import re
from typing import get_type_hints

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats

import study
from study import Estimates, Fit, Status
from study.fits.answers.fit_plot import prepare
from study.fits.fitting import fit_rows
from study.fits.points.samples import blank


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
    good = fit.ok
    np.testing.assert_array_equal(good, [[True, True, True], [True, True, False]])
    residuals = fit.residuals[good]
    numbers = [one.to_dict() for one in fit[0]]
    for row, one, r in zip(fit[0].residuals, numbers, fit[0].radius, strict=True):
        assert one["form_error"] == pytest.approx(np.nanmax(row) - np.nanmin(row))
        assert one["largest_deviation"] == pytest.approx(np.nanmax(np.abs(row)))
        assert one["diameter"] == 2.0 * r
    np.testing.assert_allclose(fit.residual_rms[good], np.sqrt(np.nanmean(residuals**2, axis=1)))
    for name in ("residuals", "residual_rms"):
        assert np.isnan(getattr(fit, name)[1, 2]).all(), name
    assert np.isnan([fit[1, 2].to_dict()[name] for name in ("form_error", "largest_deviation")]).all()
    np.testing.assert_array_equal(fit.sigma[good] ** 2, np.sqrt(fit.estimates.noise_variance[good]) ** 2)


def test_uncertainties(points):
    """Correlation and ellipsoid follow from the covariance."""
    fit = study.fit(points[0], "mle")
    np.testing.assert_array_equal(fit.standard_errors, np.sqrt(np.diagonal(fit.covariance, axis1=1, axis2=2)))
    axes, quantile = fit.ellipsoid(0.9), 3 * stats.f.ppf(0.9, 3, fit.count - 4)
    expected = quantile[:, None, None] * fit.covariance[:, :3, :3]
    np.testing.assert_allclose(axes @ axes.swapaxes(1, 2), expected, rtol=1e-9, atol=1e-12)
    known = study.fit(points[0], "mle", 0.05)  # whose noise has no degrees of freedom
    axes, expected = known.ellipsoid(0.9), stats.chi2.ppf(0.9, 3) * known.covariance[:, :3, :3]
    np.testing.assert_allclose(axes @ axes.swapaxes(1, 2), expected, rtol=1e-9, atol=1e-12)
    for one in fit:
        root = np.diag(1.0 / np.sqrt(np.diag(one.covariance)))
        np.testing.assert_allclose(one.to_dict()["correlation"], root @ one.covariance @ root, rtol=1e-12)


@pytest.mark.parametrize(
    "index", [0, -1, (1, 2), slice(None, None, -1), np.array([1, 0, 1]), ..., None, (slice(None), [True, False, True])]
)
def test_indexing(points, index):
    """A part of a batch is the fit of that part of the points."""
    part, alone = study.fit(points)[index], study.fit(points[index])
    assert part.shape == alone.shape
    names = ("center", "radius", "status", "residuals", "residual_rms", "covariance", "standard_errors", "count", "ok")
    for name in names:
        one, two = getattr(part, name), getattr(alone, name)
        assert np.shape(one) == np.shape(two), name
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-15, err_msg=name)
    for of in ("radius", "center"):
        np.testing.assert_array_equal(part.interval(of), alone.interval(of))


def test_masks_lengths_and_loops(points):
    """A mask selects fits; a batch has a length and can be looped over; a single fit has neither."""
    fit = study.fit(points)
    assert fit[fit.ok].shape == (5,)
    assert len(fit) == 2
    assert [len(row) for row in fit] == [3, 3]
    np.testing.assert_array_equal([[one.radius for one in row] for row in fit], fit.radius)
    single = fit[0, 0]
    assert single.shape == ()
    for act in (len, iter, bool, lambda fit: fit[0]):
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
    """Points and circle or sphere are drawn as by the command, and a residual per point, by its angle."""
    points = on_cap(rng, 30, 100.0, d, noise=0.02)[0]
    fit = study.fit(points)
    figure = fit.plot()
    figure.draw_without_rendering()
    below = figure.axes[-1]
    np.testing.assert_allclose(below.lines[1].get_ydata(), fit.residuals, atol=1e-12)
    away, middle = points - fit.center, points.mean(axis=0) - fit.center
    cosine = away @ middle / np.linalg.norm(away, axis=1) / np.linalg.norm(middle)
    np.testing.assert_allclose(np.abs(below.lines[1].get_xdata()), np.degrees(np.arccos(cosine)), atol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_band_of_the_surface(rng, on_cap, d):
    """At an angle it is 1.96 times the root mean square of the surface's standard error in the directions there."""
    fit = study.fit(on_cap(rng, 40, 60.0, d, noise=0.03)[0])
    frame = prepare(fit.samples.points[0], {"corrected": fit}, ["x", "y", "z"][:d])
    axis = fit.samples.points[0].mean(axis=0) - fit.center
    axis /= np.linalg.norm(axis)
    for angle, width in frame.residuals.band.T[::30]:
        sides = np.linalg.qr(np.column_stack([axis, np.eye(d)[:, : d - 1]]))[0][:, 1:]
        turns = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
        around = sides @ np.stack([np.cos(turns), np.sin(turns)]) if d == 3 else np.array([[-axis[1]], [axis[0]]])
        e = np.cos(np.radians(angle)) * axis[:, None] + np.sin(np.radians(angle)) * around
        slopes = np.vstack([e, np.ones(e.shape[1])])
        variance = np.einsum("ik,ij,jk->k", slopes, fit.covariance, slopes)
        assert width == pytest.approx(1.96 * np.sqrt(variance.mean()))


def test_outliers_are_marked(rng, on_cap):
    """A point far from the sphere is a cross; rows in order of time stand side by side."""
    points = on_cap(rng, 60, 100.0, noise=0.02)[0]
    points[7] *= 1.5
    below = study.fit(points, ordered=True).plot().axes[-1]
    crosses = [line for line in below.lines if line.get_marker() == "x"]
    np.testing.assert_array_equal(crosses[0].get_xdata(), [8.0])
    assert below.get_xlabel() == "row"


def test_pictures_that_cannot_be(rng, points):
    """A batch is refused with the remedy."""
    with pytest.raises(ValueError, match=r"fit\[0\]\.plot"):
        study.fit(points).plot()


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
        short, long = (np.ptp(fit.interval("radius", level), axis=-1)[fit.ok] for level in (0.9, 0.95))
        assert (short < long).all()
        for i, letter in enumerate("xyz"):
            for name in (letter, f"center_{i + 1}"):
                np.testing.assert_array_equal(fit.interval(name), fit.interval("center")[..., i, :])
    with pytest.raises(ValueError, match=r"of = 'w': .*'radius', 'diameter', 'center', 'x', 'y', 'z'"):
        fit.interval("w")


@pytest.mark.plain
def test_intervals_by_number():
    """The fourth coordinate has a number and no letter, and then no coordinate has one."""
    four = study.fit(np.random.default_rng(1).standard_normal((30, 4)))
    assert four.interval("center_4").shape == (2,)
    with pytest.raises(ValueError, match="'center_4'"):
        four.interval("x")


def test_numbers_as_plain_python(points):
    """A dictionary that JSON takes as it is, with the library's numbers; a batch is refused with the remedy."""
    fit = study.fit(points[0, 0])
    plain = fit.to_dict()
    again = json.loads(json.dumps(plain, allow_nan=bool(np.isnan(fit.estimates.condition))))
    assert list(again) == list(plain)
    assert plain["center"] == fit.center.tolist()
    assert plain["diameter_error"] == 2.0 * fit.standard_errors[-1]
    assert plain["radius_interval"] == fit.interval("radius").tolist()
    assert (plain["status_text"], plain["ok"]) == (fit.status.text, bool(fit.ok))
    assert {type(value) for value in plain.values()} <= {str, bool, int, float, list, dict, type(None)}
    with pytest.raises(ValueError, match="take one, or to_frame"):
        study.fit(points).to_dict()


def test_statuses_in_words(points):
    """A text for one fit, a column of texts for a batch."""
    flat = np.column_stack([np.arange(9.0), np.arange(9.0) ** 2, np.zeros(9)])
    assert study.fit(flat).status.text == study.Status.SINGULAR.text
    words = study.fit(np.stack([flat, points[0, 0, :9]]), "als").to_frame()["status"]
    assert (words.shape, words[0]) == ((2,), study.Status.SINGULAR.text)


def test_names(points):
    """A person can tab through the public names; those of version 1 that went are answered with what there is."""
    fit = study.fit(points[0, 0])
    assert len([name for name in dir(fit) if not name.startswith("_")]) <= 28  # three of them of what was given
    numbers = "noise_variance condition iterations diameter form_error largest_deviation correlation copies"
    words = "own_status status_text own_covariance outlier_influence expanded_uncertainty minimum_zone"
    for name in f"{numbers} {words} ordered without_outliers noise_is_known".split():
        with pytest.raises(AttributeError, match=f"{name!r}: use "):
            getattr(fit, name)


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
def test_arguments_of_other_libraries(points, one_line, argument, words):
    """They are answered with what there is, in one line."""
    with one_line(TypeError, re.escape(words), start=f"study.fit takes no {argument}=: "):
        study.fit(points, **{argument: 1.0})


def test_a_status_of_a_plugin_stays(points):
    """One that the list lacks is reported as it is, as failures are."""
    fit = study.fit(points)
    assert (Fit(fit.estimates._replace(status=np.full(fit.shape, 77)), fit.samples).status == 77).all()


def test_fits_without_points():
    """An answer that does not hold its points still has numbers and words, and says what it lacks."""
    fit = Fit(blank(2, 3))
    assert "2 fits" in repr(fit)
    assert "center (" in repr(fit[0])
    assert len(fit.to_frame()) == 2
    for name in ("residuals", "outliers", "count"):
        with pytest.raises(ValueError, match=r"does not hold its points.*study\.fit"):
            getattr(fit, name)


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


@pytest.mark.parametrize("d", [2, 3, pytest.param(5, marks=[pytest.mark.plain, pytest.mark.slow])])
def test_shapes(rng, on_cap, estimator, d):
    """The answer has the leading axes of the points; an empty batch has an empty answer."""
    points = on_cap(rng, 20, d=d, noise=0.01, sets=6)[0]
    for lead in ((), (1,), (4,), (2, 3), (0,), (2, 0)):
        fit = study.fit(points[: int(np.prod(lead))].reshape(*lead, 20, d), estimator, noise=0.01)
        assert fit.center.shape == (*lead, d)
        for name in Estimates._fields:
            assert getattr(fit.estimates, name).shape == ((*lead, d) if name == "center" else lead), name
        assert np.all(fit.estimates.status == Status.OK)
        np.testing.assert_allclose(fit.radius, 1.0, atol=0.1)
        np.testing.assert_array_equal(fit.count, 20)


@pytest.mark.parametrize(
    ("n", "d"),
    [*itertools.product([6, 17, 512, 1300], [2, 3]), pytest.param(17, 5, marks=[pytest.mark.plain, pytest.mark.slow])],
)
def test_batched_equals_looped(rng, on_cap, estimator, n, d):
    """A set's answer is the same alone and in a batch, where loops are compiled to the last bit."""
    points = on_cap(rng, n, 90.0, d, noise=0.01, sets=6)[0]
    together = study.fit(points, estimator, noise=0.01)
    for t in range(6):
        alone = study.fit(points[t], estimator, noise=0.01)
        for name, one, whole in zip(Estimates._fields, alone.estimates, together.estimates, strict=True):
            np.testing.assert_allclose(one, whole[t], rtol=0, atol=1e-13 if d == 5 else 0, err_msg=name)


@pytest.mark.parametrize("kind", ["int64", "int16", "uint8", "float32", ">f8", "list", "frame"])
def test_kinds_of_points(kind):
    """Integers, short and foreign floats, lists and data frames are points too."""
    exact = np.array([[9, 5, 5], [1, 5, 5], [5, 9, 5], [5, 1, 5], [5, 5, 9], [5, 5, 1]])
    points = {"list": exact.tolist(), "frame": pd.DataFrame(exact)}.get(kind)
    for name in study.ESTIMATORS:
        fit = study.fit(exact.astype(kind) if points is None else points, name, noise=1e-9)
        np.testing.assert_allclose(fit.center, 5.0, atol=1e-12, err_msg=name)
        assert fit.radius == pytest.approx(4.0, abs=1e-12), name


def test_points_are_left_alone(rng, on_cap, estimator):
    """The caller's array is not written to, and may be read-only or any view."""
    points = on_cap(rng, 30, noise=0.01)[0]
    before = points.copy()
    points.flags.writeable = False
    fit = study.fit(points, estimator, noise=0.01)
    np.testing.assert_array_equal(points, before)
    view = study.fit(np.repeat(points, 2, axis=0)[::2], estimator, noise=0.01)
    np.testing.assert_allclose(view.center, fit.center, rtol=0, atol=1e-12)


def test_fit_is_frozen(rng, on_cap):
    """An array of a fit cannot be replaced by accident."""
    fit = study.fit(on_cap(rng, 10)[0])
    for name in ("center", "radius", "sigma", "status", "estimates"):
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


def test_one_set_of_names_for_frame_dictionary_and_csv(points):
    """The numbers of `study fit --csv` stand under its names in the frame and the dictionary, intervals too."""
    fit = study.fit(points[0, 0])
    (row,) = fit_rows({"corrected": fit}, ["x", "y", "z"])
    frame, numbers = fit.to_frame().iloc[0], fit.to_dict()
    named = [f"{name}_{end}" for name in ("radius", "center_x", "center_z") for end in ("low", "high")]
    named += ["center_x", "error_x", "center_z", "error_z", "radius", "radius_error", "diameter", "diameter_error"]
    for name in named:
        assert row[name] == numbers[name] == frame[name]
    assert (frame["radius_low"], frame["radius_high"]) == tuple(fit.interval("radius"))
    batch = study.fit(points).to_frame()
    np.testing.assert_array_equal(batch["center_y_high"], study.fit(points).interval("center")[..., 1, 1].ravel())

import numpy as np
import pytest
from matplotlib.patches import Circle, Ellipse

import study
from study import style
from study.fits import Fit, Status
from study.fits.answers.fit_plot import draw, prepare

NAMES = ["x", "y", "z", "w"]


@pytest.fixture
def cap(rng, on_cap):
    """Make points on a cap of no particular place and direction."""
    usual = {"angle": 50.0, "noise": 0.03, "center": 4.0}
    return lambda d=3, **given: on_cap(rng, 150, d=d, **usual | {"axis": [1.0, 2.0, -1.0, 0.5][:d]} | given)[0]


def frame_of(points, *estimators, **changes):
    """The frame of some estimators' answers, the first one's changed."""
    fits = {name: study.fit(points, name) for name in estimators}
    if changes:
        first = fits[estimators[0]]
        fits[estimators[0]] = Fit(first.estimates._replace(**changes), first.samples)
    return prepare(points, fits, NAMES[: points.shape[1]]), fits


def plane_of(points, view):
    """Origin (d,) and the plane (d, 2) that a view was projected on, found from its points."""
    coefficients = np.linalg.lstsq(np.column_stack([points, np.ones(len(points))]), view.points, rcond=None)[0]
    return coefficients[:-1], coefficients[-1]


def words_of(figure):
    return "\n".join(text.get_text() for legend in figure.legends for text in legend.get_texts())


def test_circles_are_shown_as_they_are(cap):
    """In two dimensions there is one view, in the user's coordinates."""
    points = cap(d=2)
    frame, fits = frame_of(points, "als", "gdke")
    (view,) = frame.views
    assert view.names == ("x", "y")
    np.testing.assert_array_equal(view.points, points)
    np.testing.assert_array_equal(view.centers, [fits["als"].center, fits["gdke"].center])
    np.testing.assert_array_equal(frame.radii, [fits["als"].radius, fits["gdke"].radius])


def test_columns_without_a_name(cap):
    """What is called by a number is x with an index."""
    points = cap(d=2)
    (view,) = prepare(points, {"als": study.fit(points, "als")}, ["1", "2"]).views
    assert view.names == ("$x_{1}$", "$x_{2}$")


def test_names_are_not_taken_for_formulas(cap):
    """A column may be called $a_{$, which as a formula has a mistake."""
    points = cap(d=2)
    draw(prepare(points, {"als": study.fit(points, "als")}, ["$a_{$", "$x$ in $"])).draw_without_rendering()


@pytest.mark.parametrize("d", [3, pytest.param(4, marks=pytest.mark.plain)])
def test_views_are_along_the_axes_of_spread(cap, d):
    """Projections are orthonormal; right is the greatest variance, up the least, or the second; the names say so."""
    points = cap(d=d)
    frame, fits = frame_of(points, "als")
    variances = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) ** 2 / (len(points) - 1)
    for view, up in zip(frame.views, (-1, 1), strict=True):
        plane, origin = plane_of(points, view)
        np.testing.assert_allclose(plane.T @ plane, np.eye(2), atol=1e-9)
        np.testing.assert_allclose(view.points.var(axis=0, ddof=1), [variances[0], variances[up]])
        np.testing.assert_allclose(view.centers, [fits["als"].center @ plane + origin])
    first, second = frame.views
    assert first.names == ("greatest spread", "least spread")
    assert second.names == ("greatest spread", "middle spread")


def test_axes_have_the_unit_of_the_coordinates(cap):
    """Names of columns that end in one unit give it to every axis."""
    points = cap(d=3)
    figure = draw(prepare(points, {"als": study.fit(points, "als")}, ["X [mm]", "Y [mm]", "Z [mm]"]))
    named = [text for ax in figure.axes for text in (ax.get_xlabel(), ax.get_ylabel()) if text]
    assert all(text.endswith(" [mm]") for text in named if "angle" not in text)
    assert [ax.get_title(loc="left") for ax in figure.axes[:2]] == ["from the side", "along the cap's axis"]


@pytest.mark.parametrize("d", [2, 3, pytest.param(4, marks=pytest.mark.plain)])
def test_ellipses_are_the_shadows_of_ellipsoids(cap, d):
    """In every direction of the plane the ellipse reaches as far as the ellipsoid {A s: |s| ≤ 1} does.

    The ellipsoid reaches |Aᵀv| along a unit vector v of space; and as far as the farthest of many points drawn on it.
    """
    points = cap(d=d)
    frame, fits = frame_of(points, "gdke")
    axes = fits["gdke"].ellipsoid()
    turn = np.linspace(0.0, np.pi, 60)
    drawn = np.random.default_rng(1).normal(size=(200_000, d))
    surface = drawn / np.linalg.norm(drawn, axis=1)[:, None] @ axes.T
    for view in frame.views:
        plane, _ = plane_of(points, view)
        (half,) = view.ellipses
        assert abs(half[:, 0] @ half[:, 1]) < 1e-9 * np.linalg.norm(half) ** 2  # semi-axes, not any conjugate pair
        for u in np.column_stack([np.cos(turn), np.sin(turn)]):
            reach = np.linalg.norm(half.T @ u)
            assert reach == pytest.approx(np.linalg.norm(axes.T @ (plane @ u)), rel=1e-9)
            assert reach == pytest.approx((surface @ (plane @ u)).max(), rel=0.01)


@pytest.mark.parametrize("d", [2, 3])
def test_drawn_patches(cap, d):
    """Circles have the fit's centre and radius; ellipses the size and the turn of the shadow."""
    frame, _ = frame_of(cap(d=d), "als", "gdke")
    figure = draw(frame)
    assert len(figure.axes) == 2 * len(frame.views) + 1
    for place, view in enumerate(frame.views):
        circles = [patch for patch in figure.axes[place].patches if isinstance(patch, Circle)]
        np.testing.assert_allclose([c.center for c in circles], view.centers)
        np.testing.assert_allclose([c.radius for c in circles], frame.radii)
        ellipses = [patch for patch in figure.axes[len(frame.views) + place].patches if isinstance(patch, Ellipse)]
        assert len(ellipses) == 2
        for patch, center, half in zip(ellipses, view.centers, view.ellipses, strict=True):
            np.testing.assert_allclose(patch.center, center)
            angle = np.radians(patch.angle)
            turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            shape = turned @ np.diag([patch.width / 2, patch.height / 2]) ** 2 @ turned.T
            np.testing.assert_allclose(shape, half @ half.T, rtol=1e-9, atol=1e-12 * np.linalg.norm(half) ** 2)


@pytest.mark.parametrize("estimators", [["als"], ["als", "gdke"]])
@pytest.mark.parametrize("d", [2, 3])
def test_the_enlarged_part_holds_the_ellipses(cap, d, estimators):
    """All of each ellipse is in the window, which they fill from side to side or from top to bottom."""
    frame, _ = frame_of(cap(d=d, axis=np.ones(d)), *estimators)
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    figure = draw(frame)
    for ax, view in zip(figure.axes[len(frame.views) : -1], frame.views, strict=True):
        outlines = view.centers[:, :, None] + view.ellipses @ np.stack([np.cos(turn), np.sin(turn)])
        low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
        inside = (outlines.min(axis=(0, 2)) - low) / (high - low), (high - outlines.max(axis=(0, 2))) / (high - low)
        assert np.min(inside) > 0.0
        assert np.min(inside) < 0.1


def test_answers_that_coincide_are_named_together(cap):
    """LLS is GDKE; ALS is not, on a small cap; each group has one circle in each view."""
    points = cap(angle=30.0)
    frame, _ = frame_of(points, "lls", "als", "gdke", "igdk")
    assert frame.groups == [["lls", "gdke", "igdk"], ["als"]]
    figure = draw(frame)
    assert words_of(figure).splitlines() == ["LLS ≈ GDKE ≈ IGDK", "ALS"]
    assert [sum(isinstance(patch, Circle) for patch in ax.patches) for ax in figure.axes[:2]] == [2, 2]


@pytest.mark.parametrize(("shift", "together"), [(0.05, True), (0.5, False)])
def test_coinciding_is_within_a_tenth_of_a_standard_error(cap, shift, together):
    """A centre moved by a twentieth of its error is the same answer, by half of it another."""
    points = cap()
    fit = study.fit(points, "als")
    moved = fit.center + shift * fit.standard_errors[:3] * [1.0, 0.0, 0.0]
    frame, _ = frame_of(points, "fuller", "als", center=moved)
    assert len(frame.groups) == (1 if together else 2)


def test_fits_without_a_number_are_named(cap):
    """They are said not to be drawn, with the reason, and the others are drawn; so are statuses of what is drawn."""
    points = cap()
    nan = {"center": np.full(3, np.nan), "radius": np.array(np.nan), "status": np.array(Status.SINGULAR)}
    frame, _ = frame_of(points, "taubin", "als", **nan)
    assert frame.groups == [["als"]]
    assert f"not drawn: Taubin: {Status.SINGULAR.text}" in words_of(draw(frame)).replace("\n    ", " ")
    frame, _ = frame_of(points, "taubin", "als", status=np.array(Status.NOT_CONVERGED))
    assert frame.notes == [f"Taubin: {Status.NOT_CONVERGED.text}"]
    frame, _ = frame_of(points, "taubin", **nan)
    figure = draw(frame)
    assert len(figure.axes) == 2
    figure.draw_without_rendering()


@pytest.mark.parametrize(
    ("others", "radius", "d"), [([], 1e3, 2), (["als"], 1e12, 2), (["als", "gdke"], 1e3, 3), ([], 1e12, 3)]
)
def test_huge_circles_do_not_spoil_the_view(cap, others, radius, d):
    """One that is far larger than the points' extent is named with its radius, and the view stays with the others."""
    points = cap(d=d)
    lost = {"center": np.full(d, radius), "radius": np.array(radius), "status": np.array(Status.AT_BOUND)}
    frame, _ = frame_of(points, "mle", *others, **lost)
    figure = draw(frame)
    figure.draw_without_rendering()
    words = words_of(figure).replace("\n", " ")
    assert f"MLE: circle off the scale, radius {style.number(radius)}" in words
    assert f"MLE: {Status.AT_BOUND.text}" in words
    for ax, view in zip(figure.axes, frame.views, strict=False):
        limits = np.array([ax.get_xlim(), ax.get_ylim()])
        assert np.all(limits[:, 0] < view.points.min(axis=0))
        assert np.all(limits[:, 1] > view.points.max(axis=0))
        assert np.ptp(limits, axis=1).max() < 5.0  # radius 1, and the cap's extent below 2


def test_no_covariance_no_ellipse(rng):
    """A noise-free arc in space has a centre in its plane and infinite standard errors: a circle without ellipse."""
    t = rng.uniform(-0.6, 0.6, 60)
    arc = np.column_stack([np.cos(t), np.sin(t), np.zeros(60)])
    frame, _ = frame_of(arc, "hinge")
    assert np.isnan(frame.views[0].ellipses).all()
    assert "ellipse" not in frame.caption
    figure = draw(frame)
    assert not [p for ax in figure.axes for p in ax.patches if isinstance(p, Ellipse) and not isinstance(p, Circle)]


def test_many_points(rng, on_cap):
    """Of very many a few thousand are shown, those far out among them, and the caption says how many."""
    points, _ = on_cap(rng, 40_000, noise=0.01)
    points[12_346] = [9.0, 0.0, 0.0]
    points[777] = np.nan
    frame, _ = frame_of(points, "als")
    for view in frame.views:
        assert 4000 < len(view.points) <= 5100
    assert f"{len(frame.views[0].points):,} of 39,999 points" in frame.caption
    distance = np.hypot(*frame.views[1].points.T)  # along the axis, whose height the other view has
    height = frame.views[0].points[:, 1]
    farthest = np.linalg.norm(points[12_346] - np.nanmean(points, axis=0))
    assert np.hypot(distance, height).max() == pytest.approx(farthest)


def test_equal_bytes_twice(cap, tmp_path):
    """The same points give the same files, and no date is in them, which is never the same twice."""
    points = cap()
    for suffix, date in (("png", b"tIME"), ("svg", b"dc:date"), ("pdf", b"CreationDate")):
        pictures = [tmp_path / f"{place}.{suffix}" for place in "ab"]
        for path in pictures:
            style.save_picture(draw(frame_of(points, "mle", "gdke", "als")[0]), path)
        one, two = (path.read_bytes() for path in pictures)
        assert one == two
        assert date not in one

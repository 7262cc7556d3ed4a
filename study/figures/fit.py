"""A user's own points with the circles or spheres fitted to them, and the error ellipses of their centres.

Circles are drawn as they are. Spheres are shown in two views, along the two axes of the points' spread that are the
least and the middle one, so that a small cap is seen from the side; each shows the sphere's outline and the projection
of the centre's 95 % ellipsoid.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse
from numpy.typing import NDArray

from study.estimators import Fit
from study.estimators.fit import explain
from study.figures import style

Floats = NDArray[np.float64]

_MOST_POINTS = 5000


@dataclass(frozen=True)
class View:
    """A projection on a plane.

    Attributes:
        names: of its two axes.
        points: (n, 2), at most a few thousand of them.
        centers: of each fit (k, 2).
        ellipses: semi-axes of each centre's projected 95 % ellipse as columns (k, 2, 2); NaN where there is none.
    """

    names: tuple[str, str]
    points: Floats
    centers: Floats
    ellipses: Floats


@dataclass(frozen=True)
class Frame:
    """What the picture shows: one view of circles, two of spheres."""

    views: list[View]
    estimators: list[str]
    radii: Floats
    caption: str


def prepare(points: Floats, fits: dict[str, Fit], names: list[str]) -> Frame:
    """Project points and fits.

    Args:
        points: (n, d), rows with NaN are left out.
        fits: answers of shape () by estimator.
        names: of the coordinates.
    """
    points = points[np.logical_not(np.isnan(points).any(axis=1))]
    d = points.shape[1]
    usable = {name: fit for name, fit in fits.items() if np.isfinite(fit.center).all() and np.isfinite(fit.radius)}
    centers = np.array([fit.center for fit in usable.values()]).reshape(-1, d)
    axes = np.array([fit.ellipsoid() for fit in usable.values()]).reshape(-1, d, d)
    shown = points[:: max(1, len(points) // _MOST_POINTS)]
    if d == 2:
        views = [View((names[0], names[1]), shown, centers, axes)]
    else:
        origin = points.mean(axis=0)
        basis = np.linalg.eigh(np.cov(points.T))[1]  # ascending: the least spread is the sphere's depth
        views = [
            _view(shown - origin, centers - origin, axes, basis[:, [other, 0]], f"{word} spread")
            for other, word in ((d - 1, "greatest"), (d - 2, "middle"))
        ]
    missing = [name for name in fits if name not in usable]
    status = "; ".join(f"{name}: {explain(int(fits[name].status))}" for name in missing)
    caption = f"{len(points):,} points; ellipses: 95 % of the centre" + (f"; not drawn: {status}" if status else "")
    return Frame(views, list(usable), np.array([float(fit.radius) for fit in usable.values()]), caption)


def _view(points: Floats, centers: Floats, axes: Floats, plane: Floats, name: str) -> View:
    """Project on a plane (d, 2): an ellipsoid's shadow is the ellipse of the projected matrix."""
    halves = np.einsum("dp,kde->kpe", plane, axes)
    values, vectors = np.linalg.eigh(np.nan_to_num(halves @ halves.swapaxes(1, 2), posinf=0.0, neginf=0.0))
    ellipses = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return View((f"axis of {name}", "axis of least spread"), points @ plane, centers @ plane, ellipses)


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw the views side by side."""
    figure = Figure(figsize=(style.PAGE, 3.6), layout="constrained")
    axes = figure.subplots(1, len(frame.views), squeeze=False)
    for ax, view in zip(axes.flat, frame.views, strict=True):
        _panel(ax, view, frame)
    handles = [
        axes.flat[0].plot([], [], color=style.color(name), marker=style.marker(name), label=style.label(name))[0]
        for name in frame.estimators
    ]
    if handles:
        figure.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), 7))
    style.stamp(figure, frame.caption)
    return figure


def _panel(ax: Axes, view: View, frame: Frame) -> None:
    ax.plot(*view.points.T, ".", color=style.FAINT, markersize=2.0, zorder=2)
    for name, center, radius, half in zip(frame.estimators, view.centers, frame.radii, view.ellipses, strict=True):
        color = style.color(name)
        ax.add_patch(Circle((center[0], center[1]), radius, fill=False, linewidth=1.0, color=color, zorder=3))
        ax.plot(*center, marker=style.marker(name), color=color, markersize=3.5, zorder=5)
        lengths = np.linalg.norm(half, axis=0)
        if np.all(np.isfinite(lengths)):
            turn = float(np.degrees(np.arctan2(half[1, 0], half[0, 0])))
            outline = Ellipse(
                (center[0], center[1]), 2 * lengths[0], 2 * lengths[1], angle=turn, fill=False, color=color
            )
            ax.add_patch(outline)
    _limit(ax, view, frame.radii)
    ax.set(aspect="equal", xlabel=view.names[0], ylabel=view.names[1])


def _limit(ax: Axes, view: View, radii: Floats) -> None:
    """Show the points and every circle that is not much larger than most."""
    reach = [view.points.min(axis=0), view.points.max(axis=0)]
    if len(radii):
        usual = radii <= 3.0 * np.median(radii)
        reach += [*(view.centers[usual] - radii[usual, None]), *(view.centers[usual] + radii[usual, None])]
    low, high = np.min(reach, axis=0), np.max(reach, axis=0)
    pad = 0.04 * float(np.max(high - low))
    ax.set_xlim(low[0] - pad, high[0] + pad)
    ax.set_ylim(low[1] - pad, high[1] + pad)

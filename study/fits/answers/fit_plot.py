"""A user's own points with the circles or spheres fitted to them, and the error ellipses of their centres.

Circles are drawn as they are. Spheres are shown in two views: a small cap from the side, with the least spread upwards,
and along its axis, which is that of the least spread. Each shows the sphere's outline and the projection of the
centre's 95 % ellipsoid. Below or beside each view its centres are enlarged. Estimators whose answers differ by
less than a tenth of a standard error are drawn once and named together.

In a view from the side the points of a cap fall inside the outline. So the signed distances of the points from the
first fit stand below, by the angle from the middle of the points as seen from the centre, with the band in which the
surface lies.
"""

import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.ticker import MaxNLocator

from study import style
from study.arrays import Bools, Floats, Ints
from study.fits.points.samples import Status

_MOST_POINTS = 5000
_FARTHEST = 100  # points that are always shown, however many are left out
_SAME = 0.1  # of a standard error
_BELOW = 1.7  # height of the distances, in inches
_VIEWS = ("from the side", "along the cap's axis")
_SMALLEST = 1e-6  # difference, in radii, that a picture shows


def picture(fit: Any, ordered: bool) -> Figure:
    """Draw a single fit, whose rows may be in order of time; see `Fit.plot`."""
    if fit.shape:
        raise ValueError(f"fit of shape {fit.shape}: plot one of them, such as fit[0].plot()")
    if fit.samples is None:
        raise ValueError("this fit does not hold its points: use study.fit, which stores them in the fit")
    d = len(fit.center)
    names = list("xyz"[:d]) if d <= 3 else [str(i + 1) for i in range(d)]
    return draw(prepare(fit.samples.points[0], {fit.estimator: fit}, names, ordered))


@dataclass(frozen=True)
class Projection:
    """A projection on a plane.

    Attributes:
        names: of its two axes.
        points: (n, 2), at most a few thousand of them.
        centers: of each group (k, 2).
        ellipses: semi-axes of each centre's projected 95 % ellipse as columns (k, 2, 2); NaN where there is none.
    """

    names: tuple[str, str]
    points: Floats
    centers: Floats
    ellipses: Floats


@dataclass(frozen=True)
class Distances:
    """Signed distances of the points from a fit.

    Attributes:
        name: the estimator's.
        place: angle in degrees between each point and the mean of all as seen from the centre, in a plane with a sign;
            or the number of the row, from 1, where rows are in order of time (n,).
        distance: of each point, positive outside (n,).
        outliers: true for points that do not belong to the sphere (n,).
        by_row: true if the place is a row.
        band: angles, and 1.96 standard errors of the surface there (2, k); empty if there are none.
    """

    name: str
    place: Floats
    distance: Floats
    outliers: Bools
    by_row: bool
    band: Floats


@dataclass(frozen=True)
class FitFrame:
    """Content of the picture: one view of circles, two of spheres.

    Attributes:
        views: the projections.
        groups: names of estimators whose answers coincide; the answer shown is the first one's.
        radii: of each group (k,).
        fits_in: whether the group's circle is not much larger than the others, or than the points' extent (k,).
        caption: what is shown, in words.
        notes: what is not, and what a status says.
        residuals: of the first fit that can be drawn; None if there is none.
        unit: that of the coordinates, as their names end: " [mm]"; or "".
    """

    views: list[Projection]
    groups: list[list[str]]
    radii: Floats
    fits_in: Bools
    caption: str
    notes: list[str]
    residuals: Distances | None
    unit: str = ""


def prepare(points: Floats, fits: Mapping[str, Any], names: list[str], ordered: bool = False) -> FitFrame:
    """Project points and fits.

    Args:
        points: (n, d), rows with NaN are left out.
        fits: answers of shape () by estimator.
        names: of the coordinates.
        ordered: the rows are in order of time.
    """
    points = points[np.isfinite(points).all(axis=1)]
    names = [f"$x_{{{name}}}$" if name.isdecimal() else name.replace("$", r"\$") for name in names]
    n, d = points.shape
    units = {match[0] if (match := re.search(r" ?\[[^\]]+\]$", name)) else "" for name in names}
    unit = units.pop() if len(units) == 1 else ""
    usable = {name: fit for name, fit in fits.items() if np.isfinite(fit.center).all() and np.isfinite(fit.radius)}
    groups = _groups(usable)
    first = [usable[group[0]] for group in groups]
    centers = np.array([fit.center for fit in first]).reshape(-1, d)
    radii = np.array([float(fit.radius) for fit in first])
    with np.errstate(invalid="ignore"):  # a centre without a covariance has no ellipsoid
        axes = np.array([fit.ellipsoid() for fit in first]).reshape(-1, d, d)
    shown = points[_sample(points)]
    if d == 2:
        views = [_view(shown, centers, axes, np.eye(2), (names[0], names[1]))]
    else:
        origin = points.mean(axis=0)
        away = points - origin
        basis = np.linalg.eigh(np.cov(away.T / (np.abs(away).max() or 1.0)))[1]  # ascending: the least is the depth
        basis *= np.sign(basis[np.abs(basis).argmax(axis=0), np.arange(d)])
        words = [f"greatest spread{unit}", f"middle spread{unit}", f"least spread{unit}"]
        planes = [(basis[:, [d - 1, 0]], (words[0], words[2])), (basis[:, [d - 1, d - 2]], (words[0], words[1]))]
        views = [_view(shown - origin, centers - origin, axes, *plane) for plane in planes]
    extent = float(np.ptp(points, axis=0).max())
    fits_in = radii <= min(5.0 * float(np.median(radii)), 20.0 * extent) if len(radii) else np.zeros(0, dtype=bool)
    caption = f"{n:,} points" if len(shown) == n else f"{len(shown):,} of {n:,} points"
    if d > 2:
        caption += ", coordinates from their mean"
    if np.isfinite(axes).all(axis=(1, 2)).any():
        caption += "; ellipses: " + ("joint 95 % of the centre" if d == 2 else "shadows of the centre's 95 % ellipsoid")
    notes = _statuses(fits, usable)
    for i in np.flatnonzero(~fits_in):
        notes.append(f"{_label(groups[i])}: circle off the scale, radius {style.number(radii[i])}")
    residuals = _residuals(groups[0][0], first[0], ordered) if first else None
    return FitFrame(views, groups, radii, fits_in, caption, notes, residuals, unit)


def _residuals(name: str, fit: Any, ordered: bool) -> Distances | None:
    """Signed distances from a fit, which holds its points."""
    if fit.samples is None:
        return None
    points, center, radius = fit.samples.points[0], fit.center, float(fit.radius)
    finite = np.isfinite(points).all(axis=1).nonzero()[0]
    shown = finite[_sample(points[finite])]
    away = points[shown] - center
    axis = points[finite].mean(axis=0) - center
    axis = axis / (np.linalg.norm(axis) or 1.0)
    along = away @ axis
    across = np.linalg.norm(away - along[:, None] * axis, axis=1)
    if len(center) == 2:
        across = away @ [-axis[1], axis[0]]
    angle = np.degrees(np.arctan2(across, along))
    place = shown + 1.0 if ordered else angle
    band = np.empty((2, 0)) if ordered else _band(fit, axis, angle)
    return Distances(name, place, np.linalg.norm(away, axis=1) - radius, fit.outliers[shown], ordered, band)


def _band(fit: Any, axis: Floats, angle: Floats) -> Floats:
    """Angles between those of the points, and 1.96 standard errors of the surface there, averaged around the axis."""
    covariance, d = fit.covariance, len(axis)
    if not np.isfinite(covariance).all():
        return np.empty((2, 0))
    angles = np.linspace(angle.min(), angle.max(), 91)
    cosine, sine = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    center, mixed = covariance[:d, :d], covariance[:d, d]
    along = axis @ center @ axis
    around = (np.trace(center) - along) / (d - 1)
    variance = cosine**2 * along + sine**2 * around + 2.0 * cosine * (mixed @ axis) + covariance[d, d]
    if d == 2:
        side = np.array([-axis[1], axis[0]])
        variance += 2.0 * sine * (mixed @ side) + 2.0 * sine * cosine * (axis @ center @ side)
    return np.stack([angles, 1.96 * np.sqrt(np.maximum(variance, 0.0))])


def _groups(fits: Mapping[str, Any]) -> list[list[str]]:
    """Names of estimators whose answers and standard errors differ too little to be seen."""
    groups: list[list[str]] = []
    seen: list[tuple[Floats, Floats]] = []
    for name, fit in fits.items():
        answer = np.append(fit.center, fit.radius)
        errors = np.nan_to_num(fit.standard_errors, nan=0.0, posinf=0.0)
        allowed = np.maximum(_SAME * errors, _SMALLEST * float(fit.radius))
        for group, (other, other_errors) in zip(groups, seen, strict=True):
            if np.all(np.abs(answer - other) <= allowed) and np.all(np.abs(errors - other_errors) <= allowed):
                group.append(name)
                break
        else:
            groups.append([name])
            seen.append((answer, errors))
    return groups


def _sample(points: Floats) -> Ints:
    """Indices of the points to show: evenly spaced ones, and all that lie far out."""
    n = len(points)
    if n <= _MOST_POINTS:
        return np.arange(n)
    far = np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")[-_FARTHEST:]
    return np.union1d(np.arange(0, n, -(-n // _MOST_POINTS)), far)


def _view(points: Floats, centers: Floats, axes: Floats, plane: Floats, names: tuple[str, str]) -> Projection:
    """Project on a plane (d, 2): an ellipsoid's shadow is the ellipse of the projected matrix."""
    halves = np.einsum("dp,kde->kpe", plane, np.nan_to_num(axes, nan=0.0, posinf=0.0, neginf=0.0))
    values, vectors = np.linalg.eigh(halves @ halves.swapaxes(1, 2))
    ellipses = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    ellipses[~np.isfinite(axes).all(axis=(1, 2))] = np.nan
    return Projection(names, points @ plane, centers @ plane, ellipses)


def _statuses(fits: Mapping[str, Any], usable: Mapping[str, Any]) -> list[str]:
    """Notes on fits that are not ok, and on fits that are not drawn."""
    said: dict[tuple[str, str], list[str]] = {}
    for name, fit in fits.items():
        if name not in usable or fit.status != Status.OK:
            key = "" if name in usable else "not drawn: ", fit.status.text
            said.setdefault(key, []).append(style.label(name))
    return [f"{prefix}{', '.join(labels)}: {words}" for (prefix, words), labels in said.items()]


def _label(group: list[str]) -> str:
    return " ≈ ".join(style.label(name).replace(" ", "\xa0") for name in group)


@style.journal()
def draw(frame: FitFrame) -> Figure:
    """Draw the views side by side, with the centres enlarged below (of circles: beside)."""
    flat = len(frame.views) == 1
    zoomed = len(frame.groups) > 1 or bool(np.isfinite(frame.views[0].ellipses).any())
    below = frame.residuals is not None
    height = (3.2 if flat or not zoomed else 5.4) + _BELOW * below
    figure = style.Picture(figsize=(style.PAGE, height), layout="constrained")
    rows, columns = (1, 1 + zoomed) if flat else (1 + zoomed, 2)
    heights = [3.1 - 0.1 * flat, 2.3][:rows] + [_BELOW] * below
    grid = figure.add_gridspec(rows + below, columns, height_ratios=heights)
    axes = np.array([[figure.add_subplot(grid[i, j]) for j in range(columns)] for i in range(rows)])
    for place, view in enumerate(frame.views):
        _whole(axes.flat[place], view, frame)
        axes.flat[place].set_title("points and fits" if flat else _VIEWS[place], loc="left")
        if zoomed:
            low, high = _enlarged(axes.flat[len(frame.views) + place], view, frame, 1.0 if flat else 0.7)
            part = Rectangle((low[0], low[1]), *(high - low), fill=False, linewidth=0.6, edgecolor=style.INK, zorder=6)
            axes.flat[place].add_patch(part)
    if not flat:  # name shared axes once
        for ax in axes[:-1].flat:
            ax.set_xlabel("")
    if frame.residuals is not None:
        ax = figure.add_subplot(grid[rows, :])
        _distances(ax, frame.residuals, _look(0, frame))
        ax.set_ylabel(f"distance{frame.unit}")
    _words(figure, frame)
    style.stamp(figure, frame.caption)
    return figure


def _distances(ax: Axes, residuals: Distances, look: dict[str, Any]) -> None:
    """Draw the distances from the first fit, and the band of its surface."""
    place, distance, named = residuals.place, residuals.distance, residuals.outliers
    ax.axhline(0.0, color=look["color"], linewidth=look["linewidth"])
    if residuals.band.size:
        ax.fill_between(
            residuals.band[0], -residuals.band[1], residuals.band[1], color=look["color"], alpha=0.2, lw=0.0
        )
    ax.plot(place[~named], distance[~named], ".", color=style.FAINT, markersize=3.0)
    title = f"distance from {style.label(residuals.name)}"
    if residuals.band.size:
        title += "; band: 95 % for the surface"
    if named.any():
        ax.plot(place[named], distance[named], "x", color=style.INK, markersize=4.0)
        title += f"; × {'an outlier' if named.sum() == 1 else 'outliers'}"
    ax.set_title(title, loc="left")
    ax.set_xlabel("row" if residuals.by_row else "angle from the middle of the points, in degrees")


def _words(figure: Figure, frame: FitFrame) -> None:
    """Write names above and notes below; the figure grows by their height."""
    notes = [line for note in frame.notes for line in textwrap.wrap(note, 118, subsequent_indent="    ")]
    labels = [textwrap.fill(_label(group), 100, subsequent_indent="    ") for group in frame.groups]
    columns = max(1, min(len(labels), 110 // (8 + max(map(len, labels), default=0))))
    lines = sum(label.count("\n") + 1 for label in labels) / columns + len(notes)
    figure.set_figheight(figure.get_figheight() + 0.14 * lines)
    handles = []
    for place, (group, label) in enumerate(zip(frame.groups, labels, strict=True)):
        look = _look(place, frame) | {"linewidth": None}
        handles.append(Line2D([], [], marker=style.marker(group[0]), markersize=4, label=label, **look))
    if handles:
        figure.legend(handles=handles, loc="outside upper left", ncols=columns)
    if notes:
        line = Line2D([], [], linestyle="none", label="\n".join([*notes, ""]))  # the stamp is below
        figure.legend(handles=[line], loc="outside lower left", handlelength=0.0, handletextpad=0.0)


def _whole(ax: Axes, view: Projection, frame: FitFrame) -> None:
    """Draw points and circles."""
    ax.plot(*view.points.T, ".", color=style.FAINT, markersize=2.0, zorder=2)
    drawn = zip(frame.groups, view.centers, frame.radii, frame.fits_in, strict=True)
    for place, (group, center, radius, inside) in enumerate(drawn):
        if inside:
            look = _look(place, frame)
            ax.add_patch(Circle(tuple(center), radius, fill=False, zorder=3, **look))
            size = 2.2 * look["linewidth"]
            ax.plot(*center, marker=style.marker(group[0]), color=look["color"], markersize=size, zorder=5)
    reach = [view.points.min(axis=0), view.points.max(axis=0)]
    centers, radii = view.centers[frame.fits_in], frame.radii[frame.fits_in, None]
    low, high = np.min([*reach, *(centers - radii)], axis=0), np.max([*reach, *(centers + radii)], axis=0)
    span = 1.08 * float(np.max(high - low)) or 1.0
    size = np.maximum(high - low + 0.08 * span, 0.4 * span)  # enough for a plane seen edge-on
    low, high = 0.5 * (low + high - size), 0.5 * (low + high + size)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel=view.names[0], ylabel=view.names[1])


def _enlarged(ax: Axes, view: Projection, frame: FitFrame, shape: float) -> tuple[Floats, Floats]:
    """Draw the centres and their ellipses; return lower left and upper right of a window of the given shape."""
    halves = np.linalg.norm(view.ellipses, axis=2)  # of the box around each ellipse
    size = np.nan_to_num(halves.max(axis=1))
    use = frame.fits_in if frame.fits_in.any() else np.ones(len(size), dtype=bool)
    use = use & (size <= 5.0 * np.quantile(size[use], 0.5, method="lower"))
    reach = np.nan_to_num(halves[use])
    low, high = (view.centers[use] - reach).min(axis=0), (view.centers[use] + reach).max(axis=0)
    middle, half = 0.5 * (low + high), 0.58 * (high - low)
    wide = max(half[0], half[1] / shape, _SMALLEST * frame.radii[use].min()) or 1.0
    half = np.array([wide, wide * shape])
    low, high = middle - half, middle + half
    for place, (group, center, axes) in enumerate(zip(frame.groups, view.centers, view.ellipses, strict=True)):
        look = _look(place, frame)
        point = {"color": look["color"], "markersize": 3.0 * look["linewidth"], "linestyle": "none", "zorder": 5}
        ax.plot(*center, marker=style.marker(group[0]), **point)
        if np.isfinite(axes).all():
            long, short = 2.0 * np.linalg.norm(axes, axis=0)
            turn = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
            ax.add_patch(Ellipse((center[0], center[1]), long, short, angle=turn, fill=False, zorder=4, **look))
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel=view.names[0], ylabel=view.names[1])
    ax.xaxis.set_major_locator(MaxNLocator(3))
    ax.set_title("centres and 95 % ellipses", loc="left")
    return low, high


def _look(place: int, frame: FitFrame) -> dict[str, Any]:
    """Colour, dashes and width of a fit's lines: the first, which may lie under others, are solid and the widest."""
    width = 0.8 + 1.2 * (1.0 - (place + 1) / len(frame.groups))
    dashes = style.DASHES[place % len(style.DASHES)]
    return {"color": style.color(frame.groups[place][0]), "linestyle": dashes, "linewidth": width}

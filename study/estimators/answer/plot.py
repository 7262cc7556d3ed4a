"""Picture of a single fit: the points with the circle or sphere, and the residuals."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.estimators.answer.table import ShownFits, statuses
from study.sphere.types import Floats
from study.text.numbers import with_error

_POINT, _SPHERE = "#4c4c4c", "#1f6fb4"
_MOST_POINTS = 5000
"""Points drawn; of more, evenly spaced ones are."""


def draw(fit: ShownFits) -> Figure:
    """Draw a single fit; see `Fit.plot`."""
    sphere = fit.estimates
    d = sphere.center.shape[-1]
    if fit.shape:
        raise ValueError(f"fit of shape {fit.shape}: plot one of them, such as fit[0].plot()")
    if d > 3:
        raise ValueError(f"fit in {d} dimensions: only circles and spheres, of 2 or 3 dimensions, can be drawn")
    if fit.samples is None:
        raise ValueError("this fit does not hold its points: use study.fit, which stores them in the fit")
    points, residuals = fit.samples.points[0], fit.residuals
    step = -(-len(points) // _MOST_POINTS)
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axes = figure.add_subplot(1, 2, 1, projection="3d" if d == 3 else None)
    axes.plot(*points[::step].T, ".", color=_POINT, markersize=4.0)
    if np.isfinite([*sphere.center, sphere.radius]).all():
        (_sphere if d == 3 else _circle)(axes, sphere.center, float(sphere.radius))
    axes.set_aspect("equal")
    radius = with_error(float(sphere.radius), float(fit.standard_errors[-1]))
    axes.set_title(f"radius {radius}, {statuses(fit.status)}", fontsize=10)
    beside = figure.add_subplot(1, 2, 2)
    beside.axhline(0.0, color=_SPHERE, linewidth=1.0)
    beside.plot(np.arange(len(points))[::step], residuals[::step], ".", color=_POINT, markersize=4.0)
    beside.set(xlabel="point", ylabel="residual, in the unit of the points")
    beside.set_title("distance from the circle" if d == 2 else "distance from the sphere", fontsize=10)
    return figure


def _circle(axes: Axes, center: Floats, radius: float) -> None:
    around = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(center[0] + radius * np.cos(around), center[1] + radius * np.sin(around), color=_SPHERE, linewidth=1.0)
    axes.plot(*center, "+", color=_SPHERE)


def _sphere(axes: Any, center: Floats, radius: float) -> None:
    around, down = np.linspace(0.0, 2.0 * np.pi, 37)[:, None], np.linspace(0.0, np.pi, 19)
    x, y = np.cos(around) * np.sin(down), np.sin(around) * np.sin(down)
    shell = [c + radius * part for c, part in zip(center, (x, y, np.ones_like(around) * np.cos(down)), strict=True)]
    axes.plot_wireframe(*shell, color=_SPHERE, linewidth=0.3, alpha=0.6)
    axes.scatter(*center, marker="+", color=_SPHERE)

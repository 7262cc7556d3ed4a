"""Figure 6: two markers on concentric arcs, each fitted alone and both together.

The paper's figure 6 draws the outer marker's circle in red, the inner one's in blue and the joint fit (MGDK) in green.
It calls the improvement over both dramatic. Here the three also differ in line and mark, and colour-blind readers can
tell their red, blue and green apart. The single fits are ALS, which is UGDK with the noise estimated from the points.
The joint fit is of the same kind: one centre, one noise, a radius for each marker (eq. 22 corrected, weights 1/r̂²).

Look at: at nearly every quantile the joint fit's errors are smaller than those of either single fit. The factor is what
the information of two markers should give: the improvement is real and not dramatic. One data set can show anything;
this one was chosen because its errors are near their medians. A run with other axes than the radius is shown at their
first values. A fit without a number counts as worse than any.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from study import style
from study.arrays import Floats
from study.fits import fit, mgdk
from study.simulation.claims.claim import point_sets
from study.simulation.figures.figure import Frame, NotApplicable, Tables, at_first
from study.simulation.statistics import quantile

OUTER, INNER, JOINT = _COLORS = ("#d55e00", "#0072b2", "#009e73")
_MARKS = ("^", "s", "o")
_LINES = (style.DASHES[1], style.DASHES[2], style.DASHES[0])
_NAMES = ("outer marker alone", "inner marker alone", "both, MGDK")
_LEAST_TRIALS = 20


def prepare(tables: Tables) -> Frame:
    """Fit the kept trials of the cells of the greatest and the least radius, alone and together.

    Returns:
        points: of the outer and the inner marker (n, 2).
        centers: outer alone, inner alone, joint (3, 2).
        radii: the fitted radii, in the same order; of the joint fit both (outer, inner).
        true_radii: outer, inner.
        distances: errors of all kept trials, in the same order (3, trials); infinite for a fit without a number.
        medians: median distance of the three from the true centre.
        stamp: the run's name and trials.
        caption: the conditions in words.

    Raises:
        NotApplicable: unless the run is of circles with two radii under the same noise, drawn independently, with
            points kept.
    """
    if tables.dimension != 2 or tables.design != "grid":
        raise NotApplicable("shows circles: needs dimension = 2 and a grid of two radii")
    points = tables.points
    if points is None:
        raise NotApplicable("needs kept points: set keep_points in the config")
    tables.require_errors()
    cells = tables.summary.drop_duplicates("group").assign(cell=lambda rows: rows["group"])
    if cells["radius"].nunique() < 2:
        raise NotApplicable("needs two markers: two radii in the grid")
    cells = at_first(cells, besides=("radius",))
    if cells["radius"].nunique() < 2:
        raise NotApplicable("needs both markers under the same noise: noise in the config, not noise_over_radius")
    cells = cells.sort_values("radius")
    outer, inner = (point_sets(points, cells["cell"].iloc[place]) for place in (-1, 0))
    radii = cells["radius"].to_numpy()
    if np.allclose(np.linalg.norm(outer[0] - inner[0], axis=1), radii[-1] - radii[0], rtol=1e-9):
        raise NotApplicable('needs markers of their own: draws = "independent" in the config')
    count = min(len(outer), len(inner))
    if count < _LEAST_TRIALS:
        raise NotApplicable(f"needs at least {_LEAST_TRIALS} trials with points kept, not {count}")
    joints = [mgdk([a, b]) for a, b in zip(outer, inner, strict=False)]
    alone = [fit(marker[:count], "als") for marker in (outer, inner)]
    cloud = np.stack([alone[0].center, alone[1].center, np.array([joint.center for joint in joints])])
    distances = np.nan_to_num(np.linalg.norm(cloud, axis=2), nan=np.inf)
    shown = _typical(distances)
    cell = cells.iloc[-1]
    return Frame(
        points=(outer[shown], inner[shown]),
        centers=cloud[:, shown],
        radii=(float(alone[0].radius[shown]), float(alone[1].radius[shown]), tuple(joints[shown].radii)),
        true_radii=(float(radii[-1]), float(radii[0])),
        distances=distances,
        medians=tuple(quantile(errors, 0.5) for errors in distances),
        stamp=f"{tables.name} · trial {shown} of {count}; medians over {count} trials",
        caption=f"$N$ = {int(cell['samples']):,} each, $σ$ = {cell['noise']:g}, $φ$ = {cell['angle']:g}°",
    )


def _typical(distances: Floats) -> int:
    """The trial whose three errors are nearest to their medians, in ratio: neither the best nor the worst.

    Errors whose median is infinite do not count.
    """
    medians = np.median(distances, axis=1, keepdims=True)
    known = np.isfinite(medians[:, 0])
    off = np.abs(np.log(distances[known] / medians[known]))
    return int(off.max(axis=0, initial=0.0).argmin())


@style.journal()
def draw(frame: Frame) -> Figure:
    """Draw the circles on the left, the distributions of the errors on the right."""
    figure = style.Picture(figsize=(style.PAGE, 3.1), layout="constrained")
    whole, zoom = figure.subplots(1, 2, width_ratios=[1.0, 1.2])
    _circles(whole, frame)
    _errors(zoom, frame)
    style.stamp(figure, frame.stamp)
    return figure


def _circles(ax: Axes, frame: Frame) -> None:
    for radius in frame.true_radii:
        ax.add_patch(Circle((0, 0), radius, fill=False, linewidth=0.7, linestyle=(0, (3, 2)), color=style.FAINT))
    for points, color, mark in zip(frame.points, (OUTER, INNER), _MARKS, strict=False):
        ax.plot(*points.T, mark, color=color, markersize=2.0, markeredgewidth=0.0, alpha=0.7)
    outer, inner, both = frame.radii
    circles = ((0, outer, OUTER), (1, inner, INNER), (2, both[0], JOINT), (2, both[1], JOINT))
    for which, radius, color in circles:
        look: style.Marks = {"linewidth": 1.2, "linestyle": _LINES[which], "color": color}
        ax.add_patch(Circle(tuple(frame.centers[which]), radius, fill=False, zorder=4, **look))
    for center, color, mark in zip(frame.centers, _COLORS, _MARKS, strict=True):
        ax.plot(*center, mark, color=color, markersize=4.0, zorder=5)
    ax.plot(0, 0, "+", color="black", markersize=8, zorder=6)
    span = 1.25 * frame.true_radii[0]
    ax.set(xlim=(-span, span), ylim=(-span, span), aspect="equal", xlabel="$x_1 - c_1$", ylabel="$x_2 - c_2$")
    ax.text(0.02, 0.015, "grey, +: truth", transform=ax.transAxes, va="bottom", fontsize=style.SMALL)
    ax.set_title("one data set", loc="left")


def _errors(ax: Axes, frame: Frame) -> None:
    """Distribution functions of the three distances from the true centre."""
    share = (np.arange(frame.distances.shape[1]) + 0.5) / frame.distances.shape[1]
    for row, (distance, color) in enumerate(zip(frame.distances, _COLORS, strict=True)):
        words = f"{_NAMES[row]}: median {frame.medians[row].value:.3f} ± {frame.medians[row].error:.3f}"
        look: style.Marks = {"linestyle": _LINES[row], "marker": _MARKS[row], "markersize": 4.0, "markevery": 0.12}
        ax.plot(np.sort(distance), share, color=color, label=words, **look)
    ax.legend(loc="upper left", handlelength=3.0, borderaxespad=0.0)
    ax.axhline(0.5, color=style.FAINT, linewidth=0.7, linestyle=(0, (3, 2)))
    ax.set(xscale="log", ylim=(0.0, 1.0), xlabel="error of the centre", ylabel="share of trials below")
    low, high = np.quantile(frame.distances[np.isfinite(frame.distances)], [0.01, 0.995])
    ax.set_xlim(0.35 * low, high)  # with room for the key
    ax.text(0.98, 0.03, frame.caption, fontsize=style.SMALL, transform=ax.transAxes, ha="right")
    ax.set_title("all kept trials", loc="left")

"""Figure 3: GDKE's fit to a noisy arc, with its error ellipse: the true centre is not in it.

The paper's figure 3 shows 100 points with noise 0.05 on an arc, the circle that GDKE fits to them, and an ellipse of
the estimate's error far from the true centre, which is GDKE's bias: it shrinks the circle towards the points.

Look at: the distance from the cross (the truth) to the ellipses, and how many of all trials' ellipses hold the truth.
"""

from matplotlib.figure import Figure

from study.simulation.figures import ellipse
from study.simulation.figures.figure import Tables


def prepare(tables: Tables) -> ellipse.EllipseFrame:
    """Compute the frame; see `study.simulation.figures.ellipse.prepare`."""
    return ellipse.prepare(tables, "gdke")


def draw(frame: ellipse.EllipseFrame) -> Figure:
    """Draw the frame."""
    return ellipse.draw(frame)

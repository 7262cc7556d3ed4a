"""Figure 4: UGDK's fit to the same noisy arc as figure 3, with its error ellipse: the true centre is in it.

The paper's figure 4 shows the data of figure 3 with the circle of UGDK, which subtracts the known noise from the sample
covariance; the true centre lies inside the ellipse.

Look at: the bias is gone, and the ellipse has grown: four times as long as GDKE's, twice the bound. The dots show that
the errors are not Gaussian: they trail off away from the points.
"""

from matplotlib.figure import Figure

from study.simulation.figures import ellipse
from study.simulation.figures.figure import Tables


def prepare(tables: Tables) -> ellipse.EllipseFrame:
    """Compute the frame; see `study.simulation.figures.ellipse.prepare`."""
    return ellipse.prepare(tables, "ugdk")


def draw(frame: ellipse.EllipseFrame) -> Figure:
    """Draw the frame."""
    return ellipse.draw(frame)

"""Stored points of a run as markers of joints: the cells of a grid of radii that share one centre; and their fits.

The fits are those of `study.mgdk` for a noise that is known (theory §2), without its covariances: of all trials of a
joint at once.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from study.estimators.common_center import MarkersMoments
from study.experiment.conditions import RADIUS, STORED
from study.sphere.moments import Moments
from study.sphere.types import Bools, Floats


class JointMarkers(NamedTuple):
    """Markers about one centre, in many trials.

    Attributes:
        sigma: standard deviation of a coordinate, the same for all markers.
        radii: radius of each marker's sphere (M,), ascending.
        markers: points of each marker (trials, n, d), measured from the true centre.
    """

    sigma: float
    radii: Floats
    markers: list[Floats]


def point_sets(points: pd.DataFrame, cell: str) -> Floats:
    """Point sets (trials, n, d) of one cell, measured from the true centre."""
    mine = points[points["cell"] == cell].sort_values(["trial", "sample"])
    dimension = sum(name.startswith("center_") for name in points.columns)
    axes = range(1, dimension + 1)
    flat = np.stack([(mine[f"x_{i}"] - mine[f"center_{i}"]).to_numpy() for i in axes], axis=1)
    return flat.reshape(max(mine["trial"].nunique(), 1), -1, dimension)


def joint_markers(errors: pd.DataFrame, points: pd.DataFrame) -> Iterator[JointMarkers]:
    """The joints of a grid run with several radii, drawn independently, whose points were stored.

    Args:
        errors: the run's error table, for the conditions of its cells.
        points: its table of points.

    Yields:
        A joint per noise (ascending), number of samples, angle and centre, with a marker for each radius. Conditions
        with a single radius yield nothing.
    """
    cells = errors.drop_duplicates("cell").astype({"cell": str}).sort_values("radius")
    by_name = points.assign(cell=points["cell"].astype(str))
    others = [condition.name for condition in STORED if condition is not RADIUS and condition.name in cells]
    for _, mine in cells.groupby(others):
        if len(mine) > 1:
            sets = [point_sets(by_name, cell) for cell in mine["cell"]]
            count = min(map(len, sets))
            markers = [each[:count] for each in sets]
            yield JointMarkers(float(mine["noise"].iloc[0]), mine["radius"].to_numpy(), markers)


class JointFits(NamedTuple):
    """One centre fitted to markers, in many trials.

    Attributes:
        center: ĉ (trials, d).
        squares: r̂² of each marker (M, trials); negative where the noise hides the marker's extent.
        definite: true where Σ w (C - Σ̂) is positive definite, without which a fit is not ok (trials,).
    """

    center: Floats
    squares: Floats
    definite: Bools

    def distances(self) -> Floats:
        """Errors of all fits, infinite where there is no number (trials,); the true centre is the origin."""
        distances: Floats = np.linalg.norm(self.center, axis=1)
        return np.nan_to_num(distances, nan=np.inf)


def fit_joints(markers: Sequence[Floats], sigma: float, weighted: bool = False) -> JointFits:
    """Fit one centre to markers by eq. 22, corrected, in each trial. For a single marker that is UGDK.

    Args:
        markers: points of each marker (trials, n, d), n ≥ 2.
        sigma: standard deviation of a coordinate.
        weighted: weigh markers by 1/r̂².
    """
    # contiguous, as a study's points are: its compiled code serves here, too
    joint = MarkersMoments.of([Moments.of(np.ascontiguousarray(each.swapaxes(1, 2))) for each in markers])
    noise = sigma**2 * np.eye(joint.mean.shape[2])
    center, weights = joint.known(noise, weighted)
    subtracted = joint.subtracted(noise)
    matrix = np.einsum("mt,mtij->tij", weights, joint.c - subtracted)
    return JointFits(center, joint.square_radii(center, subtracted), np.linalg.eigvalsh(matrix)[:, 0] > 0.0)

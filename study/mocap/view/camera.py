"""View a scene from a direction, in parallel projection: lengths across the view keep their scale."""

from dataclasses import dataclass

import numpy as np

from study.sphere.types import Floats


@dataclass(frozen=True)
class Camera:
    """The direction of view, z up: ``azimuth`` from x to y and ``elevation`` above the horizon, degrees."""

    azimuth: float = 30.0
    elevation: float = 10.0

    @property
    def axes(self) -> Floats:
        """Directions to the right, up, and towards the viewer, as rows (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        return np.array(
            [
                [-np.sin(a), np.cos(a), 0.0],
                [-np.cos(a) * np.sin(e), -np.sin(a) * np.sin(e), np.cos(e)],
                [np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)],
            ]
        )

    def project(self, x: Floats) -> Floats:
        """Coordinates of points (…, 3) to the right, up and towards the viewer (…, 3), metres."""
        projected: Floats = x @ self.axes.T
        return projected


def outlines(half: Floats, directions: Floats, camera: Camera, corners: int = 48) -> Floats:
    """Outlines of ellipsoids about zero (ellipsoids, corners, 2), metres right and up.

    The parallel projection P of an ellipsoid {M u : |u| ≤ 1} is {P M u}, the ellipse of the matrix P M Mᵀ Pᵀ.

    Args:
        half: lengths of the half axes (ellipsoids, 3); one of zero gives a disc.
        directions: of these axes, as columns (ellipsoids, 3, 3).
        camera: the direction of view.
        corners: of the polygons.
    """
    matrix = camera.axes[:2] @ (directions * half[:, None])
    values, vectors = np.linalg.eigh(matrix @ matrix.transpose(0, 2, 1))
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    ellipse: Floats = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None]) @ circle
    return ellipse.transpose(0, 2, 1)

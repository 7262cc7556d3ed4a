"""Looking at a scene from a side: parallel projection, in which lengths across the view stay as they are."""

from dataclasses import dataclass

import numpy as np

from study.sphere.types import Floats


@dataclass(frozen=True)
class Camera:
    """From where one looks, z up. ``azimuth`` counts from x to y, ``elevation`` from the horizon; degrees."""

    azimuth: float = 30.0
    elevation: float = 10.0

    @property
    def axes(self) -> Floats:
        """Right, up, and towards the viewer, as rows (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        return np.array(
            [
                [-np.sin(a), np.cos(a), 0.0],
                [-np.cos(a) * np.sin(e), -np.sin(a) * np.sin(e), np.cos(e)],
                [np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)],
            ]
        )

    def see(self, x: Floats) -> Floats:
        """Points (…, 3) as right, up, nearness (…, 3), metres."""
        seen: Floats = x @ self.axes.T
        return seen


def outlines(half: Floats, directions: Floats, camera: Camera, corners: int = 48) -> Floats:
    """Outlines of ellipsoids about zero (ellipsoids, corners, 2), metres right and up.

    An ellipsoid {M u : |u| ≤ 1} is seen in parallel projection P as {P M u}, the ellipse of the matrix P M Mᵀ Pᵀ.

    Args:
        half: lengths of the half axes (ellipsoids, 3); one of zero gives a disc.
        directions: of these axes, as columns (ellipsoids, 3, 3).
        camera: from where.
        corners: of the polygons.
    """
    matrix = camera.axes[:2] @ (directions * half[:, None])
    values, vectors = np.linalg.eigh(matrix @ matrix.transpose(0, 2, 1))
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    ellipse: Floats = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None]) @ circle
    return ellipse.transpose(0, 2, 1)

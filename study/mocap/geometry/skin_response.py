"""Covariance of a joint's centre from skin that moves with the joint's own angle.

A marker at lever arm a, whose skin moves by Bθ for the joint's rotation vector θ, moves the centre by about (Bᵀâ) × â,
without a trace in the residuals (theory §12). So the covariance rests on the size of B alone. The entries of B have the
variance β² of the segment: for the segment on which the markers are, half of it common to its markers; for the segment
in whose axes the centre is fitted, each marker's own.
"""

from typing import NamedTuple

import numpy as np

from study.mocap.geometry.pose_noise import skew
from study.sphere.types import Bools, Floats

_COMMON = 0.5
"""Share of the variance of the skin that is common to the markers of a segment."""
_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_i, _k, _j] = 1.0, -1.0


class Cluster(NamedTuple):
    """The points that a segment's pose is fitted to, in its axes.

    Attributes:
        points: (m, 3), metres.
        on_skin: which of them are markers (m,), and not joints.
    """

    points: Floats
    on_skin: Bools

    def shifts(self, place: Floats) -> Floats:
        """Displacements (skin markers, 3, 3) of a point (3,) fixed in the segment per displacement of each marker."""
        v = self.points - self.points.mean(axis=0)
        k = skew(v)
        inverse = np.linalg.pinv(np.einsum("mij,mkj->ik", k, k))
        arm = skew(place - self.points.mean(axis=0))
        each = np.eye(3) / len(v) - arm @ inverse @ k
        return np.asarray(each[self.on_skin])


class MarkerResponse(NamedTuple):
    """Response of a sphere fit's centre to radial displacements that are linear in the joint's angles.

    Attributes:
        inverse: inverse of the normal matrix (3, 3), 0 along a dropped axis.
        slopes: Σ over the frames of w r z θᵀ for each marker (M, 3, 3).
        arms: unit lever arms (M, 3).
        places: mean places of the markers (M, 3), metres.
    """

    inverse: Floats
    slopes: Floats
    arms: Floats
    places: Floats


def sphere_skin(response: MarkerResponse, frame: Cluster, markers: float, own: float) -> Floats:
    """Covariance (3, 3), m², of a centre that is fitted to spheres.

    Args:
        response: of the fit.
        frame: of the segment in whose axes it is fitted.
        markers: β² of the skin below the markers on spheres, (m/rad)².
        own: β² of the skin of the frame's segment.
    """
    u = response.arms
    along = u @ u.T
    shared = markers * (_COMMON * along + (1.0 - _COMMON) * np.eye(len(u)))
    if not len(u):
        return np.zeros((3, 3))
    h = np.stack([np.einsum("i,kij->kj", arm, frame.shifts(at)) for arm, at in zip(u, response.places, strict=True)])
    shared = shared + own * np.einsum("jki,lki->jl", h, h)
    total = np.einsum("jl,jai,lbi->ab", shared, response.slopes, response.slopes)
    return np.asarray(response.inverse @ total @ response.inverse)


def pair_skin(angles: Floats, basis: Floats, moved: Floats) -> Floats:
    """Covariance (3, 3), m², of the point in which two segments agree.

    Args:
        angles: second moments of the joint's rotation vectors (3, 3), rad².
        basis: directions in which the point is known (3, d), in the same axes.
        moved: covariance of the displacement between the point's two images per radian about each axis (3, 3),
            (m/rad)².
    """
    matrix = np.trace(angles) * np.eye(3) - angles
    inverse = basis @ np.linalg.pinv(basis.T @ matrix @ basis, hermitian=True) @ basis.T
    total = np.einsum("ijk,abc,jb,kc->ia", _LEVI_CIVITA, _LEVI_CIVITA, angles @ angles, moved)
    return np.asarray(inverse @ total @ inverse)


def image_skin(cluster: Cluster, place: Floats, own: float) -> Floats:
    """Covariance (3, 3) of the displacement of a point of a segment, for skin of unit variance along each axis.

    Args:
        cluster: of the segment.
        place: of the point (3,), metres.
        own: share of the variance that is each marker's own; the rest is common to all.
    """
    each = cluster.shifts(place)
    return np.asarray(own * np.einsum("kij,klj->il", each, each) + (1.0 - own) * np.eye(3))

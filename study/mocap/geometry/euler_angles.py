"""Angles of rotations about three axes, one after the other."""

import numpy as np

from study.sphere.types import Floats

_LOCKED = 1e-9
"""Sine of the angle between the first and the third axis below which they are one axis."""


def zxy_angles(r: Floats) -> Floats:
    """Angles about z, x and y (3, frames), radians, of rotations Rz Rx Ry (3, 3, frames), without jumps.

    Where z and y rotate about one axis, the angle about y is taken as 0.
    """
    tilt = np.arcsin(np.clip(r[2, 1], -1.0, 1.0))
    z, y = np.arctan2(-r[0, 1], r[1, 1]), np.arctan2(-r[2, 0], r[2, 2])
    locked = np.hypot(r[0, 1], r[1, 1]) < _LOCKED
    z, y = np.where(locked, np.arctan2(r[1, 0], r[0, 0]), z), np.where(locked, 0.0, y)
    return np.unwrap(np.stack([z, tilt, y]), axis=1)

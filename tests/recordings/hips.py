"""A pelvis and a thigh about a known hip, in random poses; places of points in the axes of other markers."""

import numpy as np
from scipy.spatial.transform import Rotation

PELVIS = np.array([[0.12, 0.1, 0.0], [-0.12, 0.1, 0.0], [0.05, -0.1, 0.02], [-0.05, -0.1, 0.02]])
THIGH = np.array([[0.06, 0.05, -0.15], [-0.04, 0.07, -0.2], [0.02, -0.06, -0.28]])
CENTRE = np.array([-0.09, 0.02, -0.08])


def hip_motion(frames, sweep=0.5, noise=0.001, seed=1, axis=None, still=False, beside=0.0):
    """Positions of the seven markers (7, 3, frames), rotations of the pelvis, and positions of the hip (frames, 3).

    The thigh rotates about `CENTRE`, or about an axis through it; the pelvis moves, too, unless it stands still. The
    joint is so far beside that, and the thigh's markers are not.
    """
    aside = np.array([beside, 0.0, 0.0])
    rng = np.random.default_rng(seed)
    reach = 0.0 if still else 1.0
    pelvis = Rotation.from_rotvec(0.3 * reach * rng.uniform(-1, 1, (frames, 3)))
    origin = reach * rng.uniform(-1, 1, (frames, 3))
    turns = rng.uniform(-sweep, sweep, (frames, 3))
    thigh = pelvis * Rotation.from_rotvec(turns if axis is None else turns[:, :1] * axis)
    hip = origin + pelvis.apply(CENTRE - aside)
    markers = [*(origin + pelvis.apply(p) for p in PELVIS), *(hip + thigh.apply(aside + p) for p in THIGH)]
    x = np.stack(markers).transpose(0, 2, 1)
    return x + noise * rng.standard_normal(x.shape), pelvis, hip


def in_axes_of(places, true, point):
    """A point beside true places of markers, in the axes in which these are at other places."""
    turn, _ = Rotation.align_vectors(places - places.mean(axis=0), true - true.mean(axis=0))
    return turn.apply(point - true.mean(axis=0)) + places.mean(axis=0)

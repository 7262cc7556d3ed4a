"""The rotation after which z points up: files do not say which way is up, but a body's parts are above one another."""

import numpy as np

from study.mocap.io.recording import Recording
from study.sphere.types import Floats

_Y_UP = 1.3
"""The recording's y points up if its markers' mean places extend along it by this factor more than along z."""


def upright_rotation(recording: Recording) -> Floats:
    """Rotation (3, 3) after which z points up: the identity, or (z, x, y) of a recording whose y points up."""
    middle = _mean(recording.positions, axis=0)
    # a body that rotates about the vertical has little mean extent to the sides; that from foot to head stays
    mean = _mean(recording.positions - middle, axis=2)
    _, y, z = np.nanstd(mean[~np.isnan(mean[:, 0])], axis=0)
    if y > _Y_UP * z:
        return np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return np.eye(3)


def _mean(x: Floats, axis: int) -> Floats:
    """Mean of the values that are not NaN; NaN where there are none."""
    known = ~np.isnan(x)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, x, 0.0).sum(axis=axis) / known.sum(axis=axis))

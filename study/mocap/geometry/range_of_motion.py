"""Ranges of motion: the angle that markers sweep about a joint, and the angle by which one segment rotates in another.

They say what a fitted centre rests on, whatever its standard error is.
"""

import numpy as np

from study.mocap.geometry.moving_axes import nearest_rotation
from study.sphere.types import Bools, Floats

_QUANTILE = 0.95
"""Share of the samples within the angle; the rest may be outliers."""


def cap_angle(y: Floats, used: Bools, center: Floats) -> float:
    """Half-angle of the cap about the mean direction that holds 95 % of a marker's samples.

    Args:
        y: the marker in the segment's axes (3, frames), metres.
        used: samples to use (frames,).
        center: centre of the joint (3,), metres.

    Returns:
        The angle, radians; NaN without samples.
    """
    away = y[:, used] - center[:, None]
    with np.errstate(invalid="ignore"):
        direction = away / np.sqrt((away**2).sum(axis=0))
    if not direction.size or np.isnan(direction).all():
        return float("nan")
    middle = np.nanmean(direction, axis=1)
    length = np.sqrt((middle**2).sum())
    if not length > 0.0:
        return float(np.pi)
    cosine = np.clip(middle @ direction / length, -1.0, 1.0)
    return float(np.nanquantile(np.arccos(cosine), _QUANTILE))


def rotation_range(rotation: Floats) -> float:
    """Angle about the mean orientation within which 95 % of rotations lie.

    Args:
        rotation: of one segment in another's axes (3, 3, frames), NaN where unknown.

    Returns:
        The angle, radians; NaN without a known rotation.
    """
    known = rotation[:, :, ~np.isnan(rotation[0, 0])]
    if not known.shape[2]:
        return float("nan")
    mean = nearest_rotation(known.mean(axis=2))
    trace = np.einsum("ij,ijt->t", mean, known)
    return float(np.quantile(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)), _QUANTILE))

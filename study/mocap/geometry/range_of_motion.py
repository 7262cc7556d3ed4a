"""How far markers really moved about a joint: what a centre rests on, whatever its standard error says."""

import numpy as np

from study.mocap.geometry.kabsch import nearest_rotation
from study.sphere.types import Bools, Floats

_MOST = 0.95
"""Share of the samples that a cap holds; the rest may be stray ones."""


def cap_angle(y: Floats, used: Bools, center: Floats) -> float:
    """Half-angle of the cap about its mean direction that holds 95 % of a marker's samples, radians; NaN for none.

    Args:
        y: the marker in the frame's axes (3, frames), metres.
        used: samples that count (frames,).
        center: of the joint (3,), metres.
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
    return float(np.nanquantile(np.arccos(cosine), _MOST))


def turn_angle(rotation: Floats) -> float:
    """Angle about the mean orientation within which 95 % of rotations lie, radians; NaN for none.

    Args:
        rotation: of one segment in another's axes (3, 3, frames), NaN where unknown.
    """
    known = rotation[:, :, ~np.isnan(rotation[0, 0])]
    if not known.shape[2]:
        return float("nan")
    mean = nearest_rotation(known.mean(axis=2))
    trace = np.einsum("ij,ijt->t", mean, known)
    return float(np.quantile(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)), _MOST))

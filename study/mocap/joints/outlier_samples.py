"""Outliers among a marker's samples about a joint: samples far off the marker's sphere, such as swapped markers.

Least squares is not robust: one marker that is half a metre away in one frame of fifty moves the sphere there. So
small random sets of samples, many of which hold no outlier, propose centres. If the median sample is several times
nearer to its sphere about one of these than about the centre of all samples, there are outliers. Samples far from the
spheres about that centre are rejected, then those far from GDKE's, until none is.

Source: Rousseeuw 1984 (least median of squares).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from study.estimators import fit
from study.experiment.streams import stream
from study.mocap.geometry.pose_noise import PoseNoise
from study.mocap.joints.center import LocalMarker, center_only
from study.sphere.types import Floats

_FAR = 6.0
"""Robust standard deviations from its sphere beyond which a sample is rejected."""
_ROUNDING = 1e-9
"""Metres: deviations below this are rounding."""
_SETS, _SAMPLES = 20, 10
"""Random sets per marker, and samples of each: with a tenth of all samples wrong, a third of the sets are clean."""
_FRAMES = 600
"""Frames, spread over the recording, from which the centre of all samples comes."""
_COMPARED = 200
"""Samples of each marker on which centres are compared."""
_BETTER = 3.0
"""Factor by which a proposed centre must be better; one that fits a cluster of like poses is better by less."""
_COARSE = 0.3
"""Share of the radius by which a sample may miss a sphere about a centre as rough as that of a random set."""
_ROUNDS = 3


def reject_outliers(markers: Sequence[LocalMarker]) -> list[LocalMarker]:
    """Reject the samples of markers about one joint that are far off their spheres."""
    kept = list(markers)
    clean = _robust_center(markers, _center_of_all(kept))
    if clean is not None:
        kept = [reject_off_sphere(marker, clean, tolerance=_COARSE) for marker in markers]
    for _ in range(_ROUNDS):
        center = _center_of_all(kept)
        if center is None:
            break
        before, kept = kept, [reject_off_sphere(marker, center) for marker in kept]
        if all(a.used.sum() == b.used.sum() for a, b in zip(kept, before, strict=True)):
            break
    return kept


def reject_off_sphere(
    marker: LocalMarker, center: Floats, axis: Floats | None = None, tolerance: float = 0.0
) -> LocalMarker:
    """Reject the samples of a marker that are far off its sphere.

    Args:
        marker: in a segment's axes.
        center: of the sphere (3,), metres.
        axis: of a hinge (3,), to reject samples off the marker's circle about it instead.
        tolerance: share of the radius that is never far.
    """
    away = marker.y - center[:, None]
    if axis is not None:
        away = away - np.outer(axis, axis @ away)
    distance = np.sqrt((away**2).sum(axis=0))
    inside = distance[marker.used]
    if not len(inside):
        return marker
    middle = np.median(inside)
    limit = max(_FAR * 1.4826 * float(np.median(np.abs(inside - middle))), tolerance * middle, _ROUNDING)
    return replace(marker, used=marker.used & (np.abs(distance - middle) <= limit))


def _center_of_all(markers: Sequence[LocalMarker]) -> Floats | None:
    """GDKE's centre (3,), on frames spread over the recording."""
    some = slice(None, None, max(markers[0].y.shape[1] // _FRAMES, 1))
    part = [marker.in_frames(some) for marker in markers]
    none = np.zeros((1, 3, 3))
    exact = PoseNoise(np.zeros(part[0].y.shape[1], dtype=np.int64), np.zeros((1, 3)), none, none, none)
    return center_only(part, exact, size=0.0)


def _robust_center(markers: Sequence[LocalMarker], usual: Floats | None) -> Floats | None:
    """A centre (3,) from few samples that fits most samples much better than the usual one; None if there is none."""
    samples = [m.y[:, m.used].T for m in markers if m.used.sum() >= _SAMPLES]
    if not samples or usual is None:
        return None
    candidates = [usual[None]]
    for number, points in enumerate(samples):
        chosen = stream(0, "sift", number, len(points)).integers(0, len(points), (_SETS, _SAMPLES))
        candidates.append(fit(points[chosen], "gdke").center)
    centers = np.concatenate(candidates)
    centers = centers[np.isfinite(centers).all(axis=1)]
    misfit = np.zeros(len(centers))
    for points in samples:
        part = points[:: max(len(points) // _COMPARED, 1)]
        distance = np.sqrt(((part - centers[:, None]) ** 2).sum(axis=2))
        middle = np.median(distance, axis=1, keepdims=True)
        misfit += np.median(np.abs(distance - middle), axis=1)
    best = int(misfit.argmin())
    return centers[best] if misfit[best] * _BETTER < misfit[0] else None

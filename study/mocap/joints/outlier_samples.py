"""Samples that are far off their marker's sphere: another marker's, taken for this one for a moment, and the like.

Least squares has no defence: one marker in fifty frames half a metre away, and the sphere goes there. So small random
sets of samples, many of which are clean, give centres, too; one about which the median sample is several times nearer
to its sphere than about that of all samples shows that there are stray ones. Samples far from its spheres go, then
those far from GDKE's, until none does.

Source: Rousseeuw 1984 (least median of squares).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from study.estimators import fit
from study.experiment.streams import stream
from study.mocap.joints.center import Marker, middle_of
from study.mocap.joints.pose_noise import CarriedNoise
from study.sphere.types import Floats

_FAR = 6.0
"""Robust standard deviations from its sphere beyond which a sample is left out."""
_ROUNDING = 1e-9
"""Metres."""
_SETS, _OF = 20, 10
"""Random sets per marker, and samples of each: with a tenth of all samples wrong, a third of the sets are clean."""
_PART = 600
"""Frames, spread over the recording, from which the usual centre comes..."""
_TRIED = 200
"""...and those on which it is compared with the others."""
_BETTER = 3.0
"""So many times nearer to their spheres: a centre that fits a cluster of like poses is nearer, but not by so much."""
_COARSE = 0.3
"""Share of the radius that a sample may be off a centre as rough as that of a random set."""
_ROUNDS = 3


def sifted(markers: Sequence[Marker]) -> list[Marker]:
    """Markers about one joint without samples that are far off their spheres."""
    used = list(markers)
    start = _center_of_all(used)
    clean = _clean_center(markers, start)
    if clean is not None:
        used = [near_sphere(marker, clean, coarse=_COARSE) for marker in markers]
    for _ in range(_ROUNDS):
        start = _center_of_all(used)
        if start is None:
            break
        before, used = used, [near_sphere(marker, start) for marker in used]
        if all(a.used.sum() == b.used.sum() for a, b in zip(used, before, strict=True)):
            break
    return used


def near_sphere(marker: Marker, center: Floats, axis: Floats | None = None, coarse: float = 0.0) -> Marker:
    """A marker without samples far off its sphere about a centre (3,); off its circle, with an axis (3,).

    ``coarse`` is a share of the radius that is not far in any case.
    """
    away = marker.y - center[:, None]
    if axis is not None:
        away = away - np.outer(axis, axis @ away)
    distance = np.sqrt((away**2).sum(axis=0))
    inside = distance[marker.used]
    if not len(inside):
        return marker
    middle = np.median(inside)
    limit = max(_FAR * 1.4826 * float(np.median(np.abs(inside - middle))), coarse * middle, _ROUNDING)
    return replace(marker, used=marker.used & (np.abs(distance - middle) <= limit))


def _center_of_all(markers: Sequence[Marker]) -> Floats | None:
    """GDKE's centre (3,), on frames spread over the recording."""
    step = max(markers[0].y.shape[1] // _PART, 1)
    some = [Marker(np.ascontiguousarray(m.y[:, ::step]), m.used[::step], m.own) for m in markers]
    none = np.zeros((1, 3, 3))
    plain = CarriedNoise(np.zeros(some[0].y.shape[1], dtype=np.int64), np.zeros((1, 3)), none, none, none)
    return middle_of(some, plain, size=0.0)


def _clean_center(markers: Sequence[Marker], usual: Floats | None) -> Floats | None:
    """A centre (3,) from a few samples that fits most samples much better than the usual one; None if there is none."""
    samples = [m.y[:, m.used].T for m in markers if m.used.sum() >= _OF]
    if not samples or usual is None:
        return None
    candidates = [usual[None]]
    for place, points in enumerate(samples):
        chosen = stream(0, "sift", place, len(points)).integers(0, len(points), (_SETS, _OF))
        candidates.append(fit(points[chosen], "gdke").center)
    centers = np.concatenate(candidates)
    centers = centers[np.isfinite(centers).all(axis=1)]
    misfit = np.zeros(len(centers))
    for points in samples:
        part = points[:: max(len(points) // _TRIED, 1)]
        distance = np.sqrt(((part - centers[:, None]) ** 2).sum(axis=2))
        middle = np.median(distance, axis=1, keepdims=True)
        misfit += np.median(np.abs(distance - middle), axis=1)
    best = int(misfit.argmin())
    return centers[best] if misfit[best] * _BETTER < misfit[0] else None

"""The shape of a few markers on one segment, from a recording in which some are hidden, moved or swapped now and then.

Distances between markers do not depend on how the body lies, and their medians over time do not mind a few wrong
frames. Classical scaling turns the medians into a shape, wrong samples are those whose distances do not fit, and
generalised Procrustes analysis of what is left refines it: turn each frame onto the shape, take the mean, repeat.

Source: Torgerson 1952 (scaling); Gower 1975 (Procrustes), without change of size.
"""

from dataclasses import dataclass

import numpy as np

from study.mocap.geometry.kabsch import into, motion
from study.sphere.types import Bools, Floats, Ints

_ENOUGH = 500
"""Frames that a shape is refined on, spread over the recording: more would not change it visibly."""
_ROUNDS = 30
_STILL = 1e-7
"""A round that changes the shape by less than this share of its size is the last."""
_WRONG = 6.0
"""A distance that is so many robust standard deviations from its median is wrong..."""
_SLACK = 0.1
"""...if it also is this share of it away: markers on a stiff segment scatter by next to nothing."""


@dataclass(frozen=True)
class Template:
    """The shape of a segment's markers, and which of their samples to believe.

    Attributes:
        points: the shape (m, 3), metres, about its centroid; axes as in one frame of the recording. NaN for a marker
            that was never seen together with the others.
        good: samples that were seen and whose distances to the other markers fit (m, frames).
        outliers: samples that were seen and do not fit, swapped ones among them (m, frames).
    """

    points: Floats
    good: Bools
    outliers: Bools


def template(x: Floats) -> Template:
    """Shape of markers seen at x (m, 3, frames), metres, NaN where not seen."""
    m = len(x)
    seen = ~np.isnan(x).any(axis=1)
    outliers = np.zeros_like(seen)
    if m > 1:
        middle, limit = _distances(x)
        outliers = misfits(x, middle, limit)
    good = seen & ~outliers
    if m < 3:
        points = _line(m, middle[0, 1] if m == 2 else 0.0)
        return Template(points, good, outliers)
    whole = _together(np.isfinite(middle))
    points = np.full((m, 3), np.nan)
    if len(whole) >= 3:
        points[whole] = _refined(_scaled(middle[np.ix_(whole, whole)]), x[whole], good[whole])
    return Template(points, good, outliers)


def _distances(x: Floats) -> tuple[Floats, Floats]:
    """Median distance of each two markers over the frames with both (m, m), NaN if none; and how far is too far."""
    m = len(x)
    middle, limit = np.full((m, m), np.nan), np.full((m, m), np.nan)
    np.fill_diagonal(middle, 0.0)
    for i in range(m):
        for j in range(i):
            distance = np.sqrt(((x[i] - x[j]) ** 2).sum(axis=0))
            distance = distance[~np.isnan(distance)]
            if len(distance):
                middle[i, j] = middle[j, i] = np.median(distance)
                spread = 1.4826 * np.median(np.abs(distance - middle[i, j]))  # 1 for a Gaussian of deviation 1
                limit[i, j] = limit[j, i] = max(_WRONG * spread, _SLACK * middle[i, j])
    return middle, limit


def misfits(x: Floats, middle: Floats, limit: Floats) -> Bools:
    """Samples whose distances to the other markers of the frame do not fit (m, frames).

    In each frame the marker with the most wrong distances goes, then the next, until the rest fit; of two with equally
    many, the one whose distances are farther off. Two markers alone cannot tell which of them is wrong: both go.

    Args:
        x: where the markers were seen (m, 3, frames).
        middle: their usual distances (m, m).
        limit: how far a distance may be from that (m, m).
    """
    m = len(x)
    off = np.zeros((m, m, x.shape[2]))
    for i in range(m):
        for j in range(i):
            distance = np.sqrt(((x[i] - x[j]) ** 2).sum(axis=0))
            with np.errstate(invalid="ignore", divide="ignore"):
                off[i, j] = off[j, i] = np.nan_to_num(np.abs(distance - middle[i, j]) / limit[i, j])
    result = np.zeros((m, x.shape[2]), dtype=np.bool_)
    suspect = np.flatnonzero((off > 1.0).any(axis=(0, 1)))
    part = off[:, :, suspect]
    for _ in range(m):
        wrong = (part > 1.0).sum(axis=1)  # (m, suspects)
        left = wrong.any(axis=0)
        if not left.any():
            break
        # the count decides; how far off they are breaks ties
        score = wrong + 1e-3 * np.minimum(part.sum(axis=1), 100.0)
        worst = score.argmax(axis=0)
        at = np.flatnonzero(left)
        gone = np.zeros((m, len(suspect)), dtype=np.bool_)
        gone[worst[at], at] = True
        alone = left & ((wrong > 0).sum(axis=0) == 2) & ((~result[:, suspect] & _seen(x, suspect)).sum(axis=0) == 2)
        gone |= (wrong > 0) & alone
        result[:, suspect] |= gone
        part = np.where(gone[:, None] | gone[None], 0.0, part)
    return result


def _together(pairs: Bools) -> Ints:
    """Markers that were each seen together with each other, the most lacking ones left out first."""
    chosen = list(range(len(pairs)))
    while not pairs[np.ix_(chosen, chosen)].all():
        del chosen[int(pairs[np.ix_(chosen, chosen)].sum(axis=1).argmin())]
    return np.array(chosen)


def _seen(x: Floats, frames: Ints) -> Bools:
    return ~np.isnan(x[:, 0][:, frames])


def _line(m: int, length: float) -> Floats:
    """One or two markers as a shape: along the first axis, about their middle."""
    points = np.zeros((m, 3))
    if m == 2:
        points[:, 0] = [-0.5 * length, 0.5 * length]
    return points


def _scaled(middle: Floats) -> Floats:
    """Classical scaling: points (m, 3) with nearly these distances (m, m), or their mirror image."""
    m = len(middle)
    centring = np.eye(m) - 1.0 / m
    values, vectors = np.linalg.eigh(-0.5 * centring @ middle**2 @ centring)
    leading = np.sqrt(np.maximum(values[-3:], 0.0))
    return np.asarray(vectors[:, -3:] * leading)


def _refined(points: Floats, x: Floats, good: Bools) -> Floats:
    """Procrustes mean, started from the given shape or its mirror image, whichever is nearer to the frames."""
    enough = np.flatnonzero(good.sum(axis=0) >= 3)
    if not len(enough):
        return np.full_like(points, np.nan)
    chosen = enough[np.linspace(0, len(enough) - 1, min(len(enough), _ENOUGH)).astype(int)]
    part, used = np.ascontiguousarray(x[:, :, chosen]), np.ascontiguousarray(good[:, chosen])
    mirrored = points * np.array([1.0, 1.0, -1.0])
    points = min(points, mirrored, key=lambda shape: _misfit(shape, part, used))
    size = np.sqrt((points**2).sum())
    for _ in range(_ROUNDS):
        following = _mean(points, part, used)
        change = np.abs(following - points).max()
        points = following if np.isfinite(change) else points  # on a line no frame is known: as it was
        if not change > _STILL * size:
            break
    return points


def _mean(points: Floats, x: Floats, used: Bools) -> Floats:
    """Mean of the markers (m, 3) over frames turned onto a shape, about its centroid."""
    rotations, origins, known = motion(points, x, used)
    y = into(rotations, origins, x)
    count = (used & known).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where((used & known)[:, None], y, 0.0).sum(axis=2) / count[:, None]
    return np.asarray(mean - mean.mean(axis=0))


def _misfit(points: Floats, x: Floats, used: Bools) -> float:
    """Mean square distance of the markers from a shape turned onto each frame; infinite where no frame can be."""
    rotations, origins, known = motion(points, x, used)
    y = into(rotations, origins, x) - points[:, :, None]
    counted = used & known
    return float((y**2).sum(axis=1)[counted].mean()) if counted.any() else np.inf

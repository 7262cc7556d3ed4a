"""Outliers among the markers of one rigid segment, found by the distances between markers.

A distance between two markers of a rigid segment does not depend on its pose, and its median over time is not moved by
some wrong frames. A sample whose distances to the other markers are far from their medians is a swapped marker or a
stray one.
"""

import numpy as np

from study.sphere.types import Bools, Floats, Ints

_FAR = 6.0
"""A distance this many robust standard deviations from its median is wrong..."""
_SLACK = 0.1
"""...if it is also this share of the median away from it: on a stiff segment distances scatter by next to nothing."""


def usual_distances(x: Floats) -> tuple[Floats, Floats]:
    """Median distance between each two markers, and the largest deviation from it that is accepted.

    Args:
        x: markers of one segment (m, 3, frames), metres; NaN where missing.

    Returns:
        Two arrays (m, m), metres; NaN for markers that no frame shows together.
    """
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
                limit[i, j] = limit[j, i] = max(_FAR * spread, _SLACK * middle[i, j])
    return middle, limit


def distance_outliers(x: Floats, middle: Floats, limit: Floats) -> Bools:
    """Find samples whose distances to the other markers of the frame are wrong.

    In each frame the marker with the most wrong distances is rejected, then the next, until the rest agree; of two
    markers with equally many, the one with the larger deviations. Of two markers alone either may be wrong, so both
    are rejected.

    Args:
        x: markers of one segment (m, 3, frames), metres; NaN where missing.
        middle: their usual distances (m, m).
        limit: largest accepted deviation from these (m, m).

    Returns:
        Samples to reject (m, frames).
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
        # the count decides; the size of the deviations breaks ties
        score = wrong + 1e-3 * np.minimum(part.sum(axis=1), 100.0)
        worst = score.argmax(axis=0)
        at = np.flatnonzero(left)
        rejected = np.zeros((m, len(suspect)), dtype=np.bool_)
        rejected[worst[at], at] = True
        last_two = (~result[:, suspect] & _present(x, suspect)).sum(axis=0) == 2
        rejected |= (wrong > 0) & (left & ((wrong > 0).sum(axis=0) == 2) & last_two)
        result[:, suspect] |= rejected
        part = np.where(rejected[:, None] | rejected[None], 0.0, part)
    return result


def _present(x: Floats, frames: Ints) -> Bools:
    """Samples that are not missing, of some frames (m, len(frames))."""
    return ~np.isnan(x[:, 0][:, frames])

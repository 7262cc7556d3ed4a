"""Maximum likelihood from other starts than `mle`'s, to tell whether its F has other minima, and better ones.

F(c) = Σ(R - R̄)² falls off on both sides of the points: besides the minimum on the side of the sphere there may be one
on the other side, or only a slope to infinity, where the sphere is a plane (a status says so). For use on data take
`mle`; its answers are bad exactly where one of these has a much better one, or none has.
"""

from study.estimators.fit import Fit, Samples
from study.estimators.mle import minimum_from


def mle_centroid(samples: Samples) -> Fit:
    """`mle` from the centroid of the points, between the two sides.

    Source: paper §4.1, which explains MLE's outliers by multiple solutions.
    """
    return minimum_from(samples, 0.0)


def mle_mirror(samples: Samples) -> Fit:
    """`mle` from the wrong side of the points: GDKE's answer reflected through their centroid.

    Source: paper §4.1, which explains MLE's outliers by multiple solutions.
    """
    return minimum_from(samples, -1.0)

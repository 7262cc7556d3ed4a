"""The robust fit: maximum likelihood from the points that are not outliers."""

import numpy as np

from study.estimators.estimates import Estimates, blank
from study.estimators.geometric.mle import mle
from study.estimators.robust.outliers import outliers
from study.estimators.samples import Samples


def robust(samples: Samples) -> Estimates:
    """`mle` from the points that `outliers` does not name.

    Up to just under half of the points may be anywhere. Without outliers it is `mle`, but in the one data set in a
    hundred in which a clean point is taken for one. It fails where one sphere comes near to more than half of the
    points, outliers among them, within the noise: far points beside a small cap that leaves the radius open, or a
    cluster a few standard deviations from the sphere.

    Source: Rousseeuw & Van Driessen 2006; Hadi & Simonoff 1993; theory §11.
    """
    named = outliers(samples)
    count = named.sum(axis=1)
    if not count.any():
        return mle(samples)
    b, d, _ = samples.shape
    result = blank(b, d)
    for number in np.unique(count):
        sets = np.flatnonzero(count == number)
        kept = np.stack([samples.x[t][:, ~named[t]] for t in sets])
        for whole, part in zip(result, mle(Samples(kept)), strict=True):
            whole[sets] = part
    return result

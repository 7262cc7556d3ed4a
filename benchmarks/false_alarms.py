"""False alarms of the outlier rule on clean data; `python benchmarks/false_alarms.py` stores their share.

Points lie on caps in two to four dimensions, with normal noise and no outliers. A false alarm is a data set in which
some point is named; the rule promises them in 1 % of the data sets. Cells of 20° with σ = .2 r show no sphere at all:
there the noise is three times the depth of the cap.
"""

import math

from studies import clean, store

from study.fits import Samples
from study.fits.random import lanes
from study.fits.robust import outliers

SEED = 17
ANGLES, NOISES = (20.0, 60.0, 180.0), (0.01, 0.05, 0.1, 0.2)
SETS = {10: 10_000, 30: 10_000, 100: 10_000, 1000: 4000}
"""Data sets in each cell in space, by the number of points."""
OTHERS = [(d, n, angle, 0.05, 10_000) for d in (2, 4) for n in (10, 100) for angle in ANGLES]
"""Dimension, points, angle, noise and data sets of the cells in the plane and in four dimensions."""
LARGE = [(3, 10_000, 60.0, 0.05, 2000), (3, 10_000, 180.0, 0.2, 2000), (3, 100_000, 60.0, 0.05, 500)]
LARGE += [(3, 1_000_000, 60.0, 0.05, 100)]
"""Dimension, points, angle, noise and data sets of the few cells with many points."""
CELLS = [(3, n, angle, noise, sets) for n, sets in SETS.items() for angle in ANGLES for noise in NOISES]


def rows():
    """A row for each cell: the number of data sets in which a point is named, and their share."""
    for d, n, angle, noise, sets in CELLS + OTHERS + LARGE:
        state = lanes(SEED, "false alarms", d, n, angle, noise)
        alarms = sum(int(outliers(Samples(x)).any(axis=1).sum()) for x in clean(state, sets, n, angle, noise, d))
        share = alarms / sets
        error = math.sqrt(max(share, 1.0 / sets) * (1.0 - share) / sets)
        row = {"dimension": d, "samples": n, "angle": angle, "noise_over_radius": noise, "sets": sets}
        yield {**row, "alarms": alarms, "share": share, "share_error": error}


if __name__ == "__main__":
    store("false-alarms", rows())

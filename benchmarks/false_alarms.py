"""False alarms of the outlier rule on clean data; `python benchmarks/false_alarms.py` stores their share.

Points lie on spherical caps with normal noise and no outliers. A false alarm is a data set in which some point is
named; the rule promises them in 1 % of the data sets. Cells of 20° with σ ≥ .1 r show no sphere at all: there the noise
is as large as the cap is wide.
"""

import math
from pathlib import Path

import numpy as np
import pandas as pd

from study.estimators import Samples
from study.estimators.robust.outliers import outliers
from study.experiment.streams import lanes
from study.sphere import cap

SEED = 17
ANGLES, NOISES = (20.0, 60.0, 180.0), (0.01, 0.05, 0.1, 0.2)
SETS = {10: 4000, 30: 4000, 100: 2500, 1000: 500}
"""Data sets in each cell, by the number of points."""
LARGE = [(10_000, 60.0, 0.05, 200), (10_000, 180.0, 0.2, 200), (100_000, 60.0, 0.05, 80), (1_000_000, 60.0, 0.05, 25)]
"""Points, angle, noise and data sets of the few cells with many points."""
TOGETHER = 200_000
"""Points that are drawn at a time."""


def alarms(n, angle, noise, sets):
    """Number of data sets in which a point is named."""
    state, found = lanes(SEED, "false alarms", n, angle, noise), 0
    for begun in range(0, sets, max(TOGETHER // n, 1)):
        size = min(max(TOGETHER // n, 1), sets - begun)
        directions, unit_noise = np.empty((size, 3, n)), np.empty((size, 3, n))
        cap.draw(state, math.radians(angle), directions, unit_noise)
        directions[:, 0] = 1.0 - directions[:, 0]  # heights to cosines
        found += int(outliers(Samples(directions + noise * unit_noise)).any(axis=1).sum())
    return found


def main():
    """Measure every cell, and store a row for each as soon as it is known."""
    cells = [(n, angle, noise, sets) for n, sets in SETS.items() for angle in ANGLES for noise in NOISES]
    rows = []
    for n, angle, noise, sets in cells + LARGE:
        found = alarms(n, angle, noise, sets)
        share = found / sets
        error = math.sqrt(max(share, 1.0 / sets) * (1.0 - share) / sets)
        row = {"samples": n, "angle": angle, "noise_over_radius": noise, "sets": sets, "alarms": found}
        rows.append({**row, "share": share, "share_error": error})
        path = Path(__file__).parents[1] / "results" / "false-alarms.csv"
        pd.DataFrame(rows).to_csv(path, index=False, lineterminator="\n")


if __name__ == "__main__":
    main()

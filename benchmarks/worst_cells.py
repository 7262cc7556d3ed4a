"""Cells in which the fits do worst; `python benchmarks/worst_cells.py` stores them in `results/worst-cells.csv`.

Intervals between the cells of `configs/coverage.toml` and in many dimensions; the default beside another estimator
where most fits are not ok; and a cluster of 40 of 100 points, through which a sphere can always pass.
"""

import math

import numpy as np
from studies import caps, covered, store

import study

SEED = 41
COVERAGE = [(3, 12, 115, 0.22, 12000), (5, 40, 180, 0.1, 1500), (5, 250, 160, 0.34, 600), (10, 100, 180, 0.1, 1000)]
COVERAGE += [(10, 100, 180, 0.2, 1000), (10, 1000, 180, 0.1, 300), (20, 100, 180, 0.1, 600)]
"""Dimension, points, half angle of the cap, noise and number of sets."""
BESIDE = [("als", 45, 7, 0.01, 4000), ("mle", 100, 160, 0.8, 2000), ("mle", 1000, 160, 0.8, 1000)]
"""Another estimator, points, half angle, noise and number of sets."""
CLUSTERS = [(60, 0.0), (115, 0.0), (180, 0.0), (180, 0.5), (180, 2.0)]
"""Half angle of the cap of the other points, and place of the cluster along its axis."""
CLUSTERED = 400


def share(hits):
    """A share and its Monte-Carlo error."""
    value = float(np.mean(hits))
    return {"value": value, "error": math.sqrt(value * (1.0 - value) / len(hits))}


def errors(fit):
    """Distances of the centres from the truth, infinite where there is none."""
    distance = np.linalg.norm(fit.center, axis=1)
    return np.where(np.isfinite(distance), distance, np.inf)


def coverage(rng, dimension, n, angle, noise, sets):
    """Coverage of the radius and of the centre's first coordinate, over all and over ok fits."""
    fit = study.fit(caps(rng, sets, n, angle, noise, dimension))
    hits = {"radius": covered(fit.interval("radius"), 1.0), "center": covered(fit.interval("center")[:, 0], 0.0)}
    place = {"dimension": dimension, "samples": n, "angle": angle, "noise": noise, "sets": sets, "ok": fit.ok.mean()}
    for name, hit in hits.items():
        yield place | {"kind": name} | share(hit)
        yield place | {"kind": f"{name}, ok"} | share(hit[fit.ok])


def beside(rng, other, n, angle, noise, sets):
    """Median error of the default over that of another estimator, with its bootstrap error."""
    points = caps(rng, sets, n, angle, noise)
    fit = study.fit(points)
    one, two = errors(fit), errors(study.fit(points, other))
    again = [np.median(one[k]) / np.median(two[k]) for k in rng.integers(sets, size=(200, sets))]
    place = {"dimension": 3, "samples": n, "angle": angle, "noise": noise, "sets": sets, "ok": fit.ok.mean()}
    yield place | {"kind": other, "value": np.median(one) / np.median(two), "error": np.std(again)}


def clustered(rng, angle, where):
    """Share of sets in which each estimator is off by more than .1 r, and the median error."""
    points = caps(rng, CLUSTERED, 100, angle, 0.02)
    points[:, :40] = [where, 0.0, 0.0] + 0.02 * rng.standard_normal((CLUSTERED, 40, 3))
    for name in ("robust", "corrected"):
        fit = study.fit(points, name)
        place = {"dimension": 3, "samples": 100, "angle": angle, "noise": 0.02, "sets": CLUSTERED, "ok": fit.ok.mean()}
        place |= {"cluster": where, "estimator": name, "flagged": fit.outliers.any(axis=1).mean()}
        yield place | {"kind": "cluster", "median_error": np.median(errors(fit))} | share(errors(fit) > 0.1)


def rows():
    """A row for each measure of each cell."""
    rng = np.random.default_rng(SEED)
    for kind, cells in ((coverage, COVERAGE), (beside, BESIDE), (clustered, CLUSTERS)):
        for cell in cells:
            yield from kind(rng, *cell)


if __name__ == "__main__":
    store("worst-cells", rows())

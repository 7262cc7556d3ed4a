"""Where the intervals, the default estimator and the outlier rule end; each table is stored in results/.

    python benchmarks/limits.py                  # all
    python benchmarks/limits.py false-alarms     # one

- coverage-limits: 95 % intervals on data that `configs/coverage.toml` does not have: fewer than ten points, whose
  noise can look small by chance; belts, which are points about an equator; and outliers, some of which are too near to
  be noticed. Across a belt the centre is known by the points' distances from its plane alone, and the interval takes
  them to be large beside its standard error.
- worst-cells: intervals between the cells of `configs/coverage.toml` and in many dimensions; the default beside another
  estimator where most fits are not ok; and a cluster of 40 of 100 points, through which a sphere can always pass.
- false-alarms: clean data sets in which the outlier rule names a point; it promises 1 %. Caps of 20° with σ = .2 r show
  no sphere at all: there the noise is three times the depth of the cap.
"""

import math
import sys

import numpy as np
from scipy.optimize import brentq
from studies import caps, clean, covered, share, store

import study
from study.fits import Samples
from study.fits.estimators.robust import outliers
from study.fits.loops.random import lanes

SETS = 4000
FEW = [(n, angle, noise) for n in (5, 6, 7, 8) for angle in (60.0, 180.0) for noise in (0.02, 0.1)]
"""Points, half angle of the cap and noise."""
BELTS = [(n, width, ratio) for n in (40, 1000) for width in (5.0, 20.0) for ratio in (0.1, 0.2, 0.3, 0.5, 1.0)]
"""Points, largest latitude, and the standard error across over the rms distance of the points from the plane."""
NEAR = [(n, 60.0, share) for n in (40, 100) for share in (0.0, 0.1, 0.2)]
"""Points, half angle of the cap, and share of points displaced by a normal step of one radius in each coordinate."""

COVERAGE = [(3, 12, 115, 0.22, 12000), (5, 40, 180, 0.1, 1500), (5, 250, 160, 0.34, 600), (10, 100, 180, 0.1, 1000)]
COVERAGE += [(10, 100, 180, 0.2, 1000), (10, 1000, 180, 0.1, 300), (20, 100, 180, 0.1, 600)]
"""Dimension, points, half angle of the cap, noise and number of sets."""
BESIDE = [("als", 45, 7, 0.01, 4000), ("mle", 100, 160, 0.8, 2000), ("mle", 1000, 160, 0.8, 1000)]
"""Another estimator, points, half angle, noise and number of sets."""
CLUSTERS = [(60, 0.0), (115, 0.0), (180, 0.0), (180, 0.5), (180, 2.0)]
"""Half angle of the cap of the other points, and place of the cluster along its axis."""

ANGLES, NUMBERS = (20.0, 60.0, 180.0), ((10, 10_000), (30, 10_000), (100, 10_000), (1000, 4000))
ALARMS = [(3, n, angle, noise, sets) for n, sets in NUMBERS for angle in ANGLES for noise in (0.01, 0.05, 0.1, 0.2)]
ALARMS += [(d, n, angle, 0.05, 10_000) for d in (2, 4) for n in (10, 100) for angle in ANGLES]
ALARMS += [(3, 10_000, 60.0, 0.05, 2000), (3, 10_000, 180.0, 0.2, 2000), (3, 100_000, 60.0, 0.05, 500)]
ALARMS += [(3, 1_000_000, 60.0, 0.05, 100)]
"""Dimension, points, half angle, noise and number of sets."""


def belt(rng, n, width, ratio):
    """Points on sets of belts (SETS, n, 3), uniform by area between two latitudes, and their noise.

    It is the σ with √(σ²(λ + σ²)/N)/λ = ratio √λ, the centre's standard error across, where λ is the mean square of z.
    """
    rim = math.sin(math.radians(width))
    z, turn = rim * rng.uniform(-1, 1, (SETS, n)), rng.uniform(0, 2 * math.pi, (SETS, n))
    across, extent = np.sqrt(1.0 - z**2), rim**2 / 3.0
    directions = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=-1)
    noise = brentq(lambda s: s * math.sqrt((extent + s * s) / n) / extent - ratio * math.sqrt(extent), 1e-9, 10.0)
    return directions + noise * rng.standard_normal(directions.shape), noise


def coverage_limits():
    """Share of ok fits, and of intervals that hold the radius, and the last coordinate of the centre."""
    rng = np.random.default_rng(18)
    for kind, cells in (("few", FEW), ("belt", BELTS), ("near outliers", NEAR)):
        for n, angle, third in cells:
            noise, ratio = (third, math.nan) if kind == "few" else (0.02, third)
            points, noise = belt(rng, n, angle, third) if kind == "belt" else (caps(rng, SETS, n, angle, noise), noise)
            if kind == "near outliers":
                points[:, : round(third * n)] += rng.standard_normal((SETS, round(third * n), 3))
            fit = study.fit(points, "robust" if kind == "near outliers" else "corrected")
            center = covered(fit.interval("center")[:, -1], 0.0)
            held = {"radius": covered(fit.interval("radius"), 1.0), "across": center}
            row = {"kind": kind, "samples": n, "angle": angle, "noise_over_radius": noise, "ratio": ratio, "sets": SETS}
            row |= {"ok": fit.ok.mean()} | {name: inside.mean() for name, inside in held.items()}
            for name, inside in held.items():
                row[f"{name}_ok"] = inside[fit.ok].mean() if fit.ok.any() else math.nan
            yield row


def errors(fit):
    """Distances of the centres from the truth, infinite where there is none."""
    distance = np.linalg.norm(fit.center, axis=1)
    return np.where(np.isfinite(distance), distance, np.inf)


def worst_cells():
    """Measures of the cells in which the fits do worst, with Monte-Carlo errors."""
    rng = np.random.default_rng(41)
    for d, n, angle, noise, sets in COVERAGE:
        fit = study.fit(caps(rng, sets, n, angle, noise, d))
        place = {"dimension": d, "samples": n, "angle": angle, "noise": noise, "sets": sets, "ok": fit.ok.mean()}
        held = {"radius": covered(fit.interval("radius"), 1.0), "center": covered(fit.interval("center")[:, 0], 0.0)}
        for name, inside in held.items():
            yield place | {"kind": name} | share("value", inside)
            if fit.ok.any():  # of 12 points in space no fit is
                yield place | {"kind": f"{name}, ok"} | share("value", inside[fit.ok])
    for other, n, angle, noise, sets in BESIDE:
        points = caps(rng, sets, n, angle, noise)
        fit = study.fit(points)
        one, two = errors(fit), errors(study.fit(points, other))
        again = [np.median(one[k]) / np.median(two[k]) for k in rng.integers(sets, size=(200, sets))]
        place = {"dimension": 3, "samples": n, "angle": angle, "noise": noise, "sets": sets, "ok": fit.ok.mean()}
        yield place | {"kind": other, "value": np.median(one) / np.median(two), "value_error": np.std(again)}
    for angle, where in CLUSTERS:
        points = caps(rng, 400, 100, angle, 0.02)
        points[:, :40] = [where, 0.0, 0.0] + 0.02 * rng.standard_normal((400, 40, 3))
        for name in ("robust", "corrected"):
            fit = study.fit(points, name)
            place = {"dimension": 3, "samples": 100, "angle": angle, "noise": 0.02, "sets": 400, "ok": fit.ok.mean()}
            place |= {"cluster": where, "estimator": name, "flagged": fit.outliers.any(axis=1).mean()}
            yield (
                place | {"kind": "cluster", "median_error": np.median(errors(fit))} | share("value", errors(fit) > 0.1)
            )


def false_alarms():
    """The number of data sets in which a point is named, and their share."""
    for d, n, angle, noise, sets in ALARMS:
        state = lanes(17, "false alarms", d, n, angle, noise)
        alarms = np.concatenate([outliers(Samples(x)).any(axis=1) for x in clean(state, sets, n, angle, noise, d)])
        row = {"dimension": d, "samples": n, "angle": angle, "noise_over_radius": noise, "sets": sets}
        yield row | {"alarms": alarms.sum()} | share("share", alarms)


if __name__ == "__main__":
    tables = {"coverage-limits": coverage_limits, "worst-cells": worst_cells, "false-alarms": false_alarms}
    if unknown := [name for name in sys.argv[1:] if name not in tables]:
        sys.exit(f"{', '.join(unknown)}: give any of {', '.join(tables)}, or nothing for all")
    for name in sys.argv[1:] or tables:
        store(name, tables[name]())

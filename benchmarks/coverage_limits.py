"""Coverage of the 95 % intervals where it ends; `python benchmarks/coverage_limits.py` stores it.

Three kinds of data that `configs/coverage.toml` does not have: fewer than ten points, whose noise can look small by
chance; belts, which are points about an equator; and outliers, some of which are too near to be noticed. Across a belt
the centre is known by the points' distances from the belt's plane alone, and its interval takes them to be large beside
its standard error.
"""

import math

import numpy as np
from scipy.optimize import brentq
from studies import caps, covered, store

import study

SEED, SETS = 18, 4000
FEW = [(n, angle, noise) for n in (5, 6, 7, 8) for angle in (60.0, 180.0) for noise in (0.02, 0.1)]
"""Points, half angle of the cap and noise."""
BELTS = [(n, width, ratio) for n in (40, 1000) for width in (5.0, 20.0) for ratio in (0.1, 0.2, 0.3, 0.5, 1.0)]
"""Points, largest latitude, and the standard error across over the rms distance of the points from the plane."""

NEAR = [(n, 60.0, share) for n in (40, 100) for share in (0.0, 0.1, 0.2)]
"""Points, half angle of the cap, and share of points displaced by a normal step of one radius in each coordinate."""


def belt(rng, n, width):
    """Sets of directions (SETS, n, 3), uniform by area between two latitudes."""
    z, turn = math.sin(math.radians(width)) * rng.uniform(-1, 1, (SETS, n)), rng.uniform(0, 2 * math.pi, (SETS, n))
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=-1)


def noise_of(n, width, ratio):
    """The σ with √(σ²(λ + σ²)/N)/λ = ratio √λ, the centre's standard error across, where λ is the mean square of z."""
    extent = math.sin(math.radians(width)) ** 2 / 3.0
    return brentq(lambda s: s * math.sqrt((extent + s * s) / n) / extent - ratio * math.sqrt(extent), 1e-9, 10.0)


def shares(points, estimator):
    """Share of ok fits, and of intervals that hold the radius, 1, and the last coordinate of the centre, 0."""
    fit = study.fit(points, estimator)
    hits = {"radius": covered(fit.interval("radius"), 1.0), "across": covered(fit.interval("center")[:, -1], 0.0)}
    ok = {f"{name}_ok": float(hit[fit.ok].mean()) if fit.ok.any() else math.nan for name, hit in hits.items()}
    return {"ok": float(fit.ok.mean())} | {name: float(hit.mean()) for name, hit in hits.items()} | ok


def rows():
    """A row for each cell."""
    rng = np.random.default_rng(SEED)
    for kind, cells in (("few", FEW), ("belt", BELTS), ("near outliers", NEAR)):
        for n, angle, third in cells:
            noise = third if kind == "few" else noise_of(n, angle, third) if kind == "belt" else 0.02
            if kind == "belt":
                directions = belt(rng, n, angle)
                points = directions + noise * rng.standard_normal(directions.shape)
            else:
                points = caps(rng, SETS, n, angle, noise)
            moved = round(third * n) if kind == "near outliers" else 0
            points[:, :moved] += rng.standard_normal((SETS, moved, 3))
            row = {"kind": kind, "samples": n, "angle": angle, "noise_over_radius": noise}
            row |= {"ratio": math.nan if kind == "few" else third, "sets": SETS}
            yield row | shares(points, "robust" if kind == "near outliers" else "corrected")


if __name__ == "__main__":
    store("coverage-limits", rows())

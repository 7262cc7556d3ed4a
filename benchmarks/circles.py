"""Robust fits on circles of a published comparison: photographed balls, experiments B1 and B2, and time beside RANSAC.

    python benchmarks/circles.py FOLDER

FOLDER holds ``edges.csv``, ``truth.csv`` and ``published_*.csv`` made from the data of arXiv 2507.11476 (Apache License
2.0), which are not part of this project. Printed are mean Jaccard indices of fitted and true discs, with Monte-Carlo
standard errors; the mechanisms of B1 and B2 are in `semicircle` and `full_circle`. Time is compared with scikit-image's
RANSAC, where that is installed.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd

import study
from study.simulation.analysis.rank import disc_loss

SETS = 100


def jaccard(center, radius, true_center, true_radius):
    """Area of the intersection of two discs over that of their union."""
    apart = np.linalg.norm(np.asarray(center) - true_center, axis=-1)
    return 1.0 - np.minimum(disc_loss(apart, radius, true_radius), 1.0)


def placed(center, angle, distance):
    """Points (…, n, 2) at polar coordinates about a centre."""
    return center + distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def semicircle(rng, bad):
    """Sets of 50 points of B1: radius 100 about (50, 60), σ = 1, ``bad`` of them 9 to 10 σ off."""
    off = rng.standard_normal((SETS, 50))
    off[:, :bad] = rng.choice([-1, 1], (SETS, bad)) * rng.uniform(9, 10, (SETS, bad))
    return placed(np.array([50, 60]), rng.uniform(0, np.pi, off.shape), 100 + off)


def full_circle(rng, sigma, bad, quantum):
    """Sets of 100 points of B2: radius 120 about (120, 120), ``bad`` of them 5 to 20 σ off, on a grid."""
    off = rng.standard_normal((SETS, 100))
    off[:, :bad] = rng.choice([-1, 1], (SETS, bad)) * rng.uniform(5, 20, (SETS, bad))
    points = placed(120.0, rng.uniform(0, 2 * np.pi, off.shape), 120 + sigma * off)
    return np.round(points / quantum) if quantum else points


def mean(values):
    """A mean with its standard error."""
    return f"{np.mean(values):.4f} ± {np.std(values) / np.sqrt(np.size(values)):.4f}"


def balls(folder):
    """Mean index of the frames; RANSAC's time over that of the fits."""
    truth = pd.read_csv(folder / "truth.csv").set_index("frame")
    sets = [(key[0], part) for key, part in pd.read_csv(folder / "edges.csv").groupby(["frame", "threshold"])]
    found, points = [], [part[["column", "row"]].to_numpy(float) for _, part in sets]
    study.fit(points[0], "robust")
    begun = time.perf_counter()
    fits = [study.fit(some, "robust") for some in points]
    ours = time.perf_counter() - begun
    for (frame, _), fit in zip(sets, fits, strict=True):
        row = truth.loc[frame]
        found.append(jaccard(fit.center, fit.radius, row[["X", "Y"]].to_numpy(float), row["R"]))
    print(f"balls: {mean(found)} ({len(found)} sets); {1e3 * ours / len(found):.1f} ms a fit")
    try:
        from skimage.measure import CircleModel, ransac
    except ImportError:
        return
    begun = time.perf_counter()
    for some in points:
        ransac(some, CircleModel, min_samples=3, residual_threshold=1.5, max_trials=1000, rng=1)
    theirs = time.perf_counter() - begun
    print(f"RANSAC of scikit-image, 1000 trials: {1e3 * theirs / len(found):.1f} ms, {theirs / ours:.1f} times as long")


def first_experiment():
    """Index and centre's error of B1."""
    fits = [study.fit(semicircle(np.random.default_rng(bad), bad), "robust") for bad in range(6)]
    print("B1:", mean([jaccard(fit.center, fit.radius, [50, 60], 100) for fit in fits]), end=", centre ")
    print(mean([np.linalg.norm(fit.center - [50, 60], axis=1) for fit in fits]))


def second_experiment(folder):
    """Cells of B2 in which the fit is first, among those with noise and up to 40 % outliers."""
    table = pd.read_csv(folder / "published_b2.csv").query("noise_percent > 0 and outlier_percent <= 40")
    cells = table.pivot_table(index=["noise_percent", "outlier_percent", "quantum"], columns="method")["jaccard_mean"]
    ours = {}
    for number, (noise, bad, quantum) in enumerate(cells.index):
        fit = study.fit(full_circle(np.random.default_rng(number), 1.2 * noise, int(bad), quantum), "robust")
        size = 120 / (quantum or 1)
        ours[noise, bad, quantum] = np.mean(jaccard(fit.center, fit.radius, [size, size], size))
    cells["robust"] = pd.Series(ours)
    print(f"B2: of {len(cells)} cells first in", cells.idxmax(axis=1).value_counts().to_dict())


if __name__ == "__main__":
    place = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("circles")
    if not (place / "edges.csv").is_file():
        sys.exit(f"{place / 'edges.csv'} is not there: give the folder of the circles as an argument")
    balls(place)
    first_experiment()
    second_experiment(place)

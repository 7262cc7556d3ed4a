"""Data as given: photographed balls and laser scans of spheres, fitted by the methods of the benchmark.

    pip install '.[bench]'
    python benchmarks/given.py FOLDER [SCANS]

FOLDER has ``edges.csv``, ``preprocessed.parquet``, ``truth.csv`` and ``published_frames.csv``: edge pixels of balls in
72 photographs, at three thresholds of green and under the 18 preprocessings of nordlinglab/cibica, circles marked by
hand, and the numbers of arXiv 2507.11476 over twice as many photographs (both programs' repositories, Apache License
2.0). SCANS has ``SPH101.xyz`` to ``SPH106.xyz``, laser scans of spheres of a
nominal radius of 50 mm, and the same cut to a cap of 60° by their authors, ``tSPH101.xyz`` …
(usnistgov/DMG_SphereFitting, in the public domain). None of these is part of this project. Made are
docs/assets/tables/benchmark-balls.csv and docs/assets/tables/benchmark-scans.csv.
"""

import sys
import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from ranking import CONFIGS, METHODS, PLUGINS
from studies import store

import study
from study.fits import registry
from study.simulation.analysis import losses, rank
from study.simulation.experiment.config import load

RANSAC = ("skimage_ransac", "pyransac3d")
"""Methods that must be given the noise, which nobody knows here."""
RANKED = ["median", "median_error", "median_best", "rms_best", "failures"]
MILLIMETRES, MICROMETRES = 1e3, 1e6
LOST = 1e-3
"""Metres from the centre of the cut scan at which a fit has lost the sphere."""


def methods(config):
    """The methods of a config of the benchmark that get points alone."""
    for path in PLUGINS:
        registry.load(path)
    return [name for name in load(CONFIGS / f"{config}.toml").estimators if name not in RANSAC]


def fitted(points, name):
    """Centre and radius by a method; not numbers where it fails."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            fit = study.fit(points, name)
        except Exception:  # methods of others fail in many ways
            return np.full(points.shape[1], np.nan), np.nan
    return fit.center, fit.radius


def missed(edges, truth, names):
    """One less the Jaccard index of the fitted and the marked disc, by preprocessing (cell), photograph and method."""
    for (cell, frame), part in edges.groupby(["cell", "frame"]):
        points, marked = part[["column", "row"]].to_numpy(float), truth.loc[frame]
        for name in names:
            center, radius = fitted(points, name)
            apart = np.linalg.norm(center - marked[["X", "Y"]].to_numpy(float))
            loss = losses.disc_loss(apart, radius, marked["R"])
            yield {"cell": cell, "trial": frame, "estimator": name, "error": float(loss)}


def balls(folder):
    """A row per method: its Jaccard index at the thresholds and under all preprocessings, and its place in a ranking.

    The error of a mean is that over photographs, whose preprocessings belong together. The ranking is of the latter.
    """
    names, truth = methods("b1"), pd.read_csv(folder / "truth.csv").set_index("frame")
    published = pd.read_csv(folder / "published_frames.csv").set_index("method")["jaccard_mean"]
    published = {METHODS[name]: value for name, value in published.items() if name in METHODS}
    sets = {"": pd.read_csv(folder / "edges.csv").rename(columns={"threshold": "cell"})}
    sets["all_"] = pd.read_parquet(folder / "preprocessed.parquet").rename(columns={"preprocessing": "cell"})
    tables = {key: pd.DataFrame(missed(edges, truth, names)) for key, edges in sets.items()}
    ranking = rank.ranked([rank.compared(losses.Losses("balls", names, [tables["all_"]]))]).set_index("estimator")
    for name in ranking.index:
        row = {"method": name, "photographs": len(truth), "published": published.get(name, np.nan)}
        for key, table in tables.items():
            index = 1.0 - table[table["estimator"] == name].set_index(["cell", "trial"])["error"].clip(upper=1.0)
            of_frames = index.groupby("trial").mean()
            row |= {
                f"{key}index": of_frames.mean(),
                f"{key}index_error": of_frames.sem(),
                f"{key}median": index.median(),
            }
        yield row | ranking.loc[name, RANKED].rename({"median": "loss", "median_error": "loss_error"}).to_dict()


def scans(folder):
    """A row per method and kind of scan: how far its centres are from least squares of the cut scans."""
    names, numbers = methods("lesouple-spheres"), range(101, 107)
    cut = {k: np.loadtxt(folder / f"tSPH{k}.xyz", delimiter=",") for k in numbers}
    whole = {k: np.loadtxt(folder / f"SPH{k}.xyz") for k in numbers}
    reference = {k: fitted(points, "mle")[0] for k, points in cut.items()}
    for (kind, scan), name in product({"cut": cut, "whole": whole}.items(), names):
        fits = {k: fitted(points, name) for k, points in scan.items()}
        away = np.array([np.linalg.norm(center - reference[k]) for k, (center, _) in fits.items()])
        away[np.isnan(away)] = np.inf
        row = {"method": name, "scan": kind, "scans": len(away), "median_um": MICROMETRES * np.median(away)}
        row |= {"largest_um": MICROMETRES * away.max(), "lost": int((away > LOST).sum())}
        yield row | {"radius_mm": MILLIMETRES * np.median([radius for _, radius in fits.values()])}


if __name__ == "__main__":
    folders = [Path(argument) for argument in sys.argv[1:]]
    if not folders or not (folders[0] / "edges.csv").is_file():
        sys.exit("give the folder of edges.csv and truth.csv, and that of the scans")
    store("benchmark-balls", balls(folders[0]), "%.6g")
    if len(folders) > 1:
        store("benchmark-scans", scans(folders[1]), "%.6g")

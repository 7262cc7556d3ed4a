"""Data as given: photographed balls and laser scans of spheres, fitted by the methods of the benchmark.

    pip install '.[bench]'
    python benchmarks/given.py FOLDER [SCANS]

FOLDER has ``edges.csv``, ``truth.csv`` and ``published_frames.csv``: edge pixels of balls in 72 photographs at three
thresholds of green each, circles marked by hand, and the numbers of arXiv 2507.11476 over twice as many photographs
(its program's repository, Apache License 2.0). SCANS has ``SPH101.xyz`` to ``SPH106.xyz``, laser scans of spheres of a
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


def missed(folder, names):
    """One less the Jaccard index of the fitted and the marked disc, by threshold (cell), photograph and method."""
    truth = pd.read_csv(folder / "truth.csv").set_index("frame")
    for (threshold, frame), part in pd.read_csv(folder / "edges.csv").groupby(["threshold", "frame"]):
        points, marked = part[["column", "row"]].to_numpy(float), truth.loc[frame]
        for name in names:
            center, radius = fitted(points, name)
            apart = np.linalg.norm(center - marked[["X", "Y"]].to_numpy(float))
            loss = losses.disc_loss(apart, radius, marked["R"])
            yield {"cell": threshold, "trial": frame, "estimator": name, "error": float(loss)}


def balls(folder):
    """A row per method: its mean Jaccard index, that of the article, and its place in a ranking.

    The error of a mean is that over photographs, whose three thresholds belong together.
    """
    names = methods("b1")
    table = pd.DataFrame(missed(folder, names))
    ranks = rank.ranked([rank.compared(losses.Losses("balls", names, [table]))]).set_index("estimator")
    published = pd.read_csv(folder / "published_frames.csv").set_index("method")["jaccard_mean"]
    published = {METHODS[name]: value for name, value in published.items() if name in METHODS}
    table["index"] = 1.0 - table["error"].clip(upper=1.0)
    of_frames = table.groupby(["estimator", "trial"])["index"].mean().unstack()
    for name in ranks.index:
        own = of_frames.loc[name]
        row = {"method": name, "photographs": len(own), "index": own.mean(), "index_error": own.sem()}
        row["published"] = published.get(name, np.nan)
        yield row | ranks.loc[name, ["median", "median_error", "median_best", "failures"]].to_dict()


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

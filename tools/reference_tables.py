"""Small tables that the documents quote, taken from finished runs into results/; `make tables` runs the studies first.

python tools/reference_tables.py               # all
python tools/reference_tables.py robustness    # one
"""

import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd

import study
from study.arrays import Floats
from study.fits.errors.attainable import Cap, attainable_bound, cramer_rao
from study.fits.loops.random import stream
from study.fits.points.cap import cap_moments
from study.fits.registry import load
from study.simulation.analysis.summary import as_data, chosen_rows
from study.simulation.analysis.theory import median_at_bound
from study.simulation.figures import Tables, fig_coverage
from study.simulation.folders import run_folder
from study.simulation.runs.run_folder import Run

ROOT = Path(__file__).resolve().parents[1]
STORED = ROOT / "docs" / "assets" / "tables"
MEASURES = ["planned", "ok", "ratio_median", "ratio_median_error", "ratio_median_ok", "ratio_median_ok_error"]
MEASURES += ["ratio_median_all", "ratio_median_all_error", "ratio_q95", "ratio_q95_error"]
MEASURES += ["ratio_q95_all", "ratio_q95_all_error", "median_cramer_rao", "median_attainable"]

PAPERS = ["paper", "ellipse", "mgdk", "power-law", "efficiency", "outliers", "starts", "bias", "anisotropic", "markers"]
"""Studies of `make paper` that judge the paper's claims."""


def run_of(name: str) -> Run:
    """The run of a shipped config, or of another by its path."""
    return Run.open(run_folder(str(ROOT / (name if "/" in name else f"configs/{name}.toml"))))


def summary(name: str, *conditions: str) -> pd.DataFrame:
    """Median errors over the bound, and the medians at both bounds: a row per cell and estimator."""
    table = pd.DataFrame(as_data(run := run_of(name), chosen_rows(run))["rows"])
    return table[[*conditions, "estimator", *(column for column in MEASURES if column in table)]]


def robustness(name: str) -> pd.DataFrame:
    """Laws of the noise, without outliers; and outliers, under normal noise. The unit is that of normal noise."""
    table = summary(name, "angle", "law", "outlier_share")
    unit = {angle: median_at_bound(cap_moments(np.radians(angle), 3), 3) for angle in table["angle"].unique()}
    table["median_cramer_rao"] = table["angle"].map(unit)
    return table[(table["law"] == "normal") | (table["outlier_share"] == 0)]


def em_vmf() -> pd.DataFrame:
    """EM with a von Mises-Fisher law beside other estimators."""
    load(ROOT / "benchmarks" / "em_vmf.py")
    return summary("benchmarks/em_vmf.toml", "angle", "noise_over_radius")


def published() -> pd.DataFrame:
    """Mean squared errors of the radius times 10⁴, as Al-Sharadqah & Chernov 2009 give them, beside the known ones."""
    known = {"pratt": 1.5164, "taubin": 1.3451, "mle": 1.2952, "hyper": 1.2892}
    rows = []
    for name, errors in run_of("published").table("errors").groupby("estimator", observed=True)["radius_error"]:
        squares = 1e4 * errors**2
        row = {"estimator": name, "trials": len(errors), "mse": squares.mean(), "mse_error": squares.sem()}
        rows.append(row | {"bias": 1e2 * errors.mean(), "bias_error": 1e2 * errors.sem(), "published": known.get(name)})
    return pd.DataFrame(rows)


RING = [[9, 34], [35, 10], [-13, 6], [10, -14], [23, 27], [0, -10]]
ARC = [[36, 14], [36, 10], [19, 28], [18, 31], [33, 18], [26, 26]]
SIX = [[1, 7], [2, 6], [5, 8], [7, 7], [9, 5], [3, 7]]
NINE = [[0.7, 4.0], [3.3, 4.7], [5.6, 4.0], [7.5, 1.3], [6.4, -1.1], [4.4, -3.0], [0.3, -2.5], [-1.1, 1.3], [3.0, 1.0]]
FOUR = [[1.1, 0.0], [0.0, 0.9], [-1.1, 0.0], [0.0, -0.9]]
COOKBOOK, GANDER = "SciPy Cookbook, Least squares circle", "Gander, Golub & Strebel 1994"
JACQUELIN, PCIRC = "Jacquelin 2009, in scikit-guess's tests", "pcirc, from Chernov's programs"
FITS: list[tuple[str, str, list[list[float]], str, str, str]] = [
    (COOKBOOK, "six points all around", RING, "mle", "center radius", "10.50009, 9.65995, 23.33353"),
    (COOKBOOK, "the same", RING, "mle", "squares", "7.711852"),
    (COOKBOOK, "the same", RING, "gdke", "center", "10.55231, 9.70590"),
    (COOKBOOK, "six points on an arc", ARC, "mle", "center radius", "9.88757, 3.68750, 27.35044"),
    (COOKBOOK, "the same", ARC, "gdke", "center", "15.05503, 8.83615"),
    ("scikit-image, thread 5186", "the same", ARC, "mle", "squares", "4.0425218983"),
    ("scikit-image, thread 5186", "the same", ARC, "gdke", "squares", "5.1976653458"),
    (GANDER, "six points", SIX, "mle", "center radius", "4.7398, 2.9835, 4.7142"),
    (GANDER, "the same", SIX, "unit_vector", "center radius", "5.3794, 7.2532, 3.0370"),
    (JACQUELIN, "eight points", NINE[:8], "gdke", "center radius", "3.06030, 0.74361, 4.10914"),
    (JACQUELIN, "nine points", NINE, "gdke", "center radius", "3.10253, 0.75467, 3.87132"),
    (PCIRC, "four points", FOUR, "taubin", "radius squares", "1.005, 0.04010"),
]
"""Published fits: source, points, their coordinates, estimator, what is given, and its numbers.

The radius of `gdke` is the root of the mean squared distance, that of the Cookbook's algebraic fit the mean distance.
"""


def unit_vector(points: Floats) -> tuple[Floats, float]:
    """The circle of the coefficients of length 1 with the least algebraic residual; see Gander, Golub & Strebel."""
    rows = np.column_stack([(points**2).sum(axis=1), points, np.ones(len(points))])
    a, b, c, d = np.linalg.svd(rows)[2][-1]
    return np.array([-b, -c]) / (2.0 * a), float(np.sqrt((b * b + c * c) / (4.0 * a * a) - d / a))


def published_fits() -> pd.DataFrame:
    """Published fits of published points beside this program's, in as many digits."""
    rows = []
    for source, what, given, name, asked, known in FITS:
        points = np.array(given, dtype=float)
        if name == "unit_vector":
            center, radius = unit_vector(points)
        else:
            fit = study.fit(points, name)
            center, radius = fit.center, float(fit.radius)
        squares = float(np.sum((np.linalg.norm(points - center, axis=1) - radius) ** 2))
        found = {"center": [*center], "radius": [radius], "squares": [squares]}
        values = [value for word in asked.split() for value in found[word]]
        digits = [len(number.partition(".")[2]) for number in known.split(", ")]
        ours = ", ".join(f"{value:.{count}f}" for value, count in zip(values, digits, strict=True))
        what_of = asked.replace(" ", ", ").replace("center", "centre").replace("squares", "sum of squares")
        row = {"source": source, "points": what, "estimator": name, "what": what_of}
        rows.append(row | {"published": known, "ours": ours})
    return pd.DataFrame(rows)


TAILS = {3: 1, 4: 2, 5: 3, 6: 4}
"""Tail index of Kåsa's centre by the number of points: a mean exists from N > 3 on, a variance from N > 4 on.

Source: Zelniker & Clarkson, Digital Signal Processing 16 (2006) 313-331.
"""


def tail_index(samples: int, sets: int, seed: int) -> tuple[float, float]:
    """Hill's estimate of the tail index of `gdke`'s errors, from the thousandth part that is the largest; its error.

    The points are spread over the unit circle evenly, with noise of σ = 1.
    """
    rng, far = stream(seed, "tail", samples), []
    angle = 2.0 * np.pi * np.arange(samples) / samples
    for part in range(0, sets, 100_000):
        count = min(100_000, sets - part)
        points = np.column_stack([np.cos(angle), np.sin(angle)]) + rng.standard_normal((count, samples, 2))
        far.append(np.linalg.norm(study.fit(points, "gdke").center, axis=1))
    largest = np.sort(np.concatenate(far))[-sets // 1000 :]
    index = 1.0 / np.mean(np.log(largest[1:] / largest[0]))
    return float(index), float(index / np.sqrt(len(largest) - 1))


def published_tails() -> pd.DataFrame:
    """Tail index of Kåsa's centre, published and measured, by the number of points."""
    rows = []
    for samples, known in TAILS.items():
        index, error = tail_index(samples, 2_000_000, 1)
        rows.append({"samples": samples, "published": known, "index": index, "index_error": error})
    return pd.DataFrame(rows)


def coverage() -> pd.DataFrame:
    """Coverage by each method in every cell, with the width also over those at the attainable bound."""
    cells: pd.DataFrame = fig_coverage.prepare(Tables(run_of("coverage"))).cells
    larger = [_attainable_ratio(row.angle, row.sigma) for row in cells.itertuples()]
    return cells.assign(**{f"width_attainable{end}": cells[f"width{end}"] / larger for end in ("", "_error")})


def _attainable_ratio(angle: float, sigma: float) -> float:
    """Standard error of the radius at the attainable bound over that at the Cramér-Rao bound.

    Each for one sample, over the law of the directions; NaN where noise hides the cap.
    """
    try:
        reached = attainable_bound(angle, sigma)[3, 3]
    except ValueError:
        return math.nan
    return math.sqrt(reached / cramer_rao(Cap(math.radians(angle), sigma, 3))[3, 3])


def studies() -> pd.DataFrame:
    """Seconds that the studies of the paper's claims took, on the machine of their runs."""
    manifests = {name: run_of(name).manifest() for name in PAPERS}
    rows = [{"study": name, "fits": one["fits"], "seconds": one["seconds"]} for name, one in manifests.items()]
    machines = [{key: one["machine"][key] for key in ("cores", "processor")} for one in manifests.values()]
    return pd.DataFrame(rows).join(pd.DataFrame(machines))


TABLES = {
    "studies": studies,
    "published": published,
    "published-fits": published_fits,
    "published-tails": published_tails,
    "coverage": coverage,
    "efficiency": lambda: summary("efficiency", "angle", "noise_over_radius").query(
        "estimator in ['mle', 'gdke', 'ugdk', 'corrected']"
    ),
    "robustness": lambda: robustness("robustness"),
    "robust": lambda: robustness("robust"),
    "em-vmf": em_vmf,
    "precision": lambda: run_of("precision").table("precision"),
}
"""Functions that make each table."""


def main() -> None:
    """Write the tables that are named, or all; as `paper` the run, without its rows, and the verdicts on its claims."""
    for name in sys.argv[1:] or ["paper", *TABLES]:
        if name == "paper":
            run = run_of(name)
            run.check("claims")
            for file in ("config.toml", "manifest.json", "summary.parquet", "claims.parquet"):
                shutil.copyfile(run.folder / file, ROOT / "results" / "paper" / file)
            print("results/paper")
        else:
            TABLES[name]().to_csv(STORED / f"{name}.csv", index=False, lineterminator="\n")
            print(f"docs/assets/tables/{name}.csv")


if __name__ == "__main__":
    main()

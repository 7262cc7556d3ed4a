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

from study.fits.bounds import Cap, attainable_bound, cramer_rao
from study.fits.cap import cap_moments
from study.fits.registry import load
from study.simulation.analysis.summary import as_data, chosen_rows
from study.simulation.analysis.theory import median_at_bound
from study.simulation.commands import run_folder
from study.simulation.figures import Tables, fig_coverage
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

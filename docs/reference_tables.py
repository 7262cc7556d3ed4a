"""Small tables that the documents quote, taken from finished runs into results/; `make tables` runs the studies first.

python docs/reference_tables.py               # all
python docs/reference_tables.py robustness    # one
"""

import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from study.fits.cap import cap_moments
from study.fits.registry import load
from study.simulation.analysis.regret import median_at_bound
from study.simulation.analysis.summary_text import RowChoice, as_data
from study.simulation.commands import run_folder
from study.simulation.runs.run_folder import Run

RESULTS = Path(__file__).resolve().parents[1] / "results"
KEPT = ["planned", "ok", "ratio_median", "ratio_median_error", "ratio_median_ok", "ratio_median_ok_error"]
KEPT += ["ratio_median_all", "ratio_median_all_error", "ratio_q95", "ratio_q95_error"]
KEPT += ["ratio_q95_all", "ratio_q95_all_error", "median_cramer_rao", "median_attainable"]


def summary(run: Run, conditions: list[str]) -> pd.DataFrame:
    """Median errors over the bound, and the medians at both bounds: a row per cell and estimator."""
    table = pd.DataFrame(as_data(run, RowChoice())["rows"])
    return table[[*conditions, "estimator", *(column for column in KEPT if column in table)]]


def efficiency(run: Run) -> pd.DataFrame:
    """The default estimator over angle and noise."""
    table = summary(run, ["angle", "noise_over_radius"])
    return table[table["estimator"] == "corrected"]


def robustness(run: Run) -> pd.DataFrame:
    """Laws of the noise, without outliers; and outliers, under normal noise. The unit is that of normal noise."""
    table = summary(run, ["angle", "law", "outlier_share"])
    unit = {angle: median_at_bound(cap_moments(np.radians(angle), 3), 3) for angle in table["angle"].unique()}
    table["median_cramer_rao"] = table["angle"].map(unit)
    return table[(table["law"] == "normal") | (table["outlier_share"] == 0)]


def em_vmf(run: Run) -> pd.DataFrame:
    """EM with a von Mises-Fisher law beside other estimators."""
    return summary(run, ["angle", "noise_over_radius"])


def precision(run: Run) -> pd.DataFrame:
    """Trials of each cell of an adaptive run."""
    return run.table("precision")


def published(run: Run) -> pd.DataFrame:
    """Mean squared errors of the radius times 10⁴, as Al-Sharadqah & Chernov 2009 give them, beside the known ones."""
    known = {"pratt": 1.5164, "taubin": 1.3451, "mle": 1.2952, "hyper": 1.2892}
    rows = []
    for name, errors in run.table("errors").groupby("estimator", observed=True)["radius_error"]:
        squares = 1e4 * errors**2
        row = {"estimator": name, "trials": len(errors), "mse": squares.mean(), "mse_error": squares.sem()}
        row |= {"bias": 1e2 * errors.mean(), "bias_error": 1e2 * errors.sem(), "published": known.get(name)}
        rows.append(row)
    return pd.DataFrame(rows)


TABLES = {
    "published": (published, "configs/published.toml"),
    "efficiency": (efficiency, "configs/efficiency.toml"),
    "robustness": (robustness, "configs/robustness.toml"),
    "robust": (robustness, "configs/robust.toml"),
    "em-vmf": (em_vmf, "benchmarks/em_vmf.toml"),
    "precision": (precision, "configs/precision.toml"),
}
"""Name of each table, the function that makes it, and the config of its run."""


PAPERS = ["paper", "ellipse", "mgdk", "power-law", "efficiency", "outliers", "starts", "bias", "anisotropic", "markers"]
"""Studies of `make paper` that judge the paper's claims."""


def studies() -> pd.DataFrame:
    """Seconds that the studies of the paper's claims took, on the machine of their runs."""
    rows = []
    for name in PAPERS:
        manifest = Run.open(run_folder(str(RESULTS.parent / "configs" / f"{name}.toml"))).manifest()
        row = {"study": name, "fits": manifest["fits"], "seconds": manifest["seconds"]}
        rows.append(row | {"cores": manifest["machine"]["cores"], "processor": manifest["machine"]["processor"]})
    return pd.DataFrame(rows)


def paper() -> None:
    """Store the paper's run, without its rows, and the verdicts on its claims (of `make paper`) as the reference."""
    run = Run.open(run_folder(str(RESULTS.parent / "configs" / "paper.toml")))
    run.check("claims")
    for name in ("config.toml", "manifest.json", "summary.parquet", "claims.parquet"):
        shutil.copyfile(run.folder / name, RESULTS / "paper" / name)
    print("results/paper")


def main() -> None:
    """Write the tables that are named, or all."""
    for name in sys.argv[1:] or ["paper", "studies", *TABLES]:
        path = RESULTS / f"{name}.csv"
        if name == "paper":
            paper()
            continue
        if name == "studies":
            studies().to_csv(path, index=False, lineterminator="\n")
            continue
        make, config = TABLES[name]
        if name == "em-vmf":
            load(RESULTS.parent / "benchmarks" / "em_vmf.py")
        make(Run.open(run_folder(str(RESULTS.parent / config)))).to_csv(path, index=False, lineterminator="\n")
        print(path.relative_to(RESULTS.parent))


if __name__ == "__main__":
    main()

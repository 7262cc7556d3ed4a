"""The benchmark of circle and sphere fits: its runs, a ranking of all methods, and published numbers beside ours.

    pip install '.[bench]'
    python benchmarks/ranking.py [FOLDER]

The configs of configs/benchmark are run in results/, as far as they have not been, with the methods of other packages
and of articles in benchmarks/methods. FOLDER has ``published_b1.csv`` and ``published_b2.csv``, tables of arXiv
2507.11476 (its program's repository, Apache License 2.0), which are not part of this project; without them the rows of
results/benchmark-published.csv that need them are left as they are.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from studies import ROOT, store

import study
from study.simulation.analysis import rank

CONFIGS = ROOT / "configs" / "benchmark"
HERE = ROOT / "benchmarks"
PLUGINS = [CONFIGS / "laws.py", *sorted((HERE / "methods").glob("*.py")), HERE / "em_vmf.py"]
CIRCLES = ["b1", "b2", "b2-pixels", "b2-coarse", "lesouple", "lesouple-one-sided", "semicircle"]
"""Mechanisms in the plane, which are ranked together, too."""
SPHERES = ["lesouple-spheres"]
METHODS = {"Guo": "guo", "Greco": "greco", "Qi": "qi", "Nurunnabi": "nurunnabi", "RFCA": "rfca"}
"""The methods of arXiv 2507.11476 that stand in benchmarks/methods/robust_circles.py."""
INDEX = "mean Jaccard index"
SETS = 100
"""Sets behind each of their numbers; their errors are taken to be those of so many sets of ours."""
MOST = 3.0
"""Deviation in standard errors up to which two numbers agree."""


def run(name):
    """The run of a config of the benchmark."""
    return study.run(CONFIGS / f"{name}.toml", plugins=PLUGINS)


def ranking():
    """The rankings of the circles, each and over all, and of the spheres."""
    found = {name: rank.of_run(run(name)._run) for name in CIRCLES + SPHERES}
    tables = [rank.ranked([found[name] for name in names]) for names in (CIRCLES, SPHERES)]
    result = pd.concat(tables, ignore_index=True)
    result["run"] = result["run"].str.replace(r"^benchmark-(.*)-[0-9a-f]{10}$", r"\1", regex=True)
    return result


def beside(mechanism, condition, measure, published, values):
    """Rows of published numbers by method and ours from values by estimator, one for each set."""
    for method, number in published.items():
        mine = values[METHODS[method]]
        row = {"mechanism": mechanism, "condition": condition, "measure": measure, "method": method}
        row |= {"published": number, "published_error": mine.std() / np.sqrt(SETS), "ours": mine.mean()}
        row |= {"ours_error": mine.std() / np.sqrt(len(mine))}
        yield row | {"deviation": deviation(row)}


def deviation(row):
    """Difference of two numbers in standard errors of it, with the rounding of the published one to four digits."""
    errors = row["ours_error"], row["published_error"], 5e-5 / np.sqrt(3.0)
    return (row["ours"] - row["published"]) / np.linalg.norm(errors)


def by_estimator(part, values):
    """Values of rows by estimator."""
    return {str(name): values[(part["estimator"] == name).to_numpy()] for name in part["estimator"].unique()}


def jaccard(part, center=0.0, radius=None):
    """Jaccard indices of fitted discs with one about the true centre plus ``center``; 0 for a fit without numbers."""
    true = part["radius"].to_numpy()
    apart = np.hypot(part["error_1"] - center, part["error_2"] - center).to_numpy()
    lost = rank.disc_loss(apart, true + part["radius_error"].to_numpy(), radius or true)
    return np.where(np.isinf(lost), 0.0, 1.0 - lost)


def outliers(law):
    """Number of outliers that the word of a law has: ``contaminated(20, 5, 20)``."""
    return int(str(law).partition("(")[2].partition(",")[0])


def first_experiment(folder):
    """B1, by number of outliers; as there, a fit without numbers has the index 0 and the distance 0."""
    table = pd.read_csv(folder / "published_b1.csv").query("method in @METHODS").set_index(["measure", "method"])
    for law, part in run("b1").errors.groupby("law", observed=True):
        count = outliers(law)
        away = part["error"].fillna(0.0).to_numpy()
        for measure, values in {INDEX: jaccard(part), "mean distance of centres, mm": away}.items():
            published = table.loc[measure][f"outliers_{count}"]
            yield from beside("b1", f"{count} outliers", measure, published, by_estimator(part, values))


def second_experiment(folder):
    """B2, by noise and outliers; with q = 16 their truth is 120 // 16 = 7 pixels, not 7.5."""
    table = pd.read_csv(folder / "published_b2.csv").query("method in @METHODS")
    for name, q in (("b2", 0), ("b2-pixels", 4), ("b2-coarse", 16)):
        truth = {"center": 7.0 - 7.5, "radius": 7.0} if q == 16 else {}
        errors = run(name).errors
        errors = errors.assign(percent=(100.0 * errors["noise"] / errors["radius"]).round().astype(int))
        for (law, percent), part in errors.groupby(["law", "percent"], observed=True):
            count = outliers(law)
            rows = table.query("noise_percent == @percent and outlier_percent == @count and quantum == @q")
            condition = f"noise {percent} %, {count} % outliers, q = {q}"
            published = rows.set_index("method")["jaccard_mean"]
            values = by_estimator(part, jaccard(part, **truth))
            yield from beside(name, condition, INDEX, published, values)


def semicircle():
    """The mean squared errors of Al-Sharadqah & Chernov, whose errors are not known."""
    for row in pd.read_csv(ROOT / "results" / "published.csv").dropna().to_dict("records"):
        beside = {
            "mechanism": "semicircle",
            "condition": "σ = 0.05",
            "measure": "mean squared error of the radius, 1e4",
        }
        beside |= {"method": row["estimator"], "published": row["published"], "published_error": 0.0}
        beside |= {"ours": row["mse"], "ours_error": row["mse_error"]}
        yield beside | {"deviation": deviation(beside)}


def published(folder):
    """Rows of all published numbers of a method that both have."""
    yield from first_experiment(folder)
    yield from second_experiment(folder)
    yield from semicircle()


if __name__ == "__main__":
    store("benchmark", ranking().to_dict("records"), "%.6g")
    place = Path(sys.argv[1] if len(sys.argv) > 1 else "circles")
    if not (place / "published_b1.csv").is_file():
        sys.exit(f"{place / 'published_b1.csv'} is not there: results/benchmark-published.csv is left as it is")
    store("benchmark-published", published(place), "%.6g")
    rows = pd.read_csv(ROOT / "results" / "benchmark-published.csv")
    within = (rows["deviation"].abs() <= MOST).groupby([rows["mechanism"], rows["method"]], sort=False)
    print(pd.DataFrame({"numbers": within.size(), "within": within.sum()}))

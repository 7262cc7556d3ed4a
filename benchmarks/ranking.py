"""The benchmark of circle and sphere fits: its archive, a ranking of all methods, and published numbers beside ours.

    pip install '.[bench]'
    python benchmarks/ranking.py [--method FILE | --all] [FOLDER]

benchmarks/archive has the errors of all methods in the mechanisms of configs/benchmark, which the ranking is made of.
``--method`` runs the methods of a file in every mechanism, and puts their rows into the archive; ``--all`` computes it
anew, with the methods of other packages and of articles in benchmarks/methods.

FOLDER has ``published_b1.csv`` and ``published_b2.csv``, tables of arXiv 2507.11476 (its program's repository, Apache
License 2.0), which are not part of this project. Without them the tables beside published numbers are left as they are:
docs/assets/tables/benchmark-published.csv from our sets of points, and docs/assets/tables/benchmark-same-sets.csv from
the very sets behind the published numbers, whose seeds are known.
"""

import argparse
import contextlib
import json
from importlib import metadata
from pathlib import Path

import joblib
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from studies import ROOT, store

import study
from study.files import of_file, replacing, write
from study.fits import registry
from study.simulation.analysis import losses, rank

CONFIGS = ROOT / "configs" / "benchmark"
HERE = ROOT / "benchmarks"
PLUGINS = [CONFIGS / "laws.py", *sorted((HERE / "methods").glob("*.py")), HERE / "em_vmf.py"]
ARCHIVE = HERE / "archive"
KINDS = {
    "b1": "clutter",
    "b2": "clutter",
    "b2-pixels": "clutter",
    "b2-coarse": "clutter",
    "lesouple": "near noise",
    "lesouple-one-sided": "near noise",
    "semicircle": "clean arc",
    "lesouple-spheres": "near noise",
    "sphere-clutter": "clutter",
    "sphere-tumbling": "clean sphere",
    "sphere-caps": "clean arc",
}
"""The mechanisms, and the kind of their data."""
LAWS = ["em_vmf_given", "em_vmf_given_2"]
"""Methods that are given the law of the directions."""
WORDS = ["mechanism", "kind", "cell", "method", "given"]
PACKAGES = ["circle-fit", "scikit-image", "scikit-guess", "scikit-spatial", "pyransac3d", "trimesh"]
METHODS = {"Guo": "guo", "Greco": "greco", "Qi": "qi", "Nurunnabi": "nurunnabi", "RFCA": "rfca"}
"""The methods of arXiv 2507.11476 that stand in benchmarks/methods/robust_circles.py."""
INDEX, DISTANCE = "mean Jaccard index", "mean distance of centres, mm"
SETS = 100
"""Sets behind each of their numbers; their errors are taken to be those of so many sets of ours."""
NOISES, QUANTA = [0, 1, 2, 5, 10], [0, 1, 2, 4, 8, 16]
"""Noise in per cent of the radius, and q, of B2 in the order of its seeds."""
EQUAL = 5.1e-5
"""Largest difference of numbers that are the same to four digits."""
MOST = 3.0
"""Deviation in standard errors up to which two numbers agree."""


def run(name):
    """The run of a config of the benchmark."""
    return study.run(CONFIGS / f"{name}.toml", plugins=PLUGINS)


def rows_of(name, made):
    """The archive's rows of a run in a mechanism."""
    errors = made.table("errors", ["cell", "trial", "estimator", "error", "radius_error", "radius"])
    errors = errors.astype({"cell": str, "trial": np.int32, "estimator": str}).rename(columns={"estimator": "method"})
    given = {name: registry.ESTIMATORS[name].needs or "points" for name in made.study.estimators}
    given |= dict.fromkeys(LAWS, "law")
    seconds = losses.of_run(made).seconds
    errors["given"], errors["seconds"] = errors["method"].map(given), errors["method"].map(seconds)
    return errors.assign(mechanism=name, kind=KINDS[name], dimension=np.int8(made.study.dimension))


def archive(name, rows, made, known=()):
    """Write a mechanism's rows into the archive, with the config, the software and the versions of the methods.

    Args:
        name: of the mechanism.
        rows: of all methods.
        made: the run that made them, or the last ones of them.
        known: versions of the methods that it has not.
    """
    versions = dict(known) | {method: str(registry.ESTIMATORS[method].version) for method in made.study.estimators}
    software = made.maker() | {"others": {package: metadata.version(package) for package in PACKAGES}}
    texts = {
        "config": (CONFIGS / f"{name}.toml").read_text(encoding="utf-8"),
        "software": json.dumps(software),
        "methods": json.dumps(versions),
    }
    table = pa.Table.from_pandas(rows.astype(dict.fromkeys(WORDS, "category")), preserve_index=False)
    ARCHIVE.mkdir(exist_ok=True)
    with replacing(ARCHIVE / f"{name}.parquet") as temporary:
        dictionaries = [*WORDS, "dimension", "seconds", "radius"]
        pq.write_table(table.replace_schema_metadata(texts), temporary, compression="zstd", use_dictionary=dictionaries)
    sums = [f"{of_file(path)}  {path.name}" for path in sorted(ARCHIVE.glob("*.parquet"))]
    write(ARCHIVE / losses.SUMS, ("\n".join(sums) + "\n").encode())


def archive_all():
    """Compute the archive anew."""
    for name in KINDS:
        made = run(name)._run
        archive(name, rows_of(name, made), made)


def archive_methods(file):
    """Put the rows of a file's methods into the archive, in place of those of the same names."""
    for table, made in losses.entered(file, losses.read_tables(ARCHIVE), ROOT / "results", print):
        new = rows_of(table.name, made).query("method != @losses.REFERENCE")
        path = ARCHIVE / f"{table.name}.parquet"
        old = pq.read_table(path).to_pandas().query("method not in @new.method.unique()")
        known = json.loads(pq.read_schema(path).metadata[b"methods"])
        archive(table.name, pd.concat([old.astype(dict.fromkeys(WORDS, str)), new]), made, known)


def ranking():
    """The rankings of the archive: of each mechanism, of each kind of data, and over all kinds."""
    return rank.ranked([rank.compared(table.losses()) for table in losses.read_tables(ARCHIVE)])


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


def their_sets(seeds, circle, outliers, quantum=0):
    """Sets of points of B1 or B2 as their program draws them.

    Args:
        seeds: of its generators, one for each set.
        circle: centre, radius, angle that the points are spread over, number of points, and σ.
        outliers: how many there are, and least and largest distance of one in σ.
        quantum: q, by which coordinates are divided before they are rounded; 0 for neither.
    """
    center, radius, spread, count, sigma = circle
    bad, least, most = outliers
    for seed in seeds:
        rng = np.random.default_rng(seed)
        angle, away = rng.uniform(0.0, spread, count), rng.normal(0.0, sigma, count)
        for place in rng.choice(count, bad, replace=False) if bad else []:
            sign = 2.0 * round(rng.uniform(0.0, 1.0)) - 1.0
            away[place] = sign * rng.uniform(least, most) * sigma
        points = np.array(center) + (radius + away)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        yield np.unique(np.round(points / quantum), axis=0) if quantum else points


def mean_index(method, sets, center, radius):
    """Mean Jaccard index and mean distance of the centres of a method; 0 for a set where it fails."""
    registry.load(HERE / "methods" / "robust_circles.py")
    index, away = np.zeros(len(sets)), np.zeros(len(sets))
    for place, points in enumerate(sets):
        with contextlib.suppress(Exception), np.errstate(all="ignore"):
            found, size = registry.ESTIMATORS[METHODS[method]].function.function(points)
            apart = np.hypot(*(found - np.array(center)))
            loss = losses.disc_loss(apart, size, float(radius))
            index[place], away[place] = (1.0 - loss, apart) if np.isfinite(loss) else (0.0, 0.0)
    return index.mean(), away.mean()


def their_cell(experiment, number, method):
    """Index and distance of a method on the sets of a cell: its number of outliers, or its noise, outliers and q."""
    if experiment == "b1":
        (bad,) = number
        seeds = 1000 * np.arange(SETS) + bad
        sets = list(their_sets(seeds, ((50.0, 60.0), 100.0, np.pi, 50, 1.0), (bad, 9.0, 10.0)))
        return mean_index(method, sets, (50.0, 60.0), 100.0)
    noise, bad, quantum = number
    places = 1000 * NOISES.index(noise) + 100 * (bad // 10) + QUANTA.index(quantum)
    circle = (120.0, 120.0), 120.0, 2.0 * np.pi, 100, noise / 100.0 * 120.0
    sets = list(their_sets(10_000 * np.arange(SETS) + places, circle, (bad, 5.0, 20.0), quantum))
    size = 120 // quantum if quantum else 120
    return mean_index(method, sets, (size, size), size)


def same_sets(folder):
    """For each experiment and method, how many of the published numbers it has again on the sets behind them.

    `nurunnabi` draws at random, from no seed, and is left out.
    """
    first = pd.read_csv(folder / "published_b1.csv").set_index(["measure", "method"])
    second = pd.read_csv(folder / "published_b2.csv")
    for method in [name for name in METHODS if name != "Nurunnabi"]:
        rows = second[second["method"] == method]
        cells = [("b1", (bad,)) for bad in range(6)]
        cells += [("b2", tuple(map(int, c))) for c in rows[["noise_percent", "outlier_percent", "quantum"]].to_numpy()]
        found = joblib.Parallel(2)(joblib.delayed(their_cell)(*cell, method) for cell in cells)
        known = [
            ("b1", INDEX, [first.loc[(INDEX, method), f"outliers_{bad}"] for bad in range(6)], found[:6], 0),
            ("b1", DISTANCE, [first.loc[(DISTANCE, method), f"outliers_{bad}"] for bad in range(6)], found[:6], 1),
            ("b2", INDEX, rows["jaccard_mean"].tolist(), found[6:], 0),
        ]
        for experiment, measure, published, answers, which in known:
            differences = np.abs(np.array(published) - [answer[which] for answer in answers])
            row = {"experiment": experiment, "measure": measure, "method": method, "numbers": len(differences)}
            yield row | {"same": int((differences < EQUAL).sum()), "largest_difference": differences.max()}


def by_estimator(part, values):
    """Values of rows by estimator."""
    return {str(name): values[(part["estimator"] == name).to_numpy()] for name in part["estimator"].unique()}


def jaccard(part, center=0.0, radius=None):
    """Jaccard indices of fitted discs with one about the true centre plus ``center``; 0 for a fit without numbers."""
    true = part["radius"].to_numpy()
    apart = np.hypot(part["error_1"] - center, part["error_2"] - center).to_numpy()
    lost = losses.disc_loss(apart, true + part["radius_error"].to_numpy(), radius or true)
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
        for measure, values in {INDEX: jaccard(part), DISTANCE: away}.items():
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
    for row in pd.read_csv(ROOT / "docs" / "assets" / "tables" / "published.csv").dropna().to_dict("records"):
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
    parser = argparse.ArgumentParser(description="the archive of the benchmark and its ranking")
    parser.add_argument("--method", type=Path, help="a file of methods that are put into the archive")
    parser.add_argument("--all", action="store_true", help="compute the archive anew")
    parser.add_argument("folder", type=Path, nargs="?", help="folder of the published tables")
    asked = parser.parse_args()
    if asked.all:
        archive_all()
    if asked.method:
        archive_methods(asked.method)
    store("benchmark", ranking().to_dict("records"), "%.6g")
    if asked.folder:
        store("benchmark-same-sets", same_sets(asked.folder), "%.6g")
        store("benchmark-published", published(asked.folder), "%.6g")
        rows = pd.read_csv(ROOT / "docs" / "assets" / "tables" / "benchmark-published.csv")
        within = (rows["deviation"].abs() <= MOST).groupby([rows["mechanism"], rows["method"]], sort=False)
        print(pd.DataFrame({"numbers": within.size(), "within": within.sum()}))

"""The table of `study ask`: cells, the processes over them, and how good they are; takes most of an hour.

    python benchmarks/ask.py           # the table, and both tables of the documents
    python benchmarks/ask.py check     # the tables of the documents alone, from the table as it is

The first cells fill the conditions evenly (Sobol's sequence, scrambled), in the logarithms of N, σ/r and the angle. The
others are chosen where the processes are least sure, batch by batch. Each cell is computed as a study of it is, from
the same streams. Cells are kept in results/ask.csv and not computed again. Each estimator's factor is the quantile of
the scores of the even cells, left out one at a time.

- ask: cells that were drawn at random and never seen: errors, intervals, and fits spent.
- ask-worst: conditions in which the default errs most beside another estimator, as the processes find them, and what
  a simulation of them gives.
"""

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.linalg import cho_solve
from scipy.optimize import minimize
from scipy.stats import qmc
from studies import ROOT, store, whole

from study import __version__
from study.simulation.analysis.ask import ASKED, LEVEL, METADATA, TABLE, Emulator, Process, correlation, features
from study.simulation.experiment.config import Study
from study.simulation.statistics import measured

ESTIMATORS = ["corrected", "als", "fuller", "mle", "taubin", "pratt", "hyper", "gdke", "ugdk"]
NAMES = [condition.name for condition in ASKED]
RANGES = {"samples": [8, 2000], "noise_over_radius": [0.003, 0.8], "angle": [8.0, 180.0]}
SEED, TRIALS, EVEN = 51, 20_000, 768
BATCH, BATCHES, CANDIDATES = 96, 8, 1200
UNSEEN, CHECKED, CHECK_TRIALS = 52, 200, 80_000
"""Seed, number and trials of the cells that are checked."""
KEPT = ROOT / "results" / "ask.csv"


def cells(uniform):
    """Conditions (n, 3) at uniform numbers (n, 3), of so few digits that a config can have them."""
    low, high = np.log(list(RANGES.values())).T
    values = np.exp(low + (high - low) * uniform)
    return np.array([[round(n), float(f"{s:.4g}"), round(a, 2)] for n, s, a in values])


def simulated(conditions, trials=TRIALS, seed=SEED):
    """Medians and their errors, a row per cell; computed as far as they are not kept."""
    known = {}
    if KEPT.exists():
        kept = pd.read_csv(KEPT)
        known = dict(zip(kept[["seed", "trials", *NAMES]].itertuples(index=False, name=None), kept.index, strict=True))
    keys = [(seed, trials, int(n), s, a) for n, s, a in conditions]
    rows = []
    for key in keys:
        if key not in known:
            rows.append(simulate(*key))
            frame = pd.DataFrame(rows[-1:])
            frame.to_csv(KEPT, mode="a", header=not KEPT.exists(), index=False)
    everything = pd.read_csv(KEPT).drop_duplicates(["seed", "trials", *NAMES])
    return everything.set_index(["seed", "trials", *NAMES]).loc[keys].reset_index()


def simulate(seed, trials, samples, noise, angle):
    """One cell: the median of each estimator's errors over the bound, as the summary has it."""
    design = {"kind": "grid", "trials": trials, "samples": samples, "noise_over_radius": noise, "angle": angle}
    study = Study.model_validate({"name": "ask", "seed": seed, "estimators": ESTIMATORS, "design": design})
    errors = whole(study)().errors
    row = {"seed": seed, "trials": trials} | dict(zip(NAMES, (samples, noise, angle), strict=True))
    for name in ESTIMATORS:
        mine = errors["estimator"] == name
        columns = {column: errors[column][mine] for column in ("error", "error_1", "bound", "status")}
        row[name], row[f"{name}_error"] = measured("ratio_median", columns)
    return row


def likelihood(logarithms, process):
    """Negative logarithm of the likelihood and its gradient, in the logarithms of a process's parameters.

    The lengths have a wide prior about e, of 1.5 in the logarithm.
    """
    *lengths, variance, roughness = np.exp(logarithms)
    tried = replace(process, lengths=np.array(lengths), variance=variance, roughness=roughness)
    inverse = cho_solve((tried.root, True), np.eye(len(tried.values)))
    slope = np.outer(tried.weights, tried.weights) - inverse
    scaled = tried.places / lengths
    squares = [np.subtract.outer(column, column) ** 2 for column in scaled.T]
    distance = np.sqrt(5.0 * sum(squares))
    by_distance = slope * variance * 5.0 / 3.0 * (1.0 + distance) * np.exp(-distance)
    away = (logarithms[:-2] - 1.0) / 1.5**2
    value = 0.5 * (tried.values - tried.values.mean()) @ tried.weights + np.log(np.diag(tried.root)).sum()
    gradient = [-0.5 * np.sum(by_distance * square) for square in squares] + away
    of_variance = -0.5 * variance * np.sum(slope * correlation(scaled, scaled))
    others = [of_variance, -0.5 * roughness * np.trace(slope)]
    return value + 0.5 * away @ away * 1.5**2, np.array([*gradient, *others])


def fitted(table, before=None):
    """Processes of the estimators, by maximum likelihood from parameters that were fitted before."""
    processes, places = {}, features(table[NAMES])
    for name in ESTIMATORS:
        values, noise = np.log(table[name].to_numpy()), (table[f"{name}_error"] / table[name]).to_numpy() ** 2
        old = before[name] if before else Process(np.full(places.shape[1], math.e), 1.0, 1e-5, places, values, noise)
        process = replace(old, places=places, values=values, noise=noise)
        start = np.log([*process.lengths, process.variance, process.roughness])
        bounds = [(-3.0, 6.0)] * places.shape[1] + [(-8.0, 8.0), (math.log(1e-8), math.log(1e-2))]
        options = {"maxiter": 15 if before else 60}
        found = minimize(likelihood, start, process, "L-BFGS-B", jac=True, bounds=bounds, options=options)
        *lengths, variance, roughness = np.exp(found.x)
        processes[name] = replace(process, lengths=np.array(lengths), variance=variance, roughness=roughness)
    return processes


def with_factors(processes):
    """The processes with intervals that hold their level in the even cells, each of which is left out."""
    rank = math.ceil(LEVEL * (EVEN + 1)) - 1
    return {name: replace(p, factor=np.sort(p.scores()[:EVEN])[rank]) for name, p in processes.items()}


def least_sure(processes, number, rng):
    """Conditions (n, 3) of new cells: one after the other where the processes will be least sure.

    What is known of one more cell lowers the variances about it, which does not depend on its value.
    """
    conditions = cells(rng.random((CANDIDATES, 3)))
    places, covariances = features(conditions), []
    for process in processes.values():
        scaled, near = places / process.lengths, correlation(places / process.lengths, process.places / process.lengths)
        known = np.linalg.solve(process.root, process.variance * near.T)
        rough = process.local(near)
        covariance = process.variance * correlation(scaled, scaled) - known.T @ known
        covariances.append(rough[:, None] * covariance * rough)
    chosen = []
    for _ in range(number):
        chosen.append(int(np.argmax(sum(np.diag(covariance) for covariance in covariances))))
        for covariance in covariances:
            column = covariance[:, chosen[-1]]
            covariance -= np.outer(column, column) / (column[chosen[-1]] + TRIALS**-1.0)
    return conditions[chosen]


def make():
    """Choose and compute the cells, fit the processes, and store the table."""
    rng = np.random.default_rng(SEED)
    table = simulated(cells(qmc.Sobol(3, rng=SEED).random(1024)[:EVEN]))
    processes = fitted(table)
    for number in range(BATCHES):
        print(f"batch {number + 1} of {BATCHES}", flush=True)
        more = simulated(least_sure(processes, BATCH, rng))
        table = pd.concat([table, more], ignore_index=True)
        columns = {name: (np.log(table[name]), (table[f"{name}_error"] / table[name]) ** 2) for name in ESTIMATORS}
        places = features(table[NAMES])
        for name, (values, noise) in columns.items():
            given = {"values": values.to_numpy(), "noise": noise.to_numpy()}
            processes[name] = replace(processes[name], places=places, **given)
    save(table, with_factors(fitted(table, processes)))


def save(table, processes):
    """Store the cells, with what the processes need, in the package."""
    kinds = {"samples": "int16"} | dict.fromkeys([c for c in table if c.startswith(tuple(ESTIMATORS))], "float32")
    origin = {"version": __version__, "seed": SEED, "trials": TRIALS, "cells": len(table), "even": EVEN}
    found = {
        name: {"lengths": [float(f"{x:.6g}") for x in p.lengths]}
        | {key: float(f"{getattr(p, key):.6g}") for key in ("variance", "roughness", "factor")}
        for name, p in processes.items()
    }
    stored = {"origin": origin, "ranges": RANGES, "processes": found}
    arrow = pa.Table.from_pandas(table.drop(columns=["seed", "trials"]).astype(kinds), preserve_index=False)
    pq.write_table(arrow.replace_schema_metadata({METADATA: json.dumps(stored)}), TABLE, compression="zstd")
    print(f"{TABLE}: {TABLE.stat().st_size:,} bytes")


def unseen():
    """Errors of the emulator in cells that were drawn at random, a row per estimator."""
    emulator, rng = Emulator.load(), np.random.default_rng(UNSEEN)
    table = simulated(cells(rng.random((CHECKED, 3))), CHECK_TRIALS, UNSEEN)
    places = features(table[NAMES])
    for name, process in emulator.processes.items():
        value, half = process.predict(places)
        error, noise = np.abs(value - np.log(table[name])), table[f"{name}_error"] / table[name]
        row = {"estimator": name, "cells": CHECKED, "median": np.median(error), "q95": np.quantile(error, 0.95)}
        row |= {"largest": error.max(), "inside": np.mean(error <= half), "half_median": np.median(half)}
        row |= {"inside_noise": np.mean(error <= np.hypot(half, 1.96 * noise)), "half_q95": np.quantile(half, 0.95)}
        own = emulator.origin
        yield row | {"noise": np.median(noise), "fits": own["cells"] * own["trials"] * len(emulator.processes)}


def worst():
    """The default beside each other estimator where it is predicted to do worst, and what a simulation gives there.

    The search draws conditions, first everywhere, then ever nearer to the worst ones.
    """
    emulator, rng = Emulator.load(), np.random.default_rng(UNSEEN)
    default = emulator.processes["corrected"]
    for name, process in emulator.processes.items():
        if process is default:
            continue
        uniform = rng.random((8000, 3))
        for width in (0.05, 0.02, 0.01, 0.0):
            places = features(cells(uniform))
            beside = default.predict(places)[0] - process.predict(places)[0]
            top = uniform[np.argsort(-beside)[:20]]
            about = np.repeat(top, 20, axis=0) + width * rng.standard_normal((400, 3))
            uniform = np.clip(np.concatenate([top, about]), 0.0, 1.0)
        found = cells(top[:1])
        row = simulated(found, CHECK_TRIALS, UNSEEN).iloc[0]
        value = row["corrected"] / row[name]
        error = value * math.hypot(*(row[f"{each}_error"] / row[each] for each in ("corrected", name)))
        place = dict(zip(NAMES, found[0], strict=True))
        yield {"beside": name, **place, "predicted": math.exp(beside.max()), "value": value, "value_error": error}


if __name__ == "__main__":
    if sys.argv[1:] not in ([], ["check"]):
        sys.exit(f"{' '.join(sys.argv[1:])}: give check, or nothing")
    if not sys.argv[1:]:
        make()
    store("ask", unseen())
    store("ask-worst", worst())

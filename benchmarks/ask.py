"""The table of `study ask`: cells, the processes over them, and how good they are; takes most of an hour.

    python benchmarks/ask.py           # the table, and both tables of the documents
    python benchmarks/ask.py check     # the tables of the documents alone, from the table as it is

The first cells fill the conditions evenly (Sobol's sequence, scrambled), in the logarithms of N, σ/r and the angle. The
others are chosen where the processes are least sure, batch by batch. Each cell is computed as a study of it is, from
the same streams. Cells are kept in results/ask.csv and not computed again: remove it after a change of the fits. Each
estimator's factor is the quantile of the scores of the even cells, left out one at a time.

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
from scipy.linalg import cho_solve, solve_triangular
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
BATCH, BATCHES, CANDIDATES, NEIGHBOURS = 96, 8, 1200, 12
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


def maximised(process, iterations):
    """The process with the parameters that are most likely, searched from its own."""
    start = np.log([*process.lengths, process.variance, process.roughness])
    bounds = [(-3.0, 6.0)] * len(process.lengths) + [(-8.0, 8.0), (math.log(1e-8), math.log(1e-2))]
    options = {"maxiter": iterations}
    found = minimize(likelihood, start, process, "L-BFGS-B", jac=True, bounds=bounds, options=options)
    *lengths, variance, roughness = np.exp(found.x)
    return replace(process, lengths=np.array(lengths), variance=variance, roughness=roughness)


def blank(places):
    """A process without values, from whose parameters the first search starts."""
    return Process(np.full(places.shape[1], math.e), 1.0, 1e-5, places, *np.zeros((2, len(places))), 1.0)


def with_cells(process, table, name):
    """The process with the cells of a table."""
    values, noise = np.log(table[name].to_numpy()), (table[f"{name}_error"] / table[name]).to_numpy() ** 2
    return replace(process, places=features(table[NAMES]), values=values, noise=noise)


def left_out(process):
    """Deviation of each cell from what the others predict of it, and the variance of that (m,).

    Source: Rasmussen & Williams 2006, eq. 5.12.
    """
    inverse = solve_triangular(process.root, np.eye(len(process.values)), lower=True)
    variance = 1.0 / np.sum(inverse**2, axis=0)
    return process.weights * variance, variance


def fitted(table, before=None):
    """Processes of the estimators by maximum likelihood, from parameters that were fitted before."""
    processes = {}
    for name in ESTIMATORS:
        start = before[name] if before else blank(features(table[NAMES]))
        processes[name] = with_cells(maximised(with_cells(start, table, name), 15 if before else 60), table, name)
    return processes


def scores(process):
    """Deviation of each cell from what the others predict, over half of its interval of factor 1 (m,)."""
    deviation, variance = left_out(process)
    return np.abs(deviation) / np.sqrt(variance - process.noise)


def with_factors(processes):
    """The processes with intervals that hold their level in the even cells, each of which is left out."""
    rank = math.ceil(LEVEL * (EVEN + 1)) - 1
    return {name: replace(p, factor=np.sort(scores(p)[:EVEN])[rank]) for name, p in processes.items()}


def surprise(process, near):
    """Root mean square of what the nearest cells deviate by from the others' predictions, and four usual ones (n,).

    A process takes itself to be as smooth everywhere. It is not.

    Args:
        process: the process.
        near: correlations of places with its cells (n, m).
    """
    deviation, variance = left_out(process)
    nearest = np.argpartition(-near, NEIGHBOURS, axis=1)[:, :NEIGHBOURS]
    return np.sqrt(((deviation**2 / variance)[nearest].sum(axis=1) + 4.0) / (NEIGHBOURS + 4.0))


def least_sure(processes, number, rng):
    """Conditions (n, 3) of new cells: one after the other where the processes will be least sure.

    What is known of one more cell lowers the variances about it, which does not depend on its value.
    """
    conditions = cells(rng.random((CANDIDATES, 3)))
    places, covariances = features(conditions), []
    for process in processes.values():
        scaled, near = places / process.lengths, correlation(places / process.lengths, process.places / process.lengths)
        known = np.linalg.solve(process.root, process.variance * near.T)
        rough = surprise(process, near)
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
        processes = {name: with_cells(process, table, name) for name, process in processes.items()}
    save(table, with_factors(fitted(table, processes)))


def save(table, processes):
    """Store the cells, with what the processes need, in the package."""
    origin = {"version": __version__, "seed": SEED, "trials": TRIALS, "cells": len(table), "even": EVEN}
    found = {
        name: {"lengths": [float(f"{x:.6g}") for x in p.lengths]}
        | {key: float(f"{getattr(p, key):.6g}") for key in ("variance", "roughness", "factor")}
        for name, p in processes.items()
    }
    table = table.drop(columns=["seed", "trials"])
    stored = {"origin": origin, "ranges": RANGES, "processes": found}
    kinds = {name: "int16" if name == "samples" else "float32" for name in table if name not in NAMES[1:]}
    arrow = pa.Table.from_pandas(table.astype(kinds), preserve_index=False)
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
        uniform = rng.random((4000, 3))
        for width in (0.2, 0.1, 0.05, 0.02, 0.01, 0.0):
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

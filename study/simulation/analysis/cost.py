"""The cost of a fit: operations by the paper and by the registry, and seconds measured here in vector and scalar code.

An estimator's entry in the registry says how many additions, subtractions, multiplications, divisions and square roots
its kernel spends on a sample. Scalar code is timed by a program of its own, because compiler settings hold from its
start.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

import numpy as np
import pandas as pd

from study import instruction_set
from study.fits import ESTIMATORS, Samples
from study.fits.loops.jit import SCALAR_CODE, always_compiled
from study.fits.loops.random import stream
from study.fits.points.cap import sample_cap
from study.text import columns


def _gdke(n: int, d: int) -> float:
    """Eqs 7-8 of the paper: 26 N + 45 in three dimensions."""
    return n * (d * d + 6 * d - 1) + d * (d + 1) * (d + 8) / 3.0 + 1.0


PAPER: dict[str, Callable[[int, int], float]] = {
    "gdke": _gdke,
    "ugdk": _gdke,
    "als": lambda n, d: math.nan,  # not in the paper
    "igdk": lambda n, d: 4.0 * _gdke(n, d),  # §8: "about four times slower"
    "lls": lambda n, d: 236.0 * n + 709.0 if d == 3 else math.nan,  # §4.4
    "mle": lambda n, d: 80.0 * _gdke(n, d),  # §10: "about 80 times faster than the MLE"
}
"""FLOPs of a fit of n samples in d dimensions, by estimator; NaN if the paper gives none."""

_TURNS = 20
"""Rounds in which each fit is timed three times; the least time counts."""


@always_compiled()
def timed(dimension: int, samples: int) -> dict[str, float]:
    """Seconds of one fit of each estimator, moments included, for points of a 60° cap with noise 0.05 r."""
    rng = stream(1, "flops")
    sets = 128
    u = np.stack([sample_cap(rng, samples, math.radians(60.0), dimension) for _ in range(sets)])
    x = np.ascontiguousarray((u + 0.05 * rng.standard_normal(u.shape)).swapaxes(1, 2))
    best = dict.fromkeys(PAPER, math.inf)
    for _ in range(_TURNS):  # round after round, because a machine's speed changes while others use it
        for name in PAPER:
            for _ in range(3):
                samples_of = Samples(x, 0.05)
                start = perf_counter()
                ESTIMATORS[name](samples_of)
                best[name] = min(best[name], perf_counter() - start)
    return {name: seconds / sets for name, seconds in best.items()}


def timed_scalar(dimension: int, samples: int) -> dict[str, float]:
    """Seconds as in `timed`, without vector instructions, like code of 2008; it is compiled the first time."""
    with _scalar_code() as cache:
        off = {"NUMBA_LOOP_VECTORIZE": "0", "NUMBA_SLP_VECTORIZE": "0", "NUMBA_CACHE_DIR": cache}
        return _timed_elsewhere(dimension, samples, off)


@contextmanager
def _scalar_code() -> Iterator[str]:
    """A folder for scalar code; one that does not last, where the package cannot be written to."""
    try:
        SCALAR_CODE.mkdir(parents=True, exist_ok=True)
        lasts = os.access(SCALAR_CODE, os.W_OK)
    except OSError:
        lasts = False
    if lasts:
        yield str(SCALAR_CODE)
        return
    with tempfile.TemporaryDirectory() as folder:
        yield folder


def _timed_elsewhere(dimension: int, samples: int, environment: dict[str, str]) -> dict[str, float]:
    """Seconds as in `timed`, by this module as a program with other compiler settings."""
    command = [sys.executable, "-m", "study.simulation.analysis.cost", str(dimension), str(samples)]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment}, check=True)
    result: dict[str, float] = json.loads(done.stdout)
    return result


_COSTS = ("paper_flops", "flops_per_sample", "vector_seconds", "scalar_seconds")


def cost_table(dimension: int = 3, samples: int = 1000) -> pd.DataFrame:
    """The paper's costs, with those of the registry and what is measured here.

    Returns:
        A row per estimator: FLOPs of a fit by the paper, FLOPs per sample here, seconds of a fit in vector and in
        scalar code, and each of them over GDKE's (``…_over_gdke``).
    """
    entries = [ESTIMATORS[name] for name in PAPER]
    vector, scalar = timed(dimension, samples), timed_scalar(dimension, samples)
    frame = pd.DataFrame({"estimator": list(PAPER), "samples": samples})
    counted = [float(entry.flops(dimension)) if entry.flops else math.nan for entry in entries]
    frame = frame.assign(paper_flops=[paper(samples, dimension) for paper in PAPER.values()], flops_per_sample=counted)
    frame = frame.assign(flops_of=[entry.flops_of or "a fit" for entry in entries])
    frame = frame.assign(vector_seconds=frame["estimator"].map(vector), scalar_seconds=frame["estimator"].map(scalar))
    base = frame[frame["estimator"] == "gdke"].iloc[0]
    return frame.assign(**{f"{column}_over_gdke": frame[column] / base[column] for column in _COSTS})


def printed(frame: pd.DataFrame) -> Iterator[str]:
    """The cost table for a terminal."""
    yield f"cost of a fit of {frame['samples'].iloc[0]} samples in 3-D; × stands for times gdke's"
    rows = []
    for row in frame.to_dict("records"):
        rows.append([row["estimator"]])
        values = [
            f"{row['paper_flops']:,.0f}",
            f"{row['flops_per_sample']:g} {row['flops_of']}",
            *(f"{1e6 * row[name]:.2f} µs" for name in ("vector_seconds", "scalar_seconds")),
        ]
        for name, value in zip(_COSTS, values, strict=True):
            known = not math.isnan(row[name])
            rows[-1] += [value, f"{row[f'{name}_over_gdke']:.2f}×"] if known else ["-", ""]
    titles = ["", "paper FLOPs", "", "FLOPs per sample", "", "vector code", "", "scalar code", ""]
    yield from columns(rows, titles, "<>")


if __name__ == "__main__":
    instruction_set.fix()  # as in the command, so that what an installation compiles is what the command calls
    print(json.dumps(timed(*map(int, sys.argv[1:]))))

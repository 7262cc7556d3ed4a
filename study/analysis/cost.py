"""What a fit costs: operations counted, seconds measured, beside the paper's figures.

Operations are counted by running the kernels themselves on numbers that count.

With compilation off the compiled functions are plain Python, and so can be fed with `Counted` numbers: every addition,
subtraction, multiplication, division and square root is one operation. Nothing is modelled; a change in a kernel
changes its count. Part of it runs as a program of its own, because compiler settings hold from the start.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from study.experiment.streams import stream

_TURNS = 20
"""Turns in which each fit is timed three times; the least of all counts."""


class Counted(float):
    """A float whose arithmetic is counted."""

    operations = 0

    def __add__(self, other: Any) -> "Counted":
        return _counted(float.__add__(self, other))

    def __sub__(self, other: Any) -> "Counted":
        return _counted(float.__sub__(self, other))

    def __mul__(self, other: Any) -> "Counted":
        return _counted(float.__mul__(self, other))

    def __truediv__(self, other: Any) -> "Counted":
        return _counted(float.__truediv__(self, other))

    def __radd__(self, other: Any) -> "Counted":
        return _counted(float.__radd__(self, other))

    def __rsub__(self, other: Any) -> "Counted":
        return _counted(float.__rsub__(self, other))

    def __rmul__(self, other: Any) -> "Counted":
        return _counted(float.__rmul__(self, other))

    def __rtruediv__(self, other: Any) -> "Counted":
        return _counted(float.__rtruediv__(self, other))

    def __pow__(self, other: Any, modulo: None = None) -> "Counted":
        return _counted(float(self) ** float(other))  # squares only

    def __neg__(self) -> "Counted":
        return Counted(float.__neg__(self))

    def __abs__(self) -> "Counted":
        return Counted(float.__abs__(self))


def _counted(value: Any) -> Counted:
    Counted.operations += 1
    return Counted(value)


@contextmanager
def _counting_numpy() -> Iterator[None]:
    """Arrays that kernels make hold objects, and square roots count."""
    empty, root = np.empty, math.sqrt
    arrays: Any = np

    def objects(shape: Any, dtype: Any = float) -> Any:
        return empty(shape, dtype=object if dtype is float else dtype)

    arrays.empty = objects
    math.sqrt = lambda value: _counted(root(value))
    try:
        yield
    finally:
        arrays.empty, math.sqrt = empty, root


def _objects(*shape: int) -> Any:
    array = np.zeros(shape, dtype=object)
    array[...] = Counted(0.0)
    return array


def _slope(run: Callable[[Any], None], dimension: int) -> float:
    """Operations per sample: the increase between two numbers of samples within one chunk."""
    counts = []
    for n in (40, 140):
        rng = stream(1, "flops")
        x = _objects(1, dimension, n)
        for index, value in np.ndenumerate(rng.standard_normal(x.shape)):
            x[index] = Counted(value)
        Counted.operations = 0
        with _counting_numpy():
            run(x)
        counts.append(Counted.operations)
    return (counts[1] - counts[0]) / 100.0


def count(dimension: int) -> dict[str, float]:
    """Operations per sample of each kernel; compilation must be off."""
    layouts, moments = (import_module(f"study.sphere.{name}") for name in ("layouts", "moments"))
    lls, mle, igdk = (import_module(f"study.estimators.{name}") for name in ("lls", "mle", "incremental"))
    d = dimension

    def zeros(dimension: int, per: int = 1) -> Any:
        return (0.0,) * (dimension * per)  # numbers that let themselves be counted, in any dimension

    def closed(x: Any) -> None:
        result = moments.Moments(_objects(2, 1), _objects(2, 1, d), _objects(1, d, d))
        moments.accumulate(x, 1, result, zeros(d), zeros(d, d))

    def linear(x: Any) -> None:
        lls._fit_all(x, 1, _objects(1, d), _objects(1), _objects(1), np.zeros(1, dtype=int), zeros(d))

    def one_pass(x: Any) -> None:
        block, scratch = layouts.Block(x, 0, 0, x.shape[2]), layouts.Scratch(None, zeros(d), zeros(d, d))
        mle._pass(block, _objects(d), _objects(d), 1.0, _objects(2 + 2 * d + d * d), scratch)

    def incremental(x: Any) -> None:
        running = igdk.Running(_objects(1, d), _objects(1, d, d), _objects(1, d), _objects(1, d, d))
        for i in range(d):
            running.inverse[0, i, i] = Counted(1.0)
        igdk._stream_all(x, d + 5, running)

    kernels = {"moments": closed, "lls": linear, "mle": one_pass, "igdk": incremental}
    return {name: _slope(run, d) for name, run in kernels.items()}


def counted(dimension: int) -> dict[str, float]:
    """Operations per sample of each kernel, counted in a process of its own."""
    return _elsewhere(["count", str(dimension)], {"NUMBA_DISABLE_JIT": "1"})


def timed(dimension: int, samples: int) -> dict[str, float]:
    """Seconds of one fit of each estimator, moments included, on points of a 60° cap with noise 0.05 r."""
    from study.estimators import ESTIMATORS, Samples
    from study.sphere.cap import sample_cap

    rng = stream(1, "flops")
    sets = 128
    u = np.stack([sample_cap(rng, samples, math.radians(60.0), dimension) for _ in range(sets)])
    x = np.ascontiguousarray((u + 0.05 * rng.standard_normal(u.shape)).swapaxes(1, 2))
    best = dict.fromkeys(PAPER, math.inf)
    for _ in range(_TURNS):  # for a machine's pace changes while others use it
        for name in PAPER:
            for _ in range(3):
                samples_of = Samples(x, 0.05)
                start = perf_counter()
                ESTIMATORS[name](samples_of)
                best[name] = min(best[name], perf_counter() - start)
    return {name: seconds / sets for name, seconds in best.items()}


def timed_scalar(dimension: int, samples: int) -> dict[str, float]:
    """The same with the compiler kept from using vector instructions, as code was in 2008."""
    with tempfile.TemporaryDirectory() as cache:
        off = {"NUMBA_LOOP_VECTORIZE": "0", "NUMBA_SLP_VECTORIZE": "0", "NUMBA_CACHE_DIR": cache}
        return _elsewhere(["time", str(dimension), str(samples)], off)


def cost_table(dimension: int = 3, samples: int = 1000) -> pd.DataFrame:
    """The paper's cost claims beside what is counted and measured here.

    Returns:
        A row per estimator: FLOPs of a fit by the paper and per sample here, seconds of a fit on two footings, and
        each of them over GDKE's.
    """
    operations, vector, scalar = counted(dimension), timed(dimension, samples), timed_scalar(dimension, samples)
    rows = []
    for name, paper in PAPER.items():
        kernel = {"mle": "mle", "lls": "lls", "igdk": "igdk"}.get(name, "moments")
        rows.append(
            {
                "estimator": name,
                "samples": samples,
                "paper_flops": paper(samples, dimension),
                "flops_per_sample": operations[kernel],
                "flops_of": "a pass" if name == "mle" else "a fit",
                "vector_seconds": vector[name],
                "scalar_seconds": scalar[name],
            }
        )
    frame = pd.DataFrame(rows)
    base = frame[frame["estimator"] == "gdke"].iloc[0]
    for column in ("paper_flops", "flops_per_sample", "vector_seconds", "scalar_seconds"):
        frame[f"{column}_over_gdke"] = frame[column] / base[column]
    return frame


def printed(frame: pd.DataFrame) -> Iterator[str]:
    """The table for a terminal."""
    yield f"cost of a fit of {frame['samples'].iloc[0]} samples in 3-D; × is over gdke"
    yield f"{'':<10}{'paper FLOPs':>16}{'FLOPs per sample':>26}{'vector code':>22}{'scalar code':>22}"
    for _, row in frame.iterrows():
        paper = f"{row['paper_flops']:,.0f} {row['paper_flops_over_gdke']:6.2f}×" if row["paper_flops"] > 0 else "-"
        mine = f"{row['flops_per_sample']:g} {row['flops_of']} {row['flops_per_sample_over_gdke']:6.2f}×"
        times = [f"{1e6 * row[c]:.2f} µs {row[f'{c}_over_gdke']:6.2f}×" for c in ("vector_seconds", "scalar_seconds")]
        yield f"{row['estimator']:<10}{paper:>16}{mine:>26}{times[0]:>22}{times[1]:>22}"


def _gdke(n: int, d: int) -> float:
    """Paper eqs 7-8: 26 N + 45 in three dimensions."""
    return n * (d * d + 6 * d - 1) + d * (d + 1) * (d + 8) / 3.0 + 1.0


PAPER: dict[str, Callable[[int, int], float]] = {
    "gdke": _gdke,
    "ugdk": _gdke,
    "als": lambda n, d: math.nan,  # not in the paper
    "igdk": lambda n, d: 4.0 * _gdke(n, d),  # §8: "about four times slower"
    "lls": lambda n, d: 236.0 * n + 709.0 if d == 3 else math.nan,  # §4.4
    "mle": lambda n, d: 80.0 * _gdke(n, d),  # §10: "about 80 times faster than the MLE"
}
"""FLOPs of a fit as the paper has them."""


def _elsewhere(arguments: list[str], environment: dict[str, str]) -> dict[str, float]:
    """Run this module as a program with other compiler settings, and read what it prints."""
    command = [sys.executable, "-m", "study.analysis.cost", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment}, check=True)
    result: dict[str, float] = json.loads(done.stdout)
    return result


if __name__ == "__main__":
    work = count if sys.argv[1] == "count" else timed
    print(json.dumps(work(*map(int, sys.argv[2:]))))

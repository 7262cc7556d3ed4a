"""Measurement of a fit's cost: operations counted in the kernels themselves, and seconds.

With compilation off the kernels are plain Python and accept `Counted` numbers: every addition, subtraction,
multiplication, division and square root is one operation. Nothing is modelled; a change in a kernel changes its count.
Counting, and timing of scalar code, run as a program of their own, because compiler settings hold from its start.

Operations of a fit by the paper's formulas and statements.

The cost of a fit as a table: operations counted and seconds measured, beside the paper's figures.
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
from numpy.typing import NDArray

from study import instruction_set
from study.fits.jit import SCALAR_CODE
from study.fits.samples import blank
from study.fits.streams import stream
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

Objects = NDArray[np.object_]
"""Arrays of `Counted` numbers."""
_TURNS = 20
"""Rounds in which each fit is timed three times; the least time counts."""


class Counted(float):
    """A float whose arithmetic is counted."""

    operations = 0

    def __add__(self, other: float) -> "Counted":
        return _counted(float.__add__(self, other))

    def __sub__(self, other: float) -> "Counted":
        return _counted(float.__sub__(self, other))

    def __mul__(self, other: float) -> "Counted":
        return _counted(float.__mul__(self, other))

    def __truediv__(self, other: float) -> "Counted":
        return _counted(float.__truediv__(self, other))

    def __radd__(self, other: float) -> "Counted":
        return _counted(float.__radd__(self, other))

    def __rsub__(self, other: float) -> "Counted":
        return _counted(float.__rsub__(self, other))

    def __rmul__(self, other: float) -> "Counted":
        return _counted(float.__rmul__(self, other))

    def __rtruediv__(self, other: float) -> "Counted":
        return _counted(float.__rtruediv__(self, other))

    def __pow__(self, other: float, modulo: None = None) -> "Counted":
        return _counted(float(self) ** float(other))  # squares only

    def __neg__(self) -> "Counted":
        return Counted(float.__neg__(self))

    def __abs__(self) -> "Counted":
        return Counted(float.__abs__(self))


def _counted(value: float) -> Counted:
    Counted.operations += 1
    return Counted(value)


@contextmanager
def _counting_numpy() -> Iterator[None]:
    """Make new arrays hold objects, and count square roots."""
    empty, root = np.empty, math.sqrt
    arrays: Any = np

    def objects(shape: int | tuple[int, ...], dtype: type = float) -> NDArray[Any]:
        return empty(shape, dtype=object if dtype is float else dtype)

    arrays.empty = objects
    math.sqrt = lambda value: _counted(root(value))
    try:
        yield
    finally:
        arrays.empty, math.sqrt = empty, root


def _objects(*shape: int) -> Objects:
    array: Objects = np.zeros(shape, dtype=object)
    array[...] = Counted(0.0)
    return array


def _slope(run: Callable[[Objects], None], dimension: int) -> float:
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
    layouts, moments = (import_module(f"study.fits.{name}") for name in ("jit", "moments"))
    lls, mle, igdk = (import_module(f"study.fits.{name}") for name in ("lls", "geometric", "incremental"))
    d = dimension

    def zeros(dimension: int, per: int = 1) -> tuple[float, ...]:
        return (0.0,) * (dimension * per)  # plain numbers, so that counting works in any dimension

    def closed(x: Objects) -> None:
        result = moments.Moments(_objects(2, 1), _objects(2, 1, d), _objects(1, d, d))
        moments.accumulate(x, 1, result, zeros(d), zeros(d, d))

    def linear(x: Objects) -> None:
        counted: dict[str, Any] = {"center": _objects(1, d), "radius": _objects(1), "noise_variance": _objects(1)}
        lls._fit_all(x, 1, blank(1, d)._replace(**counted), _objects(1), _objects(1, d, d), zeros(d))

    def one_pass(x: Objects) -> None:
        block, scratch = layouts.SampleBlock(x, 0, 0, x.shape[2]), layouts.Scratch(None, zeros(d), zeros(d, d))
        mle._pass(block, _objects(d), _objects(d), 1.0, _objects(2 + 2 * d + d * d), scratch)

    def incremental(x: Objects) -> None:
        running = igdk.Running(_objects(1, d), _objects(1, d, d), _objects(1, d), _objects(1, d, d))
        for i in range(d):
            running.inverse[0, i, i] = Counted(1.0)
        igdk._stream_all(x, np.array([d + 5]), running)

    kernels = {"moments": closed, "lls": linear, "mle": one_pass, "igdk": incremental}
    return {name: _slope(run, d) for name, run in kernels.items()}


def counted(dimension: int) -> dict[str, float]:
    """Operations per sample of each kernel, counted in a process of its own."""
    return _elsewhere(["count", str(dimension)], {"NUMBA_DISABLE_JIT": "1"})


def timed(dimension: int, samples: int) -> dict[str, float]:
    """Seconds of one fit of each estimator, moments included, for points of a 60° cap with noise 0.05 r."""
    from study.fits import ESTIMATORS, Samples
    from study.fits.cap import sample_cap

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
        return _elsewhere(["time", str(dimension), str(samples)], off)


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


def _elsewhere(arguments: list[str], environment: dict[str, str]) -> dict[str, float]:
    """Run this module as a program with other compiler settings, and read what it prints."""
    command = [sys.executable, "-m", "study.simulation.analysis.cost", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment}, check=True)
    result: dict[str, float] = json.loads(done.stdout)
    return result


if __name__ == "__main__":
    instruction_set.fix()  # as in the command, so that what an installation compiles is what the command calls
    works: dict[str, Callable[..., dict[str, float]]] = {"count": count, "time": timed, "scalar": timed_scalar}
    print(json.dumps(works[sys.argv[1]](*map(int, sys.argv[2:]))))

_COSTS = ("paper_flops", "flops_per_sample", "vector_seconds", "scalar_seconds")


def cost_table(dimension: int = 3, samples: int = 1000) -> pd.DataFrame:
    """The paper's costs beside what is counted and measured here.

    Returns:
        A row per estimator: FLOPs of a fit by the paper, FLOPs per sample here, seconds of a fit in vector and in
        scalar code, and each of them over GDKE's (``…_over_gdke``).
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
    for column in _COSTS:
        frame[f"{column}_over_gdke"] = frame[column] / base[column]
    return frame


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

"""Count the operations of kernels, run as plain Python on numbers that count: a program, with compilation off.

``NUMBA_DISABLE_JIT=1 python operations.py D`` prints the operations per sample of each kernel in D dimensions as JSON.
Every addition, subtraction, multiplication, division, square and square root is one; signs and comparisons are none.
"""

import json
import math
import sys
from types import SimpleNamespace

import numpy as np

from study.fits.estimators import geometric, lls
from study.fits.loops import jit
from study.fits.points import moments
from study.fits.points.samples import blank


class Counted(float):
    """A float whose arithmetic is counted."""

    operations = 0


def operation(function):
    """The function of two floats, counted."""

    def count(*numbers):
        value = function(*numbers[:2])
        Counted.operations += value is not NotImplemented
        return value if value is NotImplemented else Counted(value)

    return count


for name in ("add", "sub", "mul", "truediv", "pow"):
    for side in ("", "r"):
        setattr(Counted, f"__{side}{name}__", operation(getattr(float, f"__{side}{name}__")))
for name in ("neg", "abs"):
    sign = getattr(float, f"__{name}__")
    setattr(Counted, f"__{name}__", lambda number, sign=sign: Counted(sign(number)))


def objects(*shape):
    """An array of counted zeros."""
    array = np.empty(shape, dtype=object)
    array[...] = Counted(0.0)
    return array


def zeros(dimension, per=1):
    """Sums in a tuple, in any dimension."""
    return (0.0,) * (dimension * per)


def closed(x):
    """Moments, from which the closed forms follow."""
    d = x.shape[1]
    result = moments.Moments(objects(2, 1), objects(2, 1, d), objects(1, d, d))
    moments.accumulate(x, result, zeros(d), zeros(d, d))


def linear(x):
    """Linear least squares."""
    d = x.shape[1]
    fit = blank(1, d)._replace(center=objects(1, d), radius=objects(1), noise_variance=objects(1))
    lls._fit_all(x, fit, objects(1), objects(1, d, d), zeros(d))


def one_pass(x):
    """A pass of the geometric fit."""
    d, n = x.shape[1:]
    block, scratch = jit.SampleBlock(x, 0, 0, n), jit.Scratch(None, zeros(d), zeros(d, d))
    sums = geometric.SphereSums(objects(2), objects(3, d), objects(2, d, d))
    geometric.sum_about(block, objects(d), objects(d), 1.0, False, sums, scratch)


def stream(x):
    """The incremental fit."""
    d = x.shape[1]
    running = lls.Running(objects(1, d), objects(1, d, d), objects(1, d), objects(1, d, d))
    for i in range(d):
        running.inverse[0, i, i] = Counted(1.0)
    lls._stream_all(x, np.array([d + 5]), running)


def per_sample(kernel, d):
    """Operations per sample: the increase between two numbers of samples within one chunk."""
    counts = []
    for n in (40, 140):
        x = objects(1, d, n)
        for index, value in np.ndenumerate(np.random.default_rng(1).standard_normal(x.shape)):
            x[index] = Counted(value)
        Counted.operations = 0
        kernel(x)
        counts.append(Counted.operations)
    return (counts[1] - counts[0]) / 100.0


def counting():
    """Give the kernels' modules arrays that can hold counted numbers, and square roots that count."""
    root = operation(math.sqrt)
    arrays = SimpleNamespace(**vars(np))
    arrays.empty = lambda shape, dtype=float: np.empty(shape, dtype=object if dtype is float else dtype)
    for module in [module for name, module in sys.modules.items() if name.startswith("study.fits.")]:
        for name, stand_in in (("np", arrays), ("math", SimpleNamespace(**{**vars(math), "sqrt": root}))):
            if hasattr(module, name):
                setattr(module, name, stand_in)


if __name__ == "__main__":
    assert not hasattr(moments.accumulate, "py_func"), "set NUMBA_DISABLE_JIT=1, or nothing is counted"
    counting()
    kernels = {"moments": closed, "lls": linear, "mle": one_pass, "igdk": stream}
    print(json.dumps({name: per_sample(kernel, int(sys.argv[1])) for name, kernel in kernels.items()}))

"""Sums over the points of weight 1: those of the geometric fit, and the scatter of the points' directions."""

import math

from study.estimators.robust.concentration import SearchRoom
from study.sphere.jit import CHUNK, compiled, dot, fill
from study.sphere.linalg import cholesky_solve
from study.sphere.types import Floats


@compiled
def weighted_pass(y: Floats, weight: Floats, center: Floats, radius: float, rows: Floats, sums: Floats) -> None:
    """Form the sums of `study.estimators.geometric.mle`, over the points of weight 1."""
    d, n = y.shape
    fill(sums, 0.0)
    for start in range(0, n, CHUNK):
        size = min(CHUNK, n - start)
        over, part, w = rows[d, :size], rows[d + 1, :size], weight[start : start + size]
        fill(over, 1e-300)  # a sample may lie at the centre
        for i in range(d):
            row, e, c = y[i, start : start + size], rows[i, :size], center[i]
            for k in range(size):
                e[k] = row[k] - c
                over[k] += e[k] * e[k]
        excess = squares = 0.0
        for k in range(size):
            distance = math.sqrt(over[k])
            over[k] = 1.0 / distance
            part[k] = w[k] * (distance - radius)
            excess += part[k]
            squares += part[k] * part[k]
        sums[0] += excess
        sums[1] += squares
        for i in range(d):
            e = rows[i, :size]
            for k in range(size):
                e[k] *= over[k]
            sums[2 + i] += dot(e, part)
            sums[2 + d + i] += dot(e, w)
        for i in range(d):
            e = rows[i, :size]
            for k in range(size):
                part[k] = w[k] * over[k] * e[k]
            for j in range(i + 1):
                sums[2 + 2 * d + i * d + j] += dot(part, rows[j, :size])


@compiled
def direction(y: Floats, k: int, sphere: Floats, e: Floats) -> None:
    """Write the direction of point k from the centre of a sphere (d,)."""
    square = 1e-300  # a sample may lie at the centre
    for i in range(e.size):
        e[i] = y[i, k] - sphere[i]
        square += e[i] * e[i]
    over = 1.0 / math.sqrt(square)
    for i in range(e.size):
        e[i] *= over


@compiled
def scatter_directions(y: Floats, sphere: Floats, work: SearchRoom) -> bool:
    """Directions of the points of weight 1: their mean, and Cholesky's factor of Σ(e - ē)(e - ē)ᵀ; False if singular.

    They are left in ``work.vectors[0]`` and ``work.matrices[0]``.
    """
    d, n = y.shape
    mean, e, right, scatter = work.vectors[0], work.vectors[1], work.vectors[2], work.matrices[0]
    count = 0.0
    fill(mean, 0.0)
    fill(right, 0.0)
    for i in range(d):
        for j in range(d):
            scatter[i, j] = 0.0
    for turn in range(2):
        for k in range(n):
            if work.weight[k] > 0.0:
                direction(y, k, sphere, e)
                if turn == 0:
                    count += 1.0
                for i in range(d):
                    if turn == 0:
                        right[i] += e[i]
                    else:
                        e[i] -= mean[i]
                        for j in range(i + 1):
                            scatter[i, j] += e[i] * e[j]
        if turn == 0:
            for i in range(d):
                mean[i] = right[i] / count
    fill(right, 0.0)
    return cholesky_solve(scatter, right)

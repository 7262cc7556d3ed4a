"""Where compiled code finds the samples of point sets: in an array, by coordinate or by sample, or formed where read.

Every kernel takes its samples chunk by chunk from a :func:`window`, and so need not know which it is. Point sets that
share their draws are formed while those are in a cache: they are taken side by side (:func:`abreast`), a block of
samples from each in turn, for reading them from memory costs more than forming them.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from study.sphere.jit import CHUNK, compiled, compiled_as_written, fma, fresh, put
from study.sphere.types import Floats

BLOCK = 32 * CHUNK
"""Samples that are taken from a set before it is the next one's turn: draws of so many stay in a second-level cache."""

_FEW = 1 << 12
"""Coordinates that are copied in no more time than it takes to tell a kernel where they are."""

_NEAR = 32
"""Samples whose mean is near enough to all of them."""


class Placed(NamedTuple):
    """Point sets x = c + r u + σ z: those of the first trial on every sphere, then those of the next.

    Attributes:
        directions: unit vectors (t, d, n), with the height 1 - u₁ in place of u₁.
        noise: noise of unit size (t, d, n).
        center: c (l, d).
        radius: r (l,).
        sigma: σ (l,).
    """

    directions: Floats
    noise: Floats
    center: Floats
    radius: Floats
    sigma: Floats


class BySample(NamedTuple):
    """Point sets that lie in memory sample by sample, as users have them.

    Attributes:
        points: coordinates last (b, n, d), contiguous.
    """

    points: Floats


@compiled_as_written
def _coordinate(i: int, u: float, z: float, center: float, radius: float, sigma: float) -> float:
    """The i-th coordinate of a sample."""
    cosine = 1.0 - u if i == 0 else u
    return fma(sigma, z, fma(radius, cosine, center))  # type: ignore[call-arg]


@compiled
def _form(placed: Any, first: int, points: Any) -> None:
    b, d, n = points.shape
    for t in range(b):
        trial, s = (first + t) // placed.radius.size, (first + t) % placed.radius.size
        for i in range(d):
            u, z, x = placed.directions[trial, i], placed.noise[trial, i], points[t, i]
            center, radius, sigma = placed.center[s, i], placed.radius[s], placed.sigma[s]
            for k in range(n):
                x[k] = _coordinate(i, u[k], z[k], center, radius, sigma)


def form(placed: Placed, points: Floats, first: int = 0) -> Floats:
    """Form point sets, from the ``first`` on as many as there is room for, in an array (b, d, n), which is returned."""
    _form(placed, first, points)
    return points


def readable(x: "Floats | Placed") -> "Floats | Placed | BySample":
    """Point sets (b, d, n) as :func:`window` takes them: copied, if they are few, or contiguous in neither way.

    Kernels would be compiled for each other layout, of which a batch of one set and a batch of many are two.
    """
    if isinstance(x, Placed) or x.flags.c_contiguous:
        return x
    points = x.swapaxes(1, 2)
    return BySample(points) if points.flags.c_contiguous and x.size > _FEW else np.ascontiguousarray(x)


def extent(x: "Floats | Placed | BySample") -> tuple[int, int, int]:
    """Number of sets b, dimension d, samples n."""
    if isinstance(x, BySample):
        b, n, d = x.points.shape
        return b, d, n
    if isinstance(x, Placed):
        t, d, n = x.noise.shape
        return t * len(x.radius), d, n
    b, d, n = x.shape
    return b, d, n


def abreast(x: "Floats | Placed | BySample") -> int:
    """How many sets, of each so many, share what they are formed of.

    Kernels are given it, and do not ask: bits could differ where the compiler knows it to be 1.
    """
    return len(x.radius) if isinstance(x, Placed) else 1


def window(x: Any, t: int, start: int, count: int, rows: Any, zero: Any) -> Any:
    """A view of ``count`` samples of set t of a batch, from sample ``start`` on, for :func:`at`.

    It is into the batch itself if that lies in memory coordinate by coordinate, into ``rows`` (1, d, CHUNK), to which
    the samples are copied, if it lies there sample by sample, or into what they are formed of. ``zero`` are sums of one
    for each dimension. Neither the layout nor the forming shows in any sum.
    """
    return x, np.uintp(t), np.uintp(start)


def at(view: Any, i: int, k: Any) -> Any:
    """The i-th coordinate of the k-th sample of a view."""
    x, t, start = view
    return x[t, i, start + np.uintp(k)]


def _is(x: Any, kind: type) -> bool:
    return getattr(x, "instance_class", None) is kind


@overload(extent)
def _extent(x: Any) -> Any:
    def stored(x: Any) -> Any:
        return x.shape

    def placed(x: Any) -> Any:
        t, d, n = x.noise.shape
        return t * x.radius.size, d, n

    def by_sample(x: Any) -> Any:
        b, n, d = x.points.shape
        return b, d, n

    return placed if _is(x, Placed) else by_sample if _is(x, BySample) else stored


@overload(window)
def _window(x: Any, t: Any, start: Any, count: Any, rows: Any, zero: Any) -> Any:
    def itself(x: Any, t: Any, start: Any, count: Any, rows: Any, zero: Any) -> Any:
        return x, np.uintp(t), np.uintp(start)

    def copied(x: Any, t: Any, start: Any, count: Any, rows: Any, zero: Any) -> Any:
        for k in range(count):
            for i in range(len(zero)):
                rows[0, i, k] = x.points[t, np.uintp(start) + np.uintp(k), i]
        return rows, np.uintp(0), np.uintp(0)

    def formed(x: Any, t: Any, start: Any, count: Any, rows: Any, zero: Any) -> Any:
        trial, s, center = np.uintp(t // x.radius.size), t % x.radius.size, fresh(zero)
        for i in range(len(zero)):
            center = put(center, i, x.center[s, i])
        return x.directions, x.noise, trial, np.uintp(start), center, x.radius[s], x.sigma[s]

    return formed if _is(x, Placed) else copied if _is(x, BySample) else itself


@overload(at)
def _at(view: Any, i: Any, k: Any) -> Any:
    def stored(view: Any, i: Any, k: Any) -> Any:
        x, t, start = view
        return x[t, i, start + np.uintp(k)]

    def formed(view: Any, i: Any, k: Any) -> Any:
        u, z, t, start, center, radius, sigma = view
        place = start + np.uintp(k)
        return _coordinate(i, u[t, i, place], z[t, i, place], center[i], radius, sigma)

    return stored if len(view) == 3 else formed


@compiled_as_written
def near(x: Any, t: int, n: int, rows: Any, zero: Any) -> Any:
    """A point near the n samples of a set: the mean of the first of them. Whatever is formed about it has its bits."""
    m, mean = min(n, _NEAR), fresh(zero)
    view = window(x, t, 0, m, rows, zero)
    for k in range(m):
        for i in range(len(zero)):
            mean = put(mean, i, mean[i] + at(view, i, k))
    for i in range(len(zero)):
        mean = put(mean, i, mean[i] / m)
    return mean

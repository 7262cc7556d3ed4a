"""Layouts of point sets in memory, and the one way in which kernels read samples from each.

A batch of point sets is an array (b, d, n), which lies in memory coordinate by coordinate; the same sample by sample
(`BySample`); or the draws that its points are formed from (`Placed`). Kernels read samples chunk by chunk from a
:func:`window`, and so are written once for all three. Sets that are formed from the same draws are read side by side
(:func:`abreast`), a block of samples from each in turn, while the draws are in a cache: reading them from memory costs
more than forming the points.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np

from study.sphere.jit import CHUNK, Sums, compiled, compiled_as_written, fma, fresh, overload, put
from study.sphere.types import Floats

BLOCK = 32 * CHUNK
"""Samples that are read from a set before it is the next one's turn: that many draws stay in a second-level cache."""

_FEW = 1 << 12
"""Smaller arrays are copied rather than wrapped."""

_NEAR = 32
"""Number of first samples whose mean serves as an origin near all."""


class Placed(NamedTuple):
    """Point sets x = c + r u + σ z: those of the first trial on every sphere, then those of the next.

    Attributes:
        directions: unit vectors u (t, d, n), with the height 1 - u₁ in place of u₁.
        noise: noise z of unit size (t, d, n).
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


PointSets = Floats | Placed | BySample


class Stored(NamedTuple):
    """View of samples in an array (b, d, n): those of set ``t`` from sample ``start`` on."""

    x: Floats
    t: np.uintp
    start: np.uintp


class Formed(NamedTuple):
    """View of samples that are formed when they are read: those of a trial from sample ``start`` on."""

    directions: Floats
    noise: Floats
    trial: np.uintp
    start: np.uintp
    center: Sums
    radius: float
    sigma: float


View = Stored | Formed


class SampleBlock(NamedTuple):
    """The ``size`` samples of set ``t`` of a batch from sample ``start`` on."""

    x: PointSets
    t: int
    start: int
    size: int


class Scratch(NamedTuple):
    """Working memory of kernels that read samples.

    Attributes:
        rows: place for one chunk of samples (1, d, CHUNK).
        zero: d sums at zero.
        square: d² sums at zero.
    """

    rows: Floats
    zero: Sums
    square: Sums


@compiled_as_written
def _coordinate(i: int, u: float, z: float, center: float, radius: float, sigma: float) -> float:
    """The i-th coordinate of a sample."""
    cosine = 1.0 - u if i == 0 else u
    return fma(sigma, z, fma(radius, cosine, center))


@compiled
def _form(placed: Placed, first: int, points: Floats) -> None:
    b, d, n = points.shape
    for t in range(b):
        trial, s = (first + t) // placed.radius.size, (first + t) % placed.radius.size
        for i in range(d):
            u, z, x = placed.directions[trial, i], placed.noise[trial, i], points[t, i]
            center, radius, sigma = placed.center[s, i], placed.radius[s], placed.sigma[s]
            for k in range(n):
                x[k] = _coordinate(i, u[k], z[k], center, radius, sigma)


def form(placed: Placed, points: Floats, first: int = 0) -> Floats:
    """Write point sets into an array (b, d, n), from set ``first`` on as many as it holds, and return it."""
    _form(placed, first, points)
    return points


def readable(x: Floats | Placed) -> PointSets:
    """Point sets (b, d, n) in a form that :func:`window` reads. Small or strided arrays are copied.

    Kernels would be compiled for each other layout, of which a batch of one set and a batch of many are two.
    """
    if isinstance(x, Placed) or x.flags.c_contiguous:
        return x
    points = x.swapaxes(1, 2)
    return BySample(points) if points.flags.c_contiguous and x.size > _FEW else np.ascontiguousarray(x)


def extent(x: PointSets) -> tuple[int, int, int]:
    """Number of sets b, dimension d, samples n."""
    if isinstance(x, BySample):
        b, n, d = x.points.shape
        return b, d, n
    if isinstance(x, Placed):
        t, d, n = x.noise.shape
        return t * len(x.radius), d, n
    b, d, n = x.shape
    return b, d, n


def abreast(x: PointSets) -> int:
    """Number of consecutive sets built from the same draws.

    Kernels take it as an argument, and do not compute it: bits could differ where the compiler knows it to be 1.
    """
    return len(x.radius) if isinstance(x, Placed) else 1


def window(x: PointSets, t: int, start: int, count: int, rows: Floats, zero: Sums) -> View:
    """A view of ``count`` samples of set t of a batch, from sample ``start`` on, for :func:`at`.

    It shows the batch itself if that lies in memory coordinate by coordinate; ``rows`` (1, d, CHUNK), to which
    the samples are copied, if it lies there sample by sample; or the draws that the points are formed from. ``zero``
    holds d sums at zero. No sum depends on the layout, not in a bit.
    """
    return Stored(cast(Floats, x), np.uintp(t), np.uintp(start))


def at(view: View, i: int, k: int) -> float:
    """The i-th coordinate of the k-th sample of a view."""
    x, t, start = cast(Stored, view)
    return x[t, i, start + np.uintp(k)]  # type: ignore[no-any-return]


def _is(x: object, kind: type) -> bool:
    return getattr(x, "instance_class", None) is kind


@overload(extent)
def _extent(x: Any) -> Callable[..., tuple[int, ...]]:
    def stored(x: Any) -> tuple[int, ...]:
        return x.shape  # type: ignore[no-any-return]

    def placed(x: Any) -> tuple[int, ...]:
        t, d, n = x.noise.shape
        return t * x.radius.size, d, n

    def by_sample(x: Any) -> tuple[int, ...]:
        b, n, d = x.points.shape
        return b, d, n

    return placed if _is(x, Placed) else by_sample if _is(x, BySample) else stored


@overload(window)
def _window(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Callable[..., View]:
    def itself(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Stored:
        return Stored(x, np.uintp(t), np.uintp(start))

    def copied(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Stored:
        for k in range(count):
            for i in range(len(zero)):
                rows[0, i, k] = x.points[t, np.uintp(start) + np.uintp(k), i]
        return Stored(rows, np.uintp(0), np.uintp(0))

    def formed(x: Any, t: int, start: int, count: int, rows: Floats, zero: Sums) -> Formed:
        trial, s, center = np.uintp(t // x.radius.size), t % x.radius.size, fresh(zero)
        for i in range(len(zero)):
            center = put(center, i, x.center[s, i])
        return Formed(x.directions, x.noise, trial, np.uintp(start), center, x.radius[s], x.sigma[s])

    return formed if _is(x, Placed) else copied if _is(x, BySample) else itself


@overload(at)
def _at(view: Any, i: int, k: int) -> Callable[..., float]:
    def stored(view: Any, i: int, k: int) -> float:
        x, t, start = view
        return x[t, i, start + np.uintp(k)]  # type: ignore[no-any-return]

    def formed(view: Any, i: int, k: int) -> float:
        u, z, t, start, center, radius, sigma = view
        place = start + np.uintp(k)
        return _coordinate(i, u[t, i, place], z[t, i, place], center[i], radius, sigma)

    return formed if _is(view, Formed) else stored


@compiled_as_written
def near(x: PointSets, t: int, n: int, rows: Floats, zero: Sums) -> Sums:
    """A point near the n samples of a set: the mean of the first of them, by its bits the same in every layout."""
    m, mean = min(n, _NEAR), fresh(zero)
    view = window(x, t, 0, m, rows, zero)
    for k in range(m):
        for i in range(len(zero)):
            mean = put(mean, i, mean[i] + at(view, i, k))
    for i in range(len(zero)):
        mean = put(mean, i, mean[i] / m)
    return mean

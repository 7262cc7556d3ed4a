"""Several spheres in one cloud of points: found one after another, each then fitted to its own points.

A guess is a sphere through d + 1 points that lie near each other, on scales from a few points to half of the cloud.
It is judged by the number k of the n points within a distance w of it, beside the share p that would be there without a
sphere: that of the cloud's volume, or of the points at w to 3w, whichever is larger. The log-likelihood ratio

    k log(k/np) + (n - k) log((n - k)/(n - np)),

at the best of a ladder of widths w, is compared among guesses, and with what chance gives the best of all guesses
(Desolneux, Moisan & Morel 2000; with the width as in Moisan & Stival 2004). A plane, a cube or a filled ball has as
many points beside a sphere as near it, and so gives no good guess. The best one is improved by fits to its points.

The outliers of a robust fit to what lies near are left out, and the sphere is fitted to the rest by any estimator.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from study.arrays import Bools, Floats, Ints, real_array
from study.fits import ESTIMATORS, Fit, Status, fit
from study.fits.answers.display import meanings, statuses
from study.fits.loops.random import stream
from study.text import columns, with_error
from study.text import number as text_number
from study.words import Hinting, estimator_remedy

if TYPE_CHECKING:
    import pandas as pd

_GUESSES = 2400
_SUBSAMPLE = 3000
"""Points of the cloud on which guesses are judged."""
_LEAST = 15
"""Points of the subsample that a sphere has at least, beside the d + 1 that a guess goes through: lines of a scan are
circles, which have a few more in common with some sphere."""
_SCALES = 8
"""Sizes of neighbourhoods from which guesses take their points, from `_FEWEST` points to half of the subsample."""
_FEWEST = 12
_IMPROVED = 24
"""Guesses that are improved by fits."""
_ROUNDS = 6
"""Most fits of a guess."""
_WIDTHS = 1e-5 * 3.0 ** (0.5 * np.arange(18))
"""Distances from a sphere, in units of the cloud's size; the next but one is three times as large."""
_LARGEST = 10.0
"""Largest radius of a guess, in units of the cloud's size."""
_CHANCE = math.log(1e3)
"""Log-likelihood ratio beyond that of the best of all guesses by chance."""
_NEAR = 6.0
"""Distance from a sphere, in standard deviations of its noise, up to which points may be outliers of its fit."""
_EMPTY = 0.1
"""Share of a sphere's points that may be others by chance, by the points at 3 to 9 standard deviations from it."""
_SMALL, _SMALL_SHARE = 100, 0.01
"""A sphere with fewer points than both, the latter a share of the cloud, may stand on lines of a scan by chance."""
_ROUNDING = 64 * 2.0**-52
"""Noise below this share of the largest coordinate is rounding."""
_TOO_LARGE = 1e150
"""Coordinates whose squares cannot be computed with; such points are missing."""


@dataclass(frozen=True, eq=False)
class CloudSpheres(Hinting):
    """Spheres in one cloud, as `fit_spheres` finds them: those that are ok first, in the order of their points.

    Attributes:
        fits: a fit of shape () for each sphere, of its own points.
        labels: number of the sphere that each point belongs to (n,), from 0; -1 for a point of none.
        alone: False (k,) for a sphere near which there are so many other points that it may be part of another shape,
            for one of fewer than 100 points that are less than a hundredth of the cloud, and for one whose radius is
            larger than the cloud: it is a plane.

    Examples:
        Two balls of radius 25 on a table, which is not a sphere:

        >>> import numpy as np, study
        >>> rng = np.random.default_rng(1)
        >>> ball = rng.normal(size=(400, 3))
        >>> ball = 25 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + rng.normal(0, 0.1, (400, 3))
        >>> table = np.column_stack([rng.uniform(-80, 160, (500, 2)), rng.normal(-25, 0.1, 500)])
        >>> spheres = study.fit_spheres(np.vstack([ball, ball + [90, 0, 0], table]), 3)
        >>> spheres.ok, spheres.radius[spheres.ok].round(1)
        (array([ True,  True, False]), array([25., 25.]))
        >>> np.sort(spheres.center[spheres.ok][:, 0]).round()
        array([-0., 90.])
    """

    fits: tuple[Fit, ...]
    labels: Ints
    alone: Bools

    @property
    def ok(self) -> Bools:
        """True (k,) for each sphere whose status is ok."""
        return np.asarray(self.status == Status.OK)

    @property
    def status(self) -> Ints:
        """Status of each sphere (k,): that of its fit, or `Status.MISFIT` if it does not stand alone."""
        own = np.array([int(fit.status) for fit in self.fits], dtype=np.int64)
        return np.where((own == Status.OK) & ~self.alone, int(Status.MISFIT), own)

    @property
    def center(self) -> Floats:
        """Centres (k, d), in the unit of the points."""
        return np.array([fit.center for fit in self.fits])

    @property
    def radius(self) -> Floats:
        """Radii (k,), in the unit of the points."""
        return np.array([float(fit.radius) for fit in self.fits])

    @property
    def count(self) -> Ints:
        """Number of points of each sphere (k,)."""
        return np.bincount(self.labels[self.labels >= 0], minlength=len(self.fits))

    @property
    def left(self) -> int:
        """Number of points that belong to no sphere, missing ones among them."""
        return int((self.labels < 0).sum())

    def __len__(self) -> int:
        return len(self.fits)

    def __iter__(self) -> Iterator[Fit]:
        return iter(self.fits)

    def to_frame(self) -> pd.DataFrame:
        """A row per sphere: the columns of `Fit.to_frame`, with the status that counts here."""
        import pandas as pd  # takes as long to load as the rest of the library

        pairs = zip(self.fits, self.status, strict=True)
        frames = [fit.to_frame().assign(status=Status(int(status)).text) for fit, status in pairs]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def fit_spheres(
    points: ArrayLike, count: int, *, estimator: str = "corrected", radius: tuple[float, float] | None = None
) -> CloudSpheres:
    """Find and fit several spheres (circles, if d = 2) in one cloud of points, among points of other things.

    Args:
        points: coordinates (n, d), in any unit; points with a NaN, or masked, are missing.
        count: number of spheres to look for. There may be fewer: what is no sphere is not made one.
        estimator: name of the estimator that fits each sphere to its points, without outliers.
        radius: least and greatest radius that is looked for, in the unit of the points.

    Returns:
        The spheres, `count` at most. Look at ``spheres.ok``: a shape that is like a sphere, such as the end of a rod,
        may be among them, with a status that says so. The same points give the same spheres in each call.

    Raises:
        TypeError: if the points are not real numbers.
        ValueError: if the shape, the count or the estimator cannot be used.

    Examples:
        >>> import numpy as np, study
        >>> rng = np.random.default_rng(1)
        >>> angles = rng.uniform(0, 6.28, (2, 100))
        >>> circle, other = np.stack([np.cos(angles), np.sin(angles)], axis=2) + rng.normal(0, 0.01, (2, 100, 2))
        >>> spheres = study.fit_spheres(np.vstack([circle, 2 * other + [5, 0], rng.uniform(-2, 8, (60, 2))]), 2)
        >>> np.sort(spheres.radius).round(1), spheres.ok
        (array([1., 2.]), array([ True,  True]))
    """
    x = real_array(points, "points").astype(float)
    if x.ndim != 2 or x.shape[1] < 2 or len(x) < x.shape[1] + 3:
        raise ValueError(f"points have shape {x.shape}: expected one cloud (n, d) with d ≥ 2 and n ≥ d + 3")
    if count < 1 or count != int(count):
        raise ValueError(f"count = {count!r}: give the number of spheres to look for, 1 or more")
    if estimator not in ESTIMATORS:
        raise ValueError(f"estimator = {estimator!r}: unknown; {estimator_remedy(estimator, ESTIMATORS)}")
    low, high = (0.0, math.inf) if radius is None else radius
    if not 0.0 <= low < high:
        raise ValueError(f"radius = {radius!r}: give the least and the greatest, such as (24, 26)")
    x[~(np.abs(x) < _TOO_LARGE)] = np.nan
    free = np.isfinite(x).all(axis=1)
    rng, candidates, around = stream(0, "spheres"), list[_Candidate](), free.copy()
    for _ in range(2 * int(count) + 4):
        guess = _guess(x[free], rng, (low, high)) if sum(one.ok for one in candidates) < count else None
        if guess is None:
            break
        places = np.flatnonzero(free)
        near, candidate = _settle(x, (places, np.flatnonzero(around)), guess, estimator)
        free[near] = False
        if candidate is not None and low <= candidate.fit.radius <= high:
            candidates.append(candidate)
            around[near] &= not candidate.ok
    candidates.sort(key=lambda one: (not one.ok, -len(one.members)))
    del candidates[int(count) :]
    labels = np.full(len(x), -1)
    for number, one in enumerate(candidates):
        labels[one.members] = number
    alone = np.array([one.alone for one in candidates], np.bool_)
    return CloudSpheres(tuple(one.fit for one in candidates), labels, alone)


class _Candidate(NamedTuple):
    """A sphere, the places of its points (m,), and False if it may be part of another shape."""

    fit: Fit
    members: Ints
    alone: bool

    @property
    def ok(self) -> bool:
        return bool(self.fit.ok) and self.alone


class _Cloud:
    """Points in units of the cloud's size, on which guesses are judged, and the volume that they take."""

    def __init__(self, x: Floats, rng: np.random.Generator) -> None:
        if len(x) > _SUBSAMPLE:
            x = x[np.sort(rng.choice(len(x), _SUBSAMPLE, replace=False))]
        low, high = np.quantile(x, [0.02, 0.98], axis=0)
        self.middle, self.size = np.median(x, axis=0), float((high - low).max())
        unit = self.size or 1.0  # of equal points there is no cloud
        self.y = (x - self.middle) / unit
        edges = np.maximum((high - low) / unit, 0.1)
        self.volume = float(edges.prod())
        self.surface = float((2.0 * self.volume / edges).sum())

    def distances(self, spheres: Floats) -> Floats:
        """|R - r| of each point (g, n) from spheres (g, d + 1)."""
        square = sum((self.y[None, :, i] - spheres[:, i, None]) ** 2 for i in range(self.y.shape[1]))
        return np.asarray(np.abs(np.sqrt(square) - spheres[:, -1:]))

    def judge(self, spheres: Floats) -> tuple[Floats, Floats]:
        """The largest log-likelihood ratio of spheres (g,), and the width where it is reached (g,)."""
        n, d = self.y.shape
        distance = self.distances(spheres)
        count = np.stack([(distance <= width).sum(axis=1) for width in _WIDTHS], axis=1)
        whole = 2.0 * math.pi ** (0.5 * d) / math.gamma(0.5 * d)
        area = np.minimum(whole * spheres[:, -1] ** (d - 1), self.surface)
        by_volume = 2.0 * _WIDTHS[:-2] * area[:, None] / self.volume
        beside = 0.5 * (count[:, 2:] - count[:, :-2]) / n
        p = np.clip(np.maximum(by_volume, beside), 1.0 / n, 1.0 - 1e-9)
        k = np.maximum(count[:, :-2] - (d + 1), 1)  # the sphere goes through the others whatever they are
        ratio = k * np.log(k / (n * p)) + (n - k) * np.log(np.maximum(n - k, 1) / (n * (1.0 - p)))
        ratio = np.where((k > n * p) & (k >= _LEAST), ratio, 0.0)
        best = ratio.argmax(axis=1)
        return np.take_along_axis(ratio, best[:, None], axis=1)[:, 0], _WIDTHS[best]


def _guess(x: Floats, rng: np.random.Generator, radii: tuple[float, float]) -> tuple[Floats, float] | None:
    """The best sphere (d + 1,) in points (n, d), and its width; None if chance could give one as good.

    Its radius lies between two, in the unit of the points.
    """
    n, d = x.shape
    if n < d + 3:
        return None
    cloud = _Cloud(x, rng)
    if not cloud.size > 0.0:
        return None
    low, high = radii[0] / cloud.size, min(radii[1] / cloud.size, _LARGEST)
    spheres = _through(cloud.y, rng)
    spheres = spheres[(spheres[:, -1] >= low) & (spheres[:, -1] <= high)]
    if not len(spheres):
        return None
    judged = [cloud.judge(spheres[start : start + 100]) for start in range(0, len(spheres), 100)]
    ratios, widths = (np.concatenate(part) for part in zip(*judged, strict=True))
    best, sphere, width = 0.0, spheres[0], 0.0
    for place in np.argsort(-ratios, kind="stable")[:_IMPROVED]:
        one, ratio, reach = spheres[place], ratios[place], widths[place]
        for _ in range(_ROUNDS):
            trial = _step(cloud, one, reach)
            (value,), (wide,) = cloud.judge(trial[None])
            if not value > ratio or not low <= trial[-1] <= high:
                break
            one, ratio, reach = trial, value, wide
        if ratio > best:
            best, sphere, width = ratio, one, reach
    if best < _CHANCE + math.log(len(spheres) * len(_WIDTHS)):
        return None
    return np.append(cloud.middle + cloud.size * sphere[:d], cloud.size * sphere[d]), cloud.size * float(width)


def _through(y: Floats, rng: np.random.Generator) -> Floats:
    """Spheres (g, d + 1) through d + 1 points of neighbourhoods of several sizes."""
    n, d = y.shape
    tree, chosen = cKDTree(y), []
    for scale in np.geomspace(min(_FEWEST, n - 1), max(n // 2, min(_FEWEST, n - 1)), _SCALES).astype(int):
        seeds = rng.integers(n, size=_GUESSES // _SCALES)
        near = tree.query(y[seeds], k=scale + 1)[1]
        picked = rng.random((len(seeds), scale)).argpartition(d - 1, axis=1)[:, :d] + 1
        chosen.append(np.column_stack([seeds, np.take_along_axis(near, picked, axis=1)]))
    corners = y[np.concatenate(chosen)]
    edges = corners[:, 1:] - corners[:, :1]
    half = 0.5 * (edges**2).sum(axis=2)
    with np.errstate(all="ignore"):
        # the centre, from the first corner, has the same product with an edge as half of it; the shortest such vector
        offset = np.einsum("gij,gj->gi", np.linalg.pinv(edges, rcond=1e-9), half)
        r = np.linalg.norm(offset, axis=1)
        spheres = np.column_stack([corners[:, 0] + offset, r])
        return np.asarray(spheres[(r > 0.0) & (r < _LARGEST)])


def _step(cloud: _Cloud, sphere: Floats, width: float) -> Floats:
    """A sphere after one step of Gauss and Newton on the points within a width."""
    d = cloud.y.shape[1]
    away = cloud.y - sphere[:d]
    distance = np.linalg.norm(away, axis=1)
    inside = (np.abs(distance - sphere[d]) <= width) & (distance > 0.0)
    e, rest = away[inside] / distance[inside, None], distance[inside] - sphere[d]
    step = np.linalg.lstsq(np.column_stack([e, np.ones(len(e))]), rest, rcond=None)[0]
    return np.asarray(sphere + step)


def _settle(
    x: Floats, places: tuple[Ints, Ints], guess: tuple[Floats, float], estimator: str
) -> tuple[Ints, _Candidate | None]:
    """Fit a guessed sphere to its points; places of points near it, and the sphere if there is one.

    Args:
        x: the cloud.
        places: of the points that the sphere may have, and of those around it that may show that it is part of another
            shape: also points near spheres that were refused before, as the rest of that shape may be.
        guess: the sphere, and its width.
        estimator: name of the estimator.
    """
    (mine, around), d, (sphere, width) = places, x.shape[1], guess
    reach, rounding = 3.0 * width, _ROUNDING * float(np.abs(x[mine]).max())
    for _ in range(2):
        distance = np.abs(np.linalg.norm(x[mine] - sphere[:d], axis=1) - sphere[d])
        near = mine[distance <= reach]
        if len(near) < d + 3:
            return near, None
        robust = fit(x[near], "robust")
        if not (np.isfinite(robust.center).all() and robust.radius < math.inf and robust.sigma >= 0.0):
            return near, None
        sphere, sigma = np.append(robust.center, robust.radius), max(float(robust.sigma), rounding)
        reach = _NEAR * sigma
    members = near[~robust.outliers]
    distance = np.abs(np.linalg.norm(x[around] - sphere[:d], axis=1) - sphere[d])
    inside, further = (distance <= 3.0 * sigma).sum(), (distance <= 9.0 * sigma).sum()
    alone = 0.5 * (further - inside) <= _EMPTY * inside and len(members) >= min(_SMALL, _SMALL_SHARE * len(x))
    own = fit(x[members], estimator)
    cloud = np.linalg.norm(np.ptp(x[np.isfinite(x).all(axis=1)], axis=0))
    return near, _Candidate(own, members, bool(alone and own.radius <= cloud))


def printed(spheres: CloudSpheres, names: list[str], wanted: int) -> Iterator[str]:
    """The spheres for a terminal, a line each, and what is missing and left over.

    Args:
        spheres: those that were found.
        names: of the coordinates.
        wanted: the number that was asked for.
    """
    rows, texts = [], {}
    for number, (one, status) in enumerate(zip(spheres, spheres.status, strict=True), 1):
        errors = one.standard_errors
        ball = [with_error(*pair) for pair in zip(one.center, errors, strict=False)]
        ball.append(with_error(float(one.radius), float(errors[-1]) if len(errors) > len(ball) else 0.0))
        word = statuses(status)
        rows.append([str(number), *ball, text_number(float(one.sigma)), str(spheres.count[number - 1]), word])
        texts[word] = Status(int(status)).text
    yield from columns(rows, ["sphere", *names, "radius", "noise", "points", "status"])
    yield from meanings({word: text for word, text in texts.items() if word != "ok"})
    if len(spheres) < wanted:
        yield f"{len(spheres)} of {wanted} spheres were found"
    yield f"{spheres.left} of {len(spheres.labels)} points belong to no sphere"


def as_rows(spheres: CloudSpheres) -> list[dict[str, object]]:
    """A JSON object for each sphere: that of its fit, with its number and the status that counts here."""
    rows = []
    for number, (one, status) in enumerate(zip(spheres, map(Status, spheres.status), strict=True), 1):
        own = {"ok": status == Status.OK, "status": status.name, "status_text": status.text}
        rows.append({"sphere": number} | one.to_dict() | own)
    return rows

"""A sphere among clutter: each point is Gaussian about the sphere, or lies anywhere near it.

Within W scales of the sphere the signed distance ρ = R - r of a point has the density

    (1 - ε) φ(ρ/s)/s + ε/(2 W s),

and points further away are clutter. The probability w that a point is none weighs it. Centre, radius, scale s and share
ε that maximise the likelihood are found by turns: w from the sphere, then a weighted Gauss-Newton step, then
s² = Σ w ρ²/(Σ w - d - 1), and ε from the points within W scales, of which one more is taken to be clutter than it seems
(rule of succession: none seen does not mean that there is none). There is no constant to choose a loss by: with little
clutter the weights are those of least squares, with much they fall beyond 2.5 to 3.5 scales.

Distances alone do not tell clutter from a cap where it comes near to the rest of the sphere, and there one point moves
the fit most. So points whose direction is far from all others are clutter, too; see `isolated`.

Source: Torr & Zisserman 2000 (MLESAC); theory 11.4.
"""

from typing import NamedTuple

import numpy as np
import scipy

from study.arrays import Bools, Floats

_REACH = 10.0
"""W: scales from the sphere up to which the share of clutter is estimated."""
_ROUNDS = 60
_STEADY = 1e-5
"""A step below this share of the scale ends the rounds."""
_TURNS = 3
"""Times that the isolated points are sought again."""
_NEIGHBOUR, _AROUND = 3, 10
"""Neighbour in direction that is to be near, and number of neighbours whose own it is compared with."""
_LEVEL = 0.01
"""Largest share of data sets without clutter in which a point is isolated: measured are 0 to .3 %, for 25 to 300 points
on caps of 57 to 180 degrees and arcs."""
_MEDIAN = 2.6741
"""Median of a Gamma(3) number."""
_THIN, _LAST = 4000, 3
"""Points that the rounds begin with, where there are more, and rounds that are left for all."""
_LEAST_SPARE = 0.1
"""Least 1 - h by which a residual of leverage h is divided: a point of leverage 1 has no residual at all."""
_LARGEST = 1e6
"""Largest coordinate in units of a set's size, where its rounding is small; what is further is taken to be there."""
_ROUNDING = 2.0**-48


class Mixture(NamedTuple):
    """Spheres among clutter, one for each set.

    Attributes:
        center: ĉ (b, d).
        radius: r̂ (b,).
        scale: s (b,).
        share: ε, within W scales of the sphere (b,).
        weights: probability of each point to be no clutter (b, n).
    """

    center: Floats
    radius: Floats
    scale: Floats
    share: Floats
    weights: Floats


def in_own_units(x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Points (b, d, n) about their medians and in units of their size, these, and the size of rounding errors (b,)."""
    with np.errstate(all="ignore"):
        part = x[:, :, :: x.shape[2] // _THIN + 1]
        middle = np.median(part, axis=2)[:, :, None]
        away = np.abs(part - middle).max(axis=1)
        size = np.median(away, axis=1)
        size = np.where(size > 0.0, size, away.max(axis=1))[:, None, None]
        size = np.where(size > 0.0, size, 1.0)
        y = np.ascontiguousarray(np.clip((x - middle) / size, -_LARGEST, _LARGEST))
        floor = _ROUNDING * (1.0 + np.abs(middle / size).max(axis=1)[:, 0])
    return y, middle, size, floor


def _about(y: Floats, center: Floats, radius: Floats) -> tuple[Floats, Floats]:
    """Directions (b, d + 1, n), with a row of ones below, and signed distances (b, n) of points (b, d, n)."""
    away = y - center[:, :, None]
    distance = np.linalg.norm(away, axis=1)
    away /= np.maximum(distance, 1e-150)[:, None]
    return np.concatenate([away, np.ones_like(distance)[:, None]], axis=1), distance - radius[:, None]


def _probabilities(rho: Floats, scale: Floats, share: Floats, kept: Bools) -> Floats:
    """Probability of each point (b, n) to be no clutter."""
    z = rho / scale[:, None]
    inside = (1.0 - share)[:, None] * np.exp(-0.5 * z * z) * (2.0 * _REACH / np.sqrt(2.0 * np.pi))
    return np.asarray(np.where(kept & (np.abs(z) < _REACH), inside / (inside + share[:, None]), 0.0))


def _maximise(y: Floats, found: Mixture, kept: Bools, floor: Floats, rounds: int, fixed: bool = False) -> Mixture:
    """Improve mixtures of points (b, d, n) of which those not ``kept`` are clutter; not finite where that fails.

    The radius stays where it is ``fixed``.
    """
    result, whole, every = Mixture(*(array.copy() for array in found)), y, kept
    sets, tiny = np.arange(len(y)), 1e-14 * y.shape[2] * np.eye(y.shape[1] + 1)
    with np.errstate(all="ignore"):
        for _ in range(rounds):
            center, radius, scale, share = (array[sets] for array in result[:4])
            a, rho = _about(y, center, radius)
            weights = _probabilities(rho, scale, share, kept)
            count, near = weights.sum(axis=1), (kept & (np.abs(rho) < _REACH * scale[:, None])).sum(axis=1)
            squares = (weights * rho * rho).sum(axis=1) / np.maximum(count - y.shape[1] - (not fixed), 1.0)
            weighted = a * weights[:, None]
            normal, right = weighted @ a.swapaxes(1, 2), weighted @ rho[:, :, None]
            if fixed:
                normal[:, -1, :-1] = normal[:, :-1, -1] = right[:, -1] = 0.0
            lost = ~np.isfinite(normal).all(axis=(1, 2)) | ~(count > y.shape[1] + 1) | ~(radius > 0.0)
            normal[lost], right[lost] = np.eye(y.shape[1] + 1), np.nan
            step = np.linalg.solve(normal + tiny, right)[:, :, 0]
            length = np.linalg.norm(step[:, :-1], axis=1)
            step *= np.where(length > radius, radius / length, 1.0)[:, None]
            result.center[sets], result.radius[sets] = center + step[:, :-1], radius + step[:, -1]
            result.scale[sets] = np.sqrt(squares + (floor * (1.0 + radius)) ** 2)
            result.share[sets] = (near - count + 1.0) / (near + 1.0)
            going = length > _STEADY * scale
            if not going.all():
                sets, y, kept, floor = sets[going], y[going], kept[going], floor[going]
            if not len(sets):
                break
        rho = _about(whole, result.center, result.radius)[1]
        return result._replace(weights=_probabilities(rho, result.scale, result.share, every))


def _started(y: Floats, spheres: Floats, floor: Floats, known: Floats | None) -> Mixture:
    """A first guess at mixtures, from spheres (b, d + 1) to which most of the points (b, d, n) are near.

    Known radii (b,) replace theirs: the side toward the points' medians, which are the origin, stays where it is.
    """
    center, radius = spheres[:, :-1], spheres[:, -1]
    with np.errstate(all="ignore"):
        if known is not None:
            away = np.linalg.norm(center, axis=1)
            center = center * (1.0 + (known - radius) / np.maximum(away, 1e-150))[:, None]
            radius = np.where(np.isfinite(radius), known, np.nan)
        size = np.abs(_about(y, center, radius)[1])
        scale = 1.4826 * np.median(size, axis=1) + floor * (1.0 + radius)  # the median of |z| is 1/1.4826
    return Mixture(center, radius, scale, np.full(len(y), 0.2), size)


def mixture(y: Floats, spheres: Floats, floor: Floats, rounds: int = _ROUNDS, known: Floats | None = None) -> Mixture:
    """Spheres among clutter, by maximum likelihood from a first guess.

    Args:
        y: the points (b, d, n), in units of about their size.
        spheres: centres and radii of the first guess (b, d + 1).
        floor: standard deviation of rounding errors, per unit of the radius (b,).
        rounds: most steps.
        known: radii (b,), if they are known.

    Returns:
        The mixtures, not finite where there is no sphere.
    """
    n = y.shape[2]
    thin = np.ascontiguousarray(y[:, :, np.linspace(0, n - 1, _THIN).astype(int)]) if n > _THIN else y
    every = np.ones((len(y), thin.shape[2]), dtype=np.bool_)
    fixed = known is not None
    found = _maximise(thin, _started(thin, spheres, floor, known), every, floor, rounds, fixed)
    return found if n <= _THIN else _maximise(y, found, np.ones((len(y), n), dtype=np.bool_), floor, _LAST, fixed)


def without_isolated(y: Floats, found: Mixture, floor: Floats, fixed: bool = False) -> Mixture:
    """Mixtures of the points (b, d, n) of which isolated ones are clutter; `floor` is that of `mixture`.

    Their radii stay if they are ``fixed``.
    """
    before = np.zeros((len(y), y.shape[2]), dtype=np.bool_)
    for _ in range(_TURNS if y.shape[2] <= _THIN else 1):
        alone = isolated(y, found)
        sets = np.flatnonzero((alone != before).any(axis=1))
        part = Mixture(*(array[sets] for array in found))
        rounds = _ROUNDS if y.shape[2] <= _THIN else _LAST
        for whole, values in zip(
            found, _maximise(y[sets], part, ~alone[sets], floor[sets], rounds, fixed), strict=True
        ):
            whole[sets] = values
        before = alone
    return found


def isolated(y: Floats, found: Mixture) -> Bools:
    """True for points (b, n) far in direction from those that lie on the sphere.

    The third nearest neighbour of a point, among those more likely on the sphere than not, is further away than
    (2 q / q½)^(1/(d - 1)) times the median of the same distance, of its ten nearest neighbours and of all points. Among
    points of an even law the number within a distance is Poisson's. So the area to the third is a Gamma(3) number, of
    median q½ and of quantile q at the level over the number of points, and twice that on the rim.
    """
    result = np.zeros((y.shape[0], y.shape[2]), dtype=np.bool_)
    d = y.shape[1]
    for t in range(len(y)):
        on = found.weights[t] > 0.5
        directions = _about(y[t : t + 1], found.center[t : t + 1], found.radius[t : t + 1])[0][0, :d].T
        some = np.unique(directions[on][:: on.sum() // _THIN + 1], axis=0)
        if len(some) < _AROUND + 2 or not np.isfinite(directions).all():
            continue
        tree = scipy.spatial.cKDTree(some)
        own = tree.query(some, k=_NEIGHBOUR + 1)[0][:, -1]
        most = (2.0 * scipy.special.gammainccinv(_NEIGHBOUR, _LEVEL / len(some)) / _MEDIAN) ** (1.0 / (d - 1))
        near = np.flatnonzero(found.weights[t] > 0.0)
        far = tree.query(directions[near], k=_NEIGHBOUR + 1)[0]
        distance = np.where(far[:, 0] == 0.0, far[:, _NEIGHBOUR], far[:, _NEIGHBOUR - 1])
        alone = np.flatnonzero(distance > most * np.median(own))  # of these alone the neighbours' distances are needed
        far, who = tree.query(directions[near[alone]], k=_AROUND + 1)
        usual = np.median(own[np.where(far[:, :1] == 0.0, who[:, 1:], who[:, :-1])], axis=1)
        result[t, near[alone]] = distance[alone] > most * usual
    return result


def standard_errors(y: Floats, found: Mixture, fixed: bool = False) -> Floats:
    """Standard errors of centre and radius (b, d + 1), which count that points were selected; (b, d) if that is fixed.

    They are those of the sandwich M⁻¹ (Σ ψ² a aᵀ) M⁻¹ with a = (e, 1), ψ = w ρ and M = Σ ψ′ a aᵀ, where each ψ is
    divided by 1 - h, with its leverage h = ψ′ aᵀM⁻¹a: a clutter point at the rim draws the sphere to itself, so its
    residual is small. NaN where M is singular.

    Source: MacKinnon & White 1985 (HC3).
    """
    with np.errstate(all="ignore"):
        a, rho = _about(y, found.center, found.radius)
        a = a[:, :-1] if fixed else a
        z2 = (rho / found.scale[:, None]) ** 2
        slope = found.weights * (1.0 - (1.0 - found.weights) * z2)
        normal = (a * slope[:, None]) @ a.swapaxes(1, 2)
        usable = np.asarray(np.isfinite(normal).all(axis=(1, 2)))
        normal[~usable] = np.eye(a.shape[1])
        inverse = np.linalg.pinv(normal, hermitian=True)
        leverage = np.maximum(slope, 0.0) * np.einsum("bin,bij,bjn->bn", a, inverse, a)
        psi = found.weights * rho / np.maximum(1.0 - leverage, _LEAST_SPARE)
        each = inverse @ (a * psi[:, None])
        return np.asarray(np.where(usable[:, None], np.sqrt((each * each).sum(axis=2)), np.nan))


def white_errors(y: Floats, found: Mixture, kept: Bools, fixed: bool = False) -> Floats:
    """Standard errors as of `standard_errors`, of white noise of the same scale, from the points kept."""
    with np.errstate(all="ignore"):
        a = _about(y, found.center, found.radius)[0] * kept[:, None]
        a = a[:, :-1] if fixed else a
        normal = a @ a.swapaxes(1, 2)
        usable = np.asarray(np.isfinite(normal).all(axis=(1, 2)))
        normal[~usable] = np.nan_to_num(normal[~usable])
        inverse = np.linalg.pinv(normal, hermitian=True)
        return np.asarray(found.scale[:, None] * np.sqrt(np.einsum("bii->bi", inverse)))

"""Several markers about one centre (MGDK): the joint fit of markers at different distances from it.

The centre is that of the corrected equation 22 (`common_center`). As derived, w_p = n_p - 1. But a marker's algebraic
residual grows with its radius, and so its weight should fall: w_p = n_p/r̂_p². Where the noise is not known, one η for
all markers is found from their residuals together (theory §5.5).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from study.estimators.answer.joint_fit import JointFit
from study.estimators.careful_fit import FARTHEST, binary_size, scaled_noise
from study.estimators.common_center import ROUNDS, MarkersMoments, solved
from study.estimators.incremental import Incremental
from study.estimators.status import Status
from study.sphere.bounds import noise_covariance
from study.sphere.linalg import eigenbasis
from study.sphere.moments import Moments
from study.sphere.real_array import real_array
from study.sphere.types import Floats, Ints


def mgdk(markers: Sequence[ArrayLike], noise: ArrayLike | None = None, weighted: bool = True) -> JointFit:
    """Fit spheres with one common centre to several markers, each with a radius of its own (MGDK).

    Args:
        markers: points (n_p, d) of each marker, in one unit and one coordinate system; n_p may differ. Points with a
            NaN, or masked, are missing samples.
        noise: standard deviation σ of each coordinate, in the unit of the points, a covariance Σ (d, d), or None: it
            is then estimated from the points.
        weighted: weigh each marker by 1/r̂². If False, eq. 22 as derived is used, whose errors exceed the reported
            covariance where the radii differ.

    Returns:
        A `JointFit`. Look at its ``status`` before using the numbers: markers that determine no centre have a status,
        and raise nothing.

    Raises:
        TypeError: if the points or the noise are not real numbers.
        ValueError: if there is no marker, or a shape or the noise cannot be used. The message says which and why.

    Source: paper eqs 22-23; the correction is in theory §2, weights and the joint root in §5.5.
    """
    given = tuple(_points(marker, place) for place, marker in enumerate(markers))
    arrays = [array[np.logical_not(np.isnan(array).any(axis=1))] for array in given]
    if not arrays or len({array.shape[1] for array in arrays}) != 1:
        raise ValueError(f"markers of shapes {[a.shape for a in arrays]}: give at least one, all of the same dimension")
    d = arrays[0].shape[1]
    known = None if noise is None else noise_covariance(noise, d)
    if not all(np.isfinite(array).all() for array in arrays):
        return replace(_nothing(d, np.array([len(array) for array in arrays]), Status.NOT_FINITE), markers=given)
    # in a unit of their size, a power of two, if the points are so large or small that their powers leave float64
    power = int(binary_size(np.concatenate(arrays).T[None])[0]) if any(map(len, arrays)) else 0
    if power == 0:
        return replace(_common_center(arrays, known, weighted), markers=given)
    if abs(power) > FARTHEST:
        return replace(_nothing(d, np.array([len(array) for array in arrays]), Status.NOT_FINITE), markers=given)
    unit = [np.ldexp(array, -power) for array in arrays]
    found = _common_center(unit, None if known is None else np.asarray(scaled_noise(known, -power)), weighted)
    return replace(
        found,
        center=np.ldexp(found.center, power),
        radii=np.ldexp(found.radii, power),
        noise_variance=float(np.ldexp(found.noise_variance, 2 * power)),
        covariance=np.ldexp(found.covariance, 2 * power),
        markers=given,
    )


def mgdk_so_far(markers: Sequence[Incremental]) -> JointFit:
    """Fit one centre to several markers that grow, from their moments alone: the points are not stored.

    The answer is that of `mgdk` for the same points. Its covariance takes the spread of the directions from the
    moments, where `mgdk` takes it from the points; ``markers`` of the fit is empty.

    Args:
        markers: at least one, of the same dimension; points of a size between 1e-40 and 1e40.
    """
    moments = [marker.moments for marker in markers]
    count = np.array([0 if m is None else int(m.n[0]) for m in moments])
    used = [m for m in moments if m is not None and m.n[0] >= 2]

    def bound(joint: MarkersMoments, solution: _Solution) -> Floats:
        information = np.einsum("p,pij->ij", solution.weights, joint.c[:, 0] - solution.subtracted)
        return np.asarray(np.linalg.pinv(information, hermitian=True))

    return _fit_moments(_Sets(used, count, markers[0].dimension), None, True, bound)


def _common_center(arrays: list[Floats], known: Floats | None, weighted: bool) -> JointFit:
    """Fit points of ordinary size (n_p, d), none of which is missing, with a covariance Σ of the noise or None."""
    d = arrays[0].shape[1]
    used = [array for array in arrays if len(array) >= 2]  # one sample fixes its marker's radius and no more
    moments = [Moments.of(np.ascontiguousarray(array.T)[None]) for array in used]
    noise = np.eye(d) if known is None else known
    sets = _Sets(moments, np.array([len(array) for array in arrays]), d)
    return _fit_moments(sets, known, weighted, lambda _, solution: _unit_bound(arrays, solution.center, noise))


class _Sets(NamedTuple):
    """The moments of the markers with two samples or more, the number of samples of each marker (M,), and d."""

    moments: list[Moments]
    samples: Ints
    dimension: int


class _Solution(NamedTuple):
    """Centre (d,), what was subtracted from each C (M, d, d), and the weights (M,)."""

    center: Floats
    subtracted: Floats
    weights: Floats


def _fit_moments(
    sets: _Sets, known: Floats | None, weighted: bool, bound: Callable[[MarkersMoments, _Solution], Floats]
) -> JointFit:
    """Fit moments; ``bound`` gives the covariance of the centre for the noise as given, or for noise of size 1."""
    moments, count, d = sets.moments, sets.samples, sets.dimension
    if not moments or sum(int(m.n[0]) for m in moments) < d + len(moments):
        return _nothing(d, count, Status.TOO_FEW_POINTS)
    if not all(np.isfinite(m.fourth[0]) for m in moments):
        return _nothing(d, count, Status.NOT_FINITE)
    joint = MarkersMoments.of(moments)
    n, c = joint.n[:, 0], joint.c[:, 0]
    spread = np.einsum("p,pij->ij", n, c)
    values = np.linalg.eigvalsh(spread)
    if not values[0] > d * np.finfo(float).eps * values[-1]:
        return _nothing(d, count, Status.SINGULAR)
    solution = _solve(joint, known, weighted)
    center, subtracted, weights = solution
    total = np.einsum("p,pij->ij", weights, c)
    share = solved(total, np.einsum("p,pij->ij", weights, subtracted))
    condition = float(np.linalg.eigvals(share).real.max())
    squares = np.full(len(count), np.nan)
    squares[count >= 2] = joint.square_radii(center[None], subtracted[:, None])[:, 0]
    if known is None:
        spare = n.sum() - d - len(moments)
        variance = float(subtracted[0, 0, 0] * n.sum() / spare) if spare > 0 else np.nan
        covariance = variance * bound(joint, solution)
    else:
        variance, covariance = float(np.trace(known)) / d, bound(joint, solution)
    return JointFit(
        center=center,
        radii=np.sqrt(np.where(squares >= 0.0, squares, np.nan)),
        noise_variance=variance,
        status=Status.OK if condition < 1.0 else Status.NOT_POSITIVE_DEFINITE,
        condition=condition,
        covariance=covariance,
        count=count,
    )


def _solve(joint: MarkersMoments, known: Floats | None, weighted: bool) -> _Solution:
    """Solve for the centre of one data set, with the noise as known or found."""
    if known is not None:
        center, weights = joint.known(known, weighted)
        return _Solution(center[0], joint.subtracted(known)[:, 0], weights[:, 0])
    weights, subtracted = joint.n, np.zeros_like(joint.c)
    center = joint.center(subtracted, weights)
    for _ in range(ROUNDS):
        if weighted:
            weights = joint.weights(center)
        subtracted = np.zeros_like(joint.c) + _root(joint, weights[:, 0]) * np.eye(len(center[0]))
        center = joint.center(subtracted, weights)
    return _Solution(center[0], subtracted[:, 0], weights[:, 0])


def _root(joint: MarkersMoments, weights: Floats) -> float:
    """η for which the residuals' variances are those that such noise gives: Σ w (Var f - 4r²η - 2dη²) = 0.

    About the weighted mean of the centroids, with b the right-hand side of eq. 22 and λ_k the extents, that is

        g(η) = Σ w Var |y|² - 4η Σ w mean |y|² + 2dη² - Σ 4b_k²/(λ_k - η),

    written from g(0), which is rounding if there is no noise. Where all of the least extent is not enough, η is
    just above it: the noise hides how far the markers moved, and the fit is not positive definite.
    """
    w, (_, mean, c, s, fourth) = weights / weights.sum(), (part[:, 0] for part in joint)
    away = mean - w @ mean
    moved = np.einsum("pij,pj->pi", c, away)
    extents, vectors = (part[0] for part in eigenbasis(np.einsum("p,pij->ij", w, c)[None]))
    squares = (2.0 * (w @ (moved + 0.5 * s)) @ vectors) ** 2
    m2 = np.trace(c, axis1=1, axis2=2)
    variance = fourth - m2**2 + 4.0 * np.einsum("pi,pi->p", away, s + moved)
    start = float(w @ variance - (squares / extents).sum())
    size = float(w @ (m2 + np.einsum("pi,pi->p", away, away)))

    def excess(eta: float) -> float:
        drawn = float((squares / (extents * (extents - eta))).sum())
        return start - eta * (4.0 * size - 2.0 * len(extents) * eta + drawn)

    from scipy.optimize import brentq  # imported here, as it takes as long as the rest of the library

    if not start > 0.0:
        return 0.0
    high = float(extents[0]) * (1.0 - 1e-12)
    if excess(high) >= 0.0:
        return float(extents[0]) * (1.0 + 1e-9)
    return float(brentq(excess, 0.0, high, xtol=1e-15 * high, rtol=1e-13))


def _unit_bound(arrays: list[Floats], center: Floats, noise: Floats) -> Floats:
    """Cramér-Rao bound of the centre: each marker's radius takes the mean of its directions out of the information."""
    d = len(center)
    information = np.zeros((d, d))
    for array in arrays:
        away = array - center
        distance = np.linalg.norm(away, axis=1)
        u = away[distance > 0.0] / distance[distance > 0.0, None]  # a point at the centre has no direction
        if len(u):
            weights = 1.0 / np.einsum("ni,ij,nj->n", u, noise, u)
            u = u - weights @ u / weights.sum()
            information += np.einsum("n,ni,nj->ij", weights, u, u)
    regular = np.linalg.cond(information) < 1e15
    return np.asarray(np.linalg.inv(information)) if regular else np.full((d, d), np.inf)


def _points(marker: ArrayLike, place: int) -> Floats:
    array = real_array(marker, f"marker {place}: points").astype(float)  # a copy, which the answer keeps
    if array.ndim != 2 or array.shape[1] < 2:
        raise ValueError(f"marker {place} has shape {array.shape}: expected (n, d) with d ≥ 2")
    return array


def _nothing(dimension: int, count: Ints, status: Status) -> JointFit:
    nan = np.full(dimension, np.nan)
    return JointFit(
        nan, np.full(len(count), np.nan), np.nan, status, np.nan, np.full((dimension, dimension), np.nan), count
    )

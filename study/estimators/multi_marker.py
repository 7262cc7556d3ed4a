"""Several markers, one centre (MGDK): markers at different distances from one joint share what they know of it.

    ĉ = [Σ_p w_p (C_p - Σ̂)]⁻¹ Σ_p w_p [(C_p - Σ̂) x̄_p + ½ S_p]                            (paper eq. 22, corrected)

In print the sum closes before ½S_p; both ways of reading it are wrong. With unequal sample counts w_p = n_p - 1, and
with weights 1/r̂_p² the inner markers count for what they are worth: a marker's algebraic residual grows with its
radius. Where the noise is not known, one η for all markers is found from their residuals together (theory §5.5).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from study.estimators.fit import Status
from study.sphere.bounds import noise_covariance
from study.sphere.linalg import eigenbasis
from study.sphere.moments import Moments
from study.sphere.types import Floats, Ints

_ROUNDS = 5


@dataclass(frozen=True)
class JointFit:
    """The common centre of several markers.

    Attributes:
        center: ĉ (d,), in the unit of the points.
        radii: r̂ of each marker (M,); NaN where none is real.
        noise_variance: σ² of one coordinate, as given (the mean, for a covariance) or found.
        status: `Status` of the fit.
        condition: ρ, the share of the least extent of Σ w_p C_p that is noise; it must be below 1.
        covariance: of ĉ (d, d): the Cramér-Rao bound with the estimates plugged in.
        count: samples used of each marker (M,); rows with a NaN are left out.
    """

    center: Floats
    radii: Floats
    noise_variance: float
    status: Status
    condition: float
    covariance: Floats
    count: Ints


def mgdk(markers: Sequence[ArrayLike], noise: ArrayLike | None = None, weighted: bool = True) -> JointFit:
    """Fit one centre to several markers.

    Args:
        markers: points (n_p, d) of each marker, the numbers of samples may differ.
        noise: σ, a covariance Σ (d, d), or None: found in the points.
        weighted: weigh each marker by 1/r̂². Without, eq. 22 as derived, whose errors exceed the reported covariance
            where the radii differ.

    Raises:
        ValueError: if there is no marker, or shapes or the noise cannot be used.

    Source: paper eqs 22-23; correction, weights and the joint root: theory §2, §5.5.
    """
    arrays = [_points(marker, place) for place, marker in enumerate(markers)]
    if not arrays or len({array.shape[1] for array in arrays}) != 1:
        raise ValueError(f"markers of shapes {[a.shape for a in arrays]}: give at least one, all of the same dimension")
    d = arrays[0].shape[1]
    known = None if noise is None else noise_covariance(noise, d)
    count = np.array([len(array) for array in arrays])
    used = [array for array in arrays if len(array) >= 2]  # one sample fixes its marker's radius and no more
    if not used or sum(map(len, used)) < d + len(used):
        return _nothing(d, count, Status.TOO_FEW_POINTS)
    moments = [Moments.of(np.ascontiguousarray(array.T)[None]) for array in used]
    if not all(np.isfinite(m.fourth[0]) for m in moments):
        return _nothing(d, count, Status.NOT_FINITE)
    joint = _Joint(moments, d)
    spread = np.einsum("p,pij->ij", joint.n, joint.c)
    values = np.linalg.eigvalsh(spread)
    if not values[0] > d * np.finfo(float).eps * values[-1]:
        return _nothing(d, count, Status.SINGULAR)
    center, subtracted, weights = joint.solve(known, weighted)
    total = np.einsum("p,pij->ij", weights, joint.c)
    share = _solved(total, np.einsum("p,pij->ij", weights, subtracted))
    condition = float(np.linalg.eigvals(share).real.max())
    squares = np.full(len(arrays), np.nan)
    squares[count >= 2] = joint.square_radii(center, subtracted)
    if known is None:
        spare = joint.n.sum() - d - len(used)
        variance = float(subtracted[0, 0, 0] * joint.n.sum() / spare) if spare > 0 else np.nan
        covariance = variance * _unit_bound(arrays, center, np.eye(d))
    else:
        variance, covariance = float(np.trace(known)) / d, _unit_bound(arrays, center, known)
    return JointFit(
        center=center,
        radii=np.sqrt(np.where(squares >= 0.0, squares, np.nan)),
        noise_variance=variance,
        status=Status.OK if condition < 1.0 else Status.NOT_POSITIVE_DEFINITE,
        condition=condition,
        covariance=covariance,
        count=count,
    )


class _Joint:
    """The markers' moments, stacked, in weights of 1/n."""

    def __init__(self, moments: Sequence[Moments], dimension: int) -> None:
        self.d = dimension
        self.n = np.array([m.count[0] for m in moments])
        self.mean = np.array([m.mean[0] for m in moments])
        self.c = np.array([m.second[0] for m in moments]) / self.n[:, None, None]
        self.s = np.array([m.third[0] for m in moments]) / self.n[:, None]
        self.fourth = np.array([m.fourth[0] for m in moments]) / self.n

    def solve(self, known: Floats | None, weighted: bool) -> tuple[Floats, Floats, Floats]:
        """Centre (d,), what was subtracted from each C (M, d, d), and the weights (M,)."""
        weights, none = self.n, np.zeros_like(self.c)
        subtracted = none if known is None else known * ((self.n - 1.0) / self.n)[:, None, None]
        center = self.center(subtracted, weights)
        for _ in range(_ROUNDS):
            if weighted:
                weights = self.n / np.maximum(self.square_radii(center, none), 1e-300)
            if known is None:
                subtracted = none + self.root(weights) * np.eye(self.d)
            center = self.center(subtracted, weights)
        return center, subtracted, weights

    def center(self, subtracted: Floats, weights: Floats) -> Floats:
        """Eq. 22, corrected, about the mean of the markers' centroids."""
        left = self.c - subtracted
        origin = self.mean.mean(axis=0)
        right = np.einsum("pij,pj->pi", left, self.mean - origin) + 0.5 * self.s
        matrix = np.einsum("p,pij->ij", weights, left)
        return np.asarray(origin + _solved(matrix, np.einsum("p,pi->i", weights, right)))

    def square_radii(self, center: Floats, subtracted: Floats) -> Floats:
        """Eq. 23, squared."""
        away = self.mean - center
        return np.asarray(np.trace(self.c - subtracted, axis1=1, axis2=2) + np.einsum("pi,pi->p", away, away))

    def root(self, weights: Floats) -> float:
        """η for which the residuals' variances equal what that noise gives: Σ w (Var f - 4r²η - 2dη²) = 0.

        About the weighted mean of the centroids, with b the right-hand side of eq. 22 and λ_k the extents, that is

            g(η) = Σ w Var |y|² - 4η Σ w mean |y|² + 2dη² - Σ 4b_k²/(λ_k - η),

        written from g(0), which is rounding if there is no noise. Where all of the least extent is not enough, η is
        just above it: the noise hides how far the markers moved, and the fit is not positive definite.
        """
        w = weights / weights.sum()
        away = self.mean - w @ self.mean
        moved = np.einsum("pij,pj->pi", self.c, away)
        extents, vectors = (part[0] for part in eigenbasis(np.einsum("p,pij->ij", w, self.c)[None]))
        squares = (2.0 * (w @ (moved + 0.5 * self.s)) @ vectors) ** 2
        m2 = np.trace(self.c, axis1=1, axis2=2)
        variance = self.fourth - m2**2 + 4.0 * np.einsum("pi,pi->p", away, self.s + moved)
        start = float(w @ variance - (squares / extents).sum())
        size = float(w @ (m2 + np.einsum("pi,pi->p", away, away)))

        def excess(eta: float) -> float:
            drawn = float((squares / (extents * (extents - eta))).sum())
            return start - eta * (4.0 * size - 2.0 * self.d * eta + drawn)

        if not start > 0.0:
            return 0.0
        high = float(extents[0]) * (1.0 - 1e-12)
        if excess(high) >= 0.0:
            return float(extents[0]) * (1.0 + 1e-9)
        return float(brentq(excess, 0.0, high, xtol=1e-15 * high, rtol=1e-13))


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Solution of a linear system (d, d), the least one if the matrix is singular to the last bit."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix) @ right)


def _unit_bound(arrays: list[Floats], center: Floats, noise: Floats) -> Floats:
    """Cramér-Rao bound of the centre: each marker's radius takes the mean of its directions out of the information."""
    d = len(center)
    information = np.zeros((d, d))
    for array in arrays:
        if len(array):
            u = array - center
            u /= np.linalg.norm(u, axis=1, keepdims=True)
            weights = 1.0 / np.einsum("ni,ij,nj->n", u, noise, u)
            u = u - weights @ u / weights.sum()
            information += np.einsum("n,ni,nj->ij", weights, u, u)
    regular = np.linalg.cond(information) < 1e15
    return np.asarray(np.linalg.inv(information)) if regular else np.full((d, d), np.inf)


def _points(marker: ArrayLike, place: int) -> Floats:
    array = np.asarray(marker, dtype=float)
    if array.ndim != 2 or array.shape[1] < 2:
        raise ValueError(f"marker {place} has shape {array.shape}: expected (n, d) with d ≥ 2")
    return np.asarray(array[np.logical_not(np.isnan(array).any(axis=1))])


def _nothing(dimension: int, count: Ints, status: Status) -> JointFit:
    nan = np.full(dimension, np.nan)
    return JointFit(
        nan, np.full(len(count), np.nan), np.nan, status, np.nan, np.full((dimension, dimension), np.nan), count
    )

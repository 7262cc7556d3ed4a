"""Minimum-zone sphere: the one whose largest distance from a point is least (Chebyshev's fit of a sphere).

At the answer d + 2 points have the largest |R - r| = t, some outside and some inside, and their directions e, with the
sign s of R - r, have multipliers μ > 0 with Σ μ s (e, 1) = 0, Σ μ = 1: no small change of the sphere brings all of
them nearer. These are the conditions of a linear programme, the problem linearised at the answer.

Each step solves that programme for the points that matter, those near the largest distance, in a trust region that
shrinks where the true width does not fall. In the end Newton's method solves R - r = s t for the d + 2 points.

A form error also moves a fit. `forms_that_move` says how large one of low degree need be.
"""

from __future__ import annotations

from math import factorial, prod
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from study.arrays import Bools, Floats, Ints, real_array
from study.fits.estimators.closed_forms import taubin
from study.fits.evidence.goodness import columns, harmonics
from study.fits.points.samples import Samples
from study.words import Hinting

FORM_DEGREES = (2, 3)
"""Degrees of the forms whose effect on a fit is told: 2 makes an ellipsoid, 3 a pear."""
_MOST_STEPS = 200
_TINY = 1e-13
"""Share of the radius below which a zone's width is rounding, and a step none."""
_FEWEST = 64
"""Points of the first linear programme, those of the largest residuals; more enter where it leaves them outside."""
_FALL = 0.05
"""Least share of the predicted fall of the width for which a step counts as good."""
_FAR = 1e8
"""Radius, in units of the points' extent, beyond which a sphere is a plane."""


class MinimumZone(NamedTuple):
    """Minimum-zone spheres of point sets, with their leading axes `…`.

    Attributes:
        center: common centre of the two spheres (…, d), in the unit of the points.
        radius: mean of their radii (…), in the unit of the points.
        width: their distance (…), in the unit of the points: the form error (sphericity, roundness for d = 2).
        optimal: True (…) where d + 2 points prove that no sphere near it has a narrower zone; False where the points
            determine none, with NaN, or where the zone narrows towards a plane or is as narrow as rounding.

    Examples:
        >>> import study
        >>> zone = study.minimum_zone([[1.1, 0], [0, 0.9], [-1.1, 0], [0, -0.9]])
        >>> bool(zone.optimal), round(float(zone.width), 6)
        (True, 0.2)
    """

    center: Floats
    radius: Floats
    width: Floats
    optimal: Bools


if not TYPE_CHECKING:  # a named tuple has no other base
    MinimumZone.__getattr__ = Hinting.__getattr__


def minimum_zone(points: ArrayLike) -> MinimumZone:
    """Minimum-zone sphere: midway between the two closest concentric spheres that hold all points between them.

    Unlike a least-squares fit it depends on the extreme points alone: a description of form (ISO 12180, ISO 12181),
    not an estimate of a true sphere. The minimum is the one reached from Taubin's fit, which is the global one unless
    the width is a large share of the radius.

    Args:
        points: coordinates (…, n, d) of n ≥ d + 1 points in d ≥ 2 dimensions; points with a NaN, or masked, are left
            out.

    Raises:
        TypeError: if the points are not real numbers.
        ValueError: if the shape is another.

    Examples:
        >>> import study
        >>> zone = study.minimum_zone([[1.1, 0], [0, 0.9], [-1.1, 0], [0, -0.9]])
        >>> round(float(zone.radius), 6), abs(zone.center).round(6)
        (1.0, array([0., 0.]))

    Source: Anthony, Anthony, Bittner et al., Reference algorithms for Chebyshev and one-sided data fitting, Numer.
    Algorithms 1996.
    """
    array = real_array(points, "points").astype(float, copy=False)
    if array.ndim < 2 or array.shape[-1] < 2 or array.shape[-2] < array.shape[-1] + 1:
        raise ValueError(f"points have shape {array.shape}: expected (…, n, d) with d ≥ 2 and n ≥ d + 1")
    *lead, n, d = array.shape
    flat = array.reshape(-1, n, d)
    spheres, optimal = np.full((len(flat), d + 2), np.nan), np.zeros(len(flat), dtype=np.bool_)
    for t, one in enumerate(flat):
        present = one[~np.isnan(one).any(axis=1)]
        if len(present) > d and np.isfinite(present).all():
            spheres[t], optimal[t] = _of_one(present)
    center, radius, width = spheres[:, :d].reshape(*lead, d), spheres[:, d], spheres[:, d + 1]
    return MinimumZone(center, radius.reshape(lead), width.reshape(lead), optimal.reshape(lead))


def _of_one(x: Floats) -> tuple[Floats, bool]:
    """Centre, radius and width (d + 2,) of the minimum zone of points (n, d), and True if it is proven."""
    d = x.shape[1]
    with np.errstate(all="ignore"):
        origin = x.mean(axis=0)
        unit = float(np.abs(x - origin).max())
    lost = np.full(d + 2, np.nan)
    if not 0.0 < unit < np.inf:
        return lost, False
    y = (x - origin) / unit
    start = taubin(Samples(np.ascontiguousarray(y.T)[None]))
    center = start.center[0]
    if not np.isfinite(center).all():
        return lost, False
    center, optimal = _descend(y, center)
    distance = np.linalg.norm(y - center, axis=1)
    low, high = distance.min(), distance.max()
    return np.array([*(origin + unit * center), unit * 0.5 * (low + high), unit * (high - low)]), optimal


def _descend(y: Floats, center: Floats) -> tuple[Floats, bool]:
    """The best centre reached from one, and True if it is proven."""
    reach = np.inf
    for _ in range(_MOST_STEPS):
        away = y - center
        distance = np.linalg.norm(away, axis=1)
        low, high = float(distance.min()), float(distance.max())
        width = high - low
        if not low > 0.0 or high > _FAR or width <= _TINY * high:
            return center, False
        step, predicted, active = _programme(away / distance[:, None], distance, min(reach, 0.5 * high))
        signs = np.sign(distance[active] - 0.5 * (low + high))
        vertex = _vertex(y[active], signs, center) if len(active) == y.shape[1] + 2 else None
        if vertex is not None:
            reached = np.linalg.norm(y - vertex, axis=1)
            if np.ptp(reached) <= width * (1.0 + 1e-9) and _proven(y, active, signs, vertex):
                return vertex, True
        trial = np.linalg.norm(y - (center + step), axis=1)
        fall = width - float(np.ptp(trial))
        if fall > _FALL * (width - predicted):
            center = center + step
            reach = max(reach, 4.0 * float(np.abs(step).max())) if np.isfinite(reach) else reach
        else:
            reach = 0.25 * float(np.abs(step).max())
        if reach < _TINY * high or not np.abs(step).max() > _TINY * high:
            return center, False
    return center, False


def _programme(e: Floats, distance: Floats, reach: float) -> tuple[Floats, float, Ints]:
    """Minimise the largest |R - e·step - r|, linearised, with no component of the step longer than ``reach``.

    Returns:
        The step (d,), the width that it predicts, and the points with a multiplier.
    """
    from scipy.optimize import linprog

    d = e.shape[1]
    middle = 0.5 * (distance.min() + distance.max())
    half = distance.max() - middle
    residual = (distance - middle) / half  # HiGHS takes 1e-7 for nothing: in units of the zone it is
    taken = np.argsort(-np.abs(residual), kind="stable")[:_FEWEST]
    bound = reach / half
    while True:
        rows, right = e[taken], residual[taken]
        ones = np.ones((len(taken), 1))
        matrix = np.block([[-rows, -ones, -ones], [rows, ones, -ones]])
        bounds = [(-bound, bound)] * d + [(None, None), (0.0, None)]
        cost = np.zeros(d + 2)
        cost[-1] = 1.0
        solution = linprog(cost, matrix, np.concatenate([-right, right]), bounds=bounds, method="highs")
        if solution.status != 0:
            return np.zeros(d), 2.0 * half, np.empty(0, dtype=np.int64)
        left = np.abs(residual - e @ solution.x[:d] - solution.x[d])
        worst = np.argsort(-left, kind="stable")[:_FEWEST]
        beyond = np.setdiff1d(worst[left[worst] > solution.x[-1] + 1e-7], taken)
        if not len(beyond):
            break
        taken = np.concatenate([taken, beyond])
    multipliers = -solution.ineqlin.marginals.reshape(2, -1).sum(axis=0)
    return half * solution.x[:d], 2.0 * half * float(solution.x[-1]), taken[multipliers > 1e-9]


def _vertex(y: Floats, signs: Floats, center: Floats) -> Floats | None:
    """The centre with R - r = s t at d + 2 points (d + 2, d), by Newton's method; None if it does not converge."""
    k, d = y.shape
    center = center.copy()
    for _ in range(50):
        away = y - center
        distance = np.linalg.norm(away, axis=1)
        system = np.column_stack([-away / distance[:, None], -np.ones(k), -signs])
        try:
            step = np.linalg.solve(system, -distance)[:d]  # r and t enter linearly
        except np.linalg.LinAlgError:
            return None
        center += step
        if not np.isfinite(center).all() or np.abs(center).max() > _FAR:
            return None
        if np.abs(step).max() <= 4.0 * np.finfo(float).eps * (1.0 + distance.max()):
            return center
    return None


def _proven(y: Floats, active: Ints, signs: Floats, center: Floats) -> bool:
    """True if all points lie in the zone of the d + 2 active ones, whose multipliers are all positive."""
    distance = np.linalg.norm(y - center, axis=1)
    e = (y[active] - center) / distance[active, None]
    system = np.column_stack([signs[:, None] * e, signs, np.ones(len(active))]).T
    try:
        multipliers = np.linalg.solve(system, np.eye(len(active))[-1])
    except np.linalg.LinAlgError:
        return False
    outer, inner = distance[active][signs > 0], distance[active][signs < 0]
    if not (len(outer) and len(inner)):
        return False
    rounding = 1e-13 * distance.max()
    inside = (distance <= outer.max() + rounding) & (distance >= inner.min() - rounding)
    return bool(inside.all() and (multipliers > 0.0).all() and outer.max() > inner.min())


def forms_that_move(directions: Floats, weights: Floats, errors: Floats, held: Floats) -> Floats:
    """Size of the forms that move the centre's coordinates and the radius by their errors (b, 2, d + 1).

    A form is r + f(e) with a harmonic f of degree 2, or 3. With rows X = (e, 1) a least-squares fit moves by
    (XWXᵀ + H)⁻¹XW f to first order, linear in the coefficients of f. So of all forms of one size, which is the root
    mean square of f over the whole sphere, the worst moves a number by the length of that row.

    Args:
        directions: e of the points (b, d, n).
        weights: of the points, of mean 1 over those that are used, and 0 for others (b, n).
        errors: standard errors (b, d + 1).
        held: H, the noise variance over the squared uncertainty of a radius that is known (b,); infinite where it is
            exact, 0 where nothing is known of it.
    """
    d = directions.shape[1]
    basis, (pull, e, fine, exact, _) = harmonics(d, max(FORM_DEGREES)), _pull(directions, weights, held)
    Y, result = columns(e, basis), np.full((len(e), len(FORM_DEGREES), d + 1), np.nan)
    with np.errstate(all="ignore"):
        for row, degree in enumerate(FORM_DEGREES):
            mean_square = factorial(degree) / prod(d + 2 * k for k in range(degree))  # of the basis, over the sphere
            moved = pull @ Y[:, basis.degree == degree].swapaxes(1, 2)
            size = errors * np.sqrt(mean_square) / np.linalg.norm(moved, axis=2)
            result[fine, row] = size[fine]
    result[exact, :, d] = np.inf
    return result


def moves_of_forms(directions: Floats, weights: Floats, held: Floats) -> Floats:
    """Moves of the centre's coordinates and the radius (b, d + 1) by forms of degree 2 whose residuals are of size 1.

    The size is the root mean square at the points of what the sphere beside the form leaves of it. Moves are root mean
    squares over all forms of degree 2; 0 for a radius that is exact. For the arguments see `forms_that_move`.
    """
    basis, (pull, e, fine, _, X) = harmonics(directions.shape[1], 2), _pull(directions, weights, held)
    Y = columns(e, basis)[:, basis.degree == 2]
    moved, left = pull @ Y.swapaxes(1, 2), Y * weights[:, None]
    with np.errstate(all="ignore"):
        square = np.einsum("bkn,bkn->b", Y, left) - np.einsum("bik,bkn,bin->b", moved, left, X)
        result = np.linalg.norm(moved, axis=2) / np.sqrt(square / weights.sum(axis=1))[:, None]
    result[~fine] = np.nan
    return np.asarray(result)


def _pull(directions: Floats, weights: Floats, held: Floats) -> tuple[Floats, Floats, Bools, Bools, Floats]:
    """The matrix that takes a form at the points to the moves of (c, r) (b, d + 1, n), and what it is made of.

    These are the directions, 0 where a weight is 0; True where a sphere is determined; True where the radius is exact;
    and the rows X = (e, 1), without the last where it is.
    """
    d = directions.shape[1]
    e = np.where(weights[:, None] > 0.0, directions, 0.0)
    X, exact = np.concatenate([e, np.ones_like(e[:, :1])], axis=1), np.isinf(held)
    X[exact, d] = 0.0
    normal = (X * weights[:, None]) @ X.swapaxes(1, 2)
    normal[:, d, d] += np.where(exact, 1.0, held)
    fine = np.isfinite(normal).all(axis=(1, 2)) & (weights.sum(axis=1) > d)
    normal[~fine] = np.eye(d + 1)
    return np.linalg.pinv(normal, hermitian=True) @ (X * weights[:, None]), e, fine, exact, X

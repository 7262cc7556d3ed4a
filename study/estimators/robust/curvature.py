"""Effects of the sphere's curvature where the noise is not small beside it: on the law of R, and on a fit's freedom."""

import math

import numpy as np

from study.estimators.geometric.newton import half_hessian
from study.estimators.robust.concentration import search_room
from study.estimators.robust.weighted_sums import scatter_directions, weighted_pass
from study.sphere.jit import compiled, dot, fill
from study.sphere.linalg import cholesky_solve
from study.sphere.types import Floats

_WITHOUT_RADIUS = 0.534
"""d Var R/(E R)² of points that scatter about one place: (Var R)/(E R)² is at most this over d."""
_POWER = 0.31
"""There R to the power 1 less this is nearly normal in its upper tail."""
_LITTLE = 1e-4
"""Var R/(E R)² below which R is normal."""


@compiled
def extra_parameters(y: Floats, centers: Floats, radii: Floats, extra: Floats) -> None:
    """Parameters that curvature adds to the d + 1 of a sphere, of geometric fits of the sets (b, d, n).

    It is Tr H⁻¹K - d (b,) with K = Σ(e - ē)(e - ē)ᵀ and H half the Hessian of Σ(R - r)², held between 0 and d; d
    where the fit is no minimum.

    Source: Moody 1992; theory 11.3.
    """
    b, d, n = y.shape
    work, sums, matrix = search_room(d, n), np.empty(2 + 2 * d + d * d), np.empty((d, d))
    sphere, column, solved, factor = np.empty(d + 1), np.empty(d), np.empty(d), work.matrices[0]
    fill(work.weight, 1.0)
    for t in range(b):
        for i in range(d):
            sphere[i] = centers[t, i]
        sphere[d] = radii[t]
        weighted_pass(y[t], work.weight, centers[t], radii[t], work.rows, sums)
        fine, trace = scatter_directions(y[t], sphere, work), 0.0
        for j in range(d):
            half_hessian(n, radii[t], sums[2 + d : 2 + 2 * d], sums[2 + 2 * d :], matrix)
            for i in range(d):
                column[i] = solved[i] = factor[i, j] if i >= j else 0.0
            fine = fine and cholesky_solve(matrix, solved)
            trace += dot(column, solved)
        extra[t] = min(max(trace - d, 0.0), 1.0 * d) if fine else 1.0 * d


@compiled
def as_rare(z: float, share: float, d: int) -> float:
    """Value of (R - E R)/√(Var R) that is as rare as z is for a normal number.

    With ``share`` = Var R/(E R)², R to a power below 1 is nearly normal in its upper tail: the value is right to 4 %
    for z of 3 to 5 and every radius and noise. In the lower tail, which ends at R = 0, the value is further away than
    it should be.

    Source: theory 11.3.
    """
    if share < _LITTLE:
        return z
    most = _WITHOUT_RADIUS / d
    share = min(share, most)
    linear = (d - 1.0) / 3.0
    power = 1.0 - linear * share - (_POWER - linear * most) * (share / most) ** 4
    moved = 1.0 - 0.5 * power * (1.0 - power) * share + power * math.sqrt(share) * z
    return float((max(moved, 0.0) ** (1.0 / power) - 1.0) / math.sqrt(share))

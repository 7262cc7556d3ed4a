"""Linear least squares as textbooks and programs of the paper's time had it, to explain the paper's LLS outliers.

The paper's LLS came from Numerical Recipes, whose least-squares routine zeroes singular values below a tolerance
times the largest - 1e-5 in the routine, 1e-6 in the book's text. On a small cap the smallest singular value carries
the centre's distance; cutting it puts the answer on the sphere or half way to it (theory §4): `lls_nr`, `lls_nr_raw`.

A program in C of the time might have used single precision. Sums of third powers leave its range, 3.4e38, where the
points are some 1e12 units apart, so that outliers at the largest noise need not be a flaw of the method: `lls_single`.

These are for the study of the paper; on data use `lls`.
"""

import numpy as np

from study.estimators.estimates import Estimates, blank
from study.estimators.kasa import residual_noise
from study.estimators.samples import Samples
from study.estimators.status import Status
from study.sphere.types import Bools, Floats


def lls_nr(samples: Samples) -> Estimates:
    """Centred design, singular values cut below 1e-5 of the largest: where it cuts, the answer lies on the sphere.

    Source: paper §4.4; Press et al. 1992, §15.4.
    """
    return _cut(samples, 1e-5, samples.moments.mean)


def lls_nr_raw(samples: Samples) -> Estimates:
    """Design in the coordinates as they are given, singular values cut below 1e-6 of the largest.

    Source: paper §4.4; Press et al. 1992, §2.6.
    """
    return _cut(samples, 1e-6, np.zeros_like(samples.moments.mean))


def lls_single(samples: Samples) -> Estimates:
    """Normal equations of |y|² = β₀ + βᵀy for the centred points y, in single precision throughout.

    The points are centred in double precision, so that a distant origin, which normal equations do not forgive
    either, plays no part. Where a sum overflows the status is not finite. In single precision a cap below a tenth of a
    degree is a plane.

    Source: paper §4.4; Press et al. 1992, §15.4.
    """
    b, d, n = samples.shape
    fit = blank(b, d)
    with np.errstate(all="ignore"):  # sets that overflow, or span no volume, have a status of their own
        y = (samples.x - samples.moments.mean[:, :, None]).astype(np.float32, order="C")  # one order of adding
        square = np.einsum("bin,bin->bn", y, y)
        matrix, right = np.empty((b, d + 1, d + 1), dtype=np.float32), np.empty((b, d + 1), dtype=np.float32)
        matrix[:, :d, :d] = np.einsum("bin,bjn->bij", y, y)
        matrix[:, :d, d] = matrix[:, d, :d] = y.sum(axis=2)
        matrix[:, d, d] = n
        right[:, :d], right[:, d] = np.einsum("bin,bn->bi", y, square), square.sum(axis=1)
        finite = np.asarray(np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=1))
        extent = np.linalg.eigvalsh(np.where(finite[:, None, None], matrix[:, :d, :d], np.float32(0.0)))
        regular = np.asarray(extent[:, 0] > d * np.finfo(np.float32).eps * extent[:, -1])
        beta = np.linalg.solve(
            np.where(regular[:, None, None], matrix, np.eye(d + 1, dtype=np.float32)), right[..., None]
        )
        offset = 0.5 * beta[:, :d, 0].astype(float)
        squared = beta[:, d, 0] + np.einsum("bi,bi->b", offset, offset)
        fit.radius[:] = np.sqrt(np.where(squared >= 0.0, squared, np.nan))
    fit.center[:] = samples.moments.mean + offset
    fit.noise_variance[:] = residual_noise(samples.regression, offset)
    fit.status[~regular] = Status.SINGULAR
    return _without(fit, ~(finite & regular), finite)


def _cut(samples: Samples, tolerance: float, origin: Floats) -> Estimates:
    """Least-norm solution of the system |x|² = (x, 1) β with the small singular values left out."""
    b, d, n = samples.shape
    fit = blank(b, d)
    finite = np.isfinite(samples.moments.fourth)
    with np.errstate(all="ignore"):
        x = np.where(finite[:, None, None], samples.points - origin[:, None, :], 0.0)
        design = np.concatenate([x, np.ones((b, n, 1))], axis=2)
        left, values, right = np.linalg.svd(design, full_matrices=False)
        inverse = np.where(values > tolerance * values[:, :1], 1.0 / values, 0.0)
        square = np.einsum("bnd,bnd->bn", x, x)
        beta = np.einsum("bkj,bk->bj", right, inverse * np.einsum("bnk,bn->bk", left, square))
        offset = 0.5 * beta[:, :d]
        squared = beta[:, d] + np.einsum("bi,bi->b", offset, offset)
        fit.radius[:] = np.sqrt(np.where(squared >= 0.0, squared, np.nan))
        fit.center[:] = origin + offset
        fit.noise_variance[:] = residual_noise(samples.regression, fit.center - samples.moments.mean)
    return _without(fit, ~finite, finite)


def _without(fit: Estimates, lost: Bools, finite: Bools) -> Estimates:
    """Remove the numbers of lost fits, and give those of points that are not finite their status."""
    fit.status[~finite] = Status.NOT_FINITE
    fit.center[lost], fit.radius[lost], fit.noise_variance[lost] = np.nan, np.nan, np.nan
    return fit

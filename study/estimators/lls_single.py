"""Linear least squares by normal equations in single precision, as a program in C of the time would have had it.

Sums of third powers leave the range of single precision, 3.4e38, where the points are some 1e12 units apart: so the
paper's LLS outliers at the largest noise can be told from a flaw of the method. The points are centred beforehand in
double precision, so that a distant origin, which normal equations do not forgive either, is not part of what shows.
For use on data take `lls`.
"""

import numpy as np

from study.estimators.fit import Fit, Samples, Status, blank
from study.estimators.kasa import residual_noise


def lls_single(samples: Samples) -> Fit:
    """Normal equations of |y|² = β₀ + βᵀy for the centred points y, in single precision throughout.

    Where a sum overflows the status is not finite. A cap below a tenth of a degree single precision takes for a plane.

    Source: paper §4.4; Press et al. 1992, §15.4.
    """
    b, d, n = samples.shape
    fit = blank(b, d)
    with np.errstate(all="ignore"):  # what overflows, or spans no volume, has a status of its own
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
    fit.status[~finite] = Status.NOT_FINITE
    lost = ~(finite & regular)
    fit.center[lost], fit.radius[lost], fit.noise_variance[lost] = np.nan, np.nan, np.nan
    return fit

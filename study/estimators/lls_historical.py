"""Linear least squares as textbooks of the time had it: singular values below a share of the largest are cut.

The paper's LLS came from Numerical Recipes, whose least-squares routine zeroes singular values below a tolerance
times the largest - 1e-5 in the routine, 1e-6 in the book's text. On a small cap the smallest singular value carries
the centre's distance; cutting it puts the answer on the sphere or half way to it. Here so that the paper's LLS
outliers can be traced to the cut; for use on data take `lls`.
"""

import numpy as np

from study.estimators.fit import Fit, Samples, Status, blank
from study.estimators.kasa import residual_noise
from study.sphere.types import Floats


def lls_nr(samples: Samples) -> Fit:
    """Centred design, singular values cut below 1e-5 of the largest: where it cuts, the answer lies on the sphere.

    Source: paper §4.4; Press et al. 1992, §15.4.
    """
    return _cut(samples, 1e-5, samples.moments.mean)


def lls_nr_raw(samples: Samples) -> Fit:
    """Design in the coordinates as they come, singular values cut below 1e-6 of the largest.

    Source: paper §4.4; Press et al. 1992, §2.6.
    """
    return _cut(samples, 1e-6, np.zeros_like(samples.moments.mean))


def _cut(samples: Samples, tolerance: float, origin: Floats) -> Fit:
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
    fit.status[~finite] = Status.NOT_FINITE
    fit.center[~finite], fit.radius[~finite], fit.noise_variance[~finite] = np.nan, np.nan, np.nan
    return fit

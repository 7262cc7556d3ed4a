"""The registry of estimators, and `fit`, which calls one by name.

To add an estimator, write a function from `Samples` to `Estimates` and a line in `ESTIMATORS`.
"""

from functools import partial
from typing import Never

import numpy as np
from numpy.typing import ArrayLike

from study.estimators.algebraic import als, fuller, hinge, hyper, pratt, taubin
from study.estimators.answer.fit import Fit
from study.estimators.careful_fit import careful_fit, is_ordinary
from study.estimators.estimates import Estimates
from study.estimators.estimator import Estimator
from study.estimators.geometric.corrected import corrected, corrected_01, corrected_02, corrected_12
from study.estimators.geometric.mle import mle, mle_centroid, mle_mirror
from study.estimators.geometric.sandwich import corrected_covariance, sandwich
from study.estimators.incremental import igdk
from study.estimators.kasa import gdke, ugdk
from study.estimators.lls import lls
from study.estimators.lls_historical import lls_nr, lls_nr_raw, lls_single
from study.estimators.robust.robust import robust
from study.estimators.samples import Samples
from study.estimators.unknown_covariance import ugdk_cov
from study.sphere.bounds import noise_covariance
from study.sphere.real_array import real_array
from study.text.nearest import did_you_mean


def _moments(d: int) -> float:
    """FLOPs per sample of the centred moments, which every closed form starts from (the paper's count: d² + 6d - 1)."""
    return d * d + 8 * d + 2


_BIASED = "biased towards the points by the noise, which its standard errors do not include; als has no such bias"

ESTIMATORS: dict[str, Estimator] = {
    "mle": Estimator(
        mle, "paper §4.3; Shakarji 1998", flops=lambda d: d * d + 10 * d + 6, flops_of="a pass", by_window=True
    ),
    "mle_centroid": Estimator(mle_centroid, "mle from another start, the centroid of the points", by_window=True),
    "mle_mirror": Estimator(mle_mirror, "mle from a wrong start, beyond the points", by_window=True),
    "corrected": Estimator(
        corrected,
        "theory §9: geometric, without its bias, for every law of directions",
        by_window=True,
        covariance=corrected_covariance,
    ),
    "corrected_01": Estimator(
        corrected_01, "theory §9, with ν = 0", by_window=True, covariance=partial(sandwich, pair=0.0)
    ),
    "corrected_02": Estimator(
        corrected_02, "theory §9, with ν = ½", by_window=True, covariance=partial(sandwich, pair=0.5)
    ),
    "corrected_12": Estimator(
        corrected_12, "theory §9, with ν = 1", by_window=True, covariance=partial(sandwich, pair=1.0)
    ),
    "robust": Estimator(
        robust,
        "Rousseeuw & Van Driessen 2006; Hadi & Simonoff 1993: mle without the outliers",
        without_outliers=True,
        version=2,
    ),
    "lls": Estimator(
        lls, "paper §4.4", flops=lambda d: 2 * d * d + 10 * d + 5, caution=_BIASED, by_window=True, version=2
    ),
    "lls_nr": Estimator(lls_nr, "paper §4.4; Press et al. 1992: centred, singular values cut at 1e-5", caution=_BIASED),
    "lls_nr_raw": Estimator(lls_nr_raw, "paper §4.4; Press et al. 1992: not centred, cut at 1e-6", caution=_BIASED),
    "lls_single": Estimator(lls_single, "lls by normal equations in single precision", caution=_BIASED),
    "gdke": Estimator(gdke, "paper eqs 2-6; Kåsa 1976", flops=_moments, moments_suffice=True, caution=_BIASED),
    "ugdk": Estimator(ugdk, "paper eqs 15-21", needs="noise", flops=_moments, moments_suffice=True),
    "als": Estimator(als, "Kukush, Markovsky & Van Huffel 2004", flops=_moments, moments_suffice=True),
    "fuller": Estimator(fuller, "Fuller 1987, for als", flops=_moments, moments_suffice=True),
    "hinge": Estimator(hinge, "als, without directions of insignificant extent", flops=_moments, moments_suffice=True),
    "taubin": Estimator(taubin, "Taubin 1991", flops=_moments, moments_suffice=True),
    "pratt": Estimator(pratt, "Pratt 1987", flops=_moments, moments_suffice=True),
    "hyper": Estimator(hyper, "Al-Sharadqah & Chernov 2009", flops=_moments, moments_suffice=True),
    "ugdk_cov": Estimator(ugdk_cov, "the paper's open question: the whole covariance from the points"),
    "igdk": Estimator(igdk, "paper eqs 24-25", flops=lambda d: 7 * d * d + 20 * d + 3, caution=_BIASED),
}


_MOST_COPIED = 100_000
"""Number of coordinates that a fit copies by default: beyond, copying takes longer than a closed form."""


_INSTEAD = {
    "sigma": "give noise=, the standard deviation of a coordinate",
    "weight": "all points count the same; a point is left out as NaN, outliers by the estimator 'robust', and noise= "
    "takes a covariance (d, d) where coordinates differ",
    "radius": "the radius is always fitted; compare a known one with fit.interval('radius')",
}
"""The answer to arguments that other libraries have, by the beginning of their names."""


def fit(
    points: ArrayLike,
    estimator: str = "corrected",
    noise: ArrayLike | None = None,
    *,
    copy: bool | None = None,
    **others: Never,
) -> Fit:
    """Fit a sphere (a circle, if d = 2) to each of one or many point sets.

    Args:
        points: coordinates (…, n, d) of n ≥ d + 1 points in d ≥ 2 dimensions, in any unit; leading axes are a batch.
            Points with a NaN, or masked, are missing samples. Of a data frame, the columns called x, y and z (or x and
            y; X_mm, Easting …), else all of two or three.
        estimator: a name in `study.ESTIMATORS`; the default is never far from the best of them (configs/regret.toml).
        noise: standard deviation σ of each coordinate, in the unit of the points, or a covariance Σ (d, d); None if
            it is not known. Only ``ugdk`` cannot do without.
        copy: True to copy the points, from which a `Fit` computes residuals and standard errors when asked. False to
            read the caller's array again, and to refuse if it has changed; that saves time and memory. By default up
            to a hundred thousand coordinates are copied.
        others: none; a TypeError says what there is in place of weights, sigma or a known radius.

    Returns:
        A `Fit` whose arrays have the leading axes of ``points``. Look at ``fit.ok`` before using the numbers: data
        that determine no sphere have a status, and raise nothing.

    Raises:
        TypeError: if the points or the noise are not real numbers, or the estimator is no name.
        ValueError: if the shape, the noise or the estimator's name cannot be used. The message says which and why.

    Example:
        >>> points = [[1, 0], [0, 1], [-1, 0], [0, -1.0]]
        >>> float(study.fit(points, "gdke").radius)
        1.0

    Source: the paper of each estimator is in its `Estimator.reference`.
    """
    if others:
        raise TypeError(f"study.fit takes no {next(iter(others))}=: {_instead(next(iter(others)))}")
    if not isinstance(estimator, str):
        raise TypeError(f"estimator = {estimator!r}: expected a name, such as 'corrected'")
    if estimator not in ESTIMATORS:
        raise ValueError(f"estimator = {estimator!r}: unknown; {did_you_mean(estimator, ESTIMATORS)}")
    array = real_array(points, "points")
    if array.ndim < 2 or array.shape[-1] < 2:
        raise ValueError(f"points have shape {array.shape}: expected (…, n, d) with d ≥ 2")
    *lead, n, d = array.shape
    if n < d + 1:
        raise ValueError(f"points have shape {array.shape}: a sphere in {d} dimensions needs at least {d + 1} points")
    if noise is not None:
        noise_covariance(noise, d)
        noise = float(np.asarray(noise)) if np.ndim(noise) == 0 else np.asarray(noise, dtype=float)
    x = array.reshape(-1, n, d).swapaxes(1, 2)
    lent = array.size > _MOST_COPIED if copy is None else not copy
    samples = Samples(x.astype(float, copy=False) if lent else np.array(x, dtype=float, order="C"), noise, lent)
    entry = ESTIMATORS[estimator]
    if is_ordinary(samples.moments.fourth):
        found = entry(samples)
    else:
        samples = Samples(np.array(samples.x, order="C"), noise)  # moments that are not finite show no change
        found = careful_fit(entry, samples)
    return as_fit(found.reshape(*lead), samples, estimator)


def _instead(argument: str) -> str:
    """The remedy for an argument that `fit` does not have."""
    known = ["points", "estimator", "noise", "copy"]
    return next((text for name, text in _INSTEAD.items() if argument.startswith(name)), did_you_mean(argument, known))


def fit_samples(samples: Samples, estimator: str) -> Fit:
    """Fit each set of a batch without missing samples by a named estimator; leading axes (b,)."""
    return as_fit(ESTIMATORS[estimator](samples), samples, estimator)


def as_fit(estimates: Estimates, samples: Samples, estimator: str) -> Fit:
    """The answer of a named estimator, from its numbers, with the leading axes, and the flat samples."""
    entry = ESTIMATORS[estimator]
    return Fit(estimates, samples, estimator, entry.covariance, entry.without_outliers)

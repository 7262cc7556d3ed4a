"""The field's words: what other libraries and papers call the things of this one, and what there is here instead.

Nothing here makes another name work: the messages of errors say which name does.
"""

import inspect
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import TYPE_CHECKING, TypeVar, cast

from study.text import did_you_mean, listed

F = TypeVar("F", bound=Callable[..., object])

ESTIMATORS = {
    **dict.fromkeys(["kasa", "delogne", "delognekasa", "coope", "algebraic", "dlt"], "gdke"),
    **dict.fromkeys(["geometric", "orthogonal", "odr", "ml", "maximumlikelihood", "gander", "shakarji"], "mle"),
    **dict.fromkeys(["leastsquares", "nonlinear", "levenbergmarquardt", "lm", "gaussnewton"], "mle"),
    **dict.fromkeys(["ransac", "msac", "mlesac", "lmeds", "lms", "huber", "tukey"], "robust"),
    **dict.fromkeys(["hyperls", "hyperaccurate", "alsharadqah", "chernov"], "hyper"),
    **dict.fromkeys(["kukush", "adjustedleastsquares"], "als"),
    "unbiased": "corrected",
}
"""Estimators by their other names, as `_plain` writes them."""

_OWN = {"als", "fuller", "hinge", "igdk", "lls", "pratt", "taubin", "ugdk", *ESTIMATORS.values()}
"""Estimators that someone may look for as functions; the registry is not asked, since it takes time to load."""

NAMES = {
    **dict.fromkeys(["fitsphere", "fitcircle", "spherefit", "circlefit", "sphere", "circle"], "fit"),
    **dict.fromkeys(["findspheres", "spheres"], "fit_spheres"),
    **dict.fromkeys(["read", "load", "open", "readply", "readcsv", "loadpoints", "loadtxt"], "read_points"),
    **dict.fromkeys(["cramerrao", "fisher", "bound"], "crlb"),
    **dict.fromkeys(["chebyshev", "minimax", "mzc", "mzs"], "minimum_zone"),
}
"""Names of the package by their other names."""

ANSWERS = {
    **dict.fromkeys(["centre", "centers", "centres", "c"], ("center", "center")),
    **dict.fromkeys(["r", "radii"], ("radius", "radius")),
    **dict.fromkeys(["params", "coef", "coefficients", "x", "popt"], ("center", "center and radius")),
    **dict.fromkeys(["confint", "confidenceinterval", "ci"], ("interval", "interval('radius') or interval('center')")),
    **dict.fromkeys(["summary", "report"], ("to_frame", "print(fit) for a line, or to_frame() for all numbers")),
    **dict.fromkeys(["predict", "evaluate"], ("distance", "distance(points), the signed distances of points")),
    **dict.fromkeys(["bse", "stderr", "se", "uncertainty"], ("standard_errors", "standard_errors")),
    **dict.fromkeys(["cov", "pcov", "covparams"], ("covariance", "covariance")),
    **dict.fromkeys(["resid", "residual", "fun"], ("residuals", "residuals")),
    **dict.fromkeys(["rms", "rmse", "rss", "cost"], ("residual_rms", "residual_rms")),
    **dict.fromkeys(["score", "r2", "rsquared", "chi2", "pvalue", "pvalues"], ("goodness", "goodness")),
    **dict.fromkeys(["success", "converged", "valid"], ("ok", "ok")),
    **dict.fromkeys(["message", "statustext"], ("status", "status.text, or the column status of to_frame()")),
    "ownstatus": ("estimates", "estimates.status"),
    "noisevariance": ("estimates", "sigma ** 2, or estimates.noise_variance"),
    **dict.fromkeys(["condition", "rho"], ("estimates", "estimates.condition")),
    **dict.fromkeys(["nit", "niter", "iterations"], ("estimates", "estimates.iterations")),
    "diameter": ("radius", "2 * radius, and interval('diameter')"),
    "expandeduncertainty": ("standard_errors", "k * standard_errors"),
    "correlation": ("to_dict", "to_dict()['correlation'], or covariance"),
    "largestdeviation": ("residuals", "abs(residuals).max(), or to_dict()['largest_deviation']"),
    "minimumzone": ("samples", "study.minimum_zone(points)"),
    "owncovariance": ("covariance", "covariance, and allowance, by which it is longer than that of white noise"),
    **dict.fromkeys(["copies", "outlierinfluence", "ordered"], ("to_dict", "to_dict(), which has it")),
    "withoutoutliers": ("estimator", "estimator, of which 'robust' leaves outliers out"),
    "noiseisknown": ("estimates", "what you gave as noise"),
    **dict.fromkeys(["nobs", "n"], ("count", "count")),
    **dict.fromkeys(["inliers", "inliermask"], ("outliers", "~fit.outliers")),
    **dict.fromkeys(["std", "noise", "sd"], ("sigma", "sigma, the standard deviation of a coordinate")),
    **dict.fromkeys(
        ["formerror", "sphericity", "roundness", "circularity"],
        ("residuals", "np.ptp(residuals), or study.minimum_zone(points)"),
    ),
    **dict.fromkeys(["tocsv", "save"], ("to_frame", "to_frame().to_csv(path)")),
}
"""What a fit has, by the other names of it, those of version 1 among them: an attribute, and words for it."""

ARGUMENTS = {
    "sigma": "give noise=, the standard deviation of a coordinate",
    "weight": "give noise=, the standard deviation of each point (n,), and scale='estimated' if only ratios are known; "
    "a point is left out as NaN, outliers by the estimator 'robust'",
    **dict.fromkeys(["method", "algorithm"], "give estimator=, a name in study.ESTIMATORS"),
    **dict.fromkeys(["threshold", "residual_threshold", "max_trials", "loss"], "give estimator='robust'"),
    **dict.fromkeys(["level", "confidence", "alpha"], "ask the fit: fit.interval('radius', level=0.95)"),
    **dict.fromkeys(["x0", "p0", "guess", "initial"], "leave it out; no fit needs a start"),
}
"""The answer to arguments that other libraries have, by the beginning of their names."""


KEYS = {
    **dict.fromkeys(["method", "methods", "algorithms", "fits", "fitters"], "estimators"),
    **dict.fromkeys(["repetitions", "replications", "reps", "runs", "ntrials", "nsim", "nrep"], "trials"),
    **dict.fromkeys(["n", "samplesize", "points", "npoints", "size", "nsamples"], "samples"),
    **dict.fromkeys(["sigma", "noise", "noiselevel", "sd", "std"], "noise_over_radius"),
    **dict.fromkeys(["cap", "arc", "halfangle", "coneangle", "confinement", "phi"], "angle"),
    **dict.fromkeys(["r", "radii"], "radius"),
    **dict.fromkeys(["d", "dim", "ndim"], "dimension"),
    **dict.fromkeys(["randomseed", "rng", "rngseed"], "seed"),
    **dict.fromkeys(["outlier", "contamination", "outlierfraction", "clutter"], "outliers"),
}
"""Keys of a study's config by their other names."""


def _plain(word: str) -> str:
    """A word in small letters, without accents, blanks, hyphens and underscores."""
    return "".join(c for c in unicodedata.normalize("NFKD", word).casefold() if c.isalnum())


def estimator_remedy(names: str | Iterable[str], known: Iterable[str]) -> str:
    """The remedy for an unknown estimator, as the end of a message; see `did_you_mean`.

    Returns:
        "use 'gdke' for 'kasa'; known are gdke, mle" where the field has that word for one of the known, else that of
        `did_you_mean`.
    """
    names, known = [names] if isinstance(names, str) else list(names), list(known)
    found = {name: ESTIMATORS[_plain(name)] for name in names if ESTIMATORS.get(_plain(name)) in known}
    if not found:
        return did_you_mean(names, known)
    return f"use {', '.join(f'{own!r} for {name!r}' for name, own in found.items())}; known are {listed(known)}"


def name_remedy(word: str, known: Iterable[str]) -> str:
    """The remedy for a word that the package has not, as the end of a message."""
    own = NAMES.get(_plain(word))
    if own is not None:
        return f"use study.{own}"
    estimator = word if word in _OWN else ESTIMATORS.get(_plain(word))
    return did_you_mean(word, known) if estimator is None else f"use study.fit(points, {estimator!r})"


def key_remedy(word: str, names: Iterable[str], elsewhere: Mapping[str, Iterable[str]]) -> str:
    """The remedy for a key that a table of a config does not have, as the end of a message.

    Args:
        word: the key.
        names: keys of the table.
        elsewhere: keys of the other tables, by their names.
    """
    own, names = KEYS.get(_plain(word), word), list(names)
    if own in names:
        return f"use {own!r}"
    if table := next((name for name, keys in elsewhere.items() if own in keys), None):
        return f"use {own!r} in [{table}]"
    return did_you_mean(word, names)


def argument_remedy(word: str, known: Iterable[str]) -> str:
    """The remedy for an argument that a fit does not take, as the end of a message."""
    return next((text for name, text in ARGUMENTS.items() if word.startswith(name)), did_you_mean(word, known))


def hinting(function: F) -> F:
    """Answer an argument that a function does not take with what there is, in a TypeError."""
    known = list(inspect.signature(function).parameters)

    @wraps(function)
    def called(*arguments: object, **named: object) -> object:
        if unknown := [word for word in named if word not in known]:
            raise TypeError(f"study.{function.__name__} takes no {unknown[0]}=: {argument_remedy(unknown[0], known)}")
        return function(*arguments, **named)

    return cast(F, called)


class Hinting:
    """An answer whose missing attributes are answered with what there is."""

    if not TYPE_CHECKING:  # a checker of types is to see that an attribute is missing

        def __getattr__(self, name: str) -> object:
            """Raise the AttributeError with a remedy."""
            kind = type(self)
            if hasattr(kind, name):  # a property of this name failed by itself: its own error is the one to show
                return object.__getattribute__(self, name)
            message = f"{kind.__name__!r} object has no attribute {name!r}"
            if name.startswith("_"):
                raise AttributeError(message)
            own, words = ANSWERS.get(_plain(name), ("", ""))
            public = [one for one in dir(self) if not one.startswith("_")]
            raise AttributeError(f"{message}: {f'use {words}' if own in public else did_you_mean(name, public)}")

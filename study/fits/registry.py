"""The registry of estimators, `fit`, which calls one by name, and estimators of one's own.

To add an estimator here, write a function from `Samples` to `Estimates` and a line in `ESTIMATORS`. Of one's own, the
simple form is enough, a function from one set of points to a centre and a radius. It is registered by a program
(`register`), by an installed package with the entry-point group ``study.fits``, or by a file, which is read, executed,
tried out and refused with one line; what a file prints goes to standard error. `ORIGINS` has where each comes from.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import linecache
import re
import signal
import sys
import threading
import traceback
import types
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from study.arrays import Floats, real_array
from study.fits.answers.answer import Fit
from study.fits.answers.given import ALS, CORRECTED, GDKE, MLE, ROBUST, UGDK, check_way, fit_given, given_samples
from study.fits.estimators.closed_forms import als, fuller, gdke, hinge, hyper, pratt, taubin, ugdk, ugdk_cov
from study.fits.estimators.corrected import (
    corrected,
    corrected_01,
    corrected_02,
    corrected_12,
    corrected_covariance,
    sandwich,
)
from study.fits.estimators.geometric import mle, mle_centroid, mle_early, mle_mirror
from study.fits.estimators.lls import igdk, lls, lls_nr, lls_nr_raw, lls_single
from study.fits.estimators.robust import robust
from study.fits.evidence.judge import NOTHING, Assumptions
from study.fits.points.noise import is_per_point, noise_covariance
from study.fits.points.samples import Estimates, Estimator, Samples, Status, blank, careful_fit, is_ordinary
from study.words import estimator_remedy, hinting

if TYPE_CHECKING:
    from study.fits.points.point_files import PointTable

    PointsLike: TypeAlias = ArrayLike | Path | PointTable

Function = Callable[..., object]
_LONGEST = 500


@dataclass(frozen=True)
class SimpleForm:
    """A function of points (n, d) as an estimator of batches.

    The function is called once for each set, with a copy of its points; not for points whose fourth powers are not
    finite. Where it raises or returns something else than a centre (d,) and a radius, the fit has the status
    ``FAILED``; where it returns numbers that are not finite, the points did not determine a sphere. The noise variance
    is that of the residuals, over n - d - 1.

    Attributes:
        function: takes points (n, d), and the noise if it needs it; returns a centre (d,) and a radius.
        needs: ``noise`` if the function takes the noise as its second argument: σ, or a covariance (d, d).
    """

    function: Function
    needs: str = ""

    def __call__(self, samples: Samples) -> Estimates:
        """Fit each set."""
        return self.attempt(samples)[0]

    def attempt(self, samples: Samples) -> tuple[Estimates, dict[int, str]]:
        """Fit each set; also the messages of the sets that failed, by number."""
        if self.needs and samples.noise is None:
            raise ValueError("noise = None: this estimator needs the standard deviation of a coordinate")
        b, d, n = samples.shape
        result, failed = blank(b, d), dict[int, str]()
        with np.errstate(all="ignore"):
            usable = np.isfinite((samples.points**4).sum(axis=(1, 2)))
        for t, points in enumerate(samples.points):
            if not usable[t]:  # linear algebra may not even return
                result.status[t] = Status.NOT_FINITE
                continue
            try:
                center, radius = self._one(np.array(points, order="C"), samples.noise, t)
            except (Exception, SystemExit) as error:
                failed[t] = one_line(error)[:_LONGEST]
                result.status[t] = Status.FAILED
                continue
            if not (np.all(np.isfinite(center)) and np.isfinite(radius)):
                result.status[t] = Status.SINGULAR
                continue
            result.center[t], result.radius[t] = center, radius
            with np.errstate(all="ignore"):
                square = (np.linalg.norm(points - center, axis=1) - radius) ** 2
                result.noise_variance[t] = square.sum() / (n - d - 1) if n > d + 1 else np.nan
        return result, failed

    def _one(self, points: Floats, noise: float | Floats | None, place: int) -> tuple[Floats, float]:
        """Call the function for one set, and check what it returns."""
        own = noise[place] if isinstance(noise, np.ndarray) and noise.ndim == 1 else noise
        answer = self.function(points, own) if self.needs else self.function(points)
        if not isinstance(answer, tuple | list) or len(answer) != 2:
            raise TypeError(f"returned {_described(answer)}, expected a centre and a radius")
        center, radius = (np.asarray(part, dtype=float) for part in answer)
        d = points.shape[1]
        if center.shape != (d,):
            raise ValueError(f"returned a centre of shape {center.shape}, expected {(d,)}")
        if radius.shape != ():
            raise ValueError(f"returned a radius of shape {radius.shape}, expected one number")
        return center, float(radius)


def one_line(error: BaseException) -> str:
    """An exception in one line: its type and the first line of its message."""
    words = str(error).strip().split("\n")[0]
    return f"{type(error).__name__}: {words}" if words else type(error).__name__


def _described(answer: object) -> str:
    """Describe what a function returned, in a few words."""
    if isinstance(answer, tuple | list):
        return f"{len(answer)} values"
    shape = f" of shape {answer.shape}" if isinstance(answer, np.ndarray) else ""
    return f"{type(answer).__name__}{shape}"


def _moments(d: int) -> float:
    """FLOPs per sample of the centred moments, which every closed form starts from (the paper's count: d² + 6d - 1)."""
    return d * d + 8 * d + 2


_BIASED = "biased towards the points by the noise, which its standard errors do not include; als has no such bias"


class Estimators(dict[str, Estimator]):
    """Every estimator by its name, as `study.fit`, configs and `study fit -e` know it.

    ``list(study.ESTIMATORS)`` has the names, ``study.ESTIMATORS["mle"]`` the source of one and what it needs.
    `study.register` adds one of your own.
    """


ESTIMATORS = Estimators(
    {
        "mle": Estimator(
            mle, "paper §4.3; Shakarji 1998", flops=lambda d: d * d + 10 * d + 6, flops_of="a pass", given=MLE
        ),
        "mle_centroid": Estimator(mle_centroid, "mle from another start, the centroid of the points"),
        "mle_mirror": Estimator(mle_mirror, "mle from a wrong start, beyond the points"),
        "mle_early": Estimator(mle_early, "mle by Levenberg and Marquardt's method with the stop of Numerical Recipes"),
        "corrected": Estimator(
            corrected,
            "theory §9: geometric, without its bias, for every law of directions",
            covariance=corrected_covariance,
            given=CORRECTED,
        ),
        "corrected_01": Estimator(corrected_01, "theory §9, with ν = 0", covariance=partial(sandwich, pair=0.0)),
        "corrected_02": Estimator(corrected_02, "theory §9, with ν = ½", covariance=partial(sandwich, pair=0.5)),
        "corrected_12": Estimator(corrected_12, "theory §9, with ν = 1", covariance=partial(sandwich, pair=1.0)),
        "robust": Estimator(
            robust,
            "Torr & Zisserman 2000; Moisan & Stival 2004: mle, each point by its probability to be no clutter",
            without_outliers=True,
            version=5,
            given=ROBUST,
        ),
        "lls": Estimator(lls, "paper §4.4", flops=lambda d: 2 * d * d + 10 * d + 5, caution=_BIASED, version=3),
        "lls_nr": Estimator(
            lls_nr, "paper §4.4; Press et al. 1992: centred, singular values cut at 1e-5", caution=_BIASED
        ),
        "lls_nr_raw": Estimator(lls_nr_raw, "paper §4.4; Press et al. 1992: not centred, cut at 1e-6", caution=_BIASED),
        "lls_single": Estimator(lls_single, "lls by normal equations in single precision", caution=_BIASED),
        "gdke": Estimator(
            gdke, "paper eqs 2-6; Kåsa 1976", "", _moments, caution=_BIASED, moments_suffice=True, given=GDKE
        ),
        "ugdk": Estimator(ugdk, "paper eqs 15-21", needs="noise", flops=_moments, moments_suffice=True, given=UGDK),
        "als": Estimator(als, "Kukush, Markovsky & Van Huffel 2004", "", _moments, moments_suffice=True, given=ALS),
        "fuller": Estimator(fuller, "Fuller 1987, for als", flops=_moments, moments_suffice=True),
        "hinge": Estimator(
            hinge,
            "als, without directions of insignificant extent",
            flops=_moments,
            moments_suffice=True,
            takes_noise=True,
        ),
        "taubin": Estimator(taubin, "Taubin 1991", flops=_moments, moments_suffice=True),
        "pratt": Estimator(pratt, "Pratt 1987", flops=_moments, moments_suffice=True),
        "hyper": Estimator(hyper, "Al-Sharadqah & Chernov 2009", flops=_moments, moments_suffice=True),
        "ugdk_cov": Estimator(ugdk_cov, "the paper's open question: the whole covariance from the points"),
        "igdk": Estimator(igdk, "paper eqs 24-25", flops=lambda d: 7 * d * d + 20 * d + 3, caution=_BIASED),
    }
)

_MOST_COPIED = 100_000
"""Number of coordinates that a fit copies by default: beyond, copying takes longer than a closed form."""


@hinting
def fit(
    points: PointsLike,
    estimator: str = "corrected",
    noise: ArrayLike | None = None,
    *,
    radius: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    scale: str = "given",
    copy: bool | None = None,
    ordered: bool = False,
    assume: str | None = None,
    law: str = "isotropic",
) -> Fit:
    """Fit a sphere (a circle, if d = 2) to each of one or many point sets.

    Args:
        points: coordinates (…, n, d) of n ≥ d + 1 points in d ≥ 2 dimensions, in any unit; leading axes are a batch.
            Points with a NaN, or masked, are missing samples. Of a data frame, the columns called x, y and z (or x and
            y; X_mm, Easting …), else all of two or three. Or the name of a file, which is read as `study fit` does; or
            what `study.read_points` read, which lets you choose the columns.
        estimator: a name in `study.ESTIMATORS`; the default is near the best of them where fits are ok.
        noise: standard deviation σ of each coordinate, in the unit of the points, or a covariance Σ (d, d); None if
            it is not known. Only ``ugdk`` cannot do without. Where points differ: σ of each (n,), of each coordinate
            of each (n, d), or the covariance of each (n, d, d), with the leading axes of the points or none. A file's
            columns sigma, or sx, sy and sz, count in its place. Errors stand on it. So do the intervals and the status
            of fits with a known radius, of points that differ, and of ``corrected`` and ``robust``; other fits find
            the noise of their intervals in the points.
        radius: the radius, where it is known, or one for each set (…): then the centre alone is fitted. A tuple of two
            is a radius and its standard uncertainty, which the errors and intervals allow for.
        scale: "given" if the noise of each point is as large as that; "estimated" if only its ratios are known.
        copy: True to copy the points, from which a `Fit` computes residuals and standard errors when asked. False to
            read the caller's array again, and to refuse if it has changed; that saves time and memory. By default up
            to a hundred thousand coordinates are copied.
        ordered: True if the rows are in the order in which they were measured: where neighbours share their noise,
            errors and intervals then allow for it.
        assume: "sphere" if the points are known to lie on one (a circle, if d = 2): their shape is then not tested.
        law: "isotropic" for noise alike in all directions; "radial" for noise along the radius alone, as of a probe or
            a scanner at the centre. Then ``corrected`` and ``mle`` are one, and other estimators refuse.

    Returns:
        A `Fit` whose arrays have the leading axes of ``points``. A radius or a noise of each point is taken by
        corrected, mle, als, ugdk and gdke; `Fit.radius_test` and `Fit.noise_scale` say whether the points agree. Look
        at ``fit.ok`` before using the numbers: data that determine no sphere have a status, and raise nothing.

    Raises:
        TypeError: if the points or the noise are not real numbers, or the estimator is no name.
        ValueError: if the shape, the noise or the estimator's name cannot be used, or the file not read. The message
            says which and why.

    Examples:
        >>> import study
        >>> points = [[1, 0], [0, 1], [-1, 0], [0, -1.0]]
        >>> fit = study.fit(points, "gdke")
        >>> fit.center, float(fit.radius)
        (array([0., 0.]), 1.0)

    Source: the paper of each estimator is in its `Estimator.reference`.
    """
    if not isinstance(estimator, str):
        raise TypeError(f"estimator = {estimator!r}: expected a name, such as 'corrected'")
    if estimator not in ESTIMATORS:
        raise ValueError(f"estimator = {estimator!r}: unknown; {estimator_remedy(estimator, ESTIMATORS)}")
    if isinstance(points, str | Path | tuple):
        points, noise = _of_file(points, noise)
    array = real_array(points, "points")
    if array.ndim < 2 or array.shape[-1] < 2:
        raise ValueError(f"points have shape {array.shape}: expected (…, n, d) with d ≥ 2")
    *lead, n, d = array.shape
    if n < d + 1:
        hint = "; points are rows: swap the last two axes" if n in (2, 3) and d > 4 else ""
        needs = f"a sphere in {d} dimensions needs at least {d + 1} points"
        raise ValueError(f"points have shape {array.shape}: {needs}{hint}")
    assumed = Assumptions.of(ordered, assume, law)
    entry = ESTIMATORS[estimator]
    stated = noise is not None and is_per_point(np.shape(noise), n, d)
    if noise is not None and not stated:
        noise_covariance(noise, d)  # an estimator that finds the noise by itself would not use it
        stated = entry.covariance is not None or (entry.without_outliers and np.ndim(noise) == 0)
    if radius is not None or scale != "given" or stated or assumed.radial:
        samples = given_samples(array, noise, radius, scale, assumed.radial)
        check_way(estimator, samples, ESTIMATORS)
        estimates, samples = fit_given(entry, samples)
        return as_fit(estimates.reshape(*lead), samples, estimator, assumed)
    if noise is not None:
        noise = float(np.asarray(noise)) if np.ndim(noise) == 0 else np.asarray(noise, dtype=float)
    x = array.reshape(-1, n, d).swapaxes(1, 2)
    lent = array.size > _MOST_COPIED if copy is None else not copy
    samples = Samples(x.astype(float, copy=False) if lent else np.array(x, dtype=float, order="C"), noise, lent)
    if is_ordinary(samples.moments.fourth):
        estimates = entry(samples)
    else:
        samples = Samples(np.array(samples.x, order="C"), noise)  # moments that are not finite show no change
        estimates = careful_fit(entry, samples)
    return as_fit(estimates.reshape(*lead), samples, estimator, assumed)


def _of_file(points: PointsLike, noise: ArrayLike | None) -> tuple[ArrayLike, ArrayLike | None]:
    """The points and the noise of a file, or of what was read from it; a tuple of points as it is."""
    from study.fits.points.point_files import PointTable, read_points  # who fits arrays need not wait for its readers

    if isinstance(points, str | Path):
        points = read_points(points)
    return (points.points, points.noise_or(noise)) if isinstance(points, PointTable) else (points, noise)


def fit_samples(samples: Samples, estimator: str) -> Fit:
    """Fit each set of a batch without missing samples by a named estimator; leading axes (b,)."""
    return as_fit(ESTIMATORS[estimator](samples), samples, estimator)


def as_fit(estimates: Estimates, samples: Samples, estimator: str, assumed: Assumptions = NOTHING) -> Fit:
    """The answer of a named estimator, from its numbers, with the leading axes, and the flat samples."""
    return Fit(estimates, samples, estimator, ESTIMATORS[estimator], assumed)


def takes(estimator: str, points: Floats, noise: ArrayLike | None, known: Mapping[str, Any]) -> bool:
    """True for an estimator that takes what is known of points (…, n, d), as `study.fit` has it."""
    try:
        samples = given_samples(points, noise, known["radius"], known["scale"], known["law"] == "radial")
        check_way(estimator, samples, ESTIMATORS)
    except ValueError:
        return False
    return True


IN_PROGRAM = "this program"


class Origin(NamedTuple):
    """The source of an estimator that is not shipped.

    Attributes:
        name: of a file, or of a package with its version; or `IN_PROGRAM`.
        digest: SHA-256 of the file's or the function's text, or empty if that is not known.
        everywhere: worker processes can have it: it is from a file or from an installed package.
    """

    name: str
    digest: str
    everywhere: bool = True


ORIGINS: dict[str, Origin] = {}
"""Origins of the registered estimators that are not shipped, by their names."""

_source: list[Origin] = []


@dataclass(frozen=True)
class Registry:
    """Things of one kind that files and programs may register.

    Attributes:
        kind: what they are, in a word.
        call: the function that registers one.
        origins: of those that are not shipped, by their names.
        remove: takes one out by its name.
        tried_on: the data on which one is tried out, in words.
        fault: tries one out, and says what is wrong with it; empty if nothing is.
    """

    kind: str
    call: str
    origins: dict[str, Origin]
    remove: Callable[[str], object]
    tried_on: str
    fault: Callable[[str], str]

    def enter(self, name: str, origin: Origin, shipped: bool) -> None:
        """Note the origin of a name; ValueError if the name cannot be used or is taken."""
        call = f"{self.call}({name!r})"
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,40}", name) or name == "all":
            raise ValueError(f"{call}: a name has lower-case letters, digits and underscores, a letter first")
        before = self.origins.get(name)
        if shipped or (before is not None and (before.name != origin.name or before.everywhere)):
            taken = f"by {before.name}" if before is not None else f"by a shipped {self.kind}"
            raise ValueError(f"{call}: the name is taken {taken}; choose another")
        self.origins[name] = origin

    def listed(self, names: Iterable[str], key: str) -> list[dict[str, object]]:
        """The origins of those among some names that are not shipped, as a manifest has them."""
        by_origin: dict[Origin, list[str]] = {}
        for name in names:
            if name in self.origins:
                by_origin.setdefault(self.origins[name], []).append(name)
        return [{"from": o.name, "sha256": o.digest, key: names} for o, names in by_origin.items()]

    def only_here(self, names: Iterable[str]) -> list[str]:
        """Those among some names that worker processes cannot have."""
        return [name for name in names if name in self.origins and not self.origins[name].everywhere]


REGISTRIES: list[Registry] = []
"""The registries that a file may enter something into."""


def source(function: Function) -> Origin:
    """The origin of a function that is registered now: the file that is being loaded, or this program."""
    return _source[-1] if _source else _in_program(function)


def register(
    name: str, function: Callable[..., Any], *, needs: str = "", reference: str = "", batched: bool = False
) -> None:
    """Register an estimator of one's own; from then on `study.fit`, configs and figures know its name.

    Args:
        name: lower-case letters, digits and underscores, a letter first.
        function: takes the points (n, d) of one set, and returns a centre (d,) and a radius. It may raise on data: the
            fit is then counted as failed. With ``batched``, it takes `study.Samples` and returns a `study.Estimates`.
        needs: ``"noise"`` if the function cannot do without the standard deviation of a coordinate, which is then its
            second argument (with ``batched``: ``samples.noise``).
        reference: where the method is described.
        batched: the function fits a batch of sets at once, which is faster.

    Raises:
        TypeError: if the function cannot be called.
        ValueError: if the name cannot be used or is taken, or ``needs`` is not understood.

    Examples:
        >>> import study
        >>> study.register("centroid", lambda points: (points.mean(axis=0), 1.0))
        >>> study.fit([[1, 0], [0, 1], [-1, 0], [0, -1]], "centroid").center
        array([0., 0.])
    """
    if not callable(function):
        raise TypeError(f"register({name!r}): {type(function).__name__} is not a function")
    if needs not in ("", "noise"):
        raise ValueError(f"register({name!r}): needs = {needs!r}: must be 'noise' or left out")
    origin = source(function)
    call = function if batched else SimpleForm(function, needs)
    add(name, Estimator(call, reference, needs), origin)


def add(name: str, entry: Estimator, origin: Origin) -> None:
    """Enter an estimator into the registry; ValueError if its name cannot be used or is taken."""
    _REGISTRY.enter(name, origin, name in ESTIMATORS and name not in ORIGINS)
    ESTIMATORS[name] = replace(entry, version=origin.digest[:10] or entry.version)


def remove(names: Iterable[str]) -> None:
    """Take estimators that are not shipped out of the registry."""
    for name in names:
        if ORIGINS.pop(name, None) is not None:
            del ESTIMATORS[name]


def origins(estimators: Iterable[str]) -> list[dict[str, object]]:
    """The origins of those among some estimators that are not shipped, as a manifest has them."""
    return _REGISTRY.listed(estimators, "estimators")


def only_here(estimators: Iterable[str]) -> list[str]:
    """Those among some estimators that worker processes cannot have."""
    return _REGISTRY.only_here(estimators)


def _in_program(function: Function) -> Origin:
    """The origin of a function that a program registers itself."""
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError):  # typed at a prompt, or compiled
        text = ""
    digest = hashlib.sha256(text.encode()).hexdigest() if text else ""
    return Origin(IN_PROGRAM, digest, everywhere=False)


GROUP = "study.fits"


def load_installed() -> None:
    """Register the estimators of installed packages.

    An entry point leads to a function of the simple form, or to a `study.Estimator`; its name is the estimator's. One
    that cannot be loaded is left out, with a warning of one line: it must not cost the others.
    """
    for point in entry_points(group=GROUP):
        package = f"{point.dist.name} {point.dist.version}" if point.dist is not None else point.value
        try:
            loaded = point.load()
            entry = loaded if isinstance(loaded, Estimator) else Estimator(SimpleForm(loaded))
            add(point.name, entry, Origin(package, hashlib.sha256(package.encode()).hexdigest()))
        except (Exception, SystemExit) as error:
            warnings.warn(f"estimator {point.name!r} of {package} is left out: {one_line(error)}", stacklevel=2)


class PluginError(Exception):
    """A file of one's own that cannot be used; the message says why, in one line."""


LIMIT = 60.0
"""Seconds in which a file, or a call of its estimators on a small data set, should be done."""


class OvertimeError(BaseException):
    """A call has not returned in time. An estimator that catches every `Exception` does not catch it."""


@contextlib.contextmanager
def in_time(seconds: float) -> Iterator[None]:
    """Raise `OvertimeError` where the calls within take longer: in the main thread, on systems that have alarms."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def ring(number: int, frame: object) -> None:
        raise OvertimeError(f"has not returned after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


class PluginFile(NamedTuple):
    """A file of one's own, with its text: worker processes need not find the file.

    Attributes:
        path: of the file.
        text: its content.
    """

    path: str
    text: str

    @property
    def origin(self) -> Origin:
        """The file's name and digest, as manifests have them."""
        return Origin(Path(self.path).name, hashlib.sha256(self.text.encode()).hexdigest())


_Entry = tuple[str, str]
"""A kind, and the name of what is registered."""
_loaded: dict[str, tuple[PluginFile, tuple[_Entry, ...]]] = {}


def _registered() -> dict[_Entry, Registry]:
    """All that is registered and not shipped, with its registry."""
    return {(one.kind, name): one for one in REGISTRIES for name in one.origins}


def load(path: Path) -> tuple[str, ...]:
    """Load a file of one's own; once is enough, and a file that has changed replaces what it registered before.

    Args:
        path: a Python file that calls `study.register`, `study.register_law` or `study.register_measure`.

    Returns:
        The names of the estimators that it registered.

    Raises:
        PluginError: if it cannot be read, raises, registers nothing, or registers something that answers in the wrong
            shape. Then nothing of it is registered.
    """
    from study.files import regular  # whose libraries take long to load

    try:
        text = regular(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise PluginError(f"{path}: cannot be read: {reason}") from None
    return load_text(PluginFile(str(path.resolve()), text), str(path))


def load_text(plugin: PluginFile, shown: str = "") -> tuple[str, ...]:
    """Load a file of one's own whose text is known; see `load`.

    Args:
        plugin: the file.
        shown: its name in messages; its path, if empty.
    """
    shown = shown or plugin.path
    before, entries = _loaded.get(plugin.path, (None, ()))
    if before != plugin:
        unload(plugin.path)
        known = _registered()
        _source.append(plugin.origin)
        try:
            _execute(plugin, shown)
            entries = tuple(entry for entry in _registered() if entry not in known)
            if not entries:
                words = "study.register(name, function), or study.register_law or study.register_measure"
                raise PluginError(f"{shown}: registers nothing; it should call {words}")
            for entry in entries:
                _try_out(*entry, shown)
        except BaseException:
            _forget(entry for entry in _registered() if entry not in known)
            raise
        finally:
            _source.pop()
        _loaded[plugin.path] = plugin, entries
    return tuple(name for kind, name in entries if kind == _REGISTRY.kind)


def _try_out(kind: str, name: str, shown: str) -> None:
    """Try out what a file registered; PluginError if it fails."""
    one = _registered()[kind, name]
    try:
        with in_time(LIMIT), contextlib.redirect_stdout(sys.stderr):
            fault = one.fault(name)
    except OvertimeError as error:
        raise PluginError(f"{shown}: {name}: {error} on {one.tried_on}") from None
    if fault:
        raise PluginError(f"{shown}: {name}: fails on {one.tried_on}: {fault}")


def _forget(entries: Iterable[_Entry]) -> None:
    """Take entries out of their registries."""
    registries = _registered()
    for entry in list(entries):
        if entry in registries:
            registries[entry].remove(entry[1])


def unload(path: str) -> None:
    """Forget a file, and take out what it registered."""
    _forget(_loaded.pop(path, (None, ()))[1])


def loaded() -> tuple[tuple[str, str], ...]:
    """Paths and texts of the loaded files, as plain text: a worker must read them before it may import anything."""
    return tuple((plugin.path, plugin.text) for plugin, _ in _loaded.values())


def faults_of(name: str) -> dict[int, str]:
    """Call an estimator on sound points in the plane and in space; what went wrong, by the dimension."""
    function, faults = ESTIMATORS[name].function, {}
    for d in (2, 3):
        samples = sound_samples(d)
        try:
            if isinstance(function, SimpleForm):
                faults[d] = next(iter(function.attempt(samples)[1].values()), "")
            else:
                faults[d] = _shape_fault(function(samples), samples)
        except (Exception, SystemExit) as error:
            faults[d] = one_line(error)
    return {d: fault for d, fault in faults.items() if fault}


def _fault(name: str) -> str:
    """The fault of an estimator that fails on sound points in the plane and in space alike; empty for others."""
    faults = faults_of(name)
    return faults[3] if len(faults) == 2 else ""


_REGISTRY = Registry("estimator", "register", ORIGINS, lambda name: remove([name]), "20 sound points", _fault)
REGISTRIES.append(_REGISTRY)


def sound_samples(d: int, sets: int = 2, n: int = 20) -> Samples:
    """Some sets of points about the unit sphere, with their noise."""
    rng = np.random.default_rng(7)
    u = rng.standard_normal((sets, n, d))
    points = u / np.linalg.norm(u, axis=2, keepdims=True) + 0.01 * rng.standard_normal(u.shape)
    return Samples(points.swapaxes(1, 2), 0.01)


def _shape_fault(answer: object, samples: Samples) -> str:
    """Words for what is no answer to these samples; empty if it is one."""
    model = blank(*samples.shape[:2])
    if not isinstance(answer, tuple) or getattr(answer, "_fields", None) != model._fields:
        return f"returned {type(answer).__name__}, expected a {type(model).__name__}"
    for field, value, expected in zip(Estimates._fields, answer, model, strict=True):
        if np.shape(value) != expected.shape:
            return f"{field} has shape {np.shape(value)}, expected {expected.shape}"
    return ""


def _execute(plugin: PluginFile, shown: str) -> None:
    """Execute a file as a module of its own; PluginError with the line that raised."""
    module = types.ModuleType(f"study_own_{Path(plugin.path).stem}")
    module.__file__ = plugin.path
    vars(module)["print"] = _print
    sys.modules[module.__name__] = module  # where dataclasses and pickles look for it
    linecache.cache.setdefault(plugin.path, (len(plugin.text), None, plugin.text.splitlines(True), plugin.path))
    try:
        with in_time(LIMIT), contextlib.redirect_stdout(sys.stderr):
            exec(compile(plugin.text, plugin.path, "exec"), module.__dict__)
    except (Exception, SystemExit, OvertimeError) as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == plugin.path]
        line = error.lineno if isinstance(error, SyntaxError) and error.filename == plugin.path else (lines or [1])[-1]
        raise PluginError(f"{shown}: line {line}: {one_line(error)}") from None


def _print(*words: object, **options: Any) -> None:
    """Print to standard error; a run's threads share the standard output, which cannot be changed for one of them."""
    print(*words, **{"file": sys.stderr, **options})

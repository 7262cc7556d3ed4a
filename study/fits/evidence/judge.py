"""The judge of every fit: what its residuals show, errors that allow for it, and the status that follows.

Evidence is gathered from the residuals of each set: the test of fit (`goodness.py`), circles in space, a large
residual, points far from the rest. Where structure is seen, a series over the directions measures it, the residuals'
own squares do, and a model of memory if the rows are in the order in which they were measured: structure of low order
has coefficients of like size among the harmonics that a sphere absorbs and among those that are left.

The status follows from the evidence by one rule, whatever was fitted and however. A test that was not made is not
passed: its answer says why.

Source: theory §13.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from study.arrays import Bools, Floats, Ints
from study.fits.errors.intervals import Intervals, intervals
from study.fits.errors.weighted import free_sphere
from study.fits.estimators.corrected import corrected
from study.fits.estimators.robust import FALSE_ALARMS, outliers
from study.fits.evidence.circle import hinges
from study.fits.evidence.goodness import (
    BLOCKS,
    HINGE,
    LEVEL,
    MEMORY,
    OUTLIERS,
    SHAPE,
    Answer,
    Goodness,
    Residuals,
    evenly_thinned,
    form_of,
    highest_degree,
    see,
)
from study.fits.points.samples import Estimates, Estimator, Samples, Status, careful_fit, is_ordinary, plug_in_bound

_UPPER = 0.975
"""Probability at whose quantile the widths of several series are compared."""
_COSINES = 6
"""Terms of the series over time (Lazarus et al. 2018)."""
_FEW = 30
"""Degrees of freedom up to which outliers hide in each other's residuals, so that they are always searched."""
_GRUBBS = 0.012
"""Share of clean data sets that are searched for outliers because of their largest residual, a little above the 1 % in
which that search finds one."""
_PEAKED, _SINGLE, _FAR, _BY_CHANCE = 1.55, 2.0, 3.0, 5.0
"""Σ|x - x̄|⁴ N/(Σ|x - x̄|²)² is 1 to 4/3 on caps, 9/5 at most on arcs, and 5/3 at most where the noise is large. Above
the first of these and the last over N, points far from the rest may have drawn the fit to themselves, and left no
residual; above the second, one may carry the fit alone; above the third, there are some."""
_WELL_ABOVE = 3.0
"""Factor on an interval from which the fit is doubted."""
_EFFECT = 0.005
"""Least share of the residuals' variance, about, that structure explains in many points when the fit is doubted."""
_USUAL = 200
"""Number of points up to which everything that is seen matters."""
_MOST_NUMBERS = 500_000
"""Numbers of harmonics held at a time, which stay in a processor's cache."""


class Assumptions(NamedTuple):
    """Knowledge about the points that they cannot show.

    Attributes:
        ordered: the rows are in the order in which they were measured.
        sphere: the points lie on a sphere: their shape is not tested.
        radial: their noise is along the radius alone.
    """

    ordered: bool = False
    sphere: bool = False
    radial: bool = False

    @classmethod
    def of(cls, ordered: bool, assume: str | None, law: str = "isotropic") -> "Assumptions":
        """Check what a user says; a TypeError or ValueError names what cannot be used."""
        if isinstance(ordered, str):
            raise TypeError(f"ordered = {ordered!r}: expected True or False")
        if assume not in (None, "sphere"):
            raise ValueError(f"assume = {assume!r}: only 'sphere' can be assumed, or nothing, None")
        if law not in ("isotropic", "radial"):
            raise ValueError(f"law = {law!r}: 'isotropic' for noise alike in all directions, 'radial' along the radius")
        return cls(bool(ordered), assume == "sphere", law == "radial")


NOTHING = Assumptions()


class PointEvidence(NamedTuple):
    """Evidence in the residuals and places of the points of each set, and its consequences.

    Attributes:
        goodness: the tests, of which that of outliers is answered by `judge`.
        doubted: sets in which the model fails by enough to matter (b,).
        extreme: sets that may have outliers (b,): by their largest residual, or because they have few points.
        ratio: factors of at least 1 on the standard errors of white noise, of the centre and the radius (b, d + 1).
        freedom: degrees of freedom of Student's t that goes with them (b, d + 1); infinite for white noise.
        kurtosis: N Σ|x - x̄|⁴/(Σ|x - x̄|²)² of the points, less what chance adds (b,).
    """

    goodness: Goodness
    doubted: Bools
    extreme: Bools
    ratio: Floats
    freedom: Floats
    kurtosis: Floats

    @property
    def hinge(self) -> Bools:
        """True for sets in space that lie on a circle (b,)."""
        return np.asarray(self.goodness.answers[HINGE] == Answer.FAILED)

    @property
    def spread(self) -> Bools:
        """True for sets in which points may lie so far from the rest that they are outliers without a residual (b,)."""
        return self.kurtosis > _PEAKED

    def stretch(self, level: float, spare: Ints) -> Floats:
        """Factors on the half-widths of intervals with ``spare`` (b,) degrees of freedom (b, d + 1); 1 if no structure.

        Args:
            level: nominal coverage.
            spare: degrees of freedom of the noise of each set.
        """
        factors, quantile = np.ones_like(self.ratio), 0.5 * (1.0 + level)
        sets = np.flatnonzero((self.ratio > 1.0).any(axis=1))
        ends = stdtrit(spare[sets, None].astype(float), quantile)
        wide = stdtrit(np.minimum(self.freedom[sets], spare[sets, None]), quantile)
        factors[sets] = np.maximum(self.ratio[sets] * wide / ends, 1.0)
        return factors


def gather(
    samples: Samples, assumed: Assumptions = NOTHING, spheres: Estimates | None = None, level: float = LEVEL
) -> PointEvidence:
    """Gather the evidence of each set of points.

    Args:
        samples: the points (b, d, n) with their weights, missing ones as NaN, copies left out.
        assumed: of the points.
        spheres: whose residuals are looked at; None for free fits of the points by `corrected`.
        level: at which the tests of one set doubt it.

    Source: theory §13.
    """
    b, d, _ = samples.shape
    no, white = np.zeros((2, b), dtype=np.bool_), (np.ones((b, d + 1)), np.full((b, d + 1), np.inf))
    result = PointEvidence(Goodness.untested((b,), Answer.NO_SPHERE), no[0], no[1], *white, np.zeros(b))
    answers = result.goodness.answers
    ordinary = samples.given is None and is_ordinary(samples.moments.fourth)
    for sets, present, power in [(np.arange(b), samples, 0)] if ordinary else samples.alike():
        n = present.shape[2]
        finite = np.isfinite(present.moments.fourth) if n else np.ones(len(sets), dtype=np.bool_)
        if n < d + 2 or not finite.any():
            answers[:, sets[finite]] = int(Answer.TOO_FEW)
            continue
        sets, present = sets[finite], present if finite.all() else present.take(np.flatnonzero(finite))
        with np.errstate(all="ignore"):
            if spheres is None or power:
                mine = free_sphere(present)
            else:
                mine = Estimates._make([array[sets] for array in spheres])
            if d == 3:
                answers[HINGE, sets] = hinges(present, mine if present.weights is None else corrected(present))
            square = np.einsum("bii->b", present.moments.second)
            result.kurtosis[sets] = n * present.moments.fourth / square**2 - _BY_CHANCE / n
        tested = evenly_thinned(present)
        size = max(_MOST_NUMBERS // (25 * tested.shape[2]), 1)
        for some in (np.arange(i, min(i + size, len(sets))) for i in range(0, len(sets), size)):
            own = Estimates._make([array[some] for array in mine])
            _look(present.take(some), tested.take(some), own, assumed, level, _Part(result, sets[some]))
    if d != 3:
        answers[HINGE] = int(Answer.NOT_IN_SPACE)
    return result


class _Part(NamedTuple):
    """Places (k,) of some sets in the evidence of all."""

    evidence: PointEvidence
    sets: Ints


def _look(
    samples: Samples, tested: Samples, spheres: Estimates, assumed: Assumptions, level: float, part: _Part
) -> None:
    """Test some complete sets, and fill in their places in the evidence."""
    (_, d, n), (result, sets) = samples.shape, part
    with np.errstate(all="ignore"):
        about = Residuals.about(tested.x, spheres, tested.weights, highest_degree(tested.shape[2], d))
        spare, ordered = n - d - 1, assumed.ordered
        seen = see(about.shrunk() if assumed.radial else about, ordered)
        answer = seen.goodness
        if assumed.sphere:
            answer.shape[:], answer.visible_form[:] = np.nan, np.nan
            answer.answers[SHAPE, answer.answers[SHAPE] != Answer.NO_SPHERE] = int(Answer.ASSUMED)
        for whole, values in zip(
            (*result.goodness[:4], result.goodness.visible_form), (*answer[:4], answer.visible_form), strict=True
        ):
            whole[sets] = values
        result.goodness.answers[: len(BLOCKS), sets] = answer.answers[: len(BLOCKS)]
        fitted = np.isfinite(seen.largest)
        result.goodness.answers[OUTLIERS, sets] = np.where(fitted, Answer.PASSED, answer.answers[MEMORY])
        result.extreme[sets] = fitted & ((spare < _FEW) | _extreme(seen.largest, tested.shape[2], d))
        speaks, strong = answer.speaks(level), answer.speaks(level * math.exp(-_EFFECT * max(n - _USUAL, 0)))
        matters = strong[0] | strong[1] | (strong[3] & (not ordered)) | (strong[2] & ~seen.harmless)
        matters &= ~(ordered & (answer.first(level) == "memory"))  # which the errors allow for
        structured = np.asarray(speaks[[0, 1, 3]].any(axis=0))
        where = np.flatnonzero(fitted & (ordered | structured))
        if len(where):
            some, own = samples.take(where), Estimates._make([array[where] for array in spheres])
            ratio, freedom = _allowance(Residuals.about(some.x, own, some.weights, 2), ordered, structured[where])
            result.ratio[sets[where]], result.freedom[sets[where]] = ratio, freedom
        wide = result.stretch(0.95, np.full(len(result.ratio), spare))[sets]
    result.doubted[sets] = matters | (wide > _WELL_ABOVE).any(axis=1)


def _extreme(largest: Floats, n: int, d: int) -> Bools:
    """True where the largest of n studentised residuals is beyond Grubbs' limit (b,)."""
    spare = n - d - 1.0
    q = stdtrit(spare - 1.0, 1.0 - 0.5 * _GRUBBS / n)
    return np.asarray(largest > q * np.sqrt(spare / (spare - 1.0 + q * q)))


def _allowance(residuals: Residuals, ordered: bool, speaks: Bools) -> tuple[Floats, Floats]:
    """Factors on the standard errors of fitted sets, and their degrees of freedom (b, d + 1); the largest counts.

    Args:
        residuals: with harmonics up to degree 2.
        ordered: the rows are in the order in which they were measured: errors then hold for the worst plausible memory.
        speaks: sets of which the test of fit sees structure (b,).
    """
    (b, n), d = residuals.R.shape, residuals.dimension
    Y, over = residuals.weighted(residuals.Y), residuals.weighted(residuals.R - 1.0)
    X, spare = Y[:, : d + 1], n - d - 1
    inverse = np.linalg.inv(X @ X.swapaxes(1, 2))
    pull = (inverse @ X)[:, np.r_[1 : d + 1, 0]]  # (c, r) = pull ρ to first order
    rho = over - (over[:, None] @ X.swapaxes(1, 2) @ inverse @ X)[:, 0]
    weight = np.einsum("bkn,bkn->bk", pull, pull)
    white = weight * (np.einsum("bn,bn->b", rho, rho) / spare)[:, None]
    ratio, freedom, best = (
        np.ones((b, d + 1)),
        np.full((b, d + 1), np.inf),
        np.full((b, d + 1), float(stdtrit(spare, _UPPER))),
    )

    def admit(variance: Floats, free: Floats, sets: Bools) -> None:
        width = np.sqrt(variance / white) * stdtrit(free, _UPPER)
        larger = (width > best) & sets[:, None]
        best[larger], ratio[larger] = width[larger], np.sqrt(variance / white)[larger]
        freedom[larger] = np.broadcast_to(free, (b, d + 1))[larger]

    gram = Y[:, d + 1 :] - Y[:, d + 1 :] @ X.swapaxes(1, 2) @ inverse @ X
    form, count, _ = form_of((gram @ rho[:, :, None])[:, :, 0], gram @ gram.swapaxes(1, 2), max(spare // 3, 2))
    admit(weight * (form / count)[:, None], count[:, None].astype(float), speaks)
    leverage = np.einsum("bkn,bkl,bln->bn", X, inverse, X, optimize=True)
    squares = np.full((b, 1), float(spare))
    admit((pull**2 @ ((rho / (1.0 - leverage)) ** 2)[:, :, None])[:, :, 0], squares, speaks)
    if ordered:
        places = np.pi * np.outer(np.arange(1, _COSINES + 1), (np.arange(n) + 0.5) / n)
        along = (pull * rho[:, None]) @ np.cos(places).T * np.sqrt(2.0)
        admit((along**2).mean(axis=2), np.full((b, 1), float(_COSINES)), speaks)
        admit(_remembering(X, rho, pull), squares, np.ones(b, dtype=np.bool_))
    return np.maximum(ratio, 1.0), freedom


_MEMORIES = np.append(np.arange(0.0, 0.8, 0.05), [0.8, 0.83, 0.86, 0.89, 0.92, 0.94, 0.96, 0.98])
"""Memories from row to row that are tried."""
_PLAUSIBLE = 1.35
"""Largest fall of the log-likelihood from its maximum of a memory that is plausible: half the .90 quantile of χ² with
one degree of freedom, .95 on one side."""


def _remembering(X: Floats, rho: Floats, pull: Floats) -> Floats:
    """Variances (b, k) of ``pull`` ρ for noise that remembers from row to row, for the worst plausible memory.

    Noise of the model eᵢ = φ eᵢ₋₁ + white noise; φ is judged by the restricted likelihood of the residuals (b, n) of a
    regression on X (b, k, n).

    Source: Harville, J. Amer. Statist. Assoc. 72 (1977) 320.
    """
    from scipy.signal import lfilter  # takes as long to load as the rest of the library

    (b, k, n), rows = X.shape, np.concatenate([X, rho[:, None]], axis=1)
    likelihood, variance = np.empty((len(_MEMORIES), b)), np.empty((len(_MEMORIES), b, k))
    for place, phi in enumerate(_MEMORIES):
        white = np.concatenate(
            [math.sqrt(1.0 - phi * phi) * rows[..., :1], rows[..., 1:] - phi * rows[..., :-1]], axis=2
        )
        gram = white @ white.swapaxes(1, 2)
        slopes = np.linalg.solve(gram[:, :k, :k], gram[:, :k, k:])
        left = (gram[:, k:, k:] - gram[:, k:, :k] @ slopes)[:, 0, 0]
        logdet = np.linalg.slogdet(gram[:, :k, :k])[1]
        likelihood[place] = -0.5 * ((n - k) * np.log(left) - math.log1p(-phi * phi) + logdet)
        before = lfilter([1.0], [1.0, -phi], pull, axis=2)  # Σ_{j≤i} φ^{i-j} of the weights
        size = (pull * (2.0 * before - pull)).sum(axis=2) / (1.0 - phi * phi)
        variance[place] = size * (left / (n - k))[:, None]
    plausible = likelihood >= likelihood.max(axis=0) - _PLAUSIBLE
    return np.asarray(np.where(plausible[..., None], variance, 0.0).max(axis=0))


def widened(white: Intervals, stretch: Floats, again: Callable[[Ints, Floats], Intervals]) -> Intervals:
    """Intervals of errors that allow for structure, where there is some.

    The score of the radius is inverted anew, at a larger quantile. The ends of a coordinate of the centre, which come
    with it, are moved by its own factor.

    Args:
        white: intervals for white noise.
        stretch: factors of `PointEvidence.stretch` (b, d + 1).
        again: forms the intervals of some sets (k,) with factors on their quantiles (k,).
    """
    sets = np.flatnonzero((stretch > 1.0).any(axis=1))
    if not len(sets):
        return white
    radius, center, share = (array.copy() for array in white)
    of_radius = stretch[sets, -1]
    longer = again(sets, of_radius)
    with np.errstate(all="ignore"):
        middle = longer.center.mean(axis=2, keepdims=True)
        ends = middle + (longer.center - middle) * (stretch[sets, :-1] / of_radius[:, None])[:, :, None]
    center[sets] = np.where(np.isfinite(longer.center), ends, longer.center)
    radius[sets] = longer.radius
    return Intervals(radius, center, share)


LARGEST_UNSEEN = 2.0
"""Size of a form, in σ, up to which the shape has *passed* if the test finds such a form in half of the sets. A form of
that size moves a fit by several times its errors; points that could hide a larger one are *not tested*."""


def judge(
    evidence: PointEvidence,
    samples: Samples,
    status: Ints,
    ends: Intervals | None,
    assumed: Assumptions,
    without_outliers: bool,
    visible: Floats | None = None,
) -> tuple[Ints, Goodness]:
    """The status of each fit (b,) after what its points show, and the answers of all tests.

    Args:
        evidence: of the points.
        samples: the points that the fits stand on (b, d, n), copies left out.
        status: by the intervals (b,).
        ends: the intervals at 95 %; None where the points need not bound a sphere alone.
        assumed: of the points.
        without_outliers: the estimator has left outliers out.
        visible: size of a form, in σ, that a known noise shows in half of such sets (b,); None if none is known.
    """
    result, answers = status.copy(), evidence.goodness.answers.copy()
    form = evidence.goodness.visible_form
    form = form if visible is None else np.fmin(form, visible)
    blind = (answers[SHAPE] == Answer.PASSED) & ~(form <= LARGEST_UNSEEN)
    answers[SHAPE, blind] = int(Answer.TOO_FEW)
    placed = (status != Status.TOO_FEW_POINTS) & (status != Status.NOT_FINITE) & (status != Status.FAILED)
    result[evidence.hinge & placed] = Status.HINGE
    result[(result == Status.OK) & evidence.doubted] = Status.MISFIT
    if not without_outliers:
        _search(evidence, samples, assumed, result, answers)
        if ends is not None:
            _remove_farthest(evidence, samples, ends, result)
    weak = (result == Status.WEAKLY_IDENTIFIED) | (result == Status.INSIGNIFICANT)  # maybe by what is allowed for
    result[weak & evidence.doubted] = Status.MISFIT
    shape = answers[SHAPE]
    untested = (shape == Answer.TOO_FEW) | (shape == Answer.TOO_NOISY) | (shape == Answer.NO_SPHERE)
    untested |= (answers[HINGE] == Answer.TOO_FEW) & (shape != Answer.ASSUMED)
    result[(result == Status.OK) & untested] = Status.UNTESTED
    return result, evidence.goodness._replace(answers=answers, visible_form=form)


def _search(evidence: PointEvidence, samples: Samples, assumed: Assumptions, result: Ints, answers: Ints) -> None:
    """Search outliers where something hints at them, and write what follows into statuses (b,) and answers (6, b)."""
    fitted = ((result == Status.OK) | (result == Status.MISFIT)) & (evidence.extreme | evidence.spread)
    fitted |= ((result == Status.WEAKLY_IDENTIFIED) | (result == Status.INSIGNIFICANT)) & evidence.spread
    fitted |= (evidence.kurtosis > _FAR) & (result == Status.HINGE)  # an arc's ends lie far from its middle, too
    searched = np.flatnonzero(fitted)
    if not len(searched):
        return
    part = evenly_thinned(samples.take(searched))
    named = outliers_of(part)
    guilty = np.flatnonzero(named.any(axis=1))
    if not len(guilty):
        return
    answers[OUTLIERS, searched[guilty]] = int(Answer.FAILED)
    rest = part.take(guilty).without(named[guilty])
    misfit = result[searched[guilty]] == Status.MISFIT
    matter = influence(part.take(guilty), named[guilty]) > INFLUENCE
    if misfit.any():  # is it the outliers alone that make the model fail?
        matter[misfit] = ~gather(rest.take(np.flatnonzero(misfit)), assumed).doubted
    result[searched[guilty[matter]]] = Status.OUTLIERS


INFLUENCE = 1.5
"""Standard errors by which outliers move a fit from which on they matter. Of noise by Student's t with 4 degrees of
freedom, N = 60 to 300, outliers are named in 0.3 to 0.8 of the sets, and 0.9 of these are moved by less; intervals
cover in 0.94 to 0.97."""
_FREE = Estimator(free_sphere)


def influence(samples: Samples, named: Bools) -> Floats:
    """Largest change of the centre or the radius without the named points (b, n), in standard errors without them (b,).

    Infinite where there is no fit without them.
    """
    rest = samples.without(named)
    fits = [careful_fit(_FREE, points.with_ratios()) for points in (samples, rest)]
    with np.errstate(all="ignore"):
        before, after = (np.column_stack([fit.center, fit.radius]) for fit in fits)
        away = rest.x - fits[1].center[:, :, None]
        directions = away / np.sqrt(np.square(away).sum(axis=1, keepdims=True))
        variances = plug_in_bound(directions, np.isfinite(directions).all(axis=1), None, fits[1].noise_variance)
        moved = np.abs(after - before) / np.sqrt(np.einsum("bii->bi", variances))
    return np.asarray(np.nan_to_num(moved, nan=np.inf).max(axis=1))


_ROUNDS = 10
"""Most rounds in which points with a noise of their own are left out and taken in again."""


def outliers_of(samples: Samples) -> Bools:
    """Outliers (b, n), in units of each point's noise where these differ."""
    if samples.weights is None or samples.even.all():
        return outliers(samples)
    named = _weighted_outliers(samples.with_ratios())
    if (even := samples.even).any():
        named[even] = outliers(samples.take(np.flatnonzero(even)))
    return named


def _weighted_outliers(samples: Samples) -> Bools:
    """Outliers (b, n) among points with weights: residuals beyond Student's limit for the largest of n.

    The sphere is fitted to the others, until these stay the same; it begins with the median of the residuals as noise.
    In about 1 % of clean sets a point is named.
    """
    b, d, n = samples.shape
    weights = samples.weights
    assert weights is not None
    named, before = np.zeros((b, n), dtype=np.bool_), None
    for turn in range(_ROUNDS):
        for sets, rest in samples.without(named).by_count():
            spare = rest.shape[2] - d - 1
            if spare < 2:
                continue
            with np.errstate(all="ignore"):
                sphere, x = free_sphere(rest), samples.x[sets]
                away = np.sqrt(np.square(x - sphere.center[:, :, None]).sum(axis=1)) - sphere.radius[:, None]
                size = np.where(np.isfinite(sphere.radius)[:, None], np.abs(away) * np.sqrt(weights[sets]), 0.0)
                sigma = np.sqrt(sphere.noise_variance)
                sigma = np.minimum(sigma, np.nanmedian(size, axis=1) / 0.6745) if turn == 0 else sigma
                named[sets] = size > sigma[:, None] * stdtrit(spare, 1.0 - 0.5 * FALSE_ALARMS / n)
        if before is not None and np.array_equal(before, named):
            break
        before = named.copy()
    return named


def _remove_farthest(evidence: PointEvidence, samples: Samples, ends: Intervals, result: Ints) -> None:
    """Doubt fits (b,) whose radius the farthest point alone carries."""
    free = ends.radius[:, 0] < ends.radius[:, 1]  # a known radius needs no point to carry it
    alone = np.flatnonzero((evidence.kurtosis > _SINGLE) & free & (result == Status.OK))
    if not len(alone):
        return
    part = samples.take(alone)
    away = np.square(part.x - np.nanmean(part.x, axis=2, keepdims=True)).sum(axis=1)
    without, radius = intervals(part.without(away == np.nanmax(away, axis=1, keepdims=True))), ends.radius[alone]
    apart = (without.radius[:, 0] > radius[:, 1]) | (without.radius[:, 1] < radius[:, 0])
    result[alone[apart]] = Status.OUTLIERS
    result[alone[~without.identified]] = Status.WEAKLY_IDENTIFIED

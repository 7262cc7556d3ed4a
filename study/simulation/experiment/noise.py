"""The mechanisms that ship: laws of directions, of noise, of outliers and of coordinates, and the Gaussian bound.

Gaussian noise of any covariance is a class with its bound. Every other law is a function that gives its answer for the
trials of a batch (`Trials`), and takes its numbers after them; `study.simulation.experiment.laws` lists them by name.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from study.arrays import Floats
from study.fits.loops.jit import CHUNK
from study.fits.loops.random import Name
from study.fits.points.information import bound_from_scatter, normal_weights, weighted_scatter

Further = Callable[[Name, Callable[[np.random.Generator, int], Floats]], Floats]
"""Draws further random numbers of the trials of a batch (b, …), always the same ones, which changes no others.

Its arguments are the last part of the names of the streams, which distinguishes these numbers from others, and a
function that gives numbers of so many trials (trials, …) from a generator; see `Draws.further`.
"""


class Trials(NamedTuple):
    """Trials of a batch, as a law sees them.

    Attributes:
        values: numbers that the law changes (b, d, n), in fresh memory: for noise and outliers the noise at σ = 1,
            which is standard normal if no other law came before; for directions those by area, as ``heights``; for
            coordinates the points about the true centre, in units of the radius.
        heights: unit vectors of the samples (b, d, n), with the height 1 - u₁ in place of u₁.
        half_angle: φ, the half-angle of the cap in radians.
        further: draws further random numbers, from streams of their own, so that a law changes no other number.
    """

    values: Floats
    heights: Floats
    half_angle: float
    further: Further

    @property
    def directions(self) -> Floats:
        """Unit vectors of the samples (b, d, n)."""
        u = self.heights.copy()
        np.subtract(1.0, u[:, 0], out=u[:, 0])
        return u

    def only(self, trial: int) -> "Trials":
        """One of the trials, by its place."""
        part = slice(trial, trial + 1)

        def further(kind: Name, numbers: Callable[[np.random.Generator, int], Floats]) -> Floats:
            return self.further(kind, numbers)[part]

        return Trials(self.values[part], self.heights[part], self.half_angle, further)


@dataclass(frozen=True)
class GaussianNoise:
    """Normal noise of a sample, of any size σ.

    Attributes:
        dimension: number of coordinates d.
        shape: covariance of a sample in units of σ², as rows of numbers (d, d); None for the identity.
    """

    dimension: int
    shape: tuple[tuple[float, ...], ...] | None = None

    @property
    def isotropic(self) -> bool:
        """True if the covariance is σ² I; estimators then take σ."""
        return self.shape is None

    @property
    def words(self) -> str:
        """The law in words, for a reader."""
        return "the same noise in all directions" if self.isotropic else "noise not the same in all directions"

    def unit_noise(self, normals: Floats) -> Floats:
        """Noise at σ = 1 (b, d, n): standard normal numbers of the same shape, times Cholesky's root of the shape."""
        return normals if self.isotropic else np.asarray(np.linalg.cholesky(self._matrix) @ normals)

    def covariance(self, sigma: float) -> Floats:
        """Covariance of a sample (d, d)."""
        return sigma**2 * self._matrix

    def given(self, sigma: float) -> float | Floats:
        """The noise as an argument of estimators: σ, or the covariance (d, d) if it is not isotropic."""
        return sigma if self.isotropic else self.covariance(sigma)

    def unit_bound(self, directions: Floats) -> Floats:
        """The Cramér-Rao bound of (c, r) at σ = 1 for these directions (b, d+1, d+1).

        Args:
            directions: unit vectors (b, d, n), with the height 1 - u₁ in place of u₁.
        """
        if self.isotropic:
            weights = np.ones((1, CHUNK))  # a row of n would be read from memory
            return bound_of_heights(*weighted_scatter(directions, weights))
        u = directions.swapaxes(1, 2).copy()
        u[:, :, 0] = 1.0 - u[:, :, 0]
        return bound_of_heights(*weighted_scatter(directions, normal_weights(u, self._matrix)))

    @cached_property
    def _matrix(self) -> Floats:
        return np.eye(self.dimension) if self.shape is None else np.array(self.shape)


def gaussian(shape: tuple[tuple[float, ...], ...] | None, dimension: int) -> GaussianNoise:
    """The Gaussian law of a covariance.

    Args:
        shape: covariance of a sample in units of σ² (d, d); the identity if None.
        dimension: d.
    """
    equal = shape is None or np.array_equal(shape, np.eye(dimension))
    return GaussianNoise(dimension, None if equal else shape)


def bound_of_heights(sums: Floats, mean: Floats, scatter: Floats) -> Floats:
    """The bound at σ = 1 from the sums of `weighted_scatter`, which are changed, of directions with 1 - u₁ for u₁.

    It is exact at tiny angles, because it is formed from heights: the sign of u₁ drops out of the variances,
    and its offset from the mean.
    """
    scatter[:, 0, 1:] *= -1.0
    scatter[:, 1:, 0] *= -1.0
    mean[:, 0] = 1.0 - mean[:, 0]
    return bound_from_scatter(sums, mean, scatter)


def laplace(trials: Trials) -> Floats:
    """Independent coordinates of density e^{-√2 |x|}/√2: variance 1, excess kurtosis 3.

    The law of a sample is not the same in every direction: it reaches farther along the axes. The quantile of a normal
    number z in this law is -sign(z) (ln 2 + ln Φ(-|z|))/√2, which is exact in the tails.
    """
    z = trials.values
    return np.asarray(-np.sign(z) * (math.log(2.0) + scipy.special.log_ndtr(-np.abs(z))) * math.sqrt(0.5))


def uniform(trials: Trials) -> Floats:
    """Independent coordinates uniform on [-√3, √3]: variance 1, excess kurtosis -6/5.

    The law of a sample is not the same in every direction: it fills a cube along the axes. The quantile of a normal
    number z in this law is √3 (2Φ(z) - 1) = √3 erf(z/√2).
    """
    return np.asarray(math.sqrt(3.0) * scipy.special.erf(math.sqrt(0.5) * trials.values))


def student(trials: Trials, freedom: float) -> Floats:
    """Multivariate t noise of ν > 2 degrees of freedom, scaled to the covariance I; below there is none.

    The coordinates of a sample share one χ² number of ν degrees of freedom: z √((ν - 2)/χ²). So its law is the same in
    every direction, and a sample is far off in all coordinates together. Each coordinate is a t number times
    √((ν - 2)/ν), whose excess kurtosis is 6/(ν - 4) for ν > 4 and infinite below.
    """
    n = trials.values.shape[2]
    square = trials.further(("student", freedom), lambda g, count: g.chisquare(freedom, (count, n)))
    square /= freedom - 2.0
    return trials.values / np.sqrt(square)[:, None]


def radial(trials: Trials) -> Floats:
    """Noise along the radius alone, (u·z) u: a sample is at c + (r + σ ε) u, ε a standard normal number.

    Its covariance is σ² u uᵀ, over a whole sphere σ² I/d on average, so it is not of covariance σ² I. The bound of
    isotropic noise of the same σ holds for it too: only the component along the radius counts there (theory 3.1).
    """
    u = trials.directions
    return np.asarray(np.einsum("bdn,bdn->bn", u, trials.values)[:, None] * u)


def rim(trials: Trials, growth: float) -> Floats:
    """Noise that grows to the rim of the cap: σ at its pole, and in proportion to the height up to k σ at its rim.

    It is z times 1 + (k - 1) (1 - cos θ)/(1 - cos φ), θ the angle of a sample to the axis.
    """
    share = trials.heights[:, :1] / (2.0 * math.sin(0.5 * trials.half_angle) ** 2)
    return np.asarray(trials.values * (1.0 + (growth - 1.0) * share))


def memory(trials: Trials, correlation: float) -> Floats:
    """Noise that remembers: a stationary autoregressive process of order 1 along the samples, of covariance I.

    It is yᵢ = ρ yᵢ₋₁ + √(1 - ρ²) zᵢ, begins with y₁ = z₁, and ρ is the correlation of neighbours.
    """
    steps = trials.values * math.sqrt(1.0 - correlation**2)
    steps[:, :, 0] = trials.values[:, :, 0]
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -correlation], steps, axis=2))


_COSINES = 300


def form(trials: Trials, length: float, size: float) -> Floats:
    """An error of form: distances from the centre differ by a smooth random function of the direction.

    The function is a Gaussian process of covariance s² exp(-|u - v|²/2l²), s in units of σ and l in half-angles of the
    cap. It is formed of so many cosines of random frequencies and phases that it is normal to three digits (Rahimi &
    Recht 2008). Each trial has its own.
    """
    u, noise = trials.directions, trials.values
    b, d, _ = noise.shape
    kind = ("form", length)
    waves = trials.further((*kind, "waves"), lambda g, count: g.standard_normal((count, _COSINES, d)))
    phases = trials.further((*kind, "phases"), lambda g, count: g.uniform(0.0, 2.0 * math.pi, (count, _COSINES)))
    result = np.empty_like(noise)
    for trial in range(b):
        angle = waves[trial] @ u[trial] / (length * trials.half_angle) + phases[trial, :, None]
        displacement = size * math.sqrt(2.0 / _COSINES) * np.cos(angle).sum(axis=0)
        result[trial] = noise[trial] + displacement * u[trial]
    return result


def any_direction(trials: Trials, size: float) -> Floats:
    """Displacements by a given distance in σ, in a direction uniform on the sphere.

    With them the covariance of a sample grows by share × size² σ²/d I. Outliers of other sizes have the same
    directions.
    """
    _, d, n = trials.values.shape
    away = trials.further(("outliers", "direction"), lambda g, count: g.standard_normal((count, d, n)))
    return np.asarray((size / np.sqrt(np.einsum("bdn,bdn->bn", away, away)))[:, None] * away)


def along_radius(trials: Trials, least: float, most: float) -> Floats:
    """Displacements along the radius, inwards or outwards alike, by a distance uniform between two in σ."""
    n = trials.values.shape[2]
    number = trials.further(("outliers", "radius"), lambda g, count: g.uniform(-1.0, 1.0, (count, n)))
    return np.asarray((np.sign(number) * (least + (most - least) * np.abs(number)))[:, None] * trials.directions)


def outliers(trials: Trials, share: float, displacement: Floats) -> Floats:
    """Noise in which each sample is displaced with some probability.

    The outliers of a smaller share are among those of a larger one: a sample is one where a uniform number of its own
    is below the share.

    Args:
        trials: with noise.
        share: the probability.
        displacement: of each sample, if it is an outlier (b, d, n).
    """
    number = trials.further(("outliers", "choice"), lambda g, count: g.random((count, trials.values.shape[2])))
    return np.asarray(trials.values + np.where((number < share)[:, None], displacement, 0.0))


def _heights(angle: Floats, across: Floats, shape: tuple[int, ...]) -> Floats:
    """Unit vectors at an angle to the first axis, with the height 1 - u₁ in place of u₁.

    Args:
        angle: of each sample, in radians (b, n) or (n,).
        across: unit vectors across the axis (b, d - 1, n), or (d - 1, n), or 1 in the plane.
        shape: of the answer (b, d, n).
    """
    result = np.empty(shape)
    result[:, 1:] = across
    result[:, 1:] *= np.sin(angle)[..., None, :]
    result[:, 0] = 2.0 * np.sin(0.5 * angle) ** 2
    return result


def polar(trials: Trials) -> Floats:
    """Directions whose angle to the first axis is uniform, so that samples crowd about it."""
    _, d, n = shape = trials.values.shape
    angle = trials.half_angle * trials.further(("directions", "polar"), lambda g, count: g.random((count, n)))
    normals = trials.further(("directions", "across"), lambda g, count: g.standard_normal((count, d - 1, n)))
    return _heights(angle, normals / np.linalg.norm(normals, axis=1, keepdims=True), shape)


_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def spaced(trials: Trials) -> Floats:
    """Equally spaced directions, the same in every trial.

    In a plane they divide the arc, both ends included, or the whole circle; in space they lie on a spiral of equal
    areas, each turned from the one before by the golden angle (González 2010).
    """
    _, d, n = shape = trials.values.shape
    if d == 2:
        gaps = n if trials.half_angle == math.pi else n - 1  # a whole circle ends where it begins
        return _heights(trials.half_angle * (2.0 * np.arange(n) / gaps - 1.0), np.ones(n), shape)
    angle = 2.0 * np.arcsin(math.sin(0.5 * trials.half_angle) * np.sqrt((np.arange(n) + 0.5) / n))
    across = [np.cos(_GOLDEN_ANGLE * np.arange(n)), np.sin(_GOLDEN_ANGLE * np.arange(n))]
    return _heights(angle, np.array(across), shape)


_SWINGS, _TURN = 3, 0.31
"""A path swings so many times through the pole, and turns so many radians for each of its own."""


def path(trials: Trials) -> Floats:
    """Directions that follow each other as those of a marker do, the same in every trial.

    They swing through the axis, from rim to rim, in a plane that turns slowly.
    """
    _, d, n = shape = trials.values.shape
    time = 2.0 * math.pi * _SWINGS * (np.arange(n) + 0.5) / n
    across = [np.cos(_TURN * time), np.sin(_TURN * time)] if d == 3 else np.ones(n)
    return _heights(trials.half_angle * np.sin(time), np.array(across), shape)


def rounded(trials: Trials, spacing: float) -> Floats:
    """Coordinates rounded to a grid of a spacing in units of the radius, whose place is random in each trial."""
    d = trials.values.shape[1]
    place = spacing * trials.further(("coordinates", "grid"), lambda g, count: g.random((count, d, 1)))
    return np.asarray(spacing * np.round((trials.values - place) / spacing) + place)

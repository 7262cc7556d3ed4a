"""Laws of the noise: Gaussian ones with their bounds, and the steps that lead from normal noise to another kind.

A Gaussian law has any covariance. A step is a function that replaces normal noise by noise of another law, or adds
outliers. It takes

- the noise at σ = 1 (b, d, n): standard normal numbers, if no other step came before; it gives fresh memory;
- unit vectors of the samples (b, d, n), with the height 1 - u₁ in place of u₁;
- a function that draws further random numbers of the same trials (`Further`), from streams of their own, so that a step
  changes no other number;
- the half-angle of the cap in radians;
- its own numbers, such as the degrees of freedom.

Laws of the directions stand at the end: uniform by area on the cap unless a config says otherwise.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from study.arrays import Floats
from study.fits.bounds import bound_from_scatter, normal_weights, weighted_scatter
from study.fits.jit import CHUNK
from study.fits.random import Name

Further = Callable[[Name, Callable[[np.random.Generator, int], Floats]], Floats]
"""Draws further random numbers of the trials of a batch (b, …), always the same ones, which changes no others.

Its arguments are the last part of the names of the streams, which distinguishes these numbers from others, and a
function that gives numbers of so many trials (trials, …) from a generator; see `Draws.further`.
"""
Step = Callable[..., Floats]
"""A step that turns noise at σ = 1 into noise of another law."""


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
            return _bound(directions, np.ones((1, CHUNK)))  # a row of n would be read from memory
        u = directions.swapaxes(1, 2).copy()
        u[:, :, 0] = 1.0 - u[:, :, 0]
        return _bound(directions, normal_weights(u, self._matrix))

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


def _bound(directions: Floats, weights: Floats) -> Floats:
    """The bound at σ = 1 of directions (b, d, n) and weights of samples.

    It is exact at tiny angles, because it is formed from heights: the sign of u₁ drops out of the variances,
    and its offset from the mean.
    """
    sums, mean, scatter = weighted_scatter(directions, weights)
    scatter[:, 0, 1:] *= -1.0
    scatter[:, 1:, 0] *= -1.0
    mean[:, 0] = 1.0 - mean[:, 0]
    return bound_from_scatter(sums, mean, scatter)


def laplace(noise: Floats, directions: Floats, further: Further, half_angle: float) -> Floats:
    """Independent coordinates of density e^{-√2 |x|}/√2: variance 1, excess kurtosis 3.

    The law of a sample is not the same in every direction: it reaches farther along the axes. The quantile of a normal
    number z in this law is -sign(z) (ln 2 + ln Φ(-|z|))/√2, which is exact in the tails.
    """
    return np.asarray(-np.sign(noise) * (math.log(2.0) + scipy.special.log_ndtr(-np.abs(noise))) * math.sqrt(0.5))


def uniform(noise: Floats, directions: Floats, further: Further, half_angle: float) -> Floats:
    """Independent coordinates uniform on [-√3, √3]: variance 1, excess kurtosis -6/5.

    The law of a sample is not the same in every direction: it fills a cube along the axes. The quantile of a normal
    number z in this law is √3 (2Φ(z) - 1) = √3 erf(z/√2).
    """
    return np.asarray(math.sqrt(3.0) * scipy.special.erf(math.sqrt(0.5) * noise))


def student(noise: Floats, directions: Floats, further: Further, half_angle: float, freedom: float) -> Floats:
    """Multivariate t noise of ν > 2 degrees of freedom, scaled to the covariance I; below there is none.

    The coordinates of a sample share one χ² number of ν degrees of freedom: z √((ν - 2)/χ²). So its law is the same in
    every direction, and a sample is far off in all coordinates together. Each coordinate is a t number times
    √((ν - 2)/ν), whose excess kurtosis is 6/(ν - 4) for ν > 4 and infinite below.
    """
    n = noise.shape[2]
    square = further(("student", freedom), lambda g, trials: g.chisquare(freedom, (trials, n)))
    square /= freedom - 2.0
    return noise / np.sqrt(square)[:, None]


def radial(noise: Floats, directions: Floats, further: Further, half_angle: float) -> Floats:
    """Noise along the radius alone, (u·z) u: a sample is at c + (r + σ ε) u, ε a standard normal number.

    Its covariance is σ² u uᵀ, over a whole sphere σ² I/d on average, so it is not of covariance σ² I. The bound of
    isotropic noise of the same σ holds for it too: only the component along the radius counts there (theory 3.1).
    """
    u = upright(directions)
    return np.asarray(np.einsum("bdn,bdn->bn", u, noise)[:, None] * u)


def rim(noise: Floats, directions: Floats, further: Further, half_angle: float, growth: float) -> Floats:
    """Noise that grows to the rim of the cap: σ at its pole, and in proportion to the height up to k σ at its rim.

    It is z times 1 + (k - 1) (1 - cos θ)/(1 - cos φ), θ the angle of a sample to the axis.
    """
    share = directions[:, :1] / (2.0 * math.sin(0.5 * half_angle) ** 2)
    return np.asarray(noise * (1.0 + (growth - 1.0) * share))


def memory(noise: Floats, directions: Floats, further: Further, half_angle: float, correlation: float) -> Floats:
    """Noise that remembers: a stationary autoregressive process of order 1 along the samples, of covariance I.

    It is yᵢ = ρ yᵢ₋₁ + √(1 - ρ²) zᵢ, begins with y₁ = z₁, and ρ is the correlation of neighbours.
    """
    steps = noise * math.sqrt(1.0 - correlation**2)
    steps[:, :, 0] = noise[:, :, 0]
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -correlation], steps, axis=2))


def form(noise: Floats, directions: Floats, further: Further, half_angle: float, length: float, size: float) -> Floats:
    """An error of form: distances from the centre differ by a smooth random function of the direction.

    The function is a Gaussian process of covariance s² exp(-|u - v|²/2l²), s in units of σ and l in half-angles of the
    cap. It is formed of so many cosines of random frequencies and phases that it is normal to three digits (Rahimi &
    Recht 2008). Each trial has its own.
    """
    u, (b, d, _) = upright(directions), noise.shape
    kind = ("form", length)
    waves = further((*kind, "waves"), lambda g, trials: g.standard_normal((trials, _COSINES, d)))
    phases = further((*kind, "phases"), lambda g, trials: g.uniform(0.0, 2.0 * math.pi, (trials, _COSINES)))
    result = np.empty_like(noise)
    for trial in range(b):
        angle = waves[trial] @ u[trial] / (length * half_angle) + phases[trial, :, None]
        displacement = size * math.sqrt(2.0 / _COSINES) * np.cos(angle).sum(axis=0)
        result[trial] = noise[trial] + displacement * u[trial]
    return result


def outliers(
    noise: Floats, directions: Floats, further: Further, half_angle: float, share: float, size: float
) -> Floats:
    """Each sample is displaced with some probability, by a given distance in σ, in a direction uniform on the sphere.

    The covariance of a sample grows by share × size² σ²/d I. Studies that differ in share or size alone displace in the
    same directions, and the outliers of a smaller share are among those of a larger one: a sample is one where a
    uniform number of its own is below the share.
    """
    _, d, n = noise.shape
    number = further(("outliers", "choice"), lambda g, trials: g.random((trials, n)))
    away = further(("outliers", "direction"), lambda g, trials: g.standard_normal((trials, d, n)))
    length = np.where(number < share, size, 0.0) / np.sqrt(np.einsum("bdn,bdn->bn", away, away))
    return np.asarray(noise + length[:, None] * away)


_COSINES = 300


def upright(directions: Floats) -> Floats:
    """Unit vectors (b, d, n) of directions that have the height 1 - u₁ in place of u₁."""
    u = directions.copy()
    np.subtract(1.0, u[:, 0], out=u[:, 0])
    return u


class Law(NamedTuple):
    """A law of the noise besides the normal one.

    Attributes:
        step: from normal noise to this law.
        numbers: how many its word has, each above 0.
        below, above: limits of its first number, neither of which it may have.
        excess_kurtosis: of a coordinate, from its numbers; None unless the covariance is σ² I.
    """

    step: Step
    numbers: int = 0
    above: float = 0.0
    below: float = math.inf
    excess_kurtosis: Callable[..., float] | None = None


NORMAL = "normal"
RADIAL = "radial"
LAWS = {
    "laplace": Law(laplace, excess_kurtosis=lambda: 3.0),
    "uniform": Law(uniform, excess_kurtosis=lambda: -1.2),
    "student": Law(student, 1, above=2.0, excess_kurtosis=lambda nu: 6.0 / (nu - 4.0) if nu > 4.0 else math.inf),
    RADIAL: Law(radial),
    "rim": Law(rim, 1),
    "memory": Law(memory, 1, below=1.0),
    "form": Law(form, 2),
}
"""The laws besides the normal one, by the word before their numbers."""
RULE = (
    f"{NORMAL}, laplace, uniform, student(ν) with ν above 2, such as student(5), {RADIAL}, rim(k), memory(ρ) with ρ "
    "below 1, or form(length, size)"
)
SIZE = 10.0
"""Length of an outlier's displacement in units of σ, where a config gives none."""


def law_of(word: str) -> tuple[Law, list[float]] | None:
    """The law that a word names, and its numbers; None for the normal one, and for a word that is written as no law is.

    A number has one way of writing, so that a law has one name: ``student(5)``, not ``student(5.0)``.
    """
    match = re.fullmatch(r"([a-z]+)(?:\(([0-9.e+-]+(?:, [0-9.e+-]+)*)\))?", word)
    if match is None or match[1] not in LAWS:
        return None
    try:
        numbers = [float(number) for number in match[2].split(", ")] if match[2] else []
    except ValueError:
        return None
    law, written = LAWS[match[1]], f"({', '.join(f'{number:g}' for number in numbers)})" if numbers else ""
    known = word == match[1] + written and all(0.0 < v < math.inf for v in numbers) and len(numbers) == law.numbers
    return (law, numbers) if known and all(law.above < v < law.below for v in numbers[:1]) else None


def freedom(word: str) -> float | None:
    """The degrees of freedom ν of ``student(ν)``; None for another word, or if ν is not above 2."""
    law, numbers = law_of(word) or (None, [])
    return numbers[0] if law is LAWS["student"] else None


def excess_kurtosis(word: str) -> float:
    """The excess kurtosis of a coordinate, larger with heavier tails; not a number unless the covariance is σ² I."""
    law, numbers = law_of(word) or (None, [])
    if law is None or law.excess_kurtosis is None:
        return 0.0 if word == NORMAL else math.nan
    return law.excess_kurtosis(*numbers)


def has_equal_covariance(word: str) -> bool:
    """True if a word names a law of covariance σ² I."""
    return not math.isnan(excess_kurtosis(word))


def is_law(word: str) -> bool:
    """True if a word names a law."""
    return word == NORMAL or law_of(word) is not None


def departures(conditions: Mapping[str, Any]) -> list[tuple[Step, list[float]]]:
    """The steps that lead from normal noise to that of a cell: another law, then outliers; none for normal noise.

    Args:
        conditions: values of the conditions ``angle``, ``law``, ``outlier_share`` and ``outlier_size``, as far as they
            are not at their defaults; others do not matter.

    Returns:
        Each step with its last arguments, the half-angle and the numbers.
    """
    half_angle, steps = math.radians(conditions.get("angle", 180.0)), []
    if (law := law_of(conditions.get("law", NORMAL))) is not None:
        steps.append((law[0].step, [half_angle, *law[1]]))
    if (share := conditions.get("outlier_share", 0.0)) > 0.0:
        steps.append((outliers, [half_angle, share, conditions.get("outlier_size", SIZE)]))
    return steps


AREA, POLAR, SPACED, PATH = DIRECTIONS = ("area", "polar", "spaced", "path")
DIRECTIONS_RULE = "area, polar or, in two and three dimensions, spaced or path"
MOST_SPACED = 3
"""Largest dimension in which there are spaced directions, and paths."""
_SWINGS, _TURN = 3, 0.31
"""A path swings so many times through the pole, and turns so many radians for each of its own."""
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def place_directions(law: str, half_angle: float, directions: Floats, further: Further) -> None:
    """Replace directions, which are uniform by area on a cap, by those of another law.

    With ``polar`` the angle to the first axis is uniform, so that samples crowd about it. With ``spaced`` the
    directions are equally spaced and the same in every trial: in a plane they divide the arc, both ends included, or
    the whole circle; in space they lie on a spiral of equal areas, each turned from the one before by the golden angle
    (González 2010). With ``path`` they follow each other as those of a marker do: they swing through the axis, from rim
    to rim, in a plane that turns slowly.

    Args:
        law: one of `DIRECTIONS`.
        half_angle: φ in radians.
        directions: receives unit vectors (b, d, n), with the height 1 - u₁ in place of u₁.
        further: draws further random numbers of the same trials.
    """
    if law == AREA:
        return
    _, d, n = directions.shape
    across = directions[:, 1:]
    if law == POLAR:
        angle = half_angle * further(("directions", "polar"), lambda g, trials: g.random((trials, n)))
        normals = further(("directions", "across"), lambda g, trials: g.standard_normal((trials, d - 1, n)))
        across[...] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    elif law == PATH:
        time = 2.0 * math.pi * _SWINGS * (np.arange(n) + 0.5) / n
        angle = half_angle * np.sin(time)
        across[...] = [np.cos(_TURN * time), np.sin(_TURN * time)] if d == 3 else 1.0
    elif d == 2:
        gaps = n if half_angle == math.pi else n - 1  # a whole circle ends where it begins
        angle = half_angle * (2.0 * np.arange(n) / gaps - 1.0)
        across[...] = 1.0
    else:
        angle = 2.0 * np.arcsin(math.sin(0.5 * half_angle) * np.sqrt((np.arange(n) + 0.5) / n))
        across[...] = [np.cos(_GOLDEN_ANGLE * np.arange(n)), np.sin(_GOLDEN_ANGLE * np.arange(n))]
    across *= np.sin(angle)[..., None, :]
    directions[:, 0] = 2.0 * np.sin(0.5 * angle) ** 2

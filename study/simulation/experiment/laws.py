"""The registry of laws: of directions, noise, outliers and coordinates; a law of one's own is an entry like any other.

A config names a law with its numbers: ``law = "student(5)"``. A law of one's own comes from a file (``--plugin``) or a
program that calls `study.register_law`. Its function is called for one trial at a time, with random numbers of its own,
so that no other number of the study depends on it.
"""

import inspect
import math
import re
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from study.arrays import Floats
from study.files import RunError
from study.fits import registry
from study.fits.loops.random import Name, stream
from study.simulation.experiment import noise
from study.simulation.experiment.noise import Trials

NOISE, DIRECTIONS, OUTLIERS, COORDINATES = "noise", "directions", "outliers", "coordinates"
PLAIN = {NOISE: "normal", DIRECTIONS: "area", OUTLIERS: "any_direction", COORDINATES: "exact"}
"""The kinds of laws, each with the word that stands where no other law is asked for."""
_POSITIVE, _FINITE = (0.0, math.inf), (-math.inf, math.inf)


@dataclass(frozen=True)
class Law:
    """A law, as the registry lists it.

    Attributes:
        kind: noise, directions, outliers or coordinates.
        function: takes the trials of a batch and the law's numbers; returns what takes the place of `Trials.values`, or
            for outliers the displacement of each sample, if it is one.
        sentence: what it is.
        numbers: names of its numbers.
        example: numbers with which it is tried out.
        limits: of each number, neither of which it may have.
        reference: where it is described.
        most_dimension: largest dimension in which there is such a law.
        excess_kurtosis: of a coordinate, from the numbers; None unless it is noise of covariance σ² I.
    """

    kind: str
    function: Callable[..., Floats]
    sentence: str
    numbers: tuple[str, ...]
    example: tuple[float, ...]
    limits: tuple[tuple[float, float], ...]
    reference: str = ""
    most_dimension: float = math.inf
    excess_kurtosis: Callable[..., float] | None = None


def _law(
    kind: str,
    function: Callable[..., Floats],
    example: Sequence[float] = (),
    limits: Sequence[tuple[float, float]] = (),
    reference: str = "",
) -> Law:
    """A law of this package: its sentence and its numbers, which are positive unless limits are given, are its own."""
    numbers, sentence = _described(function)
    limits = tuple(limits) or (_POSITIVE,) * len(numbers)
    return Law(kind, function, sentence, numbers, tuple(example), limits, reference)


def _described(function: Callable[..., object]) -> tuple[tuple[str, ...], str]:
    """Names of the parameters of a law besides the first, and its sentence."""
    names = tuple(inspect.signature(function).parameters)[1:]
    return names, " ".join((inspect.getdoc(function) or "").partition("\n\n")[0].split())


_RECHT = "Rahimi & Recht 2008"
LAWS: dict[str, Law] = {
    "laplace": replace(_law(NOISE, noise.laplace), excess_kurtosis=lambda: 3.0),
    "uniform": replace(_law(NOISE, noise.uniform), excess_kurtosis=lambda: -1.2),
    "student": replace(
        _law(NOISE, noise.student, [5.0], [(2.0, math.inf)]),
        excess_kurtosis=lambda nu: 6.0 / (nu - 4.0) if nu > 4.0 else math.inf,
    ),
    "radial": _law(NOISE, noise.radial),
    "rim": _law(NOISE, noise.rim, [4.0]),
    "memory": _law(NOISE, noise.memory, [0.9], [(0.0, 1.0)]),
    "form": _law(NOISE, noise.form, [0.4, 1.0], reference=_RECHT),
    "polar": _law(DIRECTIONS, noise.polar),
    "spaced": replace(_law(DIRECTIONS, noise.spaced, reference="González 2010"), most_dimension=3),
    "path": replace(_law(DIRECTIONS, noise.path), most_dimension=3),
    "any_direction": _law(OUTLIERS, noise.any_direction, [10.0]),
    "along_radius": _law(OUTLIERS, noise.along_radius, [5.0, 20.0]),
    "rounded": _law(COORDINATES, noise.rounded, [0.1]),
}
"""The laws by name, the word before their numbers, besides those of `PLAIN`."""
SIZE = 10.0
"""Length of an outlier's displacement in units of σ, where a config gives none."""


def written(name: str, numbers: Iterable[float]) -> str:
    """A law as a config has it: ``student(5)``."""
    texts = ", ".join(f"{number:g}" for number in numbers)
    return f"{name}({texts})" if texts else name


OF_YOUR_OWN = "one of your own needs its file: --plugin FILE, in Python plugins=[FILE]"
"""Remedy for a name that nobody knows."""


def raised(error: BaseException, function: Callable[..., object]) -> str:
    """The exception that a user's own function raised, with the line of its file, where that is known."""
    file = getattr(getattr(function, "__code__", None), "co_filename", None)
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return (f"{Path(file).name}, line {lines[-1]}: " if file and lines else "") + registry.one_line(error)


def rule(kind: str) -> str:
    """The laws of a kind in words, for a message."""
    words = [PLAIN[kind], *(_form(name, law) for name, law in LAWS.items() if law.kind == kind)]
    between = "; " if any("," in word for word in words) else ", "
    return f"{between.join(words[:-1])} or {words[-1]}"


def _form(name: str, law: Law) -> str:
    """A law with its numbers, their limits and an example: ``rim(growth), such as rim(4)``."""
    if not law.numbers:
        return name
    limits = ""
    for number, (low, high) in zip(law.numbers, law.limits, strict=True):
        limits += f" with {number} above {low:g}" * (low > 0.0) + f" with {number} below {high:g}" * (high < math.inf)
    return f"{name}({', '.join(law.numbers)}){limits}, such as {written(name, law.example)}"


def law_of(kind: str, word: str) -> tuple[Law, list[float]] | None:
    """The law that a word names, and its numbers; None for a plain word, and for one that is written as no law is.

    A number has one way of writing, so that a law has one name: ``student(5)``, not ``student(5.0)``.
    """
    match = re.fullmatch(r"([a-z][a-z0-9_]*)(?:\(([0-9.e+-]+(?:, [0-9.e+-]+)*)\))?", word)
    law = LAWS.get(match[1]) if match else None
    if match is None or law is None or law.kind != kind:
        return None
    try:
        numbers = [float(number) for number in match[2].split(", ")] if match[2] else []
    except ValueError:
        return None
    known = word == written(match[1], numbers) and len(numbers) == len(law.limits)
    inside = known and all(low < v < high for v, (low, high) in zip(numbers, law.limits, strict=True))
    return (law, numbers) if inside else None


def is_law(kind: str, word: str) -> bool:
    """True if a word names a law of a kind."""
    return word == PLAIN[kind] or law_of(kind, word) is not None


def freedom(word: str) -> float | None:
    """The degrees of freedom ν of ``student(ν)``; None for another word, or if ν is not above 2."""
    law, numbers = law_of(NOISE, word) or (None, [])
    return numbers[0] if law is LAWS["student"] else None


def excess_kurtosis(word: str) -> float:
    """The excess kurtosis of a coordinate, larger with heavier tails; not a number unless the covariance is σ² I."""
    law, numbers = law_of(NOISE, word) or (None, [])
    if law is None or law.excess_kurtosis is None:
        return 0.0 if word == PLAIN[NOISE] else math.nan
    return law.excess_kurtosis(*numbers)


def has_equal_covariance(word: str) -> bool:
    """True if a word names a law of noise of covariance σ² I."""
    return not math.isnan(excess_kurtosis(word))


def changed(kind: str, word: str, trials: Trials) -> Floats:
    """The values of trials after the law of a word; as they are if it is a plain one."""
    found = law_of(kind, word)
    return trials.values if found is None else found[0].function(trials, *found[1])


def cell_noise(trials: Trials, conditions: Mapping[str, float | str]) -> Floats:
    """Noise at σ = 1 of a cell (b, d, n), from normal noise: that of another law, then outliers.

    Args:
        trials: with normal noise.
        conditions: values of ``law``, ``outlier_share``, ``outlier_size`` and ``outlier_law``, as far as they are not
            at their defaults; others do not matter.
    """
    trials = trials._replace(values=changed(NOISE, str(conditions.get("law", PLAIN[NOISE])), trials))
    share = float(conditions.get("outlier_share", 0.0))
    if not share > 0.0:
        return trials.values
    usual = LAWS[PLAIN[OUTLIERS]], [float(conditions.get("outlier_size", SIZE))]
    law, numbers = law_of(OUTLIERS, str(conditions.get("outlier_law", ""))) or usual
    return noise.outliers(trials, share, law.function(trials, *numbers))


class LawTrial(NamedTuple):
    """One trial, as a law of one's own sees it.

    Attributes:
        rng: generator of the trial's random numbers for this law; use no others.
        values: numbers that the law changes (n, d): for noise and outliers the noise of each sample at σ = 1, which is
            standard normal if no other law came before; for directions unit vectors uniform by area on the cap about
            the first axis; for coordinates the points about the true centre, in units of the radius.
        directions: unit vectors of the samples (n, d).
        half_angle: half-angle of the cap in radians.
    """

    rng: np.random.Generator
    values: Floats
    directions: Floats
    half_angle: float


@dataclass(frozen=True)
class OneByOne:
    """A function of one trial as a law of batches.

    Attributes:
        name: of the law.
        kind: of the law.
        function: takes a `LawTrial` and the law's numbers; returns what takes the place of its values (n, d), or for
            outliers the displacement of each sample.
    """

    name: str
    kind: str
    function: Callable[..., object]

    def __call__(self, trials: Trials, *numbers: float) -> Floats:
        """Call the function for each trial; a trial has the same random numbers alone and beside others."""
        seeds = trials.further(("law", self.name), lambda g, count: g.random(count))
        directions, result = trials.directions, np.empty_like(trials.values)
        values = directions if self.kind == DIRECTIONS else trials.values
        for t, seed in enumerate(seeds):
            rng = stream(0, "law", self.name, float(seed))
            one = LawTrial(rng, values[t].T.copy(), directions[t].T.copy(), trials.half_angle)
            result[t] = self._one(one, numbers).T
        if self.kind == DIRECTIONS:
            result[:, 0] = 1.0 - result[:, 0]
        return result

    def _one(self, trial: LawTrial, numbers: Sequence[float]) -> Floats:
        """Call the function, and check what it returns; RunError if that cannot be used."""
        shape = trial.values.shape
        try:
            answer = np.asarray(self.function(trial, *numbers), dtype=float)
        except (Exception, SystemExit) as error:
            raise self._fault(numbers, raised(error, self.function)) from None
        if answer.shape != shape:
            raise self._fault(numbers, f"returned shape {answer.shape}, expected {shape}: a row for each sample")
        if not np.all(np.isfinite(answer)):
            raise self._fault(numbers, "returned a number that is not finite")
        if self.kind == DIRECTIONS:
            worst = float(np.abs(np.linalg.norm(answer, axis=1) - 1.0).max())
            if worst > _UNIT:
                raise self._fault(numbers, f"returned directions whose length differs from 1 by {worst:.2g}")
        return answer

    def _fault(self, numbers: Sequence[float], words: str) -> RunError:
        return RunError(f"law {written(self.name, numbers)}: {words}")


_UNIT = 1e-9
"""Largest difference from 1 that the length of a direction may have."""


def register_law(
    name: str, function: Callable[..., object], kind: str, *, example: Sequence[float] = (), reference: str = ""
) -> None:
    """Register a law of one's own; from then on configs know its name: ``directions = "von_mises(2)"``.

    Args:
        name: lower-case letters, digits and underscores, a letter first.
        function: takes a trial and the law's numbers; returns an array (n, d), a row for each of the trial's n samples.
            Its docstring begins with a sentence that says what the law is. The trial has ``rng``, a generator, which
            alone gives random numbers; ``values`` (n, d), which the law changes; ``directions`` (n, d) of the samples;
            and ``half_angle`` of the cap, radians. A ValueError says that the numbers are not allowed.
        kind: what the law is of, and the array that it returns. "directions": unit vectors, where ``values`` are
            uniform by area on the cap about the first axis. "noise": noise at σ = 1, where ``values`` are standard
            normal numbers. "outliers": the displacement of each sample, if it is an outlier, in units of σ.
            "coordinates": points, where ``values`` are the points about the true centre, in units of the radius.
        example: numbers with which it is tried out, one for each parameter after the first.
        reference: where it is described.

    Raises:
        TypeError: if the function cannot be called.
        ValueError: if the name cannot be used or is taken, there is no such kind, no sentence, or no example.

    Examples:
        >>> import numpy as np, study
        >>> def two_rings(trial, tilt):
        ...     "Directions on two rings about the first axis, at an angle to it and at half of that."
        ...     angle = np.where(np.arange(len(trial.values)) % 2, tilt, 0.5 * tilt)[:, None]
        ...     across = trial.values[:, 1:] / np.linalg.norm(trial.values[:, 1:], axis=1, keepdims=True)
        ...     return np.hstack([np.cos(angle), np.sin(angle) * across])
        >>> study.register_law("two_rings", two_rings, "directions", example=[0.5])
    """
    call = f"register_law({name!r})"
    if not callable(function):
        raise TypeError(f"{call}: {type(function).__name__} is not a function")
    if kind not in PLAIN:
        raise ValueError(f"{call}: kind = {kind!r}: must be {', '.join(PLAIN)}")
    numbers, sentence = _described(function)
    if not sentence:
        raise ValueError(f"{call}: give the function a docstring: its first sentence says what the law is")
    example = [example] if isinstance(example, int | float) else example
    if len(example) != len(numbers):
        words = f"give a number for each of {', '.join(numbers)}" if numbers else "the function takes none"
        raise ValueError(f"{call}: example = {list(example)}: {words}")
    _REGISTRY.enter(name, registry.source(function), (name in LAWS and name not in ORIGINS) or name in PLAIN.values())
    law = Law(kind, OneByOne(name, kind, function), sentence, numbers, tuple(map(float, example)), (), reference)
    LAWS[name] = replace(law, limits=(_FINITE,) * len(numbers))


ORIGINS: dict[str, registry.Origin] = {}
"""Origins of the laws that are not shipped, by their names."""


def own(words: Iterable[tuple[str, str]]) -> list[str]:
    """Names of those laws, given by kind and word, that are not shipped."""
    return list(dict.fromkeys(name for _, word in words if (name := word.partition("(")[0]) in ORIGINS))


def origins(names: Iterable[str]) -> list[dict[str, object]]:
    """The origins of those among some laws that are not shipped, as a manifest has them."""
    return _REGISTRY.listed(names, "laws")


def only_here(names: Iterable[str]) -> list[str]:
    """Those among some laws that worker processes cannot have."""
    return _REGISTRY.only_here(names)


def tried(word: str, kind: str, dimension: int) -> str:
    """Try out a law of one's own on a few trials; what is wrong with it, or nothing."""
    law, numbers = law_of(kind, word) or (None, [])
    if law is None or not isinstance(law.function, OneByOne):
        return ""
    try:
        law.function(sound_trials(dimension), *numbers)
    except RunError as error:
        return str(error).removeprefix(f"law {word}: ")
    return ""


def sound_trials(d: int, trials: int = 3, n: int = 20, seed: int = 7) -> Trials:
    """Some trials of normal noise, with directions by area on a whole sphere."""

    def numbers(name: str, count: int) -> Floats:
        return stream(seed, "sound", name).standard_normal((count, d, n))

    def further(kind: Name, numbers_of: Callable[[np.random.Generator, int], Floats]) -> Floats:
        return numbers_of(stream(seed, "sound", *kind), trials)

    u = numbers("directions", trials)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    u[:, 0] = 1.0 - u[:, 0]
    return Trials(numbers("noise", trials), u, math.pi, further)


def _fault(name: str) -> str:
    """The fault of a law that fails in the plane and in space alike; empty for others."""
    law = LAWS[name]
    faults = [tried(written(name, law.example), law.kind, d) for d in (2, 3)]
    return faults[1] if all(faults) else ""


def _remove(name: str) -> None:
    """Take a law that is not shipped out of the registry."""
    if ORIGINS.pop(name, None) is not None:
        del LAWS[name]


_REGISTRY = registry.Registry("law", "register_law", ORIGINS, _remove, "three sound trials", _fault)
registry.REGISTRIES.append(_REGISTRY)


def laws_of(file: str) -> list[str]:
    """Names of the laws that a file registered, by the name of the file."""
    return [name for name, origin in ORIGINS.items() if origin.name == file]


_CHECKED = 50, 200
"""Trials and samples of each, with which a law is checked."""


def check(name: str) -> tuple[list[str], list[str]]:
    """Check a law of one's own: what it returns, in the plane and in space, again and for a trial alone.

    Returns:
        A sentence for each property that it violates, and lines that say what it is and what moments it has.
    """
    law = LAWS[name]
    word, lines = written(name, law.example), [f"{written(name, law.example)}: {law.kind}. {law.sentence}"]
    faults = {d: fault for d in (2, 3) if (fault := tried(word, law.kind, d))}
    lines += [f"{word}: d = {d} is left out: {fault}" for d, fault in faults.items()]
    violations = list[str]()
    for d in {2, 3} - set(faults):
        trials = sound_trials(d, *_CHECKED)
        answer = law.function(trials, *law.example)
        alone = law.function(trials.only(1), *law.example)
        if not np.array_equal(answer, law.function(trials, *law.example)):
            violations.append(
                f"{word}: another answer for the same trial (d = {d}): take random numbers from trial.rng"
            )
        elif not np.array_equal(alone[0], answer[1]):
            violations.append(f"{word}: a trial differs alone and beside others (d = {d}): keep nothing between calls")
        if law.kind == DIRECTIONS:
            answer[:, 0] = 1.0 - answer[:, 0]
        mean, spread = answer.mean(axis=(0, 2)), answer.std(axis=(0, 2))
        shown = ", ".join(f"{m:.3f} ± {s:.3f}" for m, s in zip(mean, spread, strict=True))
        lines.append(f"{word}: d = {d}: mean ± standard deviation of each coordinate {shown}")
        if law.kind == NOISE:  # along the radius the mean of a coordinate does not show it
            away = np.einsum("bdn,bdn->bn", answer, trials.directions)
            lines[-1] += f", along the radius {away.mean():.3f} ± {away.std():.3f}"
    return violations, lines

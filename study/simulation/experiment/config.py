"""A study's config: TOML in, a frozen `Study` out, which is cut into units of work, or one message with every fault.

Its sections besides the design are ``[posterior]``, which chooses trials for ensemble posteriors, and ``[precision]``,
by which cells get trials until the Monte-Carlo error of a measure is small enough.

With a [precision] the error is computed at checkpoints: after a first number of trials, after twice as many, and so on
up to `design.trials`, the cap. A cell stops at the first checkpoint at which the error is small enough for every
estimator that the target is for. So the decision depends on the cell's own rows, and on no other cell's. A rule that
stops at a small *estimated* error prefers errors that were estimated too small. With few checkpoints, each of twice the
trials, that costs little: the true standard error is within the target, and the interval of 2 targets on either side
covers the truth in 97 % of cells. The interval of 2 stored errors covers it in 93 %, against 93 to 95 % after a number
of trials that is fixed beforehand (`benchmarks/stopping.py`).

The configs that come with the package are found by name from any folder: in an installed package they are its data, in
a checkout they stand in the folder ``configs`` beside it.
"""

import hashlib
import math
import os.path
from collections.abc import Iterator, Sequence
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self, Union

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    SerializeAsAny,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from study.fits import ESTIMATORS
from study.fits.points.samples import Worded
from study.simulation.experiment import laws
from study.simulation.experiment import measures as registry
from study.simulation.experiment.conditions import CONDITIONS, LAWS, STORED, Condition, Value
from study.simulation.experiment.designs import (
    MAX_CELLS,
    Batch,
    Cell,
    Grid,
    GridDesign,
    Group,
    Random,
    RandomDesign,
    as_list,
)
from study.simulation.experiment.noise import GaussianNoise, gaussian
from study.text import did_you_mean, listed
from study.toml import (
    ConfigError,
    Distinct,
    Fault,
    Frozen,
    Listed,
    distinct,
    each_once,
    report,
    toml_tables,
    toml_text,
)
from study.words import estimator_remedy

Noise = Literal["known", "unknown"]
Likelihood = Literal["geometric", "whole_sphere"]


class ChainStatus(Worded):
    """The way a chain ended."""

    OK = 0, "ok"
    NOT_CONVERGED = 1, "the chain did not reach 50 autocorrelation times, stable to 1 %, within its budget of steps"
    AT_PRIOR = 2, "the posterior reaches the prior's box, which decides the answer: the data alone do not bound it"
    NO_START = 3, "no finite error ellipsoid within the prior's box to start from"
    NOT_MIXED = 4, "walkers that started at different places did not mix within the budget of steps"
    DIFFERS = 5, "a mean, sd or quantile is 0.1 sd from the one by the centre's marginal density: mass was missed"
    NOT_CHECKED = 6, "not checked, so not ok: draws of the centre's marginal density are too few to see 0.1 sd"


def _conditions(value: object) -> tuple[tuple[str, tuple[Value, ...]], ...]:
    """Check ``where``, which has conditions and the values chosen of each."""
    if not isinstance(value, dict):
        raise ValueError("must be a table of conditions and values, such as { angle = [60, 180], samples = 100 }")
    unknown = [key for key in value if key not in CONDITIONS]
    if unknown:
        raise ValueError(f"{listed(unknown)} unknown: conditions are {', '.join(CONDITIONS)}")
    lists = {key: as_list(values) for key, values in value.items()}
    if any(not values for values in lists.values()):
        raise ValueError("every list must have a value; leave a condition out to choose all of its cells")
    if any(not CONDITIONS[key].holds(v) for key, values in lists.items() for v in values):
        raise ValueError("every value must be a number")
    return tuple((key, tuple(v if isinstance(v, str) else float(v) for v in values)) for key, values in lists.items())


class Posterior(Frozen):
    """Ensemble posteriors of (c, r) for some of a study's trials.

    Attributes:
        trials: number of trials of each chosen cell: the first ones.
        where: conditions that choose cells, each with the values chosen; all cells, if empty.
        noise: known; unknown, so that σ is one more parameter; or both, with a chain for each.
        likelihood: geometric; if the angle of every chosen cell is 180°, also whole_sphere, or both.
        box: half-width of the prior box on the centre, about the true one, in true radii.
        walkers: number of walkers of the ensemble.
        max_steps: most steps of a chain, which ends earlier if it has converged.
        keep_draws: number of trials of each chosen cell whose draws are stored, thinned: the first ones.
    """

    trials: Annotated[int, Field(ge=1)] = 4
    where: Annotated[tuple[tuple[str, tuple[float | str, ...]], ...], BeforeValidator(_conditions)] = ()
    noise: Annotated[Distinct[Noise], BeforeValidator(as_list)] = ("known", "unknown")
    likelihood: Annotated[Distinct[Likelihood], BeforeValidator(as_list)] = ("geometric",)
    box: Annotated[float, Field(gt=0.0, le=1e3)] = 10.0
    walkers: Annotated[int, Field(ge=8, le=4096)] = 64
    max_steps: Annotated[int, Field(ge=100, le=10_000_000)] = 20_000
    keep_draws: Annotated[int, Field(ge=0)] = 1

    def chooses(self, cell: Cell) -> bool:
        """True if the config chooses a cell; values agree to nine digits."""
        values = cell.values
        return all(any(same(CONDITIONS[name].of(values), v) for v in chosen) for name, chosen in self.where)


def same(a: Value, b: Value) -> bool:
    """True if two values of a condition are the same word, or agree to nine digits."""
    return a == b if isinstance(a, str) or isinstance(b, str) else math.isclose(a, b, rel_tol=1e-9)


WITH_ERROR = (
    *("".join(words) for words in product(("relative_", "ratio_"), ("median", "q05", "q95"), ("", "_ok", "_all"))),
    *("far", "far_ok", "far_all", "axis_median", "axis_median_ok", "tail_index", "bias", "rmse"),
)
"""The measures of the summary that have a Monte-Carlo error."""
_SHARES = ("far", "far_ok", "far_all")
"""Measures that are shares of fits."""


class Precision(Frozen):
    """The rule by which a cell has enough trials.

    Attributes:
        measure: the measure of the summary whose Monte-Carlo error decides.
        target: the error that is small enough, in the measure's own unit.
        relative_target: the same as a fraction of the measure; give one of the two.
        estimators: the estimators whose error must be so small; all of the study's, if None.
        first: trials at the first checkpoint. From 100 trials, the error of a quantile is itself known to 30 %.
        seconds: time after which one `study run` starts no new work; the finished tables do not depend on it.
    """

    measure: str = "ratio_median_ok"
    target: Annotated[float, Field(gt=0.0)] | None = None
    relative_target: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    estimators: Distinct[str] | None = None
    first: Annotated[int, Field(ge=100)] = 250
    seconds: Annotated[float, Field(gt=0.0)] | None = None

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        given = [name for name in ("target", "relative_target") if getattr(self, name) is not None]
        if len(given) != 1:
            result = " and ".join(given) or "neither"
            raise ValueError(f"give target or relative_target, one of the two (found {result})")
        return self

    def checkpoints(self, cap: int) -> list[int]:
        """Numbers of trials at which a cell is examined, up to the most that it may have."""
        points = [min(self.first, cap)]
        while points[-1] < cap:
            points.append(min(2 * points[-1], cap))
        return points

    def goal(self, value: float) -> float:
        """The largest error that is small enough, for a measure of this value."""
        return self.target if self.target is not None else float(self.relative_target or 0.0) * abs(value)

    def reached(self, value: float, error: float) -> bool:
        """True if the error of a measure is small enough; one that is infinite, or not a number, never is."""
        return math.isfinite(error) and error <= self.goal(value)


_EITHER: Any = Annotated[Union[RandomDesign, GridDesign], Field(discriminator="kind")]  # noqa: UP007  two variables
MAX_SAMPLES = 1_000_000_000
"""Limit of a trial's samples, whose directions, noise and points lie in memory together."""
_DESIGNS: TypeAdapter[Grid | Random] = TypeAdapter(_EITHER)
_FITS_IN_MEMORY = 4_000_000
"""Fits of a unit whose summary alone is kept: their errors take some 190 bytes each until they are summed up."""
_SAMPLES_IN_SUMMARY = 20_000_000_000
"""Samples that such a unit draws and fits, over its levels: some minutes, which a kill costs."""


def _known_estimators(names: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in ESTIMATORS]
    if unknown:
        raise ValueError(
            f"{listed(map(repr, unknown))} unknown; {estimator_remedy(unknown, ESTIMATORS)}; {laws.OF_YOUR_OWN}"
        )
    return names


def _known_measures(names: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in registry.MEASURES]
    if unknown:
        raise ValueError(
            f"{listed(map(repr, unknown))} unknown; {did_you_mean(unknown[0], registry.MEASURES)}; {laws.OF_YOUR_OWN}"
        )
    return names


FolderName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,60}$")]
EstimatorNames = Annotated[Distinct[str], AfterValidator(_known_estimators)]
MeasureNames = Annotated[Listed[str], AfterValidator(each_once), AfterValidator(_known_measures)]


class Study(Frozen):
    """A study: its config, complete and checked."""

    name: FolderName
    """First part of the name of the run's folder: lower-case letters, digits and hyphens."""
    seed: Annotated[int, Field(ge=0)]
    """Another seed gives other draws."""
    dimension: Annotated[int, Field(ge=2, le=50)] = 3
    """2 for circles, 3 for spheres, or more."""
    estimators: EstimatorNames
    """Names of the estimators that fit each data set."""
    noise_shape: Listed[Listed[float]] | None = None
    """Covariance matrix (d, d) of a sample's noise in units of σ²; the identity if absent."""
    keep_points: Annotated[int, Field(ge=0)] = 0
    """Number of trials of each cell whose points are stored: the first ones."""
    tolerate_failures: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Largest share of fits that may raise or kill their worker; above it a finished run ends with exit code 3."""
    route: Literal["points", "moments"] = "points"
    """Fits are computed from points, with rounding, as in the paper; or from the joint moments of directions and noise,
    for closed forms only, which gives the statistical error without rounding, and all noise levels at once."""
    keep: Literal["errors", "summary"] = "errors"
    """The table that is stored: the error of every fit, or only their summary."""
    measures: MeasureNames = ()
    """Names of what is measured of each fit besides its error; `study measures` lists them."""
    design: Annotated[SerializeAsAny[Grid | Random], PlainValidator(_DESIGNS.validate_python)]
    posterior: Posterior | None = None
    precision: Precision | None = None
    """The rule by which a cell has enough trials; without it, each has as many as the design says."""

    @property
    def noise_law(self) -> GaussianNoise:
        """The law of the noise of a sample."""
        return gaussian(self.noise_shape, self.dimension)

    def cells(self) -> int:
        """Number of cells: in a random design, one per trial."""
        if getattr(self.design, "most_noise", None) is None:
            return self.design.cells()
        return sum(len(group.cells) for group in self.groups())

    def independent(self) -> bool:
        """True if no two cells share their directions and noise."""
        return self.design.independent()

    def groups(self) -> Iterator[Group]:
        """Groups of cells that share draws, in the order of the tables."""
        return self.design.groups(self.seed, self.dimension)

    def trials_of(self, group: Group) -> int:
        """Number of trials that the study gives to the cells of a group, which may be another study's."""
        return self.design.trials_of(group.samples)

    def units(self) -> Iterator[Batch]:
        """Units of work, in the order of the tables; they depend on nothing but the config."""
        return (unit for group in self.groups() for unit in self.units_of(group))

    def units_of(self, group: Group, below: int | None = None) -> Iterator[Batch]:
        """The units of a group; only those with trials below a number, if one is given."""
        trials = self.trials_of(group)
        last = trials if below is None else min(below, trials)
        if self.keep == "summary":
            yield from (Batch(part, 0, last) for part in self._few(group))
            return
        step = self._step(group)
        for first in range(0, last, step):
            yield Batch(group, first, min(trials, first + step))

    def sizes_of(self, group: Group) -> Iterator[tuple[Batch, int]]:
        """The units of a group, of equal ones the first alone; each with the number of those that are equal in size."""
        if self.keep == "summary" or self.design.one_trial_a_cell:
            yield from ((unit, 1) for unit in self.units_of(group))
            return
        trials, step = self.trials_of(group), self._step(group)
        whole, rest = divmod(trials, step)
        if whole:
            yield Batch(group, 0, step), whole
        if rest:
            yield Batch(group, trials - rest, trials), 1

    def _step(self, group: Group) -> int:
        """Number of trials of each unit of a group, but the last, if errors are kept."""
        return group.trials_per_unit(1 if self.route == "moments" else len(group.levels))

    def _few(self, group: Group) -> Iterator[Group]:
        """Cut a group to so few cells that all their trials, of which a summary is made, are few enough for one unit.

        Each of these groups makes the draws of all trials again.
        """
        trials, cells, levels = self.trials_of(group), group.cells, len(group.levels)
        at_once = max(1, _FITS_IN_MEMORY // (trials * max(1, len(self.estimators))))
        if self.route == "points":  # a level costs as much as the draw
            at_once = min(at_once, max(1, _SAMPLES_IN_SUMMARY // (trials * group.samples) - 1) * (len(cells) // levels))
        if at_once >= len(cells):
            yield group
            return
        for first in range(0, len(cells), at_once):
            yield group.only(cells[first : first + at_once])

    def conditions(self) -> tuple[Condition, ...]:
        """The conditions that have a column in the study's tables."""
        given = self.design.given()
        return tuple(c for c in STORED if not c.silent or c.name in given)

    def columns(self) -> tuple[int, tuple[Condition, ...], tuple[registry.MeasureColumn, ...]]:
        """Arguments of `study.simulation.runs.schemas.declared`, which gives the columns of the study's tables."""
        return self.dimension, self.conditions(), self.measured()

    def measured(self) -> tuple[registry.MeasureColumn, ...]:
        """The columns of the study's measures."""
        return registry.stored(self.measures, self.dimension)

    def measure_versions(self) -> dict[str, int | str]:
        """Versions of the study's measures by name."""
        return {name: registry.MEASURES[name].version for name in self.measures}

    def canonical(self) -> str:
        """The config as JSON, as far as it determines the error table.

        That leaves out ``[posterior]``, the tolerance of failures, and the budget of time.
        """
        left_out: dict[str, Any] = dict.fromkeys(("posterior", "tolerate_failures"), True) | {"precision": {"seconds"}}
        return self.model_dump_json(exclude=left_out | dict.fromkeys(self._unused(), True))

    def own_laws(self) -> list[str]:
        """Names of the laws of a user's own that the design has."""
        given = [(c, self.design.values(c) or ()) for c in CONDITIONS.values() if c.laws]
        words = [(condition.laws, str(value)) for condition, values in given for value in values]
        return laws.own(words)

    def stem(self) -> str:
        """The entries that determine a row besides its cell, trial and estimator, as JSON: the seed, for example.

        The code of a law of a user's own is one of them, by its digest, and that of each measure, by its version.
        """
        left_out = {"posterior", "precision", "tolerate_failures", "name", "design", "estimators", "keep_points"}
        own = " ".join(f"{name}@{laws.ORIGINS[name].digest}" for name in self.own_laws())
        own += "".join(f" {name}@{version}" for name, version in self.measure_versions().items())
        return self.model_dump_json(exclude={*left_out, *self._unused()}) + own

    def _unused(self) -> set[str]:
        """Newer entries that are at their defaults; they are left out, so that older configs keep their digest."""
        names = ("route", "keep", "precision", "measures")
        return {name for name in names if getattr(self, name) == type(self).model_fields[name].default}

    def digest(self) -> str:
        """Digest of the canonical config, ten hexadecimal digits."""
        return hashlib.sha256(self.canonical().encode()).hexdigest()[:10]

    def run_name(self) -> str:
        """Name of the run's folder."""
        return f"{self.name}-{self.digest()}"


def parse(text: str, source: str = "config") -> Study:
    """Read a config.

    Args:
        text: the TOML document.
        source: its name in messages.

    Raises:
        ConfigError: with every fault, its place, its value and the values allowed.
    """
    raw = toml_tables(text, source)
    faults = list(_faults_between_keys(raw))
    study = None
    try:
        study = Study.model_validate(raw)
    except ValidationError as error:
        faults = distinct(faults + report(error, _KEYS, _path))
    if study is not None and study.design.cells() > MAX_CELLS:
        faults.append(Fault(("design",), f"{study.design.cells():,} cells; at most {MAX_CELLS:,} are allowed"))
    elif study is not None:
        for check in (
            _departure_faults,
            _law_faults,
            _neglect_faults,
            _level_faults,
            _posterior_faults,
            _precision_faults,
            _measure_faults,
        ):
            faults += check(study)
    if faults or study is None:
        raise ConfigError.listing(source, text, faults)
    return study


def load(path: Path) -> Study:
    """Read a config file; see `parse`."""
    return read(path)[0]


def read(path: Path) -> tuple[Study, str]:
    """Read a config file and return its text as well; see `parse`."""
    text = toml_text(path)
    return parse(text, str(path)), text


def _faults_between_keys(raw: dict[str, Any]) -> Iterator[Fault]:
    """Find entries that do not go together. Those of the wrong type are left to the schema."""
    design, d = raw.get("design"), raw.get("dimension", 3)
    if not isinstance(d, int) or not isinstance(design, dict):
        return
    either = ("noise", "noise_over_radius", "kappa")
    given = [key for key in either if key in design]
    if len(given) != 1:
        words = f"give one of noise, noise_over_radius and kappa (found {' and '.join(given) or 'none'})"
        yield Fault(("design",), words, wants=() if given else tuple(("design", key) for key in either))
    counts = _sample_counts(design.get("samples"))
    if counts and min(counts) < d + 1:
        words = f"{min(counts):g} samples are too few: a sphere in dimension {d} needs at least {d + 1}"
        yield Fault(("design", "samples"), words, design["samples"])
    if counts and max(counts) > MAX_SAMPLES:
        words = f"{max(counts):g} samples are too many for memory: at most {MAX_SAMPLES:,} are allowed"
        yield Fault(("design", "samples"), words, design["samples"])
    shape = raw.get("noise_shape")
    if shape is not None and not _is_covariance(shape, d):
        words = f"must be a symmetric, positive definite {d} × {d} matrix (list of rows), its largest number {_SIZES}"
        yield Fault(("noise_shape",), words, shape)
    random, points = design.get("kind") != "grid", raw.get("keep_points")
    moments, summary = raw.get("route") == "moments", raw.get("keep") == "summary"
    names, closed = raw.get("estimators"), [name for name, entry in ESTIMATORS.items() if entry.moments_suffice]
    others = [n for n in as_list(names) if isinstance(n, str) and n in ESTIMATORS and n not in closed]
    if moments and isinstance(names, list) and others:
        words = f"{', '.join(others)} need the points; the moments suffice for {', '.join(closed)}"
        yield Fault(("estimators",), words)
    for wrong, key, words in (
        (moments and shape is not None, "noise_shape", 'the route "moments" is for isotropic noise'),
        (moments and points, "keep_points", 'the route "moments" forms no points'),
        (moments and bool(raw.get("measures")), "measures", 'the route "moments" forms no points, which they need'),
        (moments and random, "route", 'a random design draws every trial for one level: route = "points"'),
        (summary and random, "keep", 'a random design has one trial in a cell: keep = "errors"'),
        (summary and points, "keep_points", 'belongs to the errors, which keep = "summary" does not store'),
    ):
        if wrong:
            yield Fault((key,), words)


def _departure_faults(study: Study) -> Iterator[Fault]:
    """Find entries that do not go with another law of the noise or of the directions, or with outliers."""
    given = study.design.given()
    if "law" in given and study.noise_shape is not None:
        yield Fault(("noise_shape",), "is the covariance of normal noise: take law out of the design")
    if "kappa" in given and "directions" in given:
        yield Fault(("design", "kappa"), "is of directions by area: take directions out, or give noise instead")
    for name in ("outlier_size", "outlier_law"):
        if name in given and "outlier_share" not in given:
            yield Fault(("design", name), "has no effect without outlier_share, the probability of an outlier")
    outlier_laws = study.design.values(CONDITIONS["outlier_law"]) or ()
    if "outlier_size" in given and laws.PLAIN[laws.OUTLIERS] not in outlier_laws:
        words = f"has no effect: the numbers of outlier_law = {', '.join(map(str, outlier_laws))} say how far"
        yield Fault(("design", "outlier_size"), words)


def _law_faults(study: Study) -> Iterator[Fault]:
    """Find laws that there are not in the study's dimension, and laws of a user's own that fail on three trials."""
    for condition in CONDITIONS.values():
        words = [str(value) for value in study.design.values(condition) or ()] if condition.laws else []
        named = [law for word in words if (law := laws.law_of(condition.laws, word)) is not None]
        if any(law.most_dimension < study.dimension for law, _ in named):
            flat = [
                n for n, law in laws.LAWS.items() if law.kind == condition.laws and math.isfinite(law.most_dimension)
            ]
            reason = f"{' and '.join(flat)} are {condition.laws} of circles and spheres, not of dimension"
            yield Fault(("design", condition.name), f"{reason} {study.dimension}")
        for word in words:
            if fault := laws.tried(word, condition.laws, study.dimension):
                yield Fault(("design", condition.name), f"fails on three sound trials: {fault}", word)


_LIKELIHOODS = "its likelihoods, of normal noise of the true σ and directions by area, take no account of"


def _neglect_faults(study: Study) -> Iterator[Fault]:
    """Find conditions of which joint moments or posteriors would take no account, unless they are at their defaults."""
    design = study.design
    given = [c for c in map(CONDITIONS.__getitem__, design.given()) if design.values(c) != (c.default,)]
    moments = study.route == "moments" and [c.name for c in given if not c.by_moments]
    posterior = study.posterior is not None and [c.name for c in given if not c.by_posterior]
    for names, key, words, remedy in (
        (moments, "route", 'the route "moments" takes no account of', 'out, or route = "points"'),
        (posterior, "posterior", _LIKELIHOODS, "out of the design"),
    ):
        if names:
            them = "it" if len(names) == 1 else "them"
            yield Fault((key,), f"{words} {' and '.join(names)}: take {them} {remedy}")


def _level_faults(study: Study) -> Iterator[Fault]:
    """Find noise that float64 cannot hold both as σ and as σ over the radius."""
    given = study.design.given()
    if not study.cells():
        words = "leaves no cell: raise it, or give less noise"
        yield Fault(("design", "most_noise"), words, getattr(study.design, "most_noise", None))
    name = "noise" if "noise" in given else "noise_over_radius"
    if name not in given:  # which is another fault
        return
    noises, radii = (list(map(float, study.design.possible(entry))) for entry in (name, "radius"))
    for noise, radius in product((min(noises), max(noises)), (min(radii), max(radii))):
        if noise > 0.0 and radius > 0.0:  # the lower end of a law is never drawn
            kind, other = ("σ/r", noise / radius) if name == "noise" else ("σ", noise * radius)
            if not 0.0 < other < math.inf:
                words = f"with radius = {radius:g} {kind} is {other:g} in float64: give another noise or radius"
                yield Fault(("design", name), words, noise)
                return


def _posterior_faults(study: Study) -> Iterator[Fault]:
    """Find entries of a ``[posterior]`` that the study cannot satisfy."""
    posterior, design, d = study.posterior, study.design, study.dimension
    if posterior is None:
        return
    where = dict(posterior.where)
    possible = {name: design.values(condition) for name, condition in CONDITIONS.items()}
    for name, chosen in where.items():
        for value in chosen:
            if (values := possible[name]) is not None and not any(same(value, v) for v in values):
                words = value if isinstance(value, str) else f"{value:.12g}"
                yield Fault(("posterior", "where"), f"no cell has {name} = {words}")
    if "trials" in posterior.model_fields_set and posterior.trials > design.trials:
        words = f"more trials than a cell has: design.trials = {design.trials:,}"
        yield Fault(("posterior", "trials"), words, posterior.trials)
    angles = where.get("angle") or possible["angle"] or (math.nan,)
    if "whole_sphere" in posterior.likelihood and any(v != 180.0 for v in angles):
        words = "whole_sphere is wrong on caps: choose cells of the whole sphere with where = { angle = 180 }"
        yield Fault(("posterior", "likelihood"), words)
    least = min(map(float, where.get("samples", ())), default=round(min(map(float, design.possible("samples")))))
    if "unknown" in posterior.noise and least < d + 2:
        words = f"an unknown noise needs at least {d + 2} samples, not {least:g}; choose with where"
        yield Fault(("posterior", "noise"), words)
    if posterior.walkers < 2 * (d + 3):
        words = f"at least {2 * (d + 3)} are needed in dimension {d}"
        yield Fault(("posterior", "walkers"), words, posterior.walkers)
    if study.noise_shape is not None:
        yield Fault(("posterior",), "its likelihoods are of isotropic noise: take noise_shape out")


def _precision_faults(study: Study) -> Iterator[Fault]:
    """Find entries of a ``[precision]`` that the study cannot satisfy."""
    precision, design = study.precision, study.design
    if precision is None:
        return
    names, shares = [*WITH_ERROR], [*_SHARES]
    for column in study.measured():
        names += column.summaries
        shares += column.summaries if column.kind is bool else ()
    if precision.measure not in names:
        words = f"no measure of the study's summary; {did_you_mean(precision.measure, names)}"
        yield Fault(("precision", "measure"), words, precision.measure)
    if precision.relative_target is not None and precision.measure in shares:
        words = f"{precision.measure} is a share, which may be 0, and no error is a fraction of 0: give target instead"
        yield Fault(("precision", "relative_target"), words, precision.relative_target)
    if design.one_trial_a_cell:
        words = 'a random design has one trial in a cell: design.kind = "grid", or leave [precision] out'
        yield Fault(("precision",), words)
    elif design.trials < precision.first:
        words = f"design.trials = {design.trials} is the cap, and below the first checkpoint: raise it, or lower first"
        yield Fault(("precision", "first"), words, precision.first)
    if study.keep == "summary":
        yield Fault(("precision",), 'needs the errors, which keep = "summary" does not store')
    if unknown := [name for name in precision.estimators or () if name not in study.estimators]:
        words = f"{listed(map(repr, unknown))} not among the study's; {estimator_remedy(unknown, study.estimators)}"
        yield Fault(("precision", "estimators"), words)


def _measure_faults(study: Study) -> Iterator[Fault]:
    """Find measures of a user's own that fail in the study's dimension, and two that have the same column."""
    return (Fault(("measures",), words) for words in registry.faults(study.measures, study.dimension))


def _sample_counts(samples: object) -> list[int]:
    """Numbers of samples that a design's entry can give, ends of ranges among them; none if the schema refuses it."""
    if isinstance(samples, dict) and "law" in samples:
        values = [*map(samples.get, ("low", "high", "value")), *as_list(samples.get("values"))]
    elif isinstance(samples, dict):
        values = [v for ends in samples.values() for v in as_list(ends)[:2]]
    else:
        values = list(as_list(samples))
    return [round(v) for v in values if CONDITIONS["samples"].holds(v)]


_SIZES = "1e-100 to 1e100"
"""Sizes of a covariance whose squares are numbers."""


def _is_covariance(shape: object, d: int) -> bool:
    """True if a noise shape is a covariance (d, d)."""
    try:
        matrix = np.asarray(shape, dtype=float)
        if matrix.shape != (d, d) or not 1e-100 <= np.max(np.abs(matrix)) <= 1e100 or not np.all(matrix == matrix.T):
            return False
        values = np.linalg.eigvalsh(matrix)
        return bool(values[0] > d * np.finfo(float).eps * values[-1])
    except (ValueError, TypeError, OverflowError):
        return False


_KEYS: dict[tuple[str, ...], list[str]] = {
    (): list(Study.model_fields),
    ("design",): sorted({*RandomDesign.model_fields, *GridDesign.model_fields}),
    ("posterior",): list(Posterior.model_fields),
    ("precision",): list(Precision.model_fields),
    ("design", "kind"): ["random", "grid"],
    **{("design", name): ["law", "value", "values", "low", "high", "linspace", "logspace"] for name in CONDITIONS},
}


def _path(location: Sequence[str | int]) -> tuple[str | int, ...]:
    """Drop the names of union members, which are not in the file, from a schema's location.

    They follow the key that has the union as its type: ``design, random, noise, uniform, low``.
    """
    path = list(location)
    if path[:1] == ["design"] and len(path) > 1 and path[1] in ("random", "grid"):
        kind = path.pop(1)
        if kind == "random" and len(path) > 2 and path[2] in LAWS:
            path.pop(2)
    return tuple(path)


def shipped_configs() -> dict[str, Path]:
    """Files of the shipped configs by name, in the order of the alphabet."""
    package = Path(str(resources.files("study")))
    folder = next((entry for entry in (package / "configs", package.parent / "configs") if entry.is_dir()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.toml"), key=lambda p: p.stem)}


def shipped_config(name: str) -> Path:
    """The file of a shipped config.

    Raises:
        ConfigError: if there is no such config; the message offers the nearest name and lists all.
    """
    known = shipped_configs()
    if name not in known:
        raise ConfigError(f"{name}: neither a file nor a shipped config; {did_you_mean(Path(name).name, known)}")
    return known[name]


def config_file(argument: Path) -> Path:
    """The file that a user means: the given one, or a shipped config if there is no such file and no suffix."""
    return argument if argument.suffix or os.path.exists(argument) else shipped_config(str(argument))


def summary_line(path: Path) -> str:
    """The first comment line of a config; empty if it has none."""
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    return first.removeprefix("#").strip() if first.startswith("#") else ""

"""Read a study's config: TOML in, a frozen `Study` out, or one message with every fault."""

import hashlib
import math
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Union

import numpy as np
from pydantic import AfterValidator, Field, PlainValidator, SerializeAsAny, TypeAdapter, ValidationError

from study.estimators import ESTIMATORS
from study.experiment.conditions import CONDITIONS, NOISE, RADIUS, STORED, Condition, is_number
from study.experiment.config_faults import ConfigError, Fault, distinct, report, toml_tables, toml_text
from study.experiment.departure_faults import departure_faults
from study.experiment.designs.design import Design
from study.experiment.designs.fields import MAX_CELLS
from study.experiment.designs.grid import GridDesign
from study.experiment.designs.random_design import RandomDesign
from study.experiment.distributions import Distribution
from study.experiment.noise.gaussian import NoiseLaw, gaussian
from study.experiment.posterior_config import Posterior, posterior_faults
from study.experiment.precision_config import Precision, precision_faults
from study.experiment.toml_model import Distinct, Frozen, Listed
from study.text.nearest import did_you_mean

_EITHER: Any = Annotated[Union[RandomDesign, GridDesign], Field(discriminator="kind")]  # noqa: UP007  two variables
MAX_SAMPLES = 1_000_000_000
"""Limit of a trial's samples, whose directions, noise and points lie in memory together."""
_DESIGNS: TypeAdapter[Design] = TypeAdapter(_EITHER)


def _known_estimators(names: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in ESTIMATORS]
    if unknown:
        raise ValueError(f"{', '.join(map(repr, unknown))} unknown; {did_you_mean(unknown, ESTIMATORS)}")
    return names


FolderName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,60}$")]
EstimatorNames = Annotated[Distinct[str], AfterValidator(_known_estimators)]


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
    design: Annotated[SerializeAsAny[Design], PlainValidator(_DESIGNS.validate_python)]
    posterior: Posterior | None = None
    precision: Precision | None = None
    """The rule by which a cell has enough trials; without it, each has as many as the design says."""

    @property
    def noise_law(self) -> NoiseLaw:
        """The law of the noise of a sample."""
        return gaussian(self.noise_shape, self.dimension)

    def cells(self) -> int:
        """Number of cells: in a random design, one per trial."""
        return self.design.cells()

    def independent(self) -> bool:
        """True if no two cells share their directions and noise."""
        return self.design.independent()

    def conditions(self) -> tuple[Condition, ...]:
        """The conditions that have a column in the study's tables."""
        given = self.design.given()
        return tuple(c for c in STORED if not c.silent or c.name in given)

    def canonical(self) -> str:
        """The config as JSON, as far as it determines the error table.

        That leaves out ``[posterior]``, the tolerance of failures, and the budget of time.
        """
        left_out: dict[str, Any] = dict.fromkeys(("posterior", "tolerate_failures"), True) | {"precision": {"seconds"}}
        return self.model_dump_json(exclude=left_out | dict.fromkeys(self._unused(), True))

    def stem(self) -> str:
        """The entries that determine a row besides its cell, trial and estimator, as JSON: the seed, for example."""
        left_out = {"posterior", "precision", "tolerate_failures", "name", "design", "estimators", "keep_points"}
        return self.model_dump_json(exclude={*left_out, *self._unused()})

    def _unused(self) -> set[str]:
        """Newer entries that are at their defaults; they are left out, so that older configs keep their digest."""
        names = ("route", "keep", "precision")
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
    faults = _faults_between_keys(raw)
    study = None
    try:
        study = Study.model_validate(raw)
    except ValidationError as error:
        faults = distinct(faults + report(error, _KEYS))
    if study is not None and study.cells() > MAX_CELLS:
        faults.append(Fault(("design",), f"{study.cells():,} cells; at most {MAX_CELLS:,} are allowed"))
    elif study is not None:
        refusing = {"posterior": study.posterior is not None, "noise_shape": study.noise_shape is not None}
        faults += departure_faults(study.design.given(), refusing)
        faults += _moment_faults(study.design) if study.route == "moments" else []
        faults += _level_faults(study.design)
        if study.posterior is not None:
            faults += posterior_faults(study.posterior, study.design, study.dimension, study.noise_shape is not None)
        if study.precision is not None:
            faults += precision_faults(study.precision, study.estimators, study.design, study.keep)
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


def _faults_between_keys(raw: dict[str, Any]) -> list[Fault]:
    """Find entries that do not go together. Those of the wrong type are left to the schema."""
    faults: list[Fault] = []
    design, d = raw.get("design"), raw.get("dimension", 3)
    if not isinstance(d, int) or not isinstance(design, dict):
        return faults
    given = [key for key in (NOISE.name, NOISE.alternative) if key in design]
    if len(given) != 1:
        found = " and ".join(given) or "neither"
        words = f"give noise or noise_over_radius, one of the two (found {found})"
        either = () if given else tuple(("design", str(key)) for key in (NOISE.name, NOISE.alternative))
        faults.append(Fault(("design",), words, wants=either))
    counts = _sample_counts(design.get("samples"))
    if counts and min(counts) < d + 1:
        words = f"{min(counts):g} samples are too few: a sphere in dimension {d} needs at least {d + 1}"
        faults.append(Fault(("design", "samples"), words, design["samples"]))
    if counts and max(counts) > MAX_SAMPLES:
        words = f"{max(counts):g} samples are too many for memory: at most {MAX_SAMPLES:,} are allowed"
        faults.append(Fault(("design", "samples"), words, design["samples"]))
    shape = raw.get("noise_shape")
    if shape is not None:
        faults += _shape_faults(shape, d)
    return faults + _route_faults(raw, design)


def _level_faults(design: Design) -> list[Fault]:
    """Find noise that float64 cannot hold both as σ and as σ over the radius."""
    given = design.given()
    name = NOISE.name if NOISE.name in given else NOISE.alternative
    if name not in given:  # which is another fault
        return []
    noises, radii = (
        entry.possible() if isinstance(entry, Distribution) else entry for entry in (given[name], given[RADIUS.name])
    )
    for noise, radius in product((min(noises), max(noises)), (min(radii), max(radii))):
        if noise > 0.0 and radius > 0.0:  # the lower end of a law is never drawn
            other = noise / radius if name == NOISE.name else noise * radius
            if not 0.0 < other < math.inf:
                kind = "σ/r" if name == NOISE.name else "σ"
                words = f"with radius = {radius:g} {kind} is {other:g} in float64: give another noise or radius"
                return [Fault(("design", str(name)), words, noise)]
    return []


def _route_faults(raw: dict[str, Any], design: dict[str, Any]) -> list[Fault]:
    """Find entries that do not go with the route through joint moments, or with storing summaries alone."""
    faults: list[Fault] = []
    grid = design.get("kind") == "grid"
    if raw.get("route") == "moments":
        names = raw.get("estimators")
        known = [name for name in names if name in ESTIMATORS] if isinstance(names, list) else []
        others = [name for name in known if not ESTIMATORS[name].moments_suffice]
        if others:
            closed = ", ".join(name for name, entry in ESTIMATORS.items() if entry.moments_suffice)
            faults.append(
                Fault(("estimators",), f"{', '.join(others)} need the points; the moments suffice for {closed}")
            )
        if raw.get("noise_shape") is not None:
            faults.append(Fault(("noise_shape",), 'the route "moments" is for isotropic noise'))
        if raw.get("keep_points"):
            faults.append(Fault(("keep_points",), 'the route "moments" forms no points'))
        if not grid:
            faults.append(Fault(("route",), 'a random design draws every trial for one level: route = "points"'))
    if raw.get("keep") == "summary":
        if not grid:
            faults.append(Fault(("keep",), 'a random design has one trial in a cell: keep = "errors"'))
        if raw.get("keep_points"):
            faults.append(Fault(("keep_points",), 'belongs to the errors, which keep = "summary" does not store'))
    return faults


def _moment_faults(design: Design) -> list[Fault]:
    """Find conditions that fits from joint moments would take no account of, unless they are at their defaults."""
    given = [CONDITIONS[name] for name in design.given()]
    unknown = [c.name for c in given if not c.by_moments and design.values(c) != (c.default,)]
    if not unknown:
        return []
    words = f'the route "moments" takes no account of {" and ".join(unknown)}'
    return [Fault(("route",), f'{words}: take {"it" if len(unknown) == 1 else "them"} out, or route = "points"')]


def _sample_counts(samples: object) -> list[int]:
    """Numbers of samples that a design's entry can give, ends of ranges among them; none if the schema refuses it."""
    if isinstance(samples, dict):
        if "law" in samples:
            ends = [samples.get(key) for key in ("low", "high", "value")]
            values = [*ends, *_as_list(samples.get("values"))]
        else:
            values = [v for ends in samples.values() for v in _as_list(ends)[:2]]
    else:
        values = _as_list(samples)
    return [round(v) for v in values if isinstance(v, int | float) and is_number(v)]


def _as_list(value: object) -> list[Any]:
    return list(value) if isinstance(value, list) else [value]


def _shape_faults(shape: object, d: int) -> list[Fault]:
    """Check that a noise shape is a covariance (d, d)."""
    try:
        matrix = np.asarray(shape, dtype=float)
        good = matrix.shape == (d, d) and bool(np.all(np.isfinite(matrix))) and bool(np.all(matrix == matrix.T))
        if good:
            values = np.linalg.eigvalsh(matrix)
            good = bool(values[0] > d * np.finfo(float).eps * values[-1])
    except (ValueError, TypeError, OverflowError):
        good = False
    words = f"must be a symmetric, positive definite {d} × {d} matrix (list of rows)"
    return [] if good else [Fault(("noise_shape",), words, shape)]


_KEYS: dict[tuple[str, ...], list[str]] = {
    (): list(Study.model_fields),
    ("posterior",): list(Posterior.model_fields),
    ("precision",): list(Precision.model_fields),
    ("design",): sorted({*RandomDesign.model_fields, *GridDesign.model_fields}),
    ("design", "kind"): ["random", "grid"],
    **{("design", name): ["law", "value", "values", "low", "high", "linspace", "logspace"] for name in CONDITIONS},
}

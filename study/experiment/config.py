"""A study's config: TOML in, a frozen `Study` out, or one message with every fault."""

import difflib
import hashlib
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Union

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    SerializeAsAny,
    TypeAdapter,
    ValidationError,
)

from study.estimators import ESTIMATORS
from study.experiment.conditions import ANGLE, CONDITIONS, SAMPLES, STORED, Condition, is_number
from study.experiment.config_faults import ConfigError, Fault, report
from study.experiment.designs.design import Design
from study.experiment.designs.fields import MAX_CELLS
from study.experiment.designs.grid import GridDesign
from study.experiment.designs.random_design import RandomDesign
from study.experiment.distributions import Frozen
from study.experiment.noise import NoiseLaw, gaussian
from study.experiment.posterior_config import Posterior, same
from study.experiment.precision_config import Precision, precision_faults

_EITHER: Any = Annotated[Union[RandomDesign, GridDesign], Field(discriminator="kind")]  # noqa: UP007  two variables
_DESIGNS: TypeAdapter[Design] = TypeAdapter(_EITHER)


def _tuples(value: object) -> object:
    """Lists as TOML has them, to tuples, which a frozen config holds."""
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _known_estimators(names: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in ESTIMATORS]
    if unknown:
        near = [difflib.get_close_matches(name, ESTIMATORS, n=1) for name in unknown]
        hint = "".join(f"; did you mean {n[0]!r}?" for n in near if n)
        raise ValueError(f"{', '.join(map(repr, unknown))} unknown: known are {', '.join(ESTIMATORS)}{hint}")
    if len(set(names)) < len(names):
        raise ValueError("an estimator is named twice")
    return names


class Study(Frozen):
    """A whole study, as its config gives it."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,60}$")]
    seed: Annotated[int, Field(ge=0)]
    dimension: Annotated[int, Field(ge=2, le=50)] = 3
    estimators: Annotated[
        tuple[str, ...], BeforeValidator(_tuples), Field(min_length=1), AfterValidator(_known_estimators)
    ]
    noise_shape: Annotated[tuple[tuple[float, ...], ...], BeforeValidator(_tuples)] | None = None
    """Covariance of a sample in units of σ² (d, d); the identity if absent."""
    keep_points: Annotated[int, Field(ge=0)] = 0
    """The trials whose points are stored: those with a number below this one, in each cell."""
    tolerate_failures: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Share of the fits that may fail - raise, or kill their worker - before a complete run counts as a bad one."""
    route: Literal["points", "moments"] = "points"
    """How fits are computed: from points, as the paper did, rounding included; or, closed forms only, from the joint
    moments of directions and noise, which gives the statistical error alone and all noise levels at once."""
    keep: Literal["errors", "summary"] = "errors"
    """What is stored of the trials: every error, or their summary alone."""
    design: Annotated[SerializeAsAny[Design], PlainValidator(_DESIGNS.validate_python)]
    posterior: Posterior | None = None
    precision: Precision | None = None
    """When a cell has trials enough; without it each has as many as its design says."""

    @property
    def noise_law(self) -> NoiseLaw:
        """The law of the noise of a sample."""
        return gaussian(self.noise_shape, self.dimension)

    def cells(self) -> int:
        """Number of cells: in a random design, one per trial."""
        return self.design.cells()

    def independent(self) -> bool:
        """Whether no two cells share their directions and noise."""
        return self.design.independent()

    def conditions(self) -> tuple[Condition, ...]:
        """The conditions that are columns of the study's tables."""
        return tuple(c for c in STORED if not c.silent or c.name in self.design.given())

    def canonical(self) -> str:
        """All that determines the error table, as JSON: without ``[posterior]``, tolerance, and budget of time."""
        left_out: dict[str, Any] = dict.fromkeys(("posterior", "tolerate_failures"), True) | {"precision": {"seconds"}}
        return self.model_dump_json(exclude=left_out | dict.fromkeys(self._usual(), True))

    def stem(self) -> str:
        """What determines any row besides its condition, trial and estimator, as JSON: the seed, for example."""
        left_out = {"posterior", "precision", "tolerate_failures", "name", "design", "estimators", "keep_points"}
        return self.model_dump_json(exclude={*left_out, *self._usual()})

    def _usual(self) -> set[str]:
        """Keys that leave no trace at their defaults, so that configs from before they were are what they were."""
        names = ("route", "keep", "precision")
        return {name for name in names if getattr(self, name) == type(self).model_fields[name].default}

    def digest(self) -> str:
        """Ten hexadecimal digits that stand for the canonical config."""
        return hashlib.sha256(self.canonical().encode()).hexdigest()[:10]

    def run_name(self) -> str:
        """Name of the run's folder."""
        return f"{self.name}-{self.digest()}"


def parse(text: str, source: str = "config") -> Study:
    """Read a config.

    Args:
        text: the TOML document.
        source: what to call it in messages.

    Raises:
        ConfigError: with every fault, its place, the value and what is allowed.
    """
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits, or brackets in thousands
        raise ConfigError(f"{source}: not TOML: {error}") from None
    faults = _across(raw)
    study = None
    try:
        study = Study.model_validate(raw)
    except ValidationError as error:
        faults = report(error, _KEYS) + faults
    if study is not None and study.cells() > MAX_CELLS:
        faults.append(Fault(("design",), f"{study.cells():,} cells; at most {MAX_CELLS:,} are allowed"))
    elif study is not None:
        if study.posterior is not None:
            faults += _posterior_faults(study, study.posterior)
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
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from None
    return parse(text, str(path)), text


def _across(raw: dict[str, Any]) -> list[Fault]:
    """Faults that lie between keys. Keys of the wrong type are left to the schema."""
    faults: list[Fault] = []
    design, d = raw.get("design"), raw.get("dimension", 3)
    if not isinstance(d, int) or not isinstance(design, dict):
        return faults
    given = [key for key in ("noise", "noise_over_radius") if key in design]
    if len(given) != 1:
        found = " and ".join(given) or "neither"
        faults.append(Fault(("design",), f"give noise or noise_over_radius, one of the two (found {found})"))
    few = _least_samples(design.get("samples"))
    if few is not None and few < d + 1:
        words = f"{few:g} samples are too few: a sphere in dimension {d} needs at least {d + 1}"
        faults.append(Fault(("design", "samples"), words))
    shape = raw.get("noise_shape")
    if shape is not None:
        faults += _shape_faults(shape, d)
    return faults + _route_faults(raw, design)


def _route_faults(raw: dict[str, Any], design: dict[str, Any]) -> list[Fault]:
    """What the route through joint moments, and the keeping of summaries alone, do not give."""
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


def _least_samples(samples: object) -> float | None:
    """Smallest sample count that a design's entry can give; None where the schema will complain."""
    if isinstance(samples, dict):
        if "law" in samples:
            values = [samples.get("low"), samples.get("value"), *_as_list(samples.get("values"))]
        else:
            values = [v for ends in samples.values() for v in _as_list(ends)[:2]]
    else:
        values = _as_list(samples)
    numbers = [round(v) for v in values if isinstance(v, int | float) and is_number(v)]
    return min(numbers, default=None)


def _as_list(value: object) -> list[Any]:
    return list(value) if isinstance(value, list) else [value]


def _shape_faults(shape: object, d: int) -> list[Fault]:
    """A noise shape must be a covariance (d, d)."""
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


def _posterior_faults(study: Study, posterior: Posterior) -> list[Fault]:
    """Posteriors that the design cannot give."""
    design, where = study.design, dict(posterior.where)
    possible = {name: design.values(condition) for name, condition in CONDITIONS.items()}
    faults = []
    for name, chosen in where.items():
        values = possible[name]
        for value in chosen if values is not None else ():
            words = value if isinstance(value, str) else f"{value:.12g}"
            if not any(same(value, v) for v in values or ()):
                faults.append(Fault(("posterior", "where"), f"no cell has {name} = {words}"))
    angles = where.get(ANGLE.name) or possible[ANGLE.name] or (math.nan,)
    if "whole_sphere" in posterior.likelihood and any(v != 180.0 for v in angles):
        words = "whole_sphere is wrong on caps: choose cells of the whole sphere with where = { angle = 180 }"
        faults.append(Fault(("posterior", "likelihood"), words))
    least = min(map(float, where.get(SAMPLES.name, ())), default=design.least_samples())
    if "unknown" in posterior.noise and least < study.dimension + 2:
        words = f"an unknown noise needs at least {study.dimension + 2} samples, not {least:g}; choose with where"
        faults.append(Fault(("posterior", "noise"), words))
    least_walkers = 2 * (study.dimension + 3)
    if posterior.walkers < least_walkers:
        words = f"at least {least_walkers} are needed in dimension {study.dimension}"
        faults.append(Fault(("posterior", "walkers"), words, posterior.walkers))
    if study.noise_shape is not None:
        faults.append(Fault(("posterior",), "its likelihoods are of isotropic noise: take noise_shape out"))
    return faults


_KEYS: dict[tuple[str, ...], list[str]] = {
    (): list(Study.model_fields),
    ("posterior",): list(Posterior.model_fields),
    ("precision",): list(Precision.model_fields),
    ("design",): sorted({*RandomDesign.model_fields, *GridDesign.model_fields}),
    **{("design", name): ["law", "value", "values", "low", "high", "linspace", "logspace"] for name in CONDITIONS},
}

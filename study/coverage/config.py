"""The config of a coverage study: caps, numbers of samples, and noise up to the level at which curvature is lost.

Noise is given by κ = (v/σ²)√(N/2), the least variance v of the directions over the standard error of the noise's
variance. It compares the extent along the cap's axis with the noise. Curvature is lost near κ = 1, whatever the cap.
"""

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field, ValidationError

from study.estimators import ESTIMATORS
from study.experiment.config import EstimatorNames, FolderName
from study.experiment.config_faults import ConfigError, Fault, report, toml_tables, toml_text
from study.experiment.toml_model import Distinct, Frozen


def _without_noise(names: tuple[str, ...]) -> tuple[str, ...]:
    if given := [name for name in names if ESTIMATORS[name].needs]:
        raise ValueError(f"{', '.join(map(repr, given))}: needs the noise, which no interval is given; leave it out")
    return names


_LEAST_TRIALS = 20
"""Trials of a cell from which shares and medians have errors."""
_Degrees = Annotated[float, Field(gt=0.0, le=180.0)]


class CoverageCell(NamedTuple):
    """One condition: N, φ in degrees, κ, σ in radii, and its number of trials."""

    samples: int
    angle: float
    kappa: float
    sigma: float
    trials: int


class CoverageDesign(Frozen):
    """A coverage study on spherical caps in three dimensions.

    Attributes:
        name: name of the results' folder.
        seed: of the streams.
        estimators: those whose estimate ± t standard errors is compared with the interval.
        angle: half-angles of the caps, in degrees.
        samples: numbers of samples N.
        kappa: values of κ.
        largest_noise: cells with σ above this many radii are left out.
        level: nominal coverage.
        trials: number of trials of a cell.
        most_samples: number of samples of all trials of a cell, at most: cells with large N have fewer trials.
    """

    name: FolderName
    seed: Annotated[int, Field(ge=0)]
    estimators: Annotated[EstimatorNames, AfterValidator(_without_noise)]
    angle: Distinct[_Degrees]
    samples: Distinct[Annotated[int, Field(ge=6)]]
    kappa: Distinct[Annotated[float, Field(gt=0.0)]]
    largest_noise: Annotated[float, Field(gt=0.0)] = 0.9
    level: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.95
    trials: Annotated[int, Field(ge=100)] = 4000
    most_samples: Annotated[int, Field(ge=10_000)] = 4_000_000

    def cells(self) -> list[CoverageCell]:
        """All conditions whose noise is not too large."""
        found = []
        for n, angle, kappa in product(self.samples, self.angle, self.kappa):
            sigma = relative_noise(n, angle, kappa)
            if sigma <= self.largest_noise:
                found.append(CoverageCell(n, angle, kappa, sigma, min(self.trials, self.most_samples // n)))
        return found


def relative_noise(samples: int, angle: float, kappa: float) -> float:
    """The noise σ in radii that has a κ."""
    return math.sqrt(least_variance(angle) / kappa * math.sqrt(samples / 2.0))


def least_variance(angle: float) -> float:
    """The least variance v of directions that are uniform on a cap of a half-angle in degrees, in three dimensions."""
    height = 2.0 * math.sin(math.radians(angle) / 2.0) ** 2
    along = height * height / 12.0
    across = 0.5 * (1.0 - (along + (1.0 - height / 2.0) ** 2))
    return min(along, across)


def read_design(path: Path) -> CoverageDesign:
    """Read a config of a coverage study.

    Raises:
        ConfigError: with every fault, its place and its value.
    """
    text = toml_text(path)
    try:
        design = CoverageDesign.model_validate(toml_tables(text, str(path)))
    except ValidationError as error:
        known: dict[tuple[str, ...], list[str]] = {(): list(CoverageDesign.model_fields)}
        raise ConfigError.listing(str(path), text, report(error, known)) from None
    if faults := list(_faults(design)):
        raise ConfigError.listing(str(path), text, faults)
    return design


def _faults(design: CoverageDesign) -> Iterator[Fault]:
    """Faults of a design whose entries are fine by themselves."""
    least = min(relative_noise(*each) for each in product(design.samples, design.angle, design.kappa))
    if least > design.largest_noise:
        words = f"leaves no cell, as the least noise is {least:.3g} radii; raise it, or kappa"
        yield Fault(("largest_noise",), words, design.largest_noise)
    most = max(design.samples)
    if design.most_samples < _LEAST_TRIALS * most:
        trials = f"{design.most_samples // most:,} of the {_LEAST_TRIALS} trials that a cell with N = {most:,} needs"
        words = f"is enough for {trials}; give at least {_LEAST_TRIALS * most:,}, or smaller samples"
        yield Fault(("most_samples",), words, design.most_samples)

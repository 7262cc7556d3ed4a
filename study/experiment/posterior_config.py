"""The section ``[posterior]`` of a config: cells and trials, likelihood, and length of the chains."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from study.estimators.status import Worded
from study.experiment.conditions import ANGLE, CONDITIONS, SAMPLES, Value
from study.experiment.config_faults import Fault
from study.experiment.designs.cells import Cell
from study.experiment.designs.design import Design
from study.experiment.toml_model import Distinct, Frozen

Noise = Literal["known", "unknown"]
Likelihood = Literal["geometric", "whole_sphere"]


class ChainStatus(Worded):
    """The way a chain ended."""

    OK = 0, "ok"
    NOT_CONVERGED = 1, "the chain did not reach 50 autocorrelation times, stable to 1 %, within its budget of steps"
    AT_PRIOR = 2, "the posterior reaches the prior's box, which decides the answer: the data alone do not bound it"
    NO_START = 3, "no finite error ellipsoid within the prior's box to start from"
    NOT_MIXED = 4, "walkers that started at different modes of the posterior did not mix within the budget of steps"


def _listed(value: object) -> Sequence[Any]:
    """Make a list of one value."""
    return value if isinstance(value, list | tuple) else (value,)


def _conditions(value: object) -> tuple[tuple[str, tuple[Value, ...]], ...]:
    """Check ``where``, which has conditions and the values chosen of each."""
    if not isinstance(value, dict):
        raise ValueError("must be a table of conditions and values, such as { angle = [60, 180], samples = 100 }")
    unknown = [key for key in value if key not in CONDITIONS]
    if unknown:
        raise ValueError(f"{', '.join(unknown)} unknown: conditions are {', '.join(CONDITIONS)}")
    listed = {key: _listed(values) for key, values in value.items()}
    if any(not values for values in listed.values()):
        raise ValueError("every list must have a value; leave a condition out to choose all of its cells")
    if any(not CONDITIONS[key].holds(v) for key, values in listed.items() for v in values):
        raise ValueError("every value must be a number")
    return tuple((key, tuple(v if isinstance(v, str) else float(v) for v in values)) for key, values in listed.items())


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
    noise: Annotated[Distinct[Noise], BeforeValidator(_listed)] = ("known", "unknown")
    likelihood: Annotated[Distinct[Likelihood], BeforeValidator(_listed)] = ("geometric",)
    box: Annotated[float, Field(gt=0.0, le=1e3)] = 10.0
    walkers: Annotated[int, Field(ge=8, le=4096)] = 64
    max_steps: Annotated[int, Field(ge=100, le=10_000_000)] = 20_000
    keep_draws: Annotated[int, Field(ge=0)] = 1

    def chooses(self, cell: Cell) -> bool:
        """True if the config chooses a cell; values agree to nine digits."""
        values = cell.values
        return all(any(same(CONDITIONS[name].of(values), v) for v in chosen) for name, chosen in self.where)


def posterior_faults(posterior: Posterior, design: Design, dimension: int, shaped: bool) -> list[Fault]:
    """Find entries of a ``[posterior]`` that a study cannot satisfy.

    Args:
        posterior: the config's section.
        design: the study's.
        dimension: the study's.
        shaped: the study's noise has a shape.
    """
    where = dict(posterior.where)
    possible = {name: design.values(condition) for name, condition in CONDITIONS.items()}
    faults = []
    for name, chosen in where.items():
        values = possible[name]
        for value in chosen:
            if values is not None and not any(same(value, v) for v in values):
                words = value if isinstance(value, str) else f"{value:.12g}"
                faults.append(Fault(("posterior", "where"), f"no cell has {name} = {words}"))
    if "trials" in posterior.model_fields_set and posterior.trials > design.trials:
        words = f"more trials than a cell has: design.trials = {design.trials:,}"
        faults.append(Fault(("posterior", "trials"), words, posterior.trials))
    angles = where.get(ANGLE.name) or possible[ANGLE.name] or (math.nan,)
    if "whole_sphere" in posterior.likelihood and any(v != 180.0 for v in angles):
        words = "whole_sphere is wrong on caps: choose cells of the whole sphere with where = { angle = 180 }"
        faults.append(Fault(("posterior", "likelihood"), words))
    least = min(map(float, where.get(SAMPLES.name, ())), default=design.least_samples())
    if "unknown" in posterior.noise and least < dimension + 2:
        words = f"an unknown noise needs at least {dimension + 2} samples, not {least:g}; choose with where"
        faults.append(Fault(("posterior", "noise"), words))
    least_walkers = 2 * (dimension + 3)
    if posterior.walkers < least_walkers:
        words = f"at least {least_walkers} are needed in dimension {dimension}"
        faults.append(Fault(("posterior", "walkers"), words, posterior.walkers))
    if shaped:
        faults.append(Fault(("posterior",), "its likelihoods are of isotropic noise: take noise_shape out"))
    return faults


def same(a: Value, b: Value) -> bool:
    """True if two values of a condition are the same word, or agree to nine digits."""
    if isinstance(a, str) or isinstance(b, str):
        return a == b
    return abs(a - b) <= 1e-9 * max(abs(a), abs(b))

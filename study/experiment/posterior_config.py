"""What a config's ``[posterior]`` asks for: which cells and trials, which likelihood, and how long a chain may be."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from study.estimators.status import Worded
from study.experiment.distributions import Frozen, is_number

CONDITIONS = ("samples", "noise", "noise_over_radius", "angle", "radius", "center")
Noise = Literal["known", "unknown"]
Likelihood = Literal["geometric", "whole_sphere"]


class ChainStatus(Worded):
    """How a chain ended."""

    OK = 0, "ok"
    NOT_CONVERGED = 1, "the chain did not reach 50 autocorrelation times, stable to 1 %, within its budget of steps"
    AT_PRIOR = 2, "the posterior reaches the prior's box, which decides the answer: the data alone do not bound it"
    NO_START = 3, "no finite error ellipsoid within the prior's box to start from"
    NOT_MIXED = 4, "walkers that started at different humps of the posterior did not mix within the budget of steps"


def _listed(value: Any) -> Any:
    """One value as a list of one; a list as a tuple, which a frozen config holds."""
    return tuple(value) if isinstance(value, list | tuple) else (value,)


def _conditions(value: Any) -> Any:
    """Check ``where``: conditions and the values chosen of each."""
    if not isinstance(value, dict):
        raise ValueError("must be a table of conditions and values, such as { angle = [60, 180], samples = 100 }")
    unknown = [key for key in value if key not in CONDITIONS]
    if unknown:
        raise ValueError(f"{', '.join(unknown)} unknown: conditions are {', '.join(CONDITIONS)}")
    listed = {key: _listed(values) for key, values in value.items()}
    if any(not values for values in listed.values()):
        raise ValueError("every list must have a value; leave a condition out to choose all of its cells")
    if any(not is_number(v) for values in listed.values() for v in values):
        raise ValueError("every value must be a number")
    return tuple((key, tuple(float(v) for v in values)) for key, values in listed.items())


def _unique(values: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(values)) < len(values):
        raise ValueError("a value is named twice")
    return values


class Posterior(Frozen):
    """Ensemble posteriors of (c, r) for some of a study's trials.

    Attributes:
        trials: of each chosen cell, the trials with a number below this one.
        where: conditions that choose cells, each with the values chosen; all cells, if empty.
        noise: whether σ is known, or one more parameter, or one chain of each.
        likelihood: geometric; or whole_sphere, or both, where every chosen cell's angle is 180°.
        box: half-width of the prior box on the centre, about the true one, in true radii.
        walkers: of the ensemble.
        max_steps: of a chain, after which it is reported as not converged.
        keep_draws: the trials whose draws are stored, thinned: those with a number below this one.
    """

    trials: Annotated[int, Field(ge=1)] = 4
    where: Annotated[tuple[tuple[str, tuple[float, ...]], ...], BeforeValidator(_conditions)] = ()
    noise: Annotated[tuple[Noise, ...], BeforeValidator(_listed), Field(min_length=1), AfterValidator(_unique)] = (
        "known",
        "unknown",
    )
    likelihood: Annotated[
        tuple[Likelihood, ...], BeforeValidator(_listed), Field(min_length=1), AfterValidator(_unique)
    ] = ("geometric",)
    box: Annotated[float, Field(gt=0.0, le=1e3)] = 10.0
    walkers: Annotated[int, Field(ge=8, le=4096)] = 64
    max_steps: Annotated[int, Field(ge=100, le=10_000_000)] = 20_000
    keep_draws: Annotated[int, Field(ge=0)] = 1

    def chooses(self, **conditions: float) -> bool:
        """Whether a cell of these conditions is among those asked for; values agree to nine digits."""
        return all(any(same(conditions[name], value) for value in values) for name, values in self.where)


def same(a: float, b: float) -> bool:
    """Whether two conditions agree to nine digits."""
    return abs(a - b) <= 1e-9 * max(abs(a), abs(b))

"""Studies that are timed: grids of one angle, computed as a run computes them."""

from functools import partial

from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch
from study.simulation.experiment.sampling import units

FOUR = ["mle", "lls", "gdke", "ugdk"]


def grid(samples, trials, levels=(0.05,), estimators=FOUR, dimension=3, **entries):
    """A study of one number of samples on caps of 60°."""
    design = {"kind": "grid", "trials": trials, "samples": [samples], "noise": list(levels), "angle": 60.0}
    return Study.model_validate(
        {"name": "bench", "seed": 1, "dimension": dimension, "estimators": estimators, "design": design, **entries}
    )


def whole(study):
    """The study as one unit, ready to be computed in this thread."""
    first, *more = units(study)
    return partial(compute, study, Batch(first.group, 0, more[-1].last if more else first.last))

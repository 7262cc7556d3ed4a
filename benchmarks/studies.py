"""Studies that are timed, as a run computes them; data sets that are measured, and tables of what they give."""

import math
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from study.fits.points import cap
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import Study
from study.simulation.experiment.designs import Batch

ROOT = Path(__file__).resolve().parents[1]
FOUR = ["mle", "lls", "gdke", "ugdk"]
TOGETHER = 200_000
"""Points that are drawn at a time."""


def grid(samples, trials, levels=(0.05,), estimators=FOUR, dimension=3, **entries):
    """A study of one number of samples on caps of 60°."""
    design = {"kind": "grid", "trials": trials, "samples": [samples], "noise": list(levels), "angle": 60.0}
    return Study.model_validate(
        {"name": "bench", "seed": 1, "dimension": dimension, "estimators": estimators, "design": design, **entries}
    )


def whole(study):
    """The study as one unit, ready to be computed in this thread."""
    first, *more = study.units()
    return partial(compute, study, Batch(first.group, 0, more[-1].last if more else first.last))


def caps(rng, sets, n, angle, noise, dimension=3):
    """Noisy points (sets, n, d) on caps of the unit sphere about the origin."""
    directions = cap.sample_cap(rng, sets * n, math.radians(angle), dimension).reshape(sets, n, dimension)
    return directions + noise * rng.standard_normal(directions.shape)


def draws(state, sets, shape, angle):
    """Unit directions and unit noise (b, d, n) of so many sets of points on a cap, some at a time.

    Args:
        state: of the generator.
        sets: their number.
        shape: d and n.
        angle: half-angle of the cap, in degrees.
    """
    while sets > 0:
        batch = min(sets, max(TOGETHER // shape[1], 1))
        sets -= batch
        directions, noise = np.empty((batch, *shape)), np.empty((batch, *shape))
        cap.draw(state, math.radians(angle), directions, noise)
        directions[:, 0] = 1.0 - directions[:, 0]  # heights to cosines
        yield directions, noise


def clean(state, sets, n, angle, noise, dimension=3):
    """The same by the generator of the studies, in parts (b, d, n)."""
    for directions, unit_noise in draws(state, sets, (dimension, n), angle):
        yield directions + noise * unit_noise


def covered(ends, truth):
    """True where intervals (…, 2) hold the truth."""
    return (ends[..., 0] <= truth) & (truth <= ends[..., 1])


def share(name, hits):
    """A share, and its standard error, that of one hit at least."""
    held = np.clip(np.mean(hits), 1.0 / len(hits), 1.0 - 1.0 / len(hits))
    return {name: np.mean(hits), f"{name}_error": math.sqrt(held * (1.0 - held) / len(hits))}


def store(name, rows, form=None):
    """Store rows in a table of docs/assets/tables/, each as soon as it is known."""
    known = []
    for row in rows:
        known.append(row)
        path = ROOT / "docs" / "assets" / "tables" / f"{name}.csv"
        pd.DataFrame(known).to_csv(path, index=False, lineterminator="\n", float_format=form)

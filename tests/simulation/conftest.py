"""Tables of errors, of points and of posteriors."""

import itertools

import numpy as np
import pandas as pd
import pytest

from study.fits import Status
from study.simulation.experiment.config import ChainStatus
from study.simulation.posterior.run import KEYS


@pytest.fixture(scope="session")
def error_rows():
    """Rows of an error table: ``error`` is (trials, d), or (trials,) along the first axis of space."""

    def make(estimator, error, **columns):
        vectors = np.asarray(error, dtype=float)
        vectors = vectors if vectors.ndim > 1 else vectors[:, None] * [1.0, 0.0, 0.0]
        cell = {"cell": "a", "trial": np.arange(len(vectors)), "samples": 100, "noise": 0.05, "angle": 60.0}
        answer = {f"error_{i + 1}": column for i, column in enumerate(vectors.T)}
        answer["error"] = np.linalg.norm(vectors, axis=1) if np.ndim(error) > 1 else vectors[:, 0]
        rest = {"bound": 0.1, "radius_bound": 0.1, "noise_variance": 0.0025, "status": 0, "iterations": 0}
        fit = {"radius": 1.0, "center": 0.0, "estimator": estimator, "radius_error": 0.0, "condition": 0.5}
        return pd.DataFrame(cell | fit | answer | rest | columns)

    return make


@pytest.fixture(scope="session")
def kept_points():
    """A table of points (trials, n, d) about a centre."""

    def make(cell, x, radius, center=0.0):
        trials, n, d = x.shape
        centers = np.broadcast_to(center, d)
        axes = {f"x_{i + 1}": x[:, :, i].ravel() for i in range(d)}
        axes |= {f"center_{i + 1}": centers[i] for i in range(d)}
        index = {"cell": cell, "trial": np.repeat(np.arange(trials), n), "sample": np.tile(np.arange(n), trials)}
        return pd.DataFrame(index | axes | {"radius": radius})

    return make


@pytest.fixture(scope="session")
def chains():
    """A posterior table of so many trials in each kind; ranks and levels are uniform, all is ok."""

    def make(rng, count, likelihoods=("geometric",), noises=("known",), ranks=("1", "2", "radius"), **columns):
        parts = []
        for likelihood, noise_is in itertools.product(likelihoods, noises):
            part = {"cell": "c", "trial": np.arange(count), "likelihood": likelihood, "noise_is": noise_is}
            part |= {name: rng.random(count) for name in (*(f"rank_{ending}" for ending in ranks), "level")}
            part["rank_noise"] = rng.random(count) if noise_is == "unknown" else np.nan
            parts.append(pd.DataFrame(part | {"flatness": 0.001, "status": int(ChainStatus.OK)} | columns))
        return pd.concat(parts, ignore_index=True)

    return make


@pytest.fixture(scope="session")
def beside():
    """Answers to a posterior table, whose ranks and levels are uniform."""

    def make(rng, posterior, names=("mle", "gdke"), **columns):
        parts, uniform = [], [c for c in posterior if (c.startswith("rank_") and c != "rank_noise") or c == "level"]
        for name in names:
            part = posterior[KEYS].assign(estimator=name, status=int(Status.OK))
            parts.append(part.assign(**{c: rng.random(len(part)) for c in uniform}).assign(**columns))
        return pd.concat(parts, ignore_index=True)

    return make


@pytest.fixture(scope="session")
def as_stored():
    """A table as it comes back from a file: words are categories."""
    words = ("cell", "likelihood", "noise_is", "estimator")
    return lambda frame: frame.astype({word: "category" for word in words if word in frame})

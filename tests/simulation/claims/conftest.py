"""Tables in memory that claims read as if they were stored, and samples whose quantiles and means are known."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from study.files import RunError
from study.simulation.claims import CLAIMS
from study.simulation.claims.claim import Evidence, evaluate


class Stored:
    """A stand-in for a run: it gives tables and records their names."""

    def __init__(self, name, tables, asked):
        self.name, self.tables, self.asked = name, tables, asked
        self.study = SimpleNamespace(name=name)

    def table(self, name, columns=None, estimators=None):
        self.asked.add(f"{self.name}/{name}")
        if name not in self.tables:
            raise RunError(f"{self.name}/{name}.parquet: missing")
        frame = self.tables[name]
        frame = frame if estimators is None else frame[frame["estimator"].isin(estimators)]
        return frame if columns is None else frame[[each for each in frame.columns if each in columns]]


@pytest.fixture(scope="session")
def find():
    """Evaluate the claim of a name by tables ``{"config/table": frame}``; it may read what it declares, no more."""

    def run(name, tables, cost=None, recordings=None):
        (claim,) = (c for c in CLAIMS if c.name == name)
        asked, configs = set(), {}
        for path, frame in tables.items():
            config, _, table = path.partition("/")
            configs.setdefault(config, {})[table] = frame
        runs = [Stored(config, held, asked) for config, held in configs.items()]
        (finding,) = evaluate([claim], Evidence(runs, cost, recordings))
        assert asked <= set(claim.reads)
        return finding

    return run


@pytest.fixture(scope="session")
def grid_of(error_rows):
    """Errors of a grid with N = 1000: ``columns(name, angle, σ/r)`` gives those of an estimator in a cell."""

    def make(columns, names, angles, levels):
        rows = []
        for angle in angles:
            for level in levels:
                cell = {"cell": f"{angle}, {level}", "angle": angle, "noise": level, "samples": 1000}
                rows += [error_rows(name, **cell | columns(name, angle, level)) for name in names]
        return pd.concat(rows, ignore_index=True)

    return make


@pytest.fixture(scope="session")
def scores():
    """A sample of n whose distribution is the standard normal as nearly as n values can be: no chance in it."""
    return lambda n: stats.norm.ppf((np.arange(n) + 0.5) / n)


@pytest.fixture(scope="session")
def marker_tables(error_rows, kept_points, on_cap):
    """Tables of errors and points of markers of given radii under given noises, each drawn by itself."""

    def make(seed, radii, noises, trials=200, samples=100, angle=60.0, d=3, told=1.0):
        rng = np.random.default_rng(seed)
        errors, points = [], []
        for noise in noises:
            for radius in radii:
                cell = f"{noise:g}, {radius:g}"
                x, _ = on_cap(rng, samples, angle, d, noise, radius, sets=trials)
                conditions = {"samples": samples, "angle": angle, "noise": told * noise, "radius": radius}
                errors.append(error_rows("ugdk", np.zeros(trials), cell=cell, **conditions))
                points.append(kept_points(cell, x, radius))
        return pd.concat(errors, ignore_index=True), pd.concat(points, ignore_index=True)

    return make

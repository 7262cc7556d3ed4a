"""Small tables with known contents, for the figures to draw."""

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import pytest

from study.simulation.experiment.noise import GaussianNoise
from study.simulation.figures import NotApplicable, Tables
from tests.summaries import summary

ESTIMATORS = ["mle", "lls", "gdke", "ugdk"]


@pytest.fixture
def make_rows(error_rows):
    """Rows of an error table of a cell; error is (trials, d)."""
    usual = {"condition": np.nan}
    return lambda cell, estimator, error, **columns: error_rows(estimator, error, cell=cell, **usual | columns)


@dataclass(frozen=True)
class MadeTables(Tables):
    """Tables that were made in memory, None for one that is not stored. All else is as of a run's."""

    name: str
    dimension: int
    design: str
    noise_law: GaussianNoise
    independent: bool = True
    run: "MadeTables" = field(init=False)
    stored: frozenset[str] = field(init=False)
    rows: pd.DataFrame | None = None
    summary: pd.DataFrame | None = None
    points: pd.DataFrame | None = None
    posterior: pd.DataFrame | None = None
    answers: pd.DataFrame | None = None
    draws: pd.DataFrame | None = None

    def __post_init__(self):
        object.__setattr__(self, "run", self)
        object.__setattr__(self, "stored", frozenset({"summary"} | ({"errors"} if self.rows is not None else set())))

    @property
    def errors(self):
        """The error table, which a test may change before a figure reads it."""
        return self.rows

    def table(self, name, columns=None, estimators=None, cells=None):
        """The error table's rows of some estimators and cells; all other tables are there already."""
        assert name == "errors"
        found = self.rows
        for key, names in (("estimator", estimators), ("cell", cells)):
            found = found if names is None else found[found[key].isin(names)]
        return found if columns is None else found[[each for each in found if each in columns]]

    def cells(self, columns):
        """The error table in one part."""
        yield self.rows

    def first_trials(self, most):
        """The first rows of the error table, sorted by trial as a random design has them."""
        rows = self.rows.sort_values(["cell", "trial"], kind="stable", ignore_index=True)
        return rows.head(most * len(self.estimators))


@pytest.fixture
def make_tables():
    """Tables of a run with the given error table."""

    def make(errors, design, points=None):
        d = 3 if "error_3" in errors else 2
        law, short = GaussianNoise(d), summary(errors, design == "random")
        return MadeTables("test-0123456789", d, design, law, rows=errors, summary=short, points=points)

    return make


@pytest.fixture
def random_tables(make_rows, make_tables):
    """400 trials of a random design over 20 decades: errors are an eighth of the noise, the bound is half of it."""
    rng = np.random.default_rng(1)
    noise = 10.0 ** rng.uniform(-10, 10, 400)
    direction = np.array([[1.0, 0.0, 0.0]])
    columns = {"noise": 2.0 * noise, "radius": 2.0, "bound": noise}
    parts = [make_rows("c", name, 0.25 * noise[:, None] * direction, **columns) for name in ESTIMATORS]
    return make_tables(pd.concat(parts, ignore_index=True), "random")


@pytest.fixture
def circle_tables(make_rows, make_tables, kept_points):
    """Circles of radius 2 about (3, 4): GDKE's errors are Gaussian about (1, 0), the others' about (0, 0)."""
    rng = np.random.default_rng(2)
    trials, kept, n = 3000, 5, 100
    parts = []
    for name in ESTIMATORS:
        error = rng.normal(size=(trials, 2)) * [0.2, 0.05] + [1.0 if name in ("gdke", "lls") else 0.0, 0.0]
        if name == "gdke":
            error = parts[1][["error_1", "error_2"]].to_numpy()  # that of lls
        condition = np.linspace(0.3, 0.9, trials) if name == "ugdk" else np.nan
        parts.append(make_rows("c", name, error, radius=2.0, center=5.0, condition=condition, noise=0.1))
    parts[3].loc[3, "condition"] = 0.55  # trial 3 is the nearest of the five that are kept
    theta = rng.uniform(-0.5, 0.5, (kept, n))
    points = kept_points("c", np.stack([3.0 + 2.0 * np.cos(theta), 4.0 + 2.0 * np.sin(theta)], axis=2), 2.0, [3.0, 4.0])
    return make_tables(pd.concat(parts, ignore_index=True), "grid", points)


@pytest.fixture
def power_tables(make_rows, make_tables):
    """Six numbers of samples: the errors of MLE and UGDK fall as N^-1/2, those of LLS and GDKE stop at 0.05."""
    rng = np.random.default_rng(3)
    parts = []
    for samples in (1000, 10, 30, 100, 300, 3000):  # not in order, as a config may have them
        unit = rng.normal(size=(400, 3)) / np.sqrt(samples)
        biased = 0.1 * unit + [0.05, 0.0, 0.0]
        for name, error in zip(ESTIMATORS, (0.1 * unit, biased, biased, 0.11 * unit), strict=True):
            bound = 0.1 * np.sqrt(3.0 / samples)
            parts.append(make_rows(f"c{samples}", name, error, samples=samples, bound=bound, noise=0.02))
    return make_tables(pd.concat(parts, ignore_index=True), "grid")


@pytest.fixture(scope="session")
def refused():
    """Hold that a figure cannot be fed by tables, or by these with changes, for a reason with these words."""

    def hold(figure, tables, words, **changes):
        with pytest.raises(NotApplicable, match=words):
            figure.prepare(replace(tables, **changes))

    return hold

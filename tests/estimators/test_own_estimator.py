"""A user's own estimator: with a function and a line in the registry it works like any other."""

import numpy as np
import pandas as pd
import pytest

import study
from study import Status
from study.analysis import estimator_list
from study.analysis.points.fitting import choose
from study.analysis.points.source import PointFileError
from study.estimators import Estimates, Estimator, Samples, fit
from study.estimators.estimates import blank
from study.experiment.config import ConfigError, parse
from study.runs import runner

CONFIG = """
name = "own"
seed = 3
estimators = ["gdke", "coope"]
[design]
kind = "grid"
trials = 40
samples = [12, 60]
noise = 0.02
angle = [60, 180]
radius = 2.0
"""


def coope(samples: Samples) -> Estimates:
    """Coope's fit: |x|² = 2c·x + k in least squares, once for each set."""
    result = blank(samples.shape[0], samples.shape[1])
    for t, x in enumerate(samples.points):
        beta = np.linalg.lstsq(np.column_stack([2 * x, np.ones(len(x))]), np.sum(x**2, axis=1))[0]
        result.center[t], result.radius[t] = beta[:-1], np.sqrt(beta[-1] + beta[:-1] @ beta[:-1])
    return result


@pytest.fixture
def registered(monkeypatch):
    """Register `coope` for one test."""
    monkeypatch.setitem(study.ESTIMATORS, "coope", Estimator(coope, "Coope 1993"))


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("d", [2, 3, 5])
def test_through_the_library(rng, on_cap, d):
    """`study.fit` calls it by name, and adds batches, missing samples and errors, which it does not handle itself."""
    points = on_cap(rng, 30, 100.0, d, 0.02, radius=2.0, center=1.0, sets=6)[0].reshape(2, 3, 30, d)
    points[1, 2, :4, 0] = np.nan
    mine, theirs = fit(points, "coope", noise=0.02), fit(points, "gdke", noise=0.02)
    np.testing.assert_allclose(mine.center, theirs.center, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mine.radius, theirs.radius, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mine.covariance, theirs.covariance, rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(mine.residual_rms, theirs.residual_rms, rtol=1e-8)
    np.testing.assert_array_equal(mine.count, theirs.count)
    assert np.all(mine.own_status == Status.OK)


@pytest.mark.usefixtures("registered")
def test_in_a_study(tmp_path):
    """A config that names it is valid, and the run's table has its rows beside the others', on the same points."""
    runner.run(parse(CONFIG), CONFIG, tmp_path / "run", 2)
    table = pd.read_parquet(tmp_path / "run" / "errors.parquet")
    mine, theirs = (table[table["estimator"] == name].reset_index(drop=True) for name in ("coope", "gdke"))
    assert len(mine) == len(theirs) == 40 * 4
    for column in ("cell", "trial", "samples", "angle", "bound"):
        pd.testing.assert_series_equal(mine[column], theirs[column])
    for column in ("error_1", "error_2", "error_3", "error", "radius_error"):
        np.testing.assert_allclose(mine[column], theirs[column], rtol=0, atol=1e-9)
    assert (mine["status"] == Status.OK).all()


def test_not_registered():
    """Without its line in the registry the library and a config raise an error that names it."""
    with pytest.raises(ValueError, match="coope"):
        fit(np.eye(4, 3), "coope")
    with pytest.raises(ConfigError, match="coope"):
        parse(CONFIG)


def test_need_of_the_noise(monkeypatch):
    """If it needs the noise, it is listed so, left out of `all` where none is given, and an error if named then."""
    monkeypatch.setitem(study.ESTIMATORS, "coope", Estimator(coope, needs="noise"))
    assert any("coope" in line and "noise" in line for line in estimator_list.printed())
    assert "coope" not in choose("all", None)
    assert "coope" in choose("all", 0.02)
    with pytest.raises(PointFileError, match="coope"):
        choose("coope", None)

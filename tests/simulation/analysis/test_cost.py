"""Kernels cost the operations that the registry declares; the paper's figures are its own."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pandas as pd
import pytest

import study
from study.files import save_frame
from study.fits.loops.jit import SCALAR_CODE
from study.simulation.analysis import cost
from study.simulation.analysis.cost import PAPER, cost_table, printed

KERNEL = {"mle": "mle", "lls": "lls", "igdk": "igdk"}
DIMENSIONS = [2, 3, 4, 5]


def count(dimension):
    """Operations per sample of each kernel, counted by a program without compilation."""
    command = [sys.executable, str(Path(__file__).with_name("operations.py")), str(dimension)]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def kernels():
    """Operations per sample of each kernel for d = 2 to 5."""
    return {d: count(d) for d in DIMENSIONS}


@pytest.fixture(scope="module")
def settings():
    """The compiler settings that scalar code was timed under."""
    return []


@pytest.fixture(scope="module")
def table(settings):
    """The cost table of fits of 20 samples.

    Scalar code is timed by the program that does it, but with the compiled code at hand: to compile all of it without
    vector instructions would take half a minute.
    """
    elsewhere = cost._timed_elsewhere

    def warm(dimension, samples, environment):
        settings.append(environment)
        return elsewhere(dimension, samples, {})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cost, "_timed_elsewhere", warm)
        return cost_table(3, 20)


@pytest.mark.parametrize("d", DIMENSIONS)
@pytest.mark.parametrize("name", [name for name, entry in study.ESTIMATORS.items() if entry.flops])
def test_declared_is_counted(kernels, name, d):
    """The declared operations per sample are those of the kernel, to the operation."""
    assert study.ESTIMATORS[name].flops(d) == kernels[d][KERNEL.get(name, "moments")]


@pytest.mark.parametrize("d", DIMENSIONS)
def test_moments_by_hand(kernels, d):
    """The moments' count follows from what a sample must go through.

    Mean d, centring d, squared length 2d, the mean that rounding left d, Σy|y|² 2d, Σyyᵀ d(d + 1), Σ|y|⁴ 2: that is
    2d + 3 more than the paper's d² + 6d - 1, for centring twice and for the fourth moment.
    """
    assert kernels[d]["moments"] == d + d + 2 * d + d + 2 * d + d * (d + 1) + 2
    assert kernels[d]["moments"] - (d * d + 6 * d - 1) == 2 * d + 3


def test_the_papers_figures():
    """Eqs 7-8 are 26N + 45 in 3-D, LLS 236N + 709, IGDK four and MLE eighty times GDKE; it says no more."""
    for n in (4, 100, 10**6):
        assert PAPER["gdke"](n, 3) == PAPER["ugdk"](n, 3) == 26 * n + 45
        assert PAPER["lls"](n, 3) == 236 * n + 709
        assert PAPER["igdk"](n, 3) == 4 * (26 * n + 45)
        assert PAPER["mle"](n, 3) == 80 * (26 * n + 45)
        assert math.isnan(PAPER["lls"](n, 2))
        assert math.isnan(PAPER["als"](n, 3))
    for d in (2, 3, 7):  # per sample d² + 6d - 1 (eq. 7)
        assert PAPER["gdke"](11, d) - PAPER["gdke"](10, d) == pytest.approx(d * d + 6 * d - 1)
    for n, ratio in [(4, 11.09), (5, 10.79), (10, 10.06), (100, 9.19), (10**9, 9.08)]:  # theory §1
        assert round(PAPER["lls"](n, 3) / PAPER["gdke"](n, 3), 2) == ratio


def test_cost_table(table):
    """The table has a row per estimator of the comparison, what was counted and measured, and each over GDKE."""
    assert list(table["estimator"]) == list(PAPER)
    assert (table["samples"] == 20).all()
    rows = table.set_index("estimator")
    for name, row in rows.iterrows():
        assert row["flops_per_sample"] == study.ESTIMATORS[name].flops(3)
        assert row["flops_of"] == ("a pass" if name == "mle" else "a fit")
        np.testing.assert_equal(row["paper_flops"], PAPER[name](20, 3))
        for column in ("vector_seconds", "scalar_seconds"):
            assert 0.0 < row[column] < np.inf
        for column in ("paper_flops", "flops_per_sample", "vector_seconds", "scalar_seconds"):
            expected = row[column] / rows.loc["gdke", column]
            np.testing.assert_allclose(row[f"{column}_over_gdke"], expected, rtol=1e-12)


def test_scalar_code_is_compiled_apart(table, settings):
    """Without vector instructions, by settings that numba knows, into a cache that holds no other code."""
    (environment,) = settings
    off = {name for name, value in environment.items() if value == "0"}
    assert off == {"NUMBA_LOOP_VECTORIZE", "NUMBA_SLP_VECTORIZE"}
    assert all(hasattr(numba.config, name.removeprefix("NUMBA_")) for name in environment)
    assert environment["NUMBA_CACHE_DIR"] == str(SCALAR_CODE)
    assert not list(SCALAR_CODE.glob("*.nb?"))  # the cache of vector code has its files side by side


def test_scalar_code_of_a_package_that_cannot_be_written_to(monkeypatch, tmp_path):
    """It goes to an empty folder that is removed afterwards."""
    (tmp_path / "file").touch()
    monkeypatch.setattr(cost, "SCALAR_CODE", tmp_path / "file" / "scalar")
    with cost._scalar_code() as folder:
        assert list(Path(folder).iterdir()) == []
    assert not Path(folder).exists()


def test_cost_table_printed_and_stored(table, tmp_path):
    """Printed, each estimator has a line with no NaN in it; stored, both kinds of file hold the table."""
    lines = list(printed(table))
    assert [line.split()[0] for line in lines[2:]] == list(PAPER)
    assert not any("nan" in line for line in lines)
    for suffix, read in [(".csv", pd.read_csv), (".parquet", pd.read_parquet)]:
        path = tmp_path / "deep" / f"cost{suffix}"
        save_frame(table, path)
        pd.testing.assert_frame_equal(read(path), table, check_dtype=False, rtol=1e-12)

"""Operations counted: counting really counts, kernels cost what they declare, and the paper's figures are its own."""

import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import numpy as np
import pandas as pd
import pytest

import study
from study.files import save_frame
from study.fits.jit import SCALAR_CODE
from study.simulation.analysis import cost
from study.simulation.analysis.cost import PAPER, Counted, cost_table, counted, printed

KERNEL = {"mle": "mle", "lls": "lls", "igdk": "igdk"}
DIMENSIONS = [2, 3, 4, 5]


def operations(expression):
    """Operations that evaluating an expression of three counted numbers takes, and its value."""
    numbers = [Counted(value) for value in (3.0, 4.0, 0.5)]
    Counted.operations = 0
    value = expression(*numbers)
    return Counted.operations, float(value)


@pytest.mark.parametrize(
    ("expression", "count", "value"),
    [
        (lambda a, b, c: a, 0, 3.0),
        (lambda a, b, c: a + b, 1, 7.0),
        (lambda a, b, c: a - b, 1, -1.0),
        (lambda a, b, c: (a + b) * c - a / b, 4, 2.75),
        (lambda a, b, c: 1.0 - 2 * a / (1.0 + b), 4, -0.2),
        (lambda a, b, c: 1 / a, 1, 1 / 3),
        (lambda a, b, c: a**2 + b**2, 3, 25.0),
        (lambda a, b, c: -abs(-a), 0, -3.0),
        (lambda a, b, c: max(a, b) if a < b else c, 0, 4.0),
        (lambda a, b, c: sum([a, b, c]), 3, 7.5),
        (lambda a, b, c: np.array([a, b, c], dtype=object).sum(), 2, 7.5),
        (lambda a, b, c: np.array([a, b], dtype=object) @ np.array([b, a], dtype=object), 3, 24.0),
    ],
)
def test_expressions_are_counted(expression, count, value):
    """Each +, -, *, / and square is one operation, in arrays too; signs and comparisons are not; values are right."""
    found, result = operations(expression)
    assert found == count
    assert result == pytest.approx(value, rel=1e-15)


def test_roots_are_counted_and_numpy_is_given_back():
    """Within the context square roots count and new arrays hold numbers that do; after it all is as before."""
    empty, root = np.empty, math.sqrt
    with cost._counting_numpy():
        array = np.empty(2)
        array[:] = Counted(9.0)
        found, value = operations(lambda a, b, c: math.sqrt(a * a + b * b) + array[0])
        assert np.empty(3, dtype=bool).dtype == bool
    assert (found, value) == (5, 14.0)
    assert array.dtype == object
    assert (np.empty, math.sqrt) == (empty, root)
    assert np.empty(2).dtype == float


@pytest.fixture(scope="module")
def kernels():
    """Operations per sample of each kernel for d = 2 to 5."""
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(DIMENSIONS, pool.map(counted, DIMENSIONS), strict=True))


@pytest.fixture(scope="module")
def settings():
    """The compiler settings that scalar code was timed under."""
    return []


@pytest.fixture(scope="module")
def table(kernels, settings):
    """The cost table of fits of 20 samples.

    Scalar code is timed by the program that does it, but with the compiled code at hand: to compile all of it without
    vector instructions would take half a minute.
    """
    elsewhere = cost._elsewhere

    def warm(arguments, environment):
        if arguments[0] == "count":
            return kernels[int(arguments[1])]
        settings.append(environment)
        return elsewhere(arguments, {})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cost, "_elsewhere", warm)
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


def test_cost_table(table, kernels):
    """The table has a row per estimator of the comparison, what was counted and measured, and each over GDKE."""
    assert list(table["estimator"]) == list(PAPER)
    assert (table["samples"] == 20).all()
    rows = table.set_index("estimator")
    for name, row in rows.iterrows():
        assert row["flops_per_sample"] == kernels[3][KERNEL.get(name, "moments")]
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


def test_counting_needs_compilation_off():
    """Asked to count with compilation on, the program fails instead of reporting nothing counted."""
    done = subprocess.run(
        [sys.executable, "-m", "study.simulation.analysis.cost", "count", "2"], capture_output=True, text=True
    )
    assert done.returncode != 0

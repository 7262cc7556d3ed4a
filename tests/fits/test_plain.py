"""Loops that are not compiled run as plain Python where they have little to do, and answer as compiled ones do."""

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile
from numba.core.registry import CPUDispatcher

import study
from study.fits.loops import jit
from study.fits.loops.jit import COMPILING, always_compiled, compiled

KINDS = ("cap", "sphere", "plane", "clutter", "cluster", "hinge", "missing", "rounded", "huge", "tiny")
CHOICES = ({}, {"estimator": "robust"}, {"estimator": "mle"}, {"radius": 1.0}, {"ordered": True}, {"noise": 0.05})


def point_set(rng, kind, on_cap):
    """Points of a kind, in two or three dimensions, with noise of .1 % to 30 % of the radius."""
    d, n, sigma = int(rng.integers(2, 4)), int(np.exp(rng.uniform(np.log(7), np.log(250)))), 10 ** rng.uniform(-3, -0.5)
    points = on_cap(rng, n, 180.0 if kind == "sphere" else rng.uniform(15.0, 90.0), d, sigma)[0]
    if kind == "plane":
        points[:, 0] = 0.0
    elif kind == "clutter":
        points[: n // 4] = rng.uniform(-2.0, 2.0, (n // 4, d))
    elif kind == "cluster":
        points[: n // 5] = points[0] + 3.0
    elif kind == "hinge":
        points[:, -1] = 0.3 + sigma * rng.standard_normal(n)
    elif kind == "missing":
        points[0] = np.nan
    elif kind == "rounded":
        points = np.round(points * 64.0) / 64.0
    return points * {"huge": 1e150, "tiny": 1e-150}.get(kind, 1.0)


def numbers(points, options):
    """What a user reads of a fit: its status, its tests, and its numbers in units of the radius."""
    fit = study.fit(points, **options)
    size = abs(float(fit.radius))
    parts = [fit.center, fit.radius, fit.sigma, fit.standard_errors, fit.interval("radius"), fit.interval("center")]
    sizes = np.concatenate([np.ravel(part) for part in parts]) / size
    return int(fit.status), fit.goodness.in_words(), fit.outliers.tolist(), sizes


@pytest.mark.parametrize("choices", [CHOICES[:1], pytest.param(CHOICES[1:], marks=pytest.mark.slow)], ids=["", "more"])
@pytest.mark.parametrize("kind", KINDS)
def test_plain_loops_answer_as_compiled_ones_do(monkeypatch, rng, on_cap, kind, choices):
    """The same status, tests and outliers of every set; of those that are ok the same numbers to 1e-9 of the radius."""
    for options in choices:
        if kind in ("huge", "tiny") and "noise" in options | ({"noise": 1} if "radius" in options else {}):
            continue  # they are given in the unit of the points
        points = point_set(rng, kind, on_cap)
        one = numbers(points, options)
        with monkeypatch.context() as plain, np.errstate(all="ignore"):
            plain.setattr(jit._WAY, "plain", True)
            two = numbers(points, options)
        assert one[:3] == two[:3], options
        if one[0] == study.Status.OK:
            np.testing.assert_allclose(two[3], one[3], rtol=1e-9, atol=1e-9, err_msg=str(options))


@pytest.mark.parametrize("noise", [None, 0.1, np.full(15, 0.1)], ids=["unknown", "known", "of each point"])
def test_plain_loops_divide_by_zero_as_compiled_ones_do(monkeypatch, rng, noise):
    """Points that are too large, and are left out, have an extent of zero: plain Python raised an exception."""
    monkeypatch.setattr(jit._WAY, "plain", True)
    with np.errstate(all="ignore"):
        fit = study.fit(1e200 * rng.standard_normal((15, 3)), noise=noise)
        assert fit.status == study.Status.NOT_FINITE
        assert fit.interval("radius").tolist() == [0.0, np.inf]


@pytest.fixture
def new_installation(tmp_path):
    """Run a program with a copy of the package that has compiled nothing; its output and what it complains of."""
    shutil.copytree(Path(study.__file__).parent, tmp_path / "study", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA", "PYTHON"))}

    def run(*arguments, **further):
        command = [sys.executable, "-W", "error", *arguments]
        where = environment | {"PYTHONPATH": str(tmp_path)} | further
        done = subprocess.run(command, cwd=tmp_path, env=where, capture_output=True, text=True, check=True)
        return done.stdout, done.stderr

    return run


def test_the_first_fits_wait_for_no_compiler(new_installation, tmp_path, rng, on_cap, well):
    """The first command after an installation compiles nothing, and prints what compiled code does."""
    np.savetxt(tmp_path / "points.csv", on_cap(rng, 1000, 60.0, 3, 0.02)[0], delimiter=",")
    said, complained = new_installation("-m", "study.cli", "fit", "points.csv")
    assert (said, complained) == (well(tmp_path, "fit", "points.csv"), "")
    assert not list(tmp_path.rglob("*.nbi"))


def test_large_sets_are_compiled_with_a_line(new_installation, tmp_path):
    """Sums over a hundred thousand numbers are worth a compiler, which says so."""
    program = "import numpy; from study.fits.loops.jit import total; print(total(numpy.ones(100_000)))"
    assert new_installation("-c", program) == ("100000.0\n", f"{COMPILING}\n")
    assert list(tmp_path.rglob("*.nbi"))


@pytest.fixture
def loop(monkeypatch):
    """A loop that is not compiled, outside of what keeps the tests' loops compiled; and what it was run with."""
    monkeypatch.setattr(jit._WAY, "compile", False)
    monkeypatch.setattr(jit, "_PLAIN", 100)
    monkeypatch.setattr(IndexDataCacheFile, "load", lambda file, key: None)  # else an earlier test run has stored it

    @compiled
    def largest(row):
        """Largest number of a row."""
        result = row[0]
        for k in range(row.size):
            result = max(result, row[k])
        return result

    return largest


def test_a_loop_that_is_called_often_is_compiled(loop):
    """Ten rows of ten numbers are little work; the eleventh row has the loop compiled, and it stays so."""
    for times in range(1, 13):
        assert loop(np.arange(10.0)) == 9.0
        assert len(loop.dispatcher.signatures) == (times > 10)


def test_studies_compile_however_little_is_to_be_done(loop):
    """Their tables are the same to the bit, on a machine that has compiled before and on one that has not."""
    with always_compiled():
        assert loop(np.arange(3.0)) == 2.0
    assert len(loop.dispatcher.signatures) == 1


def test_an_error_in_a_plain_loop_ends_it(loop):
    """The next loops are compiled again."""
    with contextlib.suppress(IndexError):
        loop(np.empty(0))
    assert not jit._WAY.plain


def test_loops_run_where_no_folder_can_be_written(monkeypatch, loop):
    """In a read-only installation, without a home, compiled code lasts as long as the process."""
    monkeypatch.setattr(CPUDispatcher, "enable_caching", Mock(side_effect=RuntimeError("no locator available")))

    @compiled
    def last(row):
        """Last number of a row."""
        return row[-1]

    assert last(np.arange(3.0)) == 2.0
    with always_compiled():
        assert last(np.arange(4.0)) == 3.0

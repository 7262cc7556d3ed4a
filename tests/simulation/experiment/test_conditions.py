"""The table of conditions: what it holds, and that one more entry is enough, and leaves everything else as it was.

The laws of a random design, as functions: quantiles, extremes, and what may be written for them.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy import stats

from study.simulation.experiment import conditions as module
from study.simulation.experiment.conditions import CONDITIONS, Choice, Constant, Law, LogUniform, Uniform
from study.simulation.experiment.designs import Cell, GridDesign, RandomDesign
from tests.configs import config, log_uniform

SCRIPT = Path(__file__).with_name("one_more_condition.py")

TWO = {"shift": [0.0, 0.5], "family": ["normal", "other"]}


@pytest.fixture(scope="module")
def wider(tmp_path_factory):
    """Run commands on configs in the package with two more conditions: output of each, and the folder of the runs."""
    folder = tmp_path_factory.mktemp("wider")
    random = {"kind": "random", "trials": 30, "noise": log_uniform(0.01, 0.1)}
    law = {"law": "choice", "values": [0.0, 0.5]}
    plain, top = {"noise": [0.1, 0.2], "trials": 40}, {"estimators": ["gdke", "als"]}
    posterior = "[posterior]\ntrials = 1\nwalkers = 16\nmax_steps = 100\nwhere = { shift = 0.5 }\n"
    shift = {"shift": TWO["shift"]}
    configs = {
        "plain": config(top, **plain),
        "default": config(top, **plain, shift=0, family="normal"),
        "both": config(top, **plain, **TWO),
        "chains": config(top, **plain, **shift) + posterior,
        "summary": config(top | {"keep": "summary"}, **plain, **TWO),
        "random": config(top, **random),
        "law": config(top, **random, shift=law),
        "wrong": config(top, **plain, shift=-1, family="odd"),
        "no-law": config(top, **random, family="other"),
        "moments": config(top | {"route": "moments"}, **plain, **TWO),
        "no-cell": config(top, **plain, **shift) + posterior.replace("0.5", "0.7"),
        "no-account": config(top, **plain, **TWO) + posterior,
    }
    for name, text in configs.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    runs = [["run", str(folder / f"{name}.toml"), "--out", str(folder / name), "--jobs", "1"] for name in configs]
    reads = [["summary", str(folder / "both")], ["worst", str(folder / "both")], ["report", str(folder / "both")]]
    reads += [["diff", str(folder / "both"), str(folder / "summary")]]
    command = [sys.executable, "-W", "error", str(SCRIPT), json.dumps(runs + reads)]
    done = subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    said = dict(zip([*configs, *(f"study {verb}" for verb, *_ in reads)], done.stdout.split("\0"), strict=False))
    return said | {"stderr": done.stderr}, folder


def table(folder, name="errors"):
    """A stored table as a data frame with words as strings."""
    frame = pq.read_table(folder / f"{name}.parquet").to_pandas()
    return frame.astype({word: str for word in ("cell", "estimator", "family") if word in frame})


def described(folder, name):
    """Columns of a stored table with their types, units and meanings."""
    return [(field.name, str(field.type), field.metadata) for field in pq.read_schema(folder / f"{name}.parquet")]


def test_an_entry_that_nobody_asks_for_leaves_no_trace(wider, make_run):
    """A config without it has the same tables, names and digest as in a package that does not know it."""
    _, folder = wider
    for name in ("plain", "random"):
        known = make_run((folder / f"{name}.toml").read_text(encoding="utf-8"))
        for each in ("errors", "summary"):
            pd.testing.assert_frame_equal(table(known.folder, each), table(folder / name, each), check_exact=True)
            assert described(known.folder, each) == described(folder / name, each)
        metadata = pq.read_schema(folder / name / "summary.parquet").metadata
        assert known.metadata("summary")["study.config"] == metadata[b"study.config"].decode()


def test_a_default_is_not_asking(wider):
    """Giving the default is the same study as leaving it out, to the byte."""
    _, folder = wider
    for name in ("errors", "summary"):
        one, other = (folder / kind / f"{name}.parquet" for kind in ("plain", "default"))
        assert one.read_bytes() == other.read_bytes()


def test_a_grid_of_it(wider):
    """Its columns come behind the others', and cells at the defaults have the rows that they have without it."""
    _, folder = wider
    plain, both = table(folder / "plain"), table(folder / "both")
    assert len(both) == 4 * len(plain)
    where = list(both.columns).index("center")
    assert list(both.columns[where + 1 : where + 3]) == ["shift", "family"]
    usual = both[(both["shift"] == 0.0) & (both["family"] == "normal")].drop(columns=["shift", "family"])
    pd.testing.assert_frame_equal(usual.reset_index(drop=True), plain, check_exact=True)
    assert both["cell"].nunique() == len(both.groupby(["noise", "shift", "family"])) == 8


def test_draws_of_its_own_or_shared(wider):
    """Cells that differ in a condition of how draws are placed share them; others have draws of their own."""
    _, folder = wider
    both = table(folder / "both").set_index(["shift", "family", "noise", "estimator", "trial"])["error"].sort_index()
    assert np.array_equal(both[0.0, "normal"], both[0.5, "normal"])
    assert np.array_equal(both[0.0, "other"], both[0.5, "other"])
    assert not np.intersect1d(both[0.0, "normal"], both[0.0, "other"]).size


def test_a_law_of_it(wider):
    """A random design draws it from a stream of its own, and the other conditions as without it."""
    _, folder = wider
    plain, drawn = table(folder / "random"), table(folder / "law")
    assert set(drawn["shift"]) == {0.0, 0.5}
    pd.testing.assert_series_equal(drawn["noise"], plain["noise"], check_exact=True)
    same = (drawn["cell"] == plain["cell"]).to_numpy()
    assert np.array_equal(same, (drawn["shift"] == 0.0).to_numpy())


def test_every_table_and_text_has_it(wider):
    """Summary, comparison and worst trials name it; a study that keeps its summary alone does too."""
    said, folder = wider
    short = table(folder / "both", "summary")
    assert set(zip(short["shift"], short["family"], strict=True)) == {(s, f) for s in (0.0, 0.5) for f in TWO["family"]}
    pd.testing.assert_frame_equal(short, table(folder / "summary", "summary"), check_exact=True)
    assert "φ = 90°, δ = 0.5, F = other  " in said["study summary"]
    assert said["study worst"].splitlines()[2].split()[-2:] == ["δ", "F"]
    assert "identical" in said["study diff"]
    assert "δ\xa0=\xa00, 0.5; F\xa0=\xa0normal, other" in (folder / "both" / "report.html").read_text("utf-8")


def test_faults_of_it(wider):
    """A value that is not allowed comes with the rule; a condition that a random design cannot draw is unknown.

    Posteriors take the condition that says so, and refuse the other.
    """
    said, _ = wider
    assert "exit 0" in said["chains"]
    for words in (
        "design.shift = -1: -1 not allowed: every value must be at least 0",
        "design.family = 'odd': 'odd' not allowed: every value must be normal or other",
        "design.family = 'other': unknown key: not one of this kind of design",
        "posterior.where: no cell has shift = 0.7",
        "posterior: its likelihoods, of normal noise of the true σ and directions by area, take no account of family: ",
        'route: the route "moments" takes no account of shift and family: take them out, or route = "points"',
    ):
        assert words in said["stderr"]


def test_designs_have_an_entry_for_each_condition():
    """An axis or a law for every condition of the table, in its order."""
    for design, kind in ((GridDesign, "axis"), (RandomDesign, "law")):
        expected = [name for name, condition in CONDITIONS.items() if getattr(condition, kind)]
        assert [name for name in design.model_fields if name in CONDITIONS] == expected


CELL = Cell(samples=10, noise=0.1, angle=20.0, radius=2.0, center=(3.0, 4.0))


def test_a_cell_has_every_stored_condition():
    """Its values are those that columns hold: the centre as its distance; σ/r follows from them."""
    placed = {"samples": 10, "noise": 0.1, "angle": 20.0, "radius": 2.0, "center": 5.0}
    silent = {condition.name: condition.default for condition in module.SILENT if condition.default is not None}
    assert CELL.values == placed | silent
    assert list(CELL.values) == [condition.name for condition in module.STORED if condition is not module.KAPPA]
    assert CONDITIONS["noise_over_radius"].of(CELL.values) == 0.05


exact = settings(derandomize=True, deadline=None)

LAST = float(np.nextafter(1.0, 0.0))

QUANTILES = [0.0, 1e-16, 1e-9, 0.1, 0.25, 0.5, 0.9, 0.999999]


@pytest.mark.parametrize("u", QUANTILES)
@pytest.mark.parametrize(("low", "high"), [(0.0, 37.0), (0.0, 180.0), (2.5, 3.0), (1e-13, 1e14), (1e-150, 1e150)])
def test_laws_are_scipys_quantile_functions(u, low, high):
    """The value at u is the quantile at 1 - u of the uniform or log-uniform distribution, over hundreds of decades."""
    expected = stats.uniform(low, high - low).ppf(1.0 - u)
    assert Uniform(law="uniform", low=low, high=high).at(u) == pytest.approx(expected, rel=1e-14, abs=1e-15 * high)
    if low:
        expected = stats.loguniform(low, high).ppf(1.0 - u)
        assert LogUniform(law="log_uniform", low=low, high=high).at(u) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("low", "high"), [(1e-200, 1e200), (1e-307, 1e308), (5e-324, 1.0)])
def test_log_uniform_spans_all_doubles(low, high):
    """A range whose ratio overflows is still log-uniform: its median is the geometric mean of the ends."""
    median = LogUniform(law="log_uniform", low=low, high=high).at(0.5)
    assert np.log(median) == pytest.approx(0.5 * (np.log(low) + np.log(high)), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_choice_takes_each_value_equally_often(count):
    """Equal steps of u reach each value equally often, in the order of the list."""
    values = [float(10 - i) for i in range(count)]
    law = Choice(law="choice", values=values)
    assert [law.at((i + 0.5) / (5 * count)) for i in range(5 * count)] == list(np.repeat(values, 5))
    assert (law.at(0.0), law.at(LAST)) == (values[0], values[-1])


@exact
@given(ends=st.lists(st.floats(0, 1e15), min_size=2, max_size=2, unique=True), u=st.floats(0.0, LAST))
def test_uniform_stays_within_its_ends(ends, u):
    """No value lies outside, and an open lower end of 0 is never drawn."""
    low, high = sorted(ends)
    value = Uniform(law="uniform", low=low, high=high).at(u)
    assert low <= value <= high
    assert value > 0.0 or high < 1e-290


@exact
@given(ends=st.lists(st.floats(1e-150, 1e150), min_size=2, max_size=2, unique=True), u=st.floats(0.0, LAST))
def test_log_uniform_stays_within_its_ends(ends, u):
    """No value lies outside, but for the rounding of a logarithm of up to 690."""
    low, high = sorted(ends)
    value = LogUniform(law="log_uniform", low=low, high=high).at(u)
    assert low * (1 - 1e-12) <= value <= high
    assert LogUniform(law="log_uniform", low=low, high=high).at(0.0) == high


def test_what_may_be_written_for_a_law():
    """A number is a constant, whole or not; truth values, text, lists, a table without a law and NaN are refused."""
    law = TypeAdapter(Law)
    assert law.validate_python(7) == law.validate_python(7.0) == Constant(law="constant", value=7.0)
    for value in (True, "7", None, [1, 2], {"low": 1, "high": 2}, float("nan")):
        with pytest.raises(ValidationError):
            law.validate_python(value)

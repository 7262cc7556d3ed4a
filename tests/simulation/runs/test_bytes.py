"""Equal runs are equal to the byte, whatever the workers and their order.

Reuse of an earlier run: only new fits are computed, and the tables are those of a run from nothing.
"""

import gc
import math
import random
import shutil
import weakref
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import study
from study.files import TableRows
from study.simulation.experiment.config import parse
from study.simulation.runs import parts
from study.simulation.runs.parts import Layout, UnitTask
from study.simulation.runs.status import RunStatus
from tests.configs import log_uniform, uniform

pytestmark = pytest.mark.usefixtures("same_software", "small_units")


RANDOM = {"kind": "random", "trials": 80, "samples": log_uniform(4, 2000), "noise": log_uniform(1e-6, 10)}
RANDOM |= {"angle": uniform(0, 180), "radius": uniform(0, 37), "center": uniform(0, 2)}

STUDIES = {
    "shared": {"trials": 14},
    "independent": {"trials": 14, "draws": "independent"},
    "random": RANDOM,
    "dimension 5": {"top": {"dimension": 5}, "trials": 14},
}


def assert_same_bytes(run, other):
    """The tables that are promised to be equal are so; where they are not, the first number that differs is named."""
    for name in ("errors", "points"):
        one, two = run.path(name), other.path(name)
        if one.read_bytes() != two.read_bytes():
            raise AssertionError(f"{name}: {difference(pd.read_parquet(one), pd.read_parquet(two))}")


def difference(one, two):
    """Place and values of the first number that differs between two tables, row by row, in words."""
    if list(one) != list(two) or len(one) != len(two):
        return f"{len(one)} rows of {list(one)} instead of {len(two)} of {list(two)}"
    differs = (one.to_numpy() != two.to_numpy()) & ~(one.isna() & two.isna()).to_numpy()
    if not differs.any():
        return "equal values in other bytes"
    row, column = np.argwhere(differs)[0]
    name = one.columns[column]
    keys = [f"{key} {one[key].iloc[row]}" for key in ("estimator", "cell", "trial") if key in one and key != name]
    return f"{', '.join(keys)}: {name} is {one[name].iloc[row]!r} instead of {two[name].iloc[row]!r}"


@pytest.fixture(params=list(STUDIES))
def entries(request):
    """Arguments of one study of each kind."""
    made = dict(STUDIES[request.param])
    return {**made, "top": {"keep_points": 2} | made.pop("top", {})}


def test_bytes_do_not_depend_on_the_number_of_workers(start, entries, make_text):
    """One, two and three workers write the same files."""
    assert len(list(parse(make_text(**entries)).units())) > 3
    alone = start(jobs=1, **entries)
    for jobs in (2, 3):
        assert_same_bytes(start(jobs=jobs, **entries), alone)


@pytest.mark.parametrize("seed", [1, 2])
def test_bytes_do_not_depend_on_the_order_of_work(start, entries, monkeypatch, seed):
    """Units computed in a shuffled order give the same files."""
    expected = start(**entries)
    shuffled = random.Random(seed)
    monkeypatch.setattr(UnitTask, "weight", property(lambda task: shuffled.random()))
    assert_same_bytes(start(**entries), expected)


def test_the_first_difference_is_named():
    """Estimator, cell, trial, column and both values are in the message, missing numbers being equal."""
    one = pd.DataFrame({"cell": ["a", "b"], "trial": [0, 1], "estimator": ["mle", "lls"], "error": [np.nan, 1.0]})
    two = one.assign(error=[np.nan, np.nextafter(1.0, 2.0)])
    words = "estimator lls, cell b, trial 1: error is np.float64(1.0) instead of np.float64(1.0000000000000002)"
    assert difference(one, two) == words
    assert difference(one, two[:1]).startswith("2 rows of")
    assert difference(one, one) == "equal values in other bytes"


def pieces_of(made):
    """The pieces in which a study is computed."""
    return list(Layout(made).pieces())


@pytest.mark.usefixtures("raises")
def test_bytes_do_not_depend_on_what_fits_cost(start, entries, dear):
    """Units of dear fits are cut, also within a block; their tables, failures too, stay as they are."""
    failing = ["raises"] if "dimension" not in entries["top"] else []
    entries["top"] |= {"estimators": ["mle", "lls", *failing], "measures": ["jaccard"]}
    whole = start(**entries)
    units = pieces_of(whole.study)
    assert units == list(whole.study.units())
    dear()
    assert len(pieces_of(whole.study)) > 1.4 * len(units)
    cut = start(**entries)
    assert_same_bytes(cut, whole)
    assert cut.has("failures") == whole.has("failures")
    assert not whole.has("failures") or cut.path("failures").read_bytes() == whole.path("failures").read_bytes()


def test_a_summary_does_not_depend_on_what_fits_cost(start, dear):
    """Its units are cut by levels: cells whose fits are the same stay together, and all trials of a cell."""
    entries = {"top": {"keep": "summary"}, "trials": 14, "radius": [1.0, 10.0], "noise": None}
    entries |= {"noise_over_radius": [0.01, 0.1, 0.3]}
    whole = start(**entries)
    dear()
    pieces = pieces_of(whole.study)
    assert [len(unit.cells) for unit in whole.study.units()] == [6] * 4
    assert [len(piece.cells) for piece in pieces] == [2] * 12
    assert all(len(piece.group.levels) == 1 and piece.trials == 14 for piece in pieces)
    assert start(**entries).path("summary").read_bytes() == whole.path("summary").read_bytes()


def test_an_estimator_of_ones_own_weighs_more(make_text, monkeypatch):
    """It is called for one set of points after the other; a closed form weighs as much as a row."""
    monkeypatch.setitem(study.ESTIMATORS, "own", replace(study.ESTIMATORS["gdke"], version="1a2b"))
    one, two, three = (
        Layout(made).task(next(made.units())).weight
        for names in (["gdke"], ["gdke", "als"], ["gdke", "own"])
        for made in [parse(make_text({"estimators": names}, trials=3, samples=40, noise=0.1, angle=60))]
    )
    row = parts._ROW * 3
    assert two - one == pytest.approx(row)
    assert three - one == pytest.approx(row + 3 * (2e4 + 10.0 * 40))


GRID = {"trials": 10, "samples": [6, 40], "noise": [0.05, 0.5], "angle": [60]}

RANDOM_REUSE = {"kind": "random", "trials": 60, "samples": log_uniform(5, 60), "noise": log_uniform(1e-6, 2)}
RANDOM_REUSE["angle"] = uniform(0, 180)

TWO = {"estimators": ["mle", "lls"]}


@pytest.fixture
def named(start, make_text, tmp_path):
    """Run a study into its own folder, as the command line does; lines for the user are kept in ``told``."""
    told = []

    def run(top=None, **design):
        folder = tmp_path / "results" / parse(make_text(top, **design)).run_name()
        return start(top, folder=folder, warn=told.append, **design)

    run.told = told
    return run


def rows(design, top=TWO):
    """Number of fits of a study whose axes are lists."""
    cells = math.prod(len(values) for values in design.values() if isinstance(values, list))
    return cells * design["trials"] * len(top["estimators"])


LAWS, OUTLIERS, SIZES = {"law": ["normal", "laplace"]}, {"outlier_share": [0.0, 0.1]}, {"outlier_size": [10.0, 5.0]}
GROWTH = {
    "trials": (TWO, GRID | {"trials": 23}),
    "trials within a block": (TWO, GRID | {"trials": 11}),
    "noise": (TWO, GRID | {"noise": [0.01, 0.05, 0.1, 0.5]}),
    "samples": (TWO, GRID | {"samples": [20, 6, 40]}),
    "an estimator": ({"estimators": ["gdke", "lls", "mle"]}, GRID),
    "all": (
        {"estimators": ["lls", "ugdk", "mle"]},
        GRID | {"trials": 15, "noise": [0.5, 0.1, 0.05], "angle": [60, 90]},
    ),
    "points": (TWO | {"keep_points": 1}, GRID | {"trials": 12}),
    "a law": (TWO, GRID | LAWS),
    "no law": (TWO, GRID | {"trials": 13}, LAWS),
    "outliers": (TWO, GRID | OUTLIERS),
    "no outliers": (TWO, GRID | {"trials": 7}, OUTLIERS),
    "sizes of outliers": (TWO, GRID | OUTLIERS | SIZES, OUTLIERS),
    "no sizes of outliers": (TWO, GRID | OUTLIERS | {"trials": 13}, OUTLIERS | SIZES),
    "another order": ({"estimators": ["lls", "mle"]}, GRID | {"trials": 12, "noise": [0.5, 0.05]}),
}
"""What a study of TWO and GRID becomes: its entries, and those that it had besides."""


@pytest.mark.parametrize("kind", ["shared", "independent"])
@pytest.mark.parametrize("name", list(GROWTH))
def test_only_the_new_is_computed(named, start, computed, name, kind):
    """Each fit that the earlier run lacks is computed once, and no other; the bytes are those of a run from nothing."""
    top, design, *had = GROWTH[name]
    more = {"draws": "independent"} if kind == "independent" else {}
    named(TWO, **dict(*had, **GRID, **more))
    before = set(computed)
    computed.clear()
    grown = named(top, **design, **more)
    again = list(computed)
    computed.clear()
    fresh = start(top, **design, **more)
    assert len(set(again)) == len(again)
    assert set(again) == set(computed) - before
    assert len(computed) == rows(design, top)
    for table in ["errors"] + ["points"] * ("keep_points" in top):
        assert grown.path(table).read_bytes() == fresh.path(table).read_bytes()
    assert any("are taken from" in line for line in named.told)


def test_dear_fits_grow(named, start, computed, dear):
    """Units are cut along the earlier run, and its rows used, where they are cut for what their fits cost as well."""
    top, design = GROWTH["all"]
    fresh = start(top, **design)
    before, _ = set(computed), computed.clear()
    named(TWO, **GRID)
    had, _ = set(computed), computed.clear()
    dear()
    grown = named(top, **design)
    assert len(set(computed)) == len(computed)
    assert set(computed) == before - had
    assert grown.path("errors").read_bytes() == fresh.path("errors").read_bytes()


def test_a_random_design_grows(named, start, computed):
    """More trials continue the old ones; other laws have nothing in common with them."""
    named(TWO, **RANDOM_REUSE)
    computed.clear()
    grown = named(TWO, **RANDOM_REUSE | {"trials": 140})
    assert len(computed) == 2 * 80
    assert grown.path("errors").read_bytes() == start(TWO, **RANDOM_REUSE | {"trials": 140}).path("errors").read_bytes()
    computed.clear()
    named(TWO, **RANDOM_REUSE | {"angle": uniform(0, 90)})
    assert len(computed) == 2 * 60


def test_the_same_config_elsewhere_is_computed_again(named, start, computed, tmp_path):
    """The same config in another folder is computed, because a run is checked by running it again."""
    run = named(TWO, **GRID)
    computed.clear()
    start(TWO, folder=tmp_path / "results" / f"{run.study.run_name()}-again", warn=named.told.append, **GRID)
    assert len(computed) == rows(GRID)
    assert named.told == []


def test_of_several_the_largest_is_taken(named, computed):
    """Of several earlier runs, the one with the most rows is used."""
    for trials in (5, 20, 10):
        named(TWO, **GRID | {"trials": trials})
    computed.clear()
    named.told.clear()
    named(TWO, **GRID | {"trials": 24})
    assert len(computed) == rows(GRID | {"trials": 4})
    assert len(named.told) == 1


def test_another_version_is_not_taken(named, computed, monkeypatch):
    """Rows of an estimator that has changed are computed, those of the others taken; none of a damaged run."""
    run = named(TWO, **GRID)
    monkeypatch.setitem(study.ESTIMATORS, "lls", replace(study.ESTIMATORS["lls"], version=7))
    computed.clear()
    grown = named(TWO, **GRID | {"trials": 11})
    assert (sum(e == "mle" for *_, e in computed), sum(e == "lls" for *_, e in computed)) == (4, 44)
    shutil.rmtree(grown.folder)
    data = bytearray(run.path("errors").read_bytes())
    data[len(data) // 2] ^= 1
    run.path("errors").write_bytes(data)
    computed.clear()
    named(TWO, **GRID | {"trials": 11})
    assert len(computed) == rows(GRID | {"trials": 11})


@pytest.mark.usefixtures("small_parts")
def test_a_grown_run_that_stops_goes_on(named, start, computed, make_text, tmp_path):
    """Rows that were taken or computed before an interruption stay, even if the earlier run is gone."""
    design = GRID | {"trials": 23, "noise": [0.05, 0.1, 0.5]}
    earlier = named(TWO, **GRID)
    folder = tmp_path / "results" / parse(make_text(TWO, **design)).run_name()
    before = set(computed)
    computed.clear()

    with pytest.raises(ZeroDivisionError):
        start(TWO, folder=folder, progress=lambda *numbers: 1 / 0, warn=str, **design)
    first = list(computed)
    for path in earlier.folder.iterdir():
        path.unlink()
    computed.clear()
    done = named(TWO, **design)
    assert not set(computed) & (before | set(first))
    computed.clear()
    assert done.path("errors").read_bytes() == start(TWO, **design).path("errors").read_bytes()


def test_a_table_that_is_no_longer_read_is_closed(start):
    """Rows that were read by their numbers keep no file open."""
    run = start(TWO, **GRID)
    rows = TableRows(run.path("errors"))
    assert rows.rows(3, 5).num_rows == 2
    there = weakref.ref(rows)
    del rows
    gc.collect()
    assert there() is None


@pytest.mark.parametrize("stopped", [False, True], ids=["at once", "with a stop"])
def test_rows_that_are_taken_have_their_software(named, start, make_text, tmp_path, stopped):
    """The manifest and the status name the software that made the earlier run, and any other that computed for it."""
    run = named(TWO, **GRID)
    old, older = (
        {**run.maker(), "study": version, "commit": digit * 40} for version, digit in [("0.9", "9"), ("0.8", "8")]
    )
    run.save_manifest(run.manifest() | {"software": old, "also_computed_by": [older]})
    design = GRID | {"trials": 11}
    if stopped:
        folder = tmp_path / "results" / parse(make_text(TWO, **design)).run_name()
        with pytest.raises(ZeroDivisionError):
            start(TWO, folder=folder, progress=lambda *numbers: 1 / 0, warn=str, **design)
        assert old in RunStatus(folder).made_by
    grown = named(TWO, **design)
    assert grown.manifest()["also_computed_by"] == [old, older]
    assert RunStatus(grown.folder).made_by == [grown.maker(), old, older]
    assert ("0.9" in named.told[-1]) is not stopped


def test_a_run_that_is_completed_again_keeps_its_software(named, monkeypatch):
    """A newer version of an estimator leaves the other rows to the software that computed them."""
    run = named(TWO, **GRID)
    old = {**run.maker(), "study": "0.9"}
    run.save_manifest(run.manifest() | {"software": old})
    monkeypatch.setitem(study.ESTIMATORS, "lls", replace(study.ESTIMATORS["lls"], version=7))
    assert named(TWO, **GRID).manifest()["also_computed_by"] == [old]

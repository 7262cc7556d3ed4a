"""Equal runs are equal to the byte, whatever the workers and their order."""

import random

import pytest

from study.experiment.config import parse
from study.experiment.units import units
from study.runs import runner

RANDOM = {
    "kind": "random",
    "trials": 80,
    "samples": {"law": "log_uniform", "low": 4, "high": 2000},
    "noise": {"law": "log_uniform", "low": 1e-6, "high": 10},
    "angle": {"law": "uniform", "low": 0, "high": 180},
    "radius": {"law": "uniform", "low": 0, "high": 37},
    "center": {"law": "uniform", "low": 0, "high": 2},
}
STUDIES = {
    "shared": {"trials": 14},
    "independent": {"trials": 14, "draws": "independent"},
    "random": RANDOM,
    "dimension 5": {"top": {"dimension": 5}, "trials": 14},
}
TABLES = ["errors", "points"]

pytestmark = pytest.mark.usefixtures("same_software", "small_units")


def tables(run):
    """Bytes of the tables that are promised to be equal."""
    return {name: (run.folder / f"{name}.parquet").read_bytes() for name in TABLES}


@pytest.fixture(params=list(STUDIES))
def entries(request):
    """Arguments of one study of each kind."""
    made = dict(STUDIES[request.param])
    return {**made, "top": {"keep_points": 2} | made.pop("top", {})}


def test_bytes_do_not_depend_on_the_number_of_workers(start, entries, make_text):
    """One, two and three workers write the same files."""
    assert len(list(units(parse(make_text(**entries))))) > 3
    alone = tables(start(jobs=1, **entries))
    for jobs in (2, 3):
        assert tables(start(jobs=jobs, **entries)) == alone


@pytest.mark.parametrize("seed", [1, 2])
def test_bytes_do_not_depend_on_the_order_of_work(start, entries, monkeypatch, seed):
    """Units computed in a shuffled order give the same files."""
    expected = tables(start(**entries))
    shuffled = random.Random(seed)
    monkeypatch.setattr(runner, "weight", lambda job: shuffled.random())
    assert tables(start(**entries)) == expected


def test_bytes_do_not_depend_on_spelling(start, make_text, tmp_path):
    """Comments, and a range in place of a list, change config.toml alone."""
    text = make_text({"keep_points": 1}, noise=[0.1, 0.2, 0.3])
    other = "# a comment\n" + text.replace("[0.1, 0.2, 0.3]", "{ linspace = [0.1, 0.3, 3] }")
    assert other.count("linspace") == 1
    runs = [runner.run(parse(t), t, tmp_path / str(i)) for i, t in enumerate((text, other))]
    assert tables(runs[0]) == tables(runs[1])
    assert [(run.folder / "config.toml").read_text() for run in runs] == [text, other]


def test_running_again_gives_the_same_bytes(start, entries, files):
    """A second run into the same folder leaves the same tables, and no other files."""
    run = start(**entries)
    before = files(run.folder)
    start(folder=run.folder, **entries)
    after = files(run.folder)
    assert set(before) == set(after)
    assert {name for name in before if before[name] != after[name]} <= {"manifest.json", "timings.parquet"}


def test_another_seed_gives_other_bytes(start):
    """The comparison above can fail."""
    assert tables(start({"keep_points": 1})) != tables(start({"keep_points": 1, "seed": 2}))

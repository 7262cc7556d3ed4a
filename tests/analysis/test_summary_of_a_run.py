"""The summary as it is stored beside a run, and as it is printed."""

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from study.analysis.summary import summarise, summary
from study.analysis.summary_text import printed
from study.estimators import Status
from study.experiment.config import parse
from study.runs import runner
from study.runs.storage import schemas

HEAD = 'name = "test"\nseed = 1\nestimators = ["lls", "ugdk"]\n[design]\ntrials = 40\n'
GRID = HEAD + 'kind = "grid"\nsamples = [5, 40]\nnoise = [0.01, 0.5]\nangle = 30\ncenter = [0, 1]\n'
RANDOM = (
    HEAD.replace("40", "400")
    + """kind = "random"
samples = { law = "log_uniform", low = 4, high = 200 }
noise = { law = "log_uniform", low = 1e-4, high = 10 }
angle = { law = "uniform", low = 0, high = 180 }
radius = { law = "uniform", low = 0, high = 37 }
"""
)


@pytest.fixture(scope="module", params=["grid", "random"])
def run(request, tmp_path_factory):
    """A finished run of each kind of design, summarised."""
    text = GRID if request.param == "grid" else RANDOM
    done = runner.run(parse(text), text, tmp_path_factory.mktemp("summary") / "run")
    summarise(done)
    return done


def test_stored_is_computed(run):
    """The stored table is the computed one, in the declared columns and order."""
    stored = run.table("summary")
    computed = summary(run.table("errors"), by_decade=run.study.design.kind == "random")
    assert list(stored.columns) == [column.name for column in schemas.summary()]
    for name in stored.columns:
        pd.testing.assert_series_equal(stored[name], computed[name], check_dtype=False, check_categorical=False)


def test_summarising_again_changes_nothing(run):
    """The summary is a function of the error table, to the byte."""
    path = run.folder / "summary.parquet"
    before = path.read_bytes()
    summarise(run)
    assert path.read_bytes() == before


def test_nothing_is_lost(run):
    """Every fit of the error table is counted once, in its group and under its status."""
    errors, stored = run.table("errors"), run.table("summary")
    assert stored["planned"].sum() == len(errors)
    for status in Status:
        assert stored[status.name.lower()].sum() == (errors["status"] == status).sum()
    assert not stored.duplicated(["group", "estimator"]).any()
    for _, part in stored.groupby("group"):
        assert list(part["estimator"]) == ["lls", "ugdk"]


def test_every_value_has_its_error(run):
    """Each measure stands beside its Monte-Carlo error, and neither is negative where it cannot be."""
    stored = run.table("summary")
    errors = [name for name in stored.columns if name.endswith("_error")]
    assert len(errors) > 15
    for name in errors:
        value, error = stored[name.removesuffix("_error")], stored[name]
        assert not (error < 0).any()
        assert error.isna()[value.isna()].all()
        assert error.notna()[np.isfinite(value)].all()


def parts(run):
    """The lines of a print: its notes, its header, and all lines below it as a list."""
    lines = list(printed(run, every=True))
    place = next(i for i, line in enumerate(lines) if line.split()[-2:] == ["lls", "ugdk"])
    return [*lines[: place + 1], lines[place + 1 :]]


def test_printed(run):
    """A title, a note, a header and a line per group, each with a label of its own; failures are named."""
    stored = run.table("summary")
    title, note, legend, *bounds, header, lines = parts(run)
    assert title.startswith(run.study.run_name())
    assert "Brackets" in note
    assert "σ/r" in legend
    if run.study.design.one_trial_a_cell:
        assert header.split() == ["lls", "ugdk"]
        assert not bounds
    else:
        assert header.split() == ["CRLB", "attainable", "lls", "ugdk"]
        assert "attainable" in bounds[0]
    assert len(lines) == stored["group"].nunique()
    assert all(len(line) < 120 for line in lines)
    for line, (_, part) in zip(lines, stored.groupby("group", sort=False), strict=True):
        failed = (part["ok"] < part["planned"]).sum()
        assert line.count("%)") == failed


def test_printed_labels_tell_groups_apart(run):
    """No two lines of the print have the same label."""
    *_, header, lines = parts(run)
    first = "lls" if run.study.design.one_trial_a_cell else "CRLB"
    labels = [line[: header.index(first)].strip() for line in lines]
    assert len(set(labels)) == len(labels)


def test_metadata(run):
    """The stored summary holds the config of its run."""
    metadata = pq.read_schema(run.folder / "summary.parquet").metadata
    assert metadata[b"study.config"].decode() == run.study.canonical()

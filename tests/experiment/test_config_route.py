"""The entries `route`, `keep` and `most_samples` of a config."""

import json

import pytest

from study.experiment.config import ConfigError, parse
from study.experiment.units import units

GRID = """name = "test"
seed = 1
estimators = ["gdke", "ugdk"]
{}
[design]
kind = "grid"
trials = 1000
samples = [10, 100, 1000]
noise = 0.1
angle = 90
{}
"""


@pytest.mark.parametrize(
    ("top", "place", "words"),
    [
        ('route = "cumulants"', "route = 'cumulants'", "'points' or 'moments'"),
        ('keep = "nothing"', "keep = 'nothing'", "'errors' or 'summary'"),
        ('route = "moments"\nkeep_points = 1', "keep_points", "forms no points"),
        ('keep = "summary"\nkeep_points = 1', "keep_points", "does not store"),
        ('route = "moments"\nnoise_shape = [[1, 0, 0], [0, 1, 0], [0, 0, 2]]', "noise_shape", "isotropic"),
    ],
)
def test_what_does_not_go_together(top, place, words):
    """Each fault names its place and says why."""
    with pytest.raises(ConfigError) as caught:
        parse(GRID.format(top, ""))
    assert place in str(caught.value)
    assert words in str(caught.value)


def test_moments_serve_closed_forms_alone():
    """An estimator that needs the points is named, with those that do not."""
    text = GRID.format('route = "moments"', "").replace('"ugdk"', '"mle", "lls"')
    with pytest.raises(ConfigError, match=r"mle, lls need the points; the moments suffice for gdke, ugdk, "):
        parse(text)


@pytest.mark.parametrize("top", ['route = "moments"', 'keep = "summary"'])
def test_a_random_design_has_one_trial_a_cell(top):
    """A random design has neither levels that share draws nor cells to summarise, and says so."""
    text = GRID.format(top, "").replace('"grid"', '"random"').replace("[10, 100, 1000]", "10")
    with pytest.raises(ConfigError, match="random design"):
        parse(text)


def test_configs_from_before_are_what_they_were():
    """Entries at their defaults have no effect on the name of a run's folder; others have."""
    plain = parse(GRID.format("", ""))
    said = parse(GRID.format('route = "points"\nkeep = "errors"', ""))
    written = json.loads(plain.canonical())
    assert not {"route", "keep"} & set(written)
    assert "most_samples" not in written["design"]
    assert plain.digest() == said.digest()
    others = [('route = "moments"', ""), ('keep = "summary"', ""), ("", "most_samples = 5000")]
    assert len({parse(GRID.format(*other)).digest() for other in others} | {plain.digest()}) == 4


def test_cells_of_many_samples_have_fewer_trials():
    """At most 5000 samples a cell: 500 trials of 10, 50 of 100, 5 of 1000; at least one."""
    for limit, expected in ((5000, {10: 500, 100: 50, 1000: 5}), (500, {10: 50, 100: 5, 1000: 1})):
        found = dict.fromkeys(expected, 0)
        for unit in units(parse(GRID.format("", f"most_samples = {limit}"))):
            for batch in unit.batches:
                found[batch.samples] += batch.trials
        assert found == expected

"""The section ``[precision]``: its meaning, its faults, and its effect on a run's name."""

import math

import pytest

from study.experiment.config import ConfigError, Study, parse
from study.experiment.precision_config import MEASURES, Precision
from study.runs.storage import schemas

GRID = """name = "test"
seed = 1
estimators = ["mle", "ugdk"]
[design]
kind = "grid"
trials = 4000
samples = [5, 20]
noise = [0.1, 0.2]
angle = 60
"""
RANDOM = """name = "test"
seed = 1
estimators = ["mle", "ugdk"]
[design]
kind = "random"
trials = 4000
samples = 20
noise = 0.1
angle = { law = "uniform", low = 0, high = 180 }
"""
FIRST = GRID.count("\n") + 2
"""The line after [precision]'s own."""


def with_section(*lines, text=GRID):
    """A config with these lines in its [precision]."""
    return text + "\n".join(["[precision]", *lines]) + "\n"


def faults(text):
    """Lines of the message about a config, without its first, which counts them."""
    with pytest.raises(ConfigError) as caught:
        parse(text, "x.toml")
    return str(caught.value).splitlines()[1:]


def test_defaults_are_those_of_the_documentation():
    """Half the config is the target; the rest is the summary's headline, all estimators, 250 trials, no budget."""
    made = parse(with_section("target = 0.01")).precision
    assert (made.measure, made.estimators, made.first, made.seconds) == ("ratio_median_ok", None, 250, None)
    assert (made.target, made.relative_target) == (0.01, None)
    assert parse(GRID).precision is None


def test_measures_are_those_of_the_summary():
    """The names that a config may give are those of the summary's columns that have an error beside them."""
    names = [column.name for column in schemas.summary()]
    assert set(MEASURES) == {name.removesuffix("_error") for name in names if name.endswith("_error")}
    for name in MEASURES:
        assert parse(with_section("target = 0.01", f'measure = "{name}"')).precision.measure == name


FAULTS = [
    ("target = 0.0", "precision.target = 0.0", "greater than 0"),
    ("target = -1.0", "precision.target = -1.0", "greater than 0"),
    ("target = inf", "precision.target = inf", "finite"),
    ("target = nan", "precision.target = nan", "finite"),
    ('target = "1 %"', "precision.target = '1 %'", "number"),
    ("relative_target = 0.0", "precision.relative_target = 0.0", "greater than 0"),
    ("relative_target = 1.0", "precision.relative_target = 1.0", "less than 1"),
    ("target = 1.0\nrelative_target = 0.1", "precision", "one of the two (found target and relative_target)"),
    ("first = 300", "precision", "give target or relative_target, one of the two (found neither)"),
    ("target = 1.0\nfirst = 99", "precision.first = 99", "greater than or equal to 100"),
    ("target = 1.0\nfirst = 250.5", "precision.first = 250.5", "integer"),
    ("target = 1.0\nfirst = 4001", "precision.first = 4001", "design.trials = 4000 is the cap"),
    ("target = 1.0\nseconds = 0", "precision.seconds = 0", "greater than 0"),
    ("target = 1.0\nseconds = inf", "precision.seconds = inf", "finite"),
    ('target = 1.0\nmeasure = "ratio_medain_ok"', "precision.measure = 'ratio_medain_ok'", "mean 'ratio_median_ok'"),
    ('target = 1.0\nmeasure = "planned"', "precision.measure = 'planned'", "known are relative_median"),
    ("target = 1.0\nmeasure = 3", "precision.measure = 3", "string"),
    ("target = 1.0\nestimators = []", "precision.estimators = []", "must have a value"),
    ('target = 1.0\nestimators = ["mle", "mle"]', "precision.estimators", "'mle' given more than once"),
    (
        'target = 1.0\nestimators = ["ugdke"]',
        "precision.estimators",
        "not among the study's; did you mean 'ugdk'? Known are mle, ugdk",
    ),
    ("target = 1.0\ntagret = 1.0", "precision.tagret = 1.0", "unknown key; did you mean 'target'?"),
]  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault[0])
def test_each_fault_is_listed(fault):
    """One fault, with its place, its value and the values allowed."""
    lines, *words = fault
    (said,) = faults(with_section(*lines.split("\n")))
    assert f": {words[0]}" in said
    assert words[1] in said
    assert int(said.split()[1].rstrip(":")) >= FIRST - 1


def test_a_random_design():
    """Each of its trials is a cell, to which none can be added."""
    (said,) = faults(with_section("target = 0.1", text=RANDOM))
    assert 'precision: a random design has one trial in a cell: design.kind = "grid"' in said


def test_a_summary_alone():
    """Decisions need the errors."""
    (said,) = faults(with_section("target = 0.1", text=GRID.replace("seed = 1", 'seed = 1\nkeep = "summary"')))
    assert 'precision: needs the errors, which keep = "summary" does not store' in said


def test_what_names_a_run():
    """Every entry but the budget changes a run's name; a config without the section keeps its name."""
    plain = parse(with_section("target = 0.1"))
    for line in ("measure = 'far_all'", "estimators = ['mle']", "first = 500", "target = 0.2"):
        lines = [line] if line.startswith("target") else ["target = 0.1", line]
        assert parse(with_section(*lines)).digest() != plain.digest(), line
    assert parse(with_section("target = 0.1", "seconds = 3.5")).digest() == plain.digest()
    assert "precision" not in parse(GRID).canonical()
    assert plain.stem() == parse(GRID).stem()
    assert Study.model_validate_json(plain.canonical()) == plain


@pytest.mark.parametrize(("cap", "points"), [(250, [250]), (251, [250, 251]), (1000, [250, 500, 1000]), (40, [40])])
def test_checkpoints(cap, points):
    """The first, doubled up to the cap; a cell that may have fewer than the first has one."""
    assert Precision(target=1.0).checkpoints(cap) == points


def test_reached():
    """At the target is enough; what is infinite or not a number never is, also beside an infinite measure."""
    absolute, relative = Precision(target=0.5), Precision(relative_target=0.25)
    assert absolute.reached(9.0, 0.5)
    assert not absolute.reached(9.0, 0.5000001)
    assert relative.reached(-2.0, 0.5)
    assert not relative.reached(-2.0, 0.51)
    assert not relative.reached(math.inf, math.inf)
    assert not absolute.reached(math.nan, math.nan)

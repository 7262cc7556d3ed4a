"""The section ``[posterior]``: its meaning, its faults, and that it does not change a run's name."""

import dataclasses
import re
from pathlib import Path

import pytest

import study
from study.simulation.experiment.config import Posterior, load, parse
from study.simulation.experiment.designs import Cell
from study.toml import ConfigError

CONFIGS = Path(study.__file__).parents[1] / "configs"
GRID = """name = "test"
seed = 1
dimension = 3
estimators = ["mle", "ugdk"]
[design]
kind = "grid"
trials = 3
samples = [5, 20]
noise = [0.1, 0.2]
angle = [60, 180]
radius = [1.0, 2.0]
center = [0.0, 3.0]
"""
RANDOM = """name = "test"
seed = 1
dimension = 3
estimators = ["mle", "ugdk"]
[design]
kind = "random"
trials = 3
samples = { law = "log_uniform", low = 5, high = 40 }
noise_over_radius = { law = "choice", values = [0.1, 0.3] }
angle = { law = "uniform", low = 0, high = 180 }
radius = 2.0

"""
FIRST = GRID.count("\n") + 2
"""The line after [posterior]'s own."""


def with_section(text, *lines):
    """A config with these lines in its [posterior]."""
    return text + "\n".join(["[posterior]", *lines]) + "\n"


def faults(text):
    """Lines of the message about a config, without its first, which counts them."""
    with pytest.raises(ConfigError) as caught:
        parse(text, "x.toml")
    head, *lines = str(caught.value).splitlines()
    assert head == ("x.toml: 1 fault" if len(lines) == 1 else f"x.toml: {len(lines)} faults")
    return lines


def test_defaults_are_those_of_the_documentation():
    """An empty [posterior] asks for four trials of every cell, σ known and not, in the geometric likelihood."""
    made = parse(with_section(GRID)).posterior
    assert (made.trials, made.where, made.noise, made.likelihood) == (4, (), ("known", "unknown"), ("geometric",))
    assert made.box == 10.0
    assert (made.walkers, made.max_steps, made.keep_draws) == (64, 20_000, 1)
    assert parse(GRID).posterior is None


def test_one_value_stands_for_a_list_of_one():
    """Noise, likelihood and the values of a condition may be written without brackets."""
    bare = with_section(GRID, 'noise = "known"', 'likelihood = "geometric"', "where = { angle = 180, samples = 20 }")
    listed = with_section(
        GRID, 'noise = ["known"]', 'likelihood = ["geometric"]', "where = { angle = [180], samples = [20] }"
    )
    assert parse(bare) == parse(listed)
    table = GRID + '[posterior]\nnoise = "known"\n[posterior.where]\nangle = 180\nsamples = 20\n'
    assert parse(table).posterior == parse(bare).posterior


FAULTS = [
    ("trials = 0", "posterior.trials = 0", "greater than or equal to 1"),
    ("trials = 2.0", "posterior.trials = 2.0", "integer"),
    ('trials = "2"', "posterior.trials = '2'", "integer"),
    ("trials = true", "posterior.trials = True", "integer"),
    ("box = 0", "posterior.box = 0", "greater than 0"),
    ("box = -1.0", "posterior.box = -1.0", "greater than 0"),
    ("box = 2e3", "posterior.box = 2000.0", "less than or equal to 1000"),
    ("box = inf", "posterior.box = inf", "finite"),
    ("box = nan", "posterior.box = nan", "finite"),
    ("walkers = 7", "posterior.walkers = 7", "greater than or equal to 8"),
    ("walkers = 5000", "posterior.walkers = 5000", "less than or equal to 4096"),
    ("walkers = 32.5", "posterior.walkers = 32.5", "integer"),
    ("max_steps = 99", "posterior.max_steps = 99", "greater than or equal to 100"),
    ("max_steps = 20_000_000", "posterior.max_steps = 20000000", "less than or equal to 10000"),
    ("keep_draws = -1", "posterior.keep_draws = -1", "greater than or equal to 0"),
    ('noise = "knwon"', "posterior.noise[0] = 'knwon'", "'known' or 'unknown'"),
    ('noise = ["known", "both"]', "posterior.noise[1] = 'both'", "'known' or 'unknown'"),
    ("noise = 0.1", "posterior.noise[0] = 0.1", "'known' or 'unknown'"),
    ("noise = []", "posterior.noise = []", "must have a value"),
    ('noise = ["known", "known"]', "posterior.noise", "'known' given more than once"),
    ('likelihood = "flat"', "posterior.likelihood[0] = 'flat'", "'geometric' or 'whole_sphere'"),
    ("likelihood = []", "posterior.likelihood = []", "must have a value"),
    ('likelihood = ["geometric", "geometric"]', "posterior.likelihood", "'geometric' given more than once"),
    ("wlakers = 64", "posterior.wlakers = 64", "unknown key; did you mean 'walkers'?"),
    ("keep_draw = 1", "posterior.keep_draw = 1", "unknown key; did you mean 'keep_draws'?"),
    ("zzz = 1", "posterior.zzz = 1", "unknown key; known are trials, where, noise, likelihood, box"),
    ("where = 180", "posterior.where = 180", "must be a table of conditions and values, such as { angle = "),
    ("where = { angel = 180 }", "posterior.where", "angel unknown: conditions are samples, noise, noise_over_radius"),
    ('where = { angle = "wide" }', "posterior.where", "every value must be a number"),
    ("where = { angle = [180, true] }", "posterior.where", "every value must be a number"),
    ("where = { noise = nan, samples = 20 }", "posterior.where", "every value must be a number"),
    ("where = { angle = { linspace = [60, 180, 2] } }", "posterior.where", "every value must be a number"),
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault[0])
@pytest.mark.parametrize("text", [GRID, RANDOM], ids=["grid", "random"])
def test_each_fault_is_listed(text, fault):
    """One fault, with its line, its place, its value and the values allowed."""
    line, *words = fault
    (said,) = faults(with_section(text, line))
    assert said.startswith(f"  line {FIRST}: {words[0]}")
    assert words[1] in said


@pytest.mark.parametrize("text", [GRID, RANDOM], ids=["grid", "random"])
def test_a_posterior_that_is_no_table(text):
    """A number in the place of the table is a fault at its line."""
    (said,) = faults("posterior = 3\n" + text)
    assert said.startswith("  line 1: posterior = 3: ")


ACROSS = [
    ("where = { angle = 45 }", "where: no cell has angle = 45"),
    ("where = { samples = [20, 21] }", "where: no cell has samples = 21"),
    ("where = { noise = 0.1000001, samples = 20 }", "where: no cell has noise = 0.1000001"),
    ("where = { noise_over_radius = 0.15, samples = 20 }", "where: no cell has noise_over_radius = 0.15"),
    ("where = { radius = 3, samples = 20 }", "where: no cell has radius = 3"),
    ("where = { center = 1, samples = 20 }", "where: no cell has center = 1"),
]


@pytest.mark.parametrize(("line", "words"), ACROSS)
def test_a_value_that_no_cell_has(line, words):
    """A value that the grid does not have is the only fault, at the line of where."""
    assert f"  line {FIRST}: posterior.{words}" in faults(with_section(GRID, line))[0]


@pytest.mark.parametrize(
    ("line", "words"),
    [("where = { radius = 3 }", "radius = 3"), ("where = { noise_over_radius = 0.2 }", "noise_over_radius = 0.2")],
)
def test_a_value_that_no_law_gives(line, words):
    """Constants and choices have values that can be listed; those of intervals are not checked."""
    assert faults(with_section(RANDOM, line)) == [f"  line {FIRST}: posterior.where: no cell has {words}"]
    assert parse(with_section(RANDOM, "where = { radius = 2, noise_over_radius = [0.1, 0.3], noise = 7, angle = 30 }"))


def test_all_values_that_no_cell_has():
    """Each has a line of its own."""
    line = "where = { angle = [45, 60, 90], noise = 0.3, samples = 20 }"
    assert [said.split(": ", 2)[2] for said in faults(with_section(GRID, line))] == [
        "no cell has angle = 45",
        "no cell has angle = 90",
        "no cell has noise = 0.3",
    ]


def test_where_of_conditions_that_cells_have():
    """σ and σ/r are both known in a grid that gives one of them, and values need agree to nine digits only."""
    assert parse(with_section(GRID, "where = { noise_over_radius = [0.05, 0.2], samples = 20 }"))  # .1/2, .2/1
    relative = GRID.replace("noise =", "noise_over_radius =")
    assert parse(with_section(relative, "where = { noise = [0.1, 0.4], samples = 20 }"))  # .1·1, .2·2
    assert "no cell has noise = 0.3" in faults(with_section(relative, "where = { noise = 0.3 }"))[0]
    assert parse(with_section(GRID, "where = { noise = 0.10000000000001, center = 3, samples = 20.0 }"))


def test_where_is_empty():
    """A condition without values chooses nothing, which is a fault and no crash."""
    for name in ("samples", "angle"):
        (said,) = faults(with_section(GRID, f"where = {{ {name} = [] }}"))
        assert said.startswith(f"  line {FIRST}: posterior.where")


WHOLE = "whole_sphere is wrong on caps: choose cells of the whole sphere with where = { angle = 180 }"


@pytest.mark.parametrize("likelihood", ['"whole_sphere"', '["geometric", "whole_sphere"]'])
@pytest.mark.parametrize("text", [GRID, RANDOM], ids=["grid", "random"])
def test_whole_sphere_on_caps(text, likelihood):
    """It needs cells of 180° alone; the message says how to choose them, at the line of the likelihood."""
    line = f"likelihood = {likelihood}"
    told = f"  line {FIRST + 1}: posterior.likelihood: {WHOLE}"
    assert faults(with_section(text, "trials = 3", line)) == [told]
    if text == GRID:
        assert faults(with_section(text, "where = { angle = [60, 180] }", line)) == [told]
        assert faults(with_section(text, "where = { angle = 60 }", line)) == [told]
    assert parse(with_section(text, "where = { angle = 180 }", line))
    assert parse(
        with_section(text.replace("[60, 180]", "180").replace('{ law = "uniform", low = 0, high = 180 }', "180"), line)
    )


@pytest.mark.parametrize("noise", ["", 'noise = "unknown"', 'noise = ["known", "unknown"]'])
@pytest.mark.parametrize("text", [GRID, RANDOM], ids=["grid", "random"])
def test_unknown_noise_needs_two_more_samples_than_dimensions(text, noise):
    """As many as d + 1 samples lie on a sphere exactly and say nothing of σ; where may choose cells of more."""
    few = text.replace("[5, 20]", "[4, 20]").replace("low = 5", "low = 4")
    (said,) = faults(with_section(few, noise or "trials = 3"))
    line = FIRST if noise else FIRST - 1
    assert (
        said == f"  line {line}: posterior.noise: an unknown noise needs at least 5 samples, not 4; choose with where"
    )
    assert parse(with_section(text, noise))
    assert parse(with_section(few, noise, "where = { samples = 20 }"))
    assert parse(with_section(few, 'noise = "known"'))
    if text == GRID:
        assert "not 4;" in faults(with_section(few, noise, "where = { samples = [20, 4] }"))[0]


@pytest.mark.parametrize("d", [2, 5])
def test_unknown_noise_in_other_dimensions(d):
    """As many as d + 2 samples are enough."""
    text = GRID.replace("dimension = 3", f"dimension = {d}").replace("[5, 20]", f"[{d + 2}, 20]")
    assert parse(with_section(text))
    assert (
        f"needs at least {d + 2} samples, not {d + 1};"
        in faults(with_section(text.replace(f"[{d + 2},", f"[{d + 1},")))[0]
    )


def test_noise_with_a_shape():
    """The likelihoods are of isotropic noise, and the message says what to take out."""
    shaped = "noise_shape = [[1, 0, 0], [0, 1, 0], [0, 0, 4]]\n" + GRID
    (said,) = faults(with_section(shaped))
    assert said == f"  line {FIRST}: posterior: its likelihoods are of isotropic noise: take noise_shape out"
    assert parse(shaped)


@pytest.mark.parametrize(("d", "least"), [(2, 10), (3, 12), (5, 16)])
def test_walkers_for_the_dimension(d, least):
    """Half of an ensemble must span its parameters, d + 2 at most, which takes d + 3 walkers; fewer are a fault."""
    text = GRID.replace("dimension = 3", f"dimension = {d}").replace("[5, 20]", "[20]")
    assert parse(with_section(text, f"walkers = {least}"))
    (said,) = faults(with_section(text, "trials = 2", f"walkers = {least - 1}"))
    assert said == f"  line {FIRST + 1}: posterior.walkers = {least - 1}: at least {least} are needed in dimension {d}"


def test_independence():
    """Cells are independent if each has its own draws or there is only one; those of a shared grid are not."""
    text = GRID.replace("[5, 20]", "20").replace("[0.1, 0.2]", "0.1").replace("[60, 180]", "60")
    alone = text.replace("[1.0, 2.0]", "1.0").replace("[0.0, 3.0]", "0.0")
    assert parse(RANDOM).independent()
    assert parse(alone).independent()
    assert parse(GRID + 'draws = "independent"\n').independent()
    assert not parse(GRID).independent()
    assert not parse(text).independent()


def test_faults_of_the_posterior_stand_with_the_others_in_the_order_of_the_file():
    """All faults between entries are in one message."""
    lines = ["noise = 'unknown'", "likelihood = 'whole_sphere'", "where = { samples = [4, 9], angle = 61 }"]
    said = faults(with_section(GRID.replace("[5, 20]", "[4, 20]"), *lines))
    assert [int(re.match(r"  line (\d+)", line)[1]) for line in said] == [FIRST, FIRST + 1, FIRST + 2, FIRST + 2]


CELL = Cell(samples=20, noise=0.1, angle=60.0, radius=2.0, center=(3.0, 0.0, 0.0))
VALUES = {"samples": 20, "noise": 0.1, "noise_over_radius": 0.05, "angle": 60.0, "radius": 2.0, "center": 3.0}


def test_chooses():
    """A cell is chosen if each condition has one of its values, to nine digits; without where, every cell is."""
    assert Posterior().chooses(CELL)
    for name, value in VALUES.items():
        assert Posterior(where={name: [value * (1.0 + 1e-12), 7e9]}).chooses(CELL)
        assert not Posterior(where={name: [value * (1.0 + 1e-6), 7e9]}).chooses(CELL)
    both = Posterior(where={"angle": 60, "radius": 1.0})
    assert not both.chooses(CELL)
    assert both.chooses(dataclasses.replace(CELL, radius=1.0))


OLD = {
    "paper": "paper-8689e37964",
    "ellipse": "ellipse-26be580da7",
    "mgdk": "mgdk-fef748cb88",
    "power-law": "power-law-a5b1568c08",
}


@pytest.mark.parametrize("name", OLD)
def test_old_runs_keep_their_names(name):
    """Configs from before posteriors existed keep the names of their folders."""
    assert load(CONFIGS / f"{name}.toml").run_name() == OLD[name]


@pytest.mark.parametrize("text", [GRID, RANDOM], ids=["grid", "random"])
def test_the_posterior_is_not_in_the_name(text):
    """The error table does not depend on it, so a run can be given posteriors later."""
    plain = parse(text)
    for lines in ([], ["trials = 2", 'noise = "known"'], ["box = 3.0", "walkers = 128", "keep_draws = 7"]):
        other = parse(with_section(text, *lines))
        assert other.posterior is not None
        assert other != plain
        assert (other.digest(), other.run_name()) == (plain.digest(), plain.run_name())
        assert other.canonical() == plain.canonical()
    assert parse(text.replace("seed = 1", "seed = 2")).digest() != plain.digest()


def test_the_shipped_config_asks_for_posteriors_that_the_theory_can_judge():
    """The shipped config has chains of both kinds of noise, independent cells and a hundred samples at least."""
    made = load(CONFIGS / "posterior.toml")
    assert set(made.posterior.noise) == {"known", "unknown"}
    assert "geometric" in made.posterior.likelihood
    assert made.design.draws == "independent"
    assert min(made.design.samples) >= 100

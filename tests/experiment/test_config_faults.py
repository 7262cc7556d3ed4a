"""Configs with faults: one message has every fault, with its line, place, value and the values allowed."""

import re

import pytest

from study.experiment.config import ConfigError, parse

GRID = [
    'name = "test"',
    "seed = 1",
    "dimension = 3",
    'estimators = ["lls", "ugdk"]',
    "",
    "[design]",
    'kind = "grid"',
    "trials = 2",
    "samples = [10, 20]",
    "noise = 0.1",
    "angle = 90",
    "radius = 1",
]
RANDOM = [*GRID[:6], 'kind = "random"', "trials = 2", "samples = 10", *GRID[9:]]


def message(lines, changes):
    """The message about a config in which some lines, counted from 1, are replaced."""
    lines = [changes.get(number, line) for number, line in enumerate(lines, start=1)]
    with pytest.raises(ConfigError) as caught:
        parse("\n".join(lines), "study.toml")
    return str(caught.value)


def test_templates_are_right():
    """The configs that the tests below modify are good ones."""
    assert parse("\n".join(GRID)).name == parse("\n".join(RANDOM)).name == "test"


COMMON = [
    (1, 'name = "../x"', "name = '../x'", "small letters, digits and hyphens"),
    (1, 'name = "a/b"', "name = 'a/b'", "small letters, digits and hyphens"),
    (1, 'name = ""', "name = ''", "small letters, digits and hyphens"),
    (1, 'name = "a\\n"', r"name = 'a\n'", "small letters, digits and hyphens"),
    (1, "name = 7", "name = 7", "string"),
    (2, "seed = -1", "seed = -1", "greater than or equal to 0"),
    (2, "seed = 1.5", "seed = 1.5", "integer"),
    (2, "seed = true", "seed = True", "integer"),
    (2, "seeds = 1", "seeds = 1", "unknown key; did you mean 'seed'?"),
    (2, "seed = 1\nbogus = 1", "bogus = 1", "unknown key; known are name, seed"),
    (3, "dimension = 1", "dimension = 1", "greater than or equal to 2"),
    (3, 'dimension = "3"', "dimension = '3'", "integer"),
    (3, "keep_points = -1", "keep_points = -1", "greater than or equal to 0"),
    (4, "estimators = []", "estimators = []", "must have a value"),
    (4, 'estimators = "lls"', "estimators = 'lls'", "must be a list, such as"),
    (4, 'estimators = ["lsl"]', "estimators = ['lsl']", "'lsl' unknown; did you mean 'lls'? Known are mle, "),
    (4, 'estimators = ["lls", "lls"]', "estimators", "'lls' given more than once; give each value once"),
    (5, "noise_shape = [[1, 0], [0, 1]]", "noise_shape = [[1, 0], [0, 1]]", "symmetric, positive definite 3 × 3"),
    (5, "noise_shape = [[1, 2, 0], [0, 1, 0], [0, 0, 1]]", "noise_shape", "symmetric"),
    (5, "noise_shape = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "noise_shape", "positive definite"),
    (5, "noise_shape = [[1, 0, 0], [0, 1, 0], [0, 0, 0]]", "noise_shape", "positive definite"),
    (5, "noise_shape = [[1, 0, 0], [0, 1, 0]]", "noise_shape", "3 × 3"),
    (5, "noise_shape = 2", "noise_shape = 2", "3 × 3"),
    (7, 'kind = "gird"', "design.kind = 'gird'", "must be one of 'random', 'grid'"),
    (8, "trials = 0", "design.trials = 0", "greater than or equal to 1"),
    (8, "trials = 2.0", "design.trials = 2.0", "integer"),
    (9, "samples = 10.5", "design.samples = 10.5|10.5 not allowed", "whole number"),
    (9, "samples = 3", "design.samples", "3 samples are too few: a sphere in dimension 3 needs at least 4"),
    (9, "sampels = 10", "design.sampels = 10", "did you mean 'samples'?"),
    (10, "noise = -0.1", "design.noise = -0.1|-0.1 not allowed", "above 0"),
    (10, "noise = 0", "design.noise = 0|0 not allowed", "above 0"),
    (10, 'noise = "a"', "design.noise = 'a'", "above 0|law"),
    (10, "noise = true", "design.noise = True", "number|every value"),
    (10, "noise = nan", "design.noise = nan", "finite|every value"),
    (10, "noise = inf", "design.noise = inf", "finite|every value"),
    (10, "noise = 1979-05-27", "design.noise = datetime", "above 0|law"),
    (11, "angle = 0", "design.angle = 0|0 not allowed", "above 0 and at most 180 degrees"),
    (11, "angle = 180.1", "design.angle = 180.1|180.1 not allowed", "above 0 and at most 180 degrees"),
    (12, "radius = 0", "design.radius = 0|0 not allowed", "above 0"),
    (12, "radius = 1e-300", "design.radius = 1e-300|1e-300 not allowed", "between 1e-100 and 1e100"),
    (12, "radius = 1e160", "design.radius = 1e+160|1e+160 not allowed", "between 1e-100 and 1e100"),
    (12, "center = -1", "design.center = -1|-1 not allowed", "at least 0"),
]


@pytest.mark.parametrize("fault", COMMON, ids=lambda fault: fault[1].replace("\n", " "))
@pytest.mark.parametrize("template", [GRID, RANDOM], ids=["grid", "random"])
def test_each_fault_is_listed(template, fault):
    """A fault has its line, its place, its value and the values allowed."""
    number, line, *parts = fault
    said = message(template, {number: line})
    head, *lines = said.splitlines()
    assert re.fullmatch(r"study\.toml: (1 fault|[2-9] faults)", head)
    number += line.count("\n")
    here = [text for text in lines if text.startswith(f"  line {number}: ")]
    for part in parts:
        assert any(word in text for word in part.split("|") for text in here), said


IN_GRID = [
    (9, "samples = []", "design.samples = []", "the list is empty"),
    (9, "samples = [10, 3.5]", "3.5 not allowed", "whole number"),
    (9, "samples = [20, 10, 20, 1e1]", "design.samples", "20, 10 given more than once; give each value once"),
    (9, "samples = [10, 3]", "design.samples", "3 samples are too few"),
    (9, "samples = { linspace = [3, 9, 3] }", "design.samples", "3 samples are too few"),
    (9, "samples = { linspace = [4, 9] }", "linspace = [4, 9] not understood", "[first, last, count]"),
    (9, "samples = { linspace = [4, 9, 0] }", "count = 0", "whole number"),
    (9, "samples = { linspace = [4, 9, 2.5] }", "count = 2.5", "whole number"),
    (10, "noise = { logspace = [0, 1, 3] }", "logspace from 0 to 1", "both ends above 0"),
    (10, "noise = { linspace = [nan, 1, 3] }", "not understood", "[first, last, count]"),
    (10, "noise = { linspce = [1, 2, 3] }", "keys linspce not understood", "logspace"),
    (10, "noise = [0.1, -1, 'a', true]", "-1, 'a', True not allowed", "above 0"),
    (10, "noise = [inf, nan]", "inf, nan not allowed", "above 0"),
    (10, "noise = [1, 0.1, 1.0]", "design.noise", "1 given more than once; give each value once"),
    (10, 'noise = { law = "uniform", low = 1, high = 2 }', "design.noise", "linspace"),
    (11, "angle = [90, 0, 181]", "0, 181 not allowed", "at most 180 degrees"),
    (12, 'draws = "both"', "design.draws = 'both'", "'shared' or 'independent'"),
]
IN_RANDOM = [
    (9, 'samples = { law = "log_uniform", low = 3, high = 9 }', "design.samples", "3 samples are too few"),
    (9, 'samples = { law = "choice", values = [9, 3] }', "design.samples", "3 samples are too few"),
    (9, 'samples = { law = "constant", value = 3 }', "design.samples", "3 samples are too few"),
    (9, 'samples = { law = "choice", values = [4, 4.5, 9] }', "design.samples", "4.5", "whole number"),
    (10, 'noise = { law = "normal", low = 1 }', "design.noise.law = 'normal'", "'uniform', 'log_uniform'"),
    (10, 'noise = { law = "uniform", low = 2, high = 1 }', "design.noise", "low = 2 must be below high = 1"),
    (10, 'noise = { law = "uniform", low = 2, high = 2 }', "design.noise", "low = 2 must be below high = 2"),
    (10, 'noise = { law = "uniform", low = 1, hihg = 2 }', "design.noise.hihg = 2", "did you mean 'high'?"),
    (10, 'noise = { law = "uniform", low = 1 }', "design.noise.high", "required, but missing"),
    (10, 'noise = { law = "uniform", low = -1, high = 2 }', "-1 not allowed", "above 0"),
    (10, 'noise = { law = "log_uniform", low = 0, high = 2 }', "design.noise.low = 0", "greater than 0"),
    (10, 'noise = { law = "choice", values = [] }', "design.noise.values = []", "must have a value"),
    (10, 'noise = { law = "choice", values = [1, "a"] }', "design.noise.values[1] = 'a'", "number"),
    (10, 'noise = { law = "uniform", low = true, high = 2 }', "design.noise.low = True", "number"),
    (10, 'noise = { law = "uniform", low = 0, high = inf }', "design.noise.high = inf", "finite"),
    (11, 'angle = { law = "uniform", low = 0, high = 181 }', "181 not allowed", "at most 180 degrees"),
    (12, 'draws = "shared"', "design.draws = 'shared'", "unknown key"),
]


@pytest.mark.parametrize("fault", IN_GRID, ids=lambda fault: fault[1])
def test_each_fault_of_a_grid_is_listed(fault):
    """Lists, linspace and logspace are checked value by value."""
    number, line, *parts = fault
    said = message(GRID, {number: line})
    assert said.startswith("study.toml: 1 fault\n")
    assert f"line {number}: " in said
    assert all(part in said for part in parts), said


@pytest.mark.parametrize("fault", IN_RANDOM, ids=lambda fault: fault[1])
def test_each_fault_of_a_law_is_listed(fault):
    """Laws are checked key by key, and at their extremes."""
    number, line, *parts = fault
    said = message(RANDOM, {number: line})
    assert f"line {number}: " in said
    assert all(part in said for part in parts), said


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize("spelling", ["{}", "[99, {}]", "{{ linspace = [{}, 50, 2] }}", "{{ logspace = [50, {}, 2] }}"])
def test_too_few_samples_for_the_dimension_in_a_grid(d, spelling):
    """N = d is refused in every spelling, N = d + 1 is taken."""
    few = {3: f"dimension = {d}", 9: f"samples = {spelling.format(d)}"}
    assert f"needs at least {d + 1}" in message(GRID, few)
    lines = [few.get(i, line) if i != 9 else f"samples = {spelling.format(d + 1)}" for i, line in enumerate(GRID, 1)]
    assert d + 1 in parse("\n".join(lines)).design.samples


@pytest.mark.parametrize("law", ['"uniform", low = {}, high = 99', '"log_uniform", low = {}, high = 99'])
@pytest.mark.parametrize("d", [2, 3, 5])
def test_too_few_samples_for_the_dimension_in_a_law(d, law):
    """N = d is refused as a law's lower end, N = d + 1 is taken."""
    few = {3: f"dimension = {d}", 9: f"samples = {{ law = {law.format(d)} }}"}
    assert f"needs at least {d + 1}" in message(RANDOM, few)
    enough = few | {9: f"samples = {{ law = {law.format(d + 1)} }}"}
    assert parse("\n".join(enough.get(i, line) for i, line in enumerate(RANDOM, 1))).dimension == d


@pytest.mark.parametrize("template", [GRID, RANDOM], ids=["grid", "random"])
@pytest.mark.parametrize(
    ("line", "found"),
    [("", "neither"), ("noise = 1\nnoise_over_radius = 1", "noise and noise_over_radius")],
    ids=["neither", "both"],
)
def test_one_noise_of_two(template, line, found):
    """Noise is given once: absolutely, or over the radius."""
    assert f"one of the two (found {found})" in message(template, {10: line})


@pytest.mark.parametrize("key", ["name", "seed", "estimators", "kind", "trials", "samples", "noise", "angle"])
def test_what_is_missing_is_named(key):
    """A required key that is absent is named, at the line of its table."""
    number = next(i for i, line in enumerate(GRID, 1) if line.startswith(key))
    said = message(GRID, {number: ""})
    place = key if number < 6 else f"design.{key}" if key != "noise" else "design"
    assert f"line {1 if number < 6 else 6}: {place}: " in said


@pytest.mark.parametrize("value", ["[0.1, 0.2]", "{ linspace = [1, 2, 3] }", "{ low = 1, high = 2 }"])
def test_a_grid_axis_in_a_random_design(value):
    """A list or a range in a random design is refused, and the message names a law."""
    said = message(RANDOM, {10: f"noise = {value}"})
    assert "line 10: design.noise" in said
    assert "uniform" in said.split("design.noise", 1)[1].replace(value, "")


def test_a_known_key_is_not_suggested_for_itself():
    """A key of the other kind of design is not called a misspelling of itself."""
    said = message(RANDOM, {12: 'draws = "shared"'})
    assert "did you mean 'draws'" not in said


def test_a_grid_too_large_is_refused():
    """Axes that are each allowed (here 2, 10,000 and 10,000 values) may not multiply to more than can be run."""
    wide = {10: "noise = { logspace = [1e-9, 1.0, 10_000] }", 11: "angle = { linspace = [1, 180, 10_000] }"}
    assert "200,000,000 cells; at most 10,000,000 are allowed" in message(GRID, wide)


def test_a_range_of_one_value_has_one_end():
    """A count of 1 does not silently drop an end."""
    assert "cannot be 1 value" in message(GRID, {10: "noise = { linspace = [1, 2, 1] }"})

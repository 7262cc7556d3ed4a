"""Configs with faults: one message has every fault, with its line, place, value and the values allowed.

Any TOML at all: a study or a `ConfigError`, never anything else.

The message as a whole: all faults at once, in the order of the file; and files that are no configs at all.

One mistake in a config is told once, with the value, the place and the remedy.
"""

import json
import math
import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from study.simulation.experiment.config import MEASURES, Study, load, parse
from study.toml import ConfigError

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


KEYS = ["name", "seed", "dimension", "estimators", "noise_shape", "keep_points", "precision", "design"]

KEYS += ["kind", "trials", "samples", "noise", "noise_over_radius", "angle", "radius", "center", "draws"]

KEYS += ["law", "value", "values", "low", "high", "linspace", "logspace", "grid", "random", "uniform", "constant"]

KEYS += ["target", "relative_target", "measure", "first", "seconds"]

WORDS = ["grid", "random", "uniform", "log_uniform", "choice", "constant", "shared", "lls", "mle", "test", "", "a.b"]

texts = st.sampled_from(WORDS) | st.text(st.characters(codec="utf-8", exclude_categories=["C"]), max_size=5)

numbers = (
    st.integers(-5, 2000)
    | st.sampled_from([0, 3, 4, 90, 180, 10**8, -(10**30), 10**308, 10**400])
    | st.floats()
    | st.sampled_from([0.0, -0.0, 0.1, 4.5, 180.0, 1e-320, 1e308, math.inf, math.nan])
)

values = st.recursive(
    numbers | texts | st.booleans(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(KEYS) | texts, inner, max_size=4)
        | st.fixed_dictionaries({"law": texts}, optional=dict.fromkeys(("low", "high", "value", "values"), inner))
        | st.fixed_dictionaries({}, optional={k: st.lists(numbers, max_size=4) for k in ("linspace", "logspace")})
    ),
    max_leaves=6,
)


def toml(value):
    """A value as TOML; dictionaries become inline tables."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k, ensure_ascii=False)} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def outcome(data):
    """Parse a dictionary written as TOML; what is no study is a message of several parts."""
    text = "\n".join(f"{json.dumps(key, ensure_ascii=False)} = {toml(value)}" for key, value in data.items())
    try:
        study = parse(text, "x.toml")
    except ConfigError as error:
        assert str(error).startswith("x.toml: ")  # noqa: PT017
        return None
    assert isinstance(study, Study)
    assert Study.model_validate_json(study.model_dump_json()).digest() == study.digest()
    return study


@settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(st.dictionaries(st.sampled_from(KEYS) | texts, values, max_size=8))
def test_arbitrary_toml(data):
    """Any small document is a study or a fault."""
    outcome(data)


@settings(max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    kind=st.sampled_from(["grid", "random"]),
    head=st.dictionaries(st.sampled_from(KEYS[:7]) | texts, values, max_size=2),
    body=st.dictionaries(st.sampled_from(KEYS[8:17]) | texts, numbers | values, max_size=2),
)
def test_almost_right(kind, head, body):
    """A good config with up to four keys replaced by anything is a study or a fault."""
    design = {"kind": kind, "trials": 2, "samples": 10, "noise": 0.1, "angle": 90.0}
    good = {"name": "test", "seed": 1, "dimension": 3, "estimators": ["lls"]}
    assert outcome(good | {"design": design}) is not None
    outcome(good | head | {"design": design | body})


MANY = """name = "Test"
seed = -1
dimension = 5
estimators = ["lls", "ugkd"]
noise_shape = [[1, 0], [0, 1]]
keep = 3

[design]
kind = "grid"
trials = 0
samples = [5, 20]
noise = [0.1, -0.2]
noise_over_radius = 0.1
angle = [90, 200]
radius = "one"
"""


def faults(text):
    """Lines of the message about a text."""
    with pytest.raises(ConfigError) as caught:
        parse(text, "x.toml")
    head, *lines = str(caught.value).splitlines()
    assert head == ("x.toml: 1 fault" if len(lines) == 1 else f"x.toml: {len(lines)} faults")
    return lines


def test_all_faults_at_once_in_the_order_of_the_file():
    """Ten faults give ten lines, sorted by line, none swallowed by another."""
    lines = faults(MANY)
    assert [int(line.split()[1].rstrip(":")) for line in lines] == [1, 2, 4, 5, 6, 8, 10, 11, 12, 14, 15]
    places = ["name", "seed", "estimators", "noise_shape", "keep", "design", "design.trials", "design.samples"]
    places += ["design.noise", "design.angle", "design.radius"]
    assert [line.split(": ")[1].split(" = ")[0] for line in lines] == places


def test_an_empty_file():
    """Everything that is required is named."""
    assert [line.split(": ")[1] for line in faults("")] == ["name", "seed", "estimators", "design"]


@pytest.mark.parametrize(
    "head",
    [
        "design = { kind = 'grid', trials = 0 }",
        "[design]\nkind = 'grid'\ntrials = 0",
        "design.kind = 'grid'\ndesign.trials = 0",
    ],
    ids=["inline", "headed", "dotted"],
)
def test_tables_inline_headed_or_dotted(head):
    """A design is found however TOML lets it be written, and its faults have the line of the key or the table."""
    number = 2 + head.count("\n")
    text = f"name = 'test'\n{head}\n"
    line = next(line for line in faults(text) if "design.trials = 0" in line)
    assert line.startswith(f"  line {number}: ")


def test_faults_beside_a_key_named_like_a_design():
    """An unknown key called grid does not swallow the faults of other keys."""
    text = MANY.replace('radius = "one"', 'radius = "one"\ngrid = 1')
    lines = faults(text)
    assert any("design.radius = 'one'" in line for line in lines)
    assert any("design.grid = 1: unknown key" in line for line in lines)


@pytest.mark.parametrize("key", ["uniform", "low"])
def test_faults_within_a_law(key):
    """Within a law, a key named like the law does not swallow the faults of other keys."""
    noise = f'noise = {{ law = "uniform", {key} = "a", high = "b" }}'
    text = MANY.replace('"grid"', '"random"').replace("noise = [0.1, -0.2]", noise)
    lines = faults(text)
    assert any(f"design.noise.{key} = 'a'" in line for line in lines)
    assert any("design.noise.high = 'b'" in line for line in lines)


def test_a_fault_is_one_line():
    """A fault takes one line, for any key and any value."""
    assert all(line.startswith("  line ") for line in faults(MANY + '"new\\nline" = "new\\nline"\n'))


HUGE = "1" + 400 * "0"


@pytest.mark.parametrize("kind", ["grid", "random"])
@pytest.mark.parametrize("key", ["samples", "noise", "angle", "radius", "center"])
def test_numbers_beyond_floating_point(key, kind):
    """A whole number that no double can hold is a fault like any other."""
    lines = [f'name="test"\nseed=1\nestimators=["lls"]\n[design]\nkind="{kind}"\ntrials=2']
    values = {"samples": "10", "noise": "0.1", "angle": "90", "radius": "1", "center": "0"} | {key: HUGE}
    text = "\n".join([*lines, *(f"{k} = {v}" for k, v in values.items())])
    assert any(f"design.{key} = 1000" in line for line in faults(text))


@pytest.mark.parametrize(
    "line",
    [
        f"noise_shape = [[{HUGE}, 0, 0, 0, 0]]",
        "noise_shape = [[26, 13, -23], [13, 13, -19], [-23, -19, 29]]",
        f"keep_points = {5000 * '9'}",
    ],
    ids=["huge", "singular but for rounding", "5000 digits"],
)
def test_numbers_beyond_floating_point_elsewhere(line):
    """Neither a huge number nor a matrix of determinant 0, whose least eigenvalue rounds to above 0, passes."""
    good = 'name = "test"\nseed = 1\nestimators = ["lls"]\n'
    design = '[design]\nkind = "grid"\ntrials = 2\nsamples = 10\nnoise = 0.1\nangle = 90\n'
    assert parse(good + design).name == "test"
    with pytest.raises(ConfigError):
        parse(f"{good}{line}\n{design}")


@pytest.mark.parametrize("key", ["samples", "noise"])
def test_a_range_beyond_floating_point(key):
    """A linspace whose length overflows is a fault, not a warning."""
    values = {"samples": "10", "noise": "0.1", "angle": "90"} | {key: "{ linspace = [-1.7e308, 1.7e308, 3] }"}
    body = "\n".join(f"{k} = {v}" for k, v in values.items())
    lines = faults(f'name = "test"\nseed = 1\nestimators = ["lls"]\n[design]\nkind = "grid"\ntrials = 2\n{body}\n')
    assert any(f"design.{key} = " in line for line in lines)


@pytest.mark.parametrize("text", ["name = ", "name = 'a'\nname = 'b'", "just words", "[design", "a = [1,"])
def test_what_is_not_toml(text):
    """The message about a file that is no TOML has the line from the TOML reader."""
    with pytest.raises(ConfigError, match=r"^x\.toml: not TOML: .*(line|end of document)"):
        parse(text, "x.toml")


@pytest.mark.parametrize(
    ("noise", "radius", "words"),
    [
        ("noise_over_radius = 1e-250", "1e-100", r"noise_over_radius = 1e-250: with radius = 1e-100 σ is 0 in float64"),
        (
            "noise_over_radius = [1, 1e250]",
            "[1, 1e100]",
            r"noise_over_radius = 1e\+250: with radius = 1e\+100 σ is inf in float64",
        ),
        ("noise = 1e-300", "1e100", r"noise = 1e-300: with radius = 1e\+100 σ/r is 0 in float64"),
        ("noise = 1e300", "1e-100", r"noise = 1e\+300: with radius = 1e-100 σ/r is inf in float64"),
    ],
)
@pytest.mark.parametrize("kind", ["grid", "random"])
def test_noise_that_float64_cannot_hold(kind, noise, radius, words):
    """Noise that vanishes or overflows with the radius is told before anything is divided by it."""
    if kind == "random":
        noise, radius = re.sub(r"\[1, (.*)\]", r"\1", noise), radius.replace("[1, ", "").replace("]", "")
    design = f'kind = "{kind}"\ntrials = 3\nsamples = 5\nangle = 90\n{noise}\nradius = {radius}\n'
    with pytest.raises(ConfigError, match=rf"line 9: design\.{words}: give another noise or radius"):
        parse(f'name = "a"\nseed = 1\nestimators = ["lls"]\n[design]\n{design}')


@pytest.mark.parametrize(
    ("text", "place"), [("design = 3", "design"), ("[[design]]\ntrials = 3", "design"), ("[[precision]]", "precision")]
)
def test_what_is_no_table(text, place):
    """A number or a list in place of a table is told in the words of TOML."""
    with pytest.raises(
        ConfigError, match=rf"line 1: {place} = .*: must be one table, whose entries follow a line \[{place}"
    ):
        parse(text)


def test_toml_that_is_nested_too_deeply():
    """A document deeper than the reader can follow is refused like any other that cannot be read."""
    with pytest.raises(ConfigError, match=r"^x\.toml: "):
        parse("a = " + 3000 * "[" + 3000 * "]", "x.toml")


def test_what_cannot_be_read(tmp_path):
    """A missing file, a folder and bytes that are no text each have their reason."""
    (tmp_path / "bytes.toml").write_bytes(b'name = "\xff"')
    for path, reason in [
        (tmp_path / "none.toml", "No such file or directory"),
        (tmp_path, "Is a directory"),
        (tmp_path / "bytes.toml", "not UTF-8 text; save it as UTF-8"),
    ]:
        with pytest.raises(ConfigError) as caught:
            load(path)
        assert str(caught.value) == f"{path}: cannot be read: {reason}"


GRID_SINGLE_MISTAKES = """name = "test"
seed = 1
estimators = ["lls"]
[design]
kind = "grid"
trials = 300
samples = 10
noise = 0.1
angle = 90
"""

RANDOM_SINGLE_MISTAKES = GRID_SINGLE_MISTAKES.replace('"grid"', '"random"')


def only(text):
    """The one fault of a text."""
    with pytest.raises(ConfigError) as caught:
        parse(text, "x.toml")
    head, *lines = str(caught.value).splitlines()
    assert head == "x.toml: 1 fault", lines
    return lines[0].strip()


@pytest.mark.parametrize("text", [GRID_SINGLE_MISTAKES, RANDOM_SINGLE_MISTAKES], ids=["grid", "random"])
@pytest.mark.parametrize("key", ["name", "seed", "estimators", "trials", "samples", "noise", "angle"])
def test_a_misspelt_key(text, key):
    """It is unknown, with the key that was meant; that this one is missing goes without saying."""
    line = only(text.replace(f"{key} = ", f"{key}s = "))
    assert f"{key}s = " in line
    assert f"did you mean '{key}'?" in line


def test_a_misspelt_table():
    """So is a table."""
    assert "did you mean 'design'?" in only(GRID_SINGLE_MISTAKES.replace("[design]", "[desing]"))


@pytest.mark.parametrize("text", [GRID_SINGLE_MISTAKES, RANDOM_SINGLE_MISTAKES], ids=["grid", "random"])
def test_a_missing_kind(text):
    """It is required, and the message has the kinds that there are."""
    kind = text.splitlines()[4]
    words = "design.kind: required, but missing; must be one of 'random', 'grid'"
    assert only(text.replace(f"{kind}\n", "")).endswith(words)


@pytest.mark.parametrize("count", ["1e300", "1e12", "1_000_000_001", "[10, 2e9]", "{ logspace = [10, 1e10, 3] }"])
def test_more_samples_than_memory(count):
    """Numbers that no memory holds are refused with the limit."""
    line = only(GRID_SINGLE_MISTAKES.replace("samples = 10", f"samples = {count}"))
    assert "samples are too many for memory: at most 1,000,000,000 are allowed" in line
    assert (
        parse(GRID_SINGLE_MISTAKES.replace("samples = 10", "samples = 1_000_000_000")).design.least_samples() == 10**9
    )


@pytest.mark.parametrize(
    "law", ['"uniform", low = 5, high = 1e12', '"constant", value = 1e300', '"choice", values = [9, 1e10]']
)
def test_more_samples_than_memory_in_a_law(law):
    """So they are in a law."""
    line = only(RANDOM_SINGLE_MISTAKES.replace("samples = 10", f"samples = {{ law = {law} }}"))
    assert "too many for memory" in line


@pytest.mark.parametrize("samples", ["-1", "[2, 10]", "0"])
def test_too_few_samples(samples):
    """Too few are told once."""
    assert "a sphere in dimension 3 needs at least 4" in only(
        GRID_SINGLE_MISTAKES.replace("samples = 10", f"samples = {samples}")
    )


def test_one_estimator_that_is_no_list():
    """A list was expected, and is shown."""
    line = only(GRID_SINGLE_MISTAKES.replace('["lls"]', '"lls"'))
    assert line == "line 3: estimators = 'lls': must be a list, such as [\"lls\"]"
    assert "must be a list" in only(GRID_SINGLE_MISTAKES.replace('["lls"]', "5"))
    assert only(GRID_SINGLE_MISTAKES.replace('["lls"]', "[]")) == "line 3: estimators = []: must have a value"


def test_a_noise_shape_that_is_no_matrix():
    """It is told once."""
    assert "3 × 3 matrix" in only("noise_shape = 3\n" + GRID_SINGLE_MISTAKES)


def test_more_posteriors_than_trials():
    """A number of trials that no cell has is refused; the default is cut to the trials."""
    assert "posterior.trials = 301: more trials than a cell has: design.trials = 300" in only(
        GRID_SINGLE_MISTAKES + "[posterior]\ntrials = 301\n"
    )
    assert parse(GRID_SINGLE_MISTAKES + "[posterior]\ntrials = 300\n").posterior.trials == 300
    assert (
        parse(GRID_SINGLE_MISTAKES.replace("trials = 300", "trials = 2") + "[posterior]\nbox = 3.0\n").posterior
        is not None
    )


@pytest.mark.parametrize("measure", MEASURES)
def test_a_fraction_of_a_share(measure):
    """A share may be 0, so its error cannot be a fraction of it; that of other measures can."""
    text = f'{GRID_SINGLE_MISTAKES}[precision]\nmeasure = "{measure}"\n'
    if measure in ("far", "far_ok", "far_all"):
        line = only(text + "relative_target = 0.1\n")
        assert f"{measure} is a share, which may be 0, and no error is a fraction of 0: give target instead" in line
    else:
        assert parse(text + "relative_target = 0.1\n").precision.measure == measure
    assert parse(text + "target = 0.1\n").precision.target == 0.1


def test_the_mark_of_utf_8(tmp_path):
    """A file that begins with the mark that some editors write is the same config."""
    path = tmp_path / "marked.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GRID_SINGLE_MISTAKES.encode())
    assert load(path) == parse(GRID_SINGLE_MISTAKES)

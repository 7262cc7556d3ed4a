"""One mistake in a config is told once, with the value, the place and the remedy."""

import pytest

from study.experiment.config import ConfigError, load, parse
from study.experiment.precision_config import MEASURES

GRID = """name = "test"
seed = 1
estimators = ["lls"]
[design]
kind = "grid"
trials = 300
samples = 10
noise = 0.1
angle = 90
"""
RANDOM = GRID.replace('"grid"', '"random"')


def only(text):
    """The one fault of a text."""
    with pytest.raises(ConfigError) as caught:
        parse(text, "x.toml")
    head, *lines = str(caught.value).splitlines()
    assert head == "x.toml: 1 fault", lines
    return lines[0].strip()


@pytest.mark.parametrize("text", [GRID, RANDOM], ids=["grid", "random"])
@pytest.mark.parametrize("key", ["name", "seed", "estimators", "trials", "samples", "noise", "angle"])
def test_a_misspelt_key(text, key):
    """It is unknown, with the key that was meant; that this one is missing goes without saying."""
    line = only(text.replace(f"{key} = ", f"{key}s = "))
    assert f"{key}s = " in line
    assert f"did you mean '{key}'?" in line


def test_a_misspelt_table():
    """So is a table."""
    assert "did you mean 'design'?" in only(GRID.replace("[design]", "[desing]"))


@pytest.mark.parametrize("text", [GRID, RANDOM], ids=["grid", "random"])
def test_a_missing_kind(text):
    """It is required, and the message has the kinds that there are."""
    kind = text.splitlines()[4]
    words = "design.kind: required, but missing; must be one of 'random', 'grid'"
    assert only(text.replace(f"{kind}\n", "")).endswith(words)


@pytest.mark.parametrize("count", ["1e300", "1e12", "1_000_000_001", "[10, 2e9]", "{ logspace = [10, 1e10, 3] }"])
def test_more_samples_than_memory(count):
    """Numbers that no memory holds are refused with the limit."""
    line = only(GRID.replace("samples = 10", f"samples = {count}"))
    assert "samples are too many for memory: at most 1,000,000,000 are allowed" in line
    assert parse(GRID.replace("samples = 10", "samples = 1_000_000_000")).design.least_samples() == 10**9


@pytest.mark.parametrize(
    "law", ['"uniform", low = 5, high = 1e12', '"constant", value = 1e300', '"choice", values = [9, 1e10]']
)
def test_more_samples_than_memory_in_a_law(law):
    """So they are in a law."""
    line = only(RANDOM.replace("samples = 10", f"samples = {{ law = {law} }}"))
    assert "too many for memory" in line


@pytest.mark.parametrize("samples", ["-1", "[2, 10]", "0"])
def test_too_few_samples(samples):
    """Too few are told once."""
    assert "a sphere in dimension 3 needs at least 4" in only(GRID.replace("samples = 10", f"samples = {samples}"))


def test_one_estimator_that_is_no_list():
    """A list was expected, and is shown."""
    line = only(GRID.replace('["lls"]', '"lls"'))
    assert line == "line 3: estimators = 'lls': must be a list, such as [\"lls\"]"
    assert "must be a list" in only(GRID.replace('["lls"]', "5"))
    assert only(GRID.replace('["lls"]', "[]")) == "line 3: estimators = []: must have a value"


def test_a_noise_shape_that_is_no_matrix():
    """It is told once."""
    assert "3 × 3 matrix" in only("noise_shape = 3\n" + GRID)


def test_more_posteriors_than_trials():
    """A number of trials that no cell has is refused; the default is cut to the trials."""
    assert "posterior.trials = 301: more trials than a cell has: design.trials = 300" in only(
        GRID + "[posterior]\ntrials = 301\n"
    )
    assert parse(GRID + "[posterior]\ntrials = 300\n").posterior.trials == 300
    assert parse(GRID.replace("trials = 300", "trials = 2") + "[posterior]\nbox = 3.0\n").posterior is not None


@pytest.mark.parametrize("measure", MEASURES)
def test_a_fraction_of_a_share(measure):
    """A share may be 0, so its error cannot be a fraction of it; that of other measures can."""
    text = f'{GRID}[precision]\nmeasure = "{measure}"\n'
    if measure in ("far_ok", "far_all"):
        line = only(text + "relative_target = 0.1\n")
        assert f"{measure} is a share, which may be 0, and no error is a fraction of 0: give target instead" in line
    else:
        assert parse(text + "relative_target = 0.1\n").precision.measure == measure
    assert parse(text + "target = 0.1\n").precision.target == 0.1


def test_the_mark_of_utf_8(tmp_path):
    """A file that begins with the mark that some editors write is the same config."""
    path = tmp_path / "marked.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GRID.encode())
    assert load(path) == parse(GRID)

"""The message as a whole: all faults at once, in the order of the file; and files that are no configs at all."""

import re

import pytest

from study.experiment.config import ConfigError, load, parse

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
    ("text", "place"),
    [("design = 3", "design"), ("[[design]]\ntrials = 3", "design"), ("[[precision]]", "precision")],
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

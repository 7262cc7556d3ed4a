"""Configs that are right: what they mean, and that equal meaning has an equal digest.

The entries `route`, `keep` and `most_samples` of a config.

The section ``[precision]``: its meaning, its faults, and its effect on a run's name.

Shipped configs are found by name from any folder, in a checkout and in an installed package.
"""

import json
import math
import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

import study
from study.simulation.experiment.conditions import Constant
from study.simulation.experiment.config import (
    MEASURES,
    Precision,
    Study,
    config_file,
    load,
    parse,
    read,
    shipped_config,
    shipped_configs,
    summary_line,
)
from study.simulation.experiment.sampling import units
from study.simulation.runs import schemas
from study.toml import ConfigError

OTHERS = {"coverage.toml", "readings.toml"}  # configs of another kind, which have their own reader

CONFIGS = sorted(p for p in (Path(__file__).parents[3] / "configs").glob("*.toml") if p.name not in OTHERS)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_shipped_configs_parse(path):
    """Every config in configs/ is a study, named like its file."""
    study, text = read(path)
    assert study.name == path.stem
    assert study == load(path) == parse(text)


def test_there_are_configs():
    """The test above has something to test."""
    assert {"paper.toml", "sweep.toml", "smoke.toml"} <= {path.name for path in CONFIGS}


def test_defaults(make_study):
    """By default a study is three-dimensional, isotropic, of radius 1 about the origin, and shares draws."""
    study = make_study({"dimension": None})
    design = study.design
    assert (study.dimension, study.noise_shape, study.keep_points) == (3, None, 0)
    assert (design.radius, design.center, design.draws) == ((1.0,), (0.0,), "shared")


def test_ranges_include_both_ends(make_study):
    """Linspace and logspace give numpy's values, both ends among them, to 12 digits."""
    design = make_study(angle={"linspace": [0.1, 0.7, 7]}, noise={"logspace": [1e-6, 10.0, 8]}).design
    np.testing.assert_allclose(design.angle, np.linspace(0.1, 0.7, 7), rtol=1e-12)
    np.testing.assert_allclose(design.noise, 10.0 ** np.linspace(-6, 1, 8), rtol=1e-11)
    assert (design.angle[0], design.angle[-1], design.noise[0], design.noise[-1]) == (0.1, 0.7, 1e-6, 10.0)


def test_sample_ranges_are_rounded_and_each_number_occurs_once(make_study):
    """A range of N gives whole numbers without repetitions, in order."""
    assert make_study(samples={"logspace": [4, 8, 20]}).design.samples == (4, 5, 6, 7, 8)
    assert make_study(samples={"logspace": [10, 100_000, 5]}).design.samples == (10, 100, 1000, 10_000, 100_000)


def test_study_is_frozen(make_study):
    """A config cannot be changed once it is read."""
    with pytest.raises(ValueError, match="frozen"):
        make_study().seed = 2


BASE = """name = "test"
seed = 1
estimators = ["lls"]
[design]
kind = "grid"
trials = 2
samples = [10, 20, 30]
noise = [0.1, 0.2, 0.3]
angle = 90
"""

RANDOM = BASE.replace("grid", "random").replace("[10, 20, 30]", "10").replace("[0.1, 0.2, 0.3]", "0.1")


@pytest.mark.parametrize(
    "change",
    [
        ("[10, 20, 30]", "{ linspace = [10, 30, 3] }"),
        ("[10, 20, 30]", "[10.0, 2e1, 3_0]"),
        ("[0.1, 0.2, 0.3]", "{ linspace = [0.1, 0.3, 3] }"),
        ("[0.1, 0.2, 0.3]", "[\n  1e-1, # one\n  2e-1,\n  3e-1,\n]"),
        ("angle = 90", "angle = [90.0]"),
        ("angle = 90", "angle = { linspace = [90, 90, 1] }"),
        ("angle = 90", "radius = 1\ncenter = 0\ndraws = 'shared'\nangle = 90"),
        ("angle = 90", "center = -0.0\nangle = 90"),
        ("seed = 1\nestimators", "keep_points = 0\ndimension = 3\nseed = 1\nestimators"),
        ('name = "test"\nseed = 1\n', 'seed = 1\nname = "test"  # another order\n\n'),
        ("kind", "# a comment\nkind"),
    ],
    ids=lambda change: change[1].replace("\n", " "),
)
def test_equal_meaning_equal_digest(change):
    """Spelling, order, comments and defaults do not count."""
    assert change[0] in BASE
    assert parse(BASE.replace(*change)).digest() == parse(BASE).digest()


def test_powers_of_ten_as_list_or_logspace(make_study):
    """A logspace over decades is the list of its powers of ten, to the bit."""
    listed = [float(f"1e{k}") for k in range(-13, 15)]
    assert make_study(noise=listed).digest() == make_study(noise={"logspace": [1e-13, 1e14, 28]}).digest()


def test_constant_law_in_words_or_as_a_number():
    """In a random design, a number and the constant law are the same config."""
    spelled = RANDOM.replace("noise = 0.1", 'noise = { law = "constant", value = 0.1 }')
    assert parse(spelled).digest() == parse(RANDOM).digest()
    assert parse(RANDOM).design.noise == Constant(law="constant", value=0.1)


@pytest.mark.parametrize(
    "change",
    [
        ('"test"', '"other"'),
        ("seed = 1", "seed = 2"),
        ("trials = 2", "trials = 3"),
        ('["lls"]', '["lls", "mle"]'),
        ("[10, 20, 30]", "[10, 20]"),
        ("0.3]", "0.30000000000000004]"),
        ("noise", "noise_over_radius"),
        ("angle = 90", "angle = 91"),
        ("angle = 90", "angle = 90\nradius = 2"),
        ("angle = 90", "angle = 90\ncenter = 2"),
        ("angle = 90", 'angle = 90\ndraws = "independent"'),
        ("seed = 1\n", "seed = 1\nkeep_points = 1\n"),
        ("seed = 1\n", "seed = 1\ndimension = 2\n"),
        ("seed = 1\n", "seed = 1\nnoise_shape = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]\n"),
    ],
    ids=lambda change: change[1].strip().replace("\n", " "),
)
def test_other_meaning_other_digest(change):
    """A change of any number of the run, down to the last bit, changes the digest."""
    assert parse(BASE.replace(*change)).digest() != parse(BASE).digest()


def test_run_name_is_a_plain_folder_name():
    """A run's folder is the name, a dash and ten hexadecimal digits."""
    name, digest = parse(BASE).run_name().rsplit("-", 1)
    assert name == "test"
    assert len(digest) == 10
    int(digest, 16)


def test_config_survives_its_own_canonical_form():
    """The canonical JSON, which goes into the tables' metadata, is read back as the same study."""
    for text in (BASE, RANDOM):
        study = parse(text)
        assert Study.model_validate_json(study.model_dump_json()) == study


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
            for batch in unit.parts(0):
                found[batch.group.samples] += batch.trials
        assert found == expected


GRID_PRECISION_CONFIG = """name = "test"
seed = 1
estimators = ["mle", "ugdk"]
[design]
kind = "grid"
trials = 4000
samples = [5, 20]
noise = [0.1, 0.2]
angle = 60
"""

RANDOM_PRECISION_CONFIG = """name = "test"
seed = 1
estimators = ["mle", "ugdk"]
[design]
kind = "random"
trials = 4000
samples = 20
noise = 0.1
angle = { law = "uniform", low = 0, high = 180 }
"""

FIRST = GRID_PRECISION_CONFIG.count("\n") + 2
"""The line after [precision]'s own."""


def with_section(*lines, text=GRID_PRECISION_CONFIG):
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
    assert parse(GRID_PRECISION_CONFIG).precision is None


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
    (said,) = faults(with_section("target = 0.1", text=RANDOM_PRECISION_CONFIG))
    assert 'precision: a random design has one trial in a cell: design.kind = "grid"' in said


def test_a_summary_alone():
    """Decisions need the errors."""
    (said,) = faults(
        with_section("target = 0.1", text=GRID_PRECISION_CONFIG.replace("seed = 1", 'seed = 1\nkeep = "summary"'))
    )
    assert 'precision: needs the errors, which keep = "summary" does not store' in said


def test_what_names_a_run():
    """Every entry but the budget changes a run's name; a config without the section keeps its name."""
    plain = parse(with_section("target = 0.1"))
    for line in ("measure = 'far_all'", "estimators = ['mle']", "first = 500", "target = 0.2"):
        lines = [line] if line.startswith("target") else ["target = 0.1", line]
        assert parse(with_section(*lines)).digest() != plain.digest(), line
    assert parse(with_section("target = 0.1", "seconds = 3.5")).digest() == plain.digest()
    assert "precision" not in parse(GRID_PRECISION_CONFIG).canonical()
    assert plain.stem() == parse(GRID_PRECISION_CONFIG).stem()
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


ROOT = Path(study.__file__).parents[1]


def test_all_are_found(monkeypatch, tmp_path):
    """Every config has its name, from whatever folder; the file is readable."""
    monkeypatch.chdir(tmp_path)
    found = shipped_configs()
    assert "paper" in found
    assert list(found) == sorted(found)
    for name, path in found.items():
        if path.name not in OTHERS:
            assert load(path).name == name
        assert name == path.stem
        assert shipped_config(name) == path


def test_those_of_an_installed_package(monkeypatch, tmp_path):
    """Configs inside the package come before a folder beside it, which may be anybody's."""
    package = tmp_path / "study"
    for folder, name in ((package / "configs", "inside"), (tmp_path / "configs", "beside")):
        folder.mkdir(parents=True)
        (folder / f"{name}.toml").write_text("")
    monkeypatch.setattr(resources, "files", lambda name: package)
    assert list(shipped_configs()) == ["inside"]
    (package / "configs" / "inside.toml").unlink()
    (package / "configs").rmdir()
    assert list(shipped_configs()) == ["beside"]
    (tmp_path / "configs" / "beside.toml").unlink()
    (tmp_path / "configs").rmdir()
    assert shipped_configs() == {}


def test_the_file_that_is_meant(monkeypatch, tmp_path):
    """A file is itself, also one without a suffix; a name with a suffix is a file, whether there or not."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper").write_text("")
    assert config_file(Path("paper")) == Path("paper")
    (tmp_path / "paper").unlink()
    assert config_file(Path("paper")) == shipped_config("paper")
    assert config_file(Path("paper.toml")) == Path("paper.toml")


@pytest.mark.parametrize("name", ["papre", "configs/paper"])
def test_a_wrong_name(name):
    """It is answered with the nearest name and the list."""
    words = f"{name}: neither a file nor a shipped config; did you mean 'paper'? Known are anisotropic, bias, "
    with pytest.raises(ConfigError, match=re.escape(words)):
        shipped_config(name)
    with pytest.raises(ConfigError, match="known are anisotropic, bias, "):
        shipped_config("zzz")


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.toml")), ids=lambda path: path.stem)
def test_each_begins_with_its_summary(path):
    """The first line is a comment of one sentence."""
    line = summary_line(path)
    assert line.endswith(".")
    assert 20 < len(line) < 100
    assert ". " not in line


def test_no_summary(tmp_path):
    """A config without a comment has none."""
    path = tmp_path / "plain.toml"
    path.write_text('name = "plain"\n')
    assert summary_line(path) == ""
